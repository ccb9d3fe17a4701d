(() => {
  "use strict";
  const themes = JSON.parse(document.getElementById("themes").textContent);
  const root = document.documentElement;
  const wide = window.matchMedia("(prefers-color-scheme: dark)");
  const drawn = new Set();
  let ground = wide.matches ? "dark" : "light";

  function coloured(layout) {
    const theme = themes[ground];
    const changed = { paper_bgcolor: theme.paper_bgcolor, plot_bgcolor: theme.plot_bgcolor, "font.color": theme.font.color };
    for (const key of Object.keys(layout)) {
      if (/^[xy]axis\d*$/.test(key)) {
        changed[key + ".gridcolor"] = theme.xaxis.gridcolor;
        changed[key + ".linecolor"] = theme.xaxis.linecolor;
      }
    }
    return changed;
  }

  function draw(figure) {
    if (drawn.has(figure)) return Promise.resolve();
    drawn.add(figure);
    const source = figure.querySelector("script");
    const { data, layout } = JSON.parse(source.textContent);
    layout.autosize = true;
    delete layout.width;
    // Titles are broken for telephones.
    if (figure.clientWidth > 640) layout.title.text = layout.title.text.replace(/<br>/g, " ");
    source.remove();
    return Plotly.newPlot(figure, data, layout, { responsive: true, displaylogo: false })
      .then(() => Plotly.relayout(figure, coloured(layout)));
  }

  function paint() {
    root.dataset.ground = ground;
    for (const figure of drawn) Plotly.relayout(figure, coloured(figure.layout));
  }

  async function unpack() {
    const packed = document.getElementById("library");
    const bytes = Uint8Array.from(atob(packed.textContent), (c) => c.charCodeAt(0));
    packed.remove();
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const code = document.createElement("script");
    code.textContent = await new Response(stream).text();
    document.head.appendChild(code);
  }

  const figures = Array.from(document.querySelectorAll("figure.plot"));
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) { seen.unobserve(entry.target); draw(entry.target); }
  }, { rootMargin: "600px" });
  figures.forEach((figure) => {
    const { layout } = JSON.parse(figure.querySelector("script").textContent);
    figure.style.minHeight = (layout.height || 380) + "px";
    figure.setAttribute("aria-label", layout.title.text);
  });
  unpack().then(
    () => figures.forEach((figure) => seen.observe(figure)),
    () => { document.getElementById("no-figures").hidden = false; },
  );
  document.getElementById("ground").addEventListener("click", () => {
    ground = ground === "dark" ? "light" : "dark";
    paint();
  });
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((fold) => { fold.open = true; });
    ground = "light"; figures.forEach(draw); paint();
  });
  root.dataset.ground = ground;
})();
