/* Plots with the same data-link share one cursor and one zoom. */
(() => {
  "use strict";
  const W = 20000, H = 10000, NS = "http://www.w3.org/2000/svg";
  const views = new Map(), drawn = new WeakMap();
  const all = (link) => [...document.querySelectorAll("svg.plot[data-link]")].filter((p) => p.dataset.link === link);
  const pair = (text) => text.split(",").map(Number);
  const full = (plot) => pair(plot.dataset.x);
  const view = (plot) => views.get(plot.dataset.link) || full(plot);

  function points(path) {
    if (!drawn.has(path)) {
      const xs = [], ys = [];
      let x = 0, y = 0;
      for (const [, pen, rest] of path.getAttribute("d").matchAll(/([Mlh])([^Mlh]*)/g)) {
        const n = (rest.match(/-?\d+/g) || []).map(Number);
        if (pen === "M") { [x, y] = n; xs.push(x); ys.push(y); }
        else if (pen === "l") for (let k = 0; k + 1 < n.length; k += 2) { x += n[k]; y += n[k + 1]; xs.push(x); ys.push(y); }
      }
      drawn.set(path, [xs, ys]);
    }
    return drawn.get(path);
  }

  function at(path, x) {
    const [xs, ys] = points(path);
    if (!xs.length || x < xs[0] || x > xs[xs.length - 1]) return null;
    let a = 0, b = xs.length - 1;
    while (b - a > 1) { const m = (a + b) >> 1; if (xs[m] <= x) a = m; else b = m; }
    const f = xs[b] > xs[a] ? (x - xs[a]) / (xs[b] - xs[a]) : 0;
    return ys[a] + f * (ys[b] - ys[a]);
  }

  const shown = (v, span) => v.toFixed(Math.max(0, Math.min(6, 3 - Math.ceil(Math.log10(span))))).replace("-", "\u2212");

  function readouts(plot, x) {
    const home = plot.closest("[data-row]") || plot.closest(".fig");
    if (!home) return;
    const [low, high] = pair(plot.dataset.y);
    for (const path of plot.querySelectorAll("path[data-n]")) {
      const place = home.querySelector(`[data-read="${CSS.escape(path.dataset.n)}"]`);
      if (!place) continue;
      const y = x === null ? null : at(path, x);
      place.textContent = y === null ? "\u2013" : shown(low + (1 - y / H) * (high - low), high - low);
    }
  }

  function cursor(link, value) {
    for (const plot of all(link)) {
      const [a, b] = full(plot), [low, high] = view(plot);
      let line = plot.querySelector(":scope > line.cursor");
      const inside = value !== null && value >= low && value <= high;
      if (!inside) { if (line) line.remove(); }
      else {
        if (!line) {
          line = document.createElementNS(NS, "line");
          line.setAttribute("class", "cursor");
          line.setAttribute("y1", "0"); line.setAttribute("y2", "100%");
          plot.append(line);
        }
        const share = `${(100 * (value - low)) / (high - low)}%`;
        line.setAttribute("x1", share); line.setAttribute("x2", share);
      }
      readouts(plot, inside ? ((value - a) / (b - a)) * W : null);
    }
    for (const place of document.querySelectorAll(`[data-cursor="${CSS.escape(link)}"]`)) {
      if (place.tagName === "INPUT") { if (value !== null) place.value = value; }
      else place.textContent = value === null ? "" : value.toFixed(2);
    }
  }

  function zoom(link, low, high) {
    const plots = all(link);
    if (!plots.length) return;
    const [a, b] = full(plots[0]);
    const least = (b - a) / 400;
    low = Math.max(a, low); high = Math.min(b, high);
    if (!(high - low >= least)) return;
    if (low <= a && high >= b) views.delete(link); else views.set(link, [low, high]);
    for (const plot of plots) {
      const x0 = ((low - a) / (b - a)) * W, x1 = ((high - a) / (b - a)) * W;
      plot.querySelector("svg.in").setAttribute("viewBox", `${x0} 0 ${x1 - x0} ${H}`);
      const ticks = plot.querySelector("g.xt");
      if (ticks) label(ticks, low, high);
    }
  }

  function label(group, low, high) {
    const most = group.ownerSVGElement.clientWidth < 420 ? 4 : 7;
    const raw = (high - low) / most, decade = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((s) => s * decade).find((s) => s >= raw * (1 - 1e-9));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    group.replaceChildren();
    for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++) {
      const text = document.createElementNS(NS, "text");
      text.setAttribute("x", `${(100 * (k * step - low)) / (high - low)}%`);
      text.setAttribute("y", "100%"); text.setAttribute("dy", ".35em");
      text.setAttribute("text-anchor", "middle"); text.setAttribute("font-size", "12");
      text.setAttribute("class", "ink2");
      text.textContent = (k * step).toFixed(digits).replace("-", "\u2212");
      group.append(text);
    }
  }

  const value = (plot, event) => {
    const box = plot.getBoundingClientRect(), [low, high] = view(plot);
    const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    return low + share * (high - low);
  };
  const target = (event) => event.target.closest && event.target.closest("svg.plot[data-link]");
  let drag = null;
  document.addEventListener("pointerdown", (event) => {
    const plot = target(event);
    if (plot && event.pointerType === "mouse" && event.button === 0) drag = { plot, from: value(plot, event), x: event.clientX };
    else if (plot) cursor(plot.dataset.link, value(plot, event));
  });
  document.addEventListener("pointermove", (event) => {
    const plot = drag ? drag.plot : target(event);
    if (!plot) return;
    const now = value(plot, event);
    cursor(plot.dataset.link, now);
    if (!drag || Math.abs(event.clientX - drag.x) < 6) return;
    event.preventDefault();
    for (const other of all(plot.dataset.link)) {
      const [low, high] = view(other);
      let box = other.querySelector(":scope > rect.pick");
      if (!box) { box = document.createElementNS(NS, "rect"); box.setAttribute("class", "pick"); box.setAttribute("height", "100%"); other.append(box); }
      box.setAttribute("x", `${(100 * (Math.min(now, drag.from) - low)) / (high - low)}%`);
      box.setAttribute("width", `${(100 * Math.abs(now - drag.from)) / (high - low)}%`);
    }
  });
  document.addEventListener("pointerup", (event) => {
    if (!drag) return;
    const { plot, from, x } = drag, to = value(plot, event);
    drag = null;
    document.querySelectorAll("rect.pick").forEach((box) => box.remove());
    if (Math.abs(event.clientX - x) >= 6) zoom(plot.dataset.link, Math.min(from, to), Math.max(from, to));
  });
  document.addEventListener("dblclick", (event) => {
    const plot = target(event);
    if (plot) zoom(plot.dataset.link, ...full(plot));
  });
  document.addEventListener("selectstart", (event) => { if (drag) event.preventDefault(); });
  document.addEventListener("input", (event) => {
    const link = event.target.dataset && event.target.dataset.cursor;
    if (link) cursor(link, Number(event.target.value));
  });
  document.addEventListener("click", (event) => {
    const button = event.target.closest && event.target.closest("button[data-zoom]");
    if (!button) return;
    const link = button.dataset.link, plots = all(link);
    if (!plots.length) return;
    const [a, b] = full(plots[0]), [low, high] = view(plots[0]);
    const slider = document.querySelector(`input[data-cursor="${CSS.escape(link)}"]`);
    const held = slider ? Number(slider.value) : (low + high) / 2;
    const middle = held >= low && held <= high ? held : (low + high) / 2;
    const factor = Number(button.dataset.zoom);
    if (!factor) { zoom(link, a, b); return; }
    const width = Math.min(b - a, (high - low) * factor);
    const start = Math.min(Math.max(a, middle - width / 2), b - width);
    zoom(link, start, start + width);
  });
})();
