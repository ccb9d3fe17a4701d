// The four steps: what each asks for, and its one filled button.

import { digits } from "/plots.js";
import { set, send, showHandle } from "/studio.js";

const $ = (id) => document.getElementById(id);

export function h(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (name === "text") node.textContent = value;
    else if (name === "class") node.className = value;
    else if (name.startsWith("on") || name in node && typeof value === "boolean") node[name] = value;
    else if (name === "value") node.value = value;
    else if (value !== null) node.setAttribute(name, value);
  }
  if (tag === "button") node.type = "button";
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

// What was typed survives a new drawing of the panel.
const typed = {
  criterion: "prediction", period_s: 10, harmonics: "", budget_s: 15, seed: 0, target: "sim", repeat: 3,
  slow: false, word: "", record: "", validate: "", preset: "best", kind: "box", to: "urdf", estimate: "",
};
const files = {};

function field(label, name, { after, ...props } = {}) {
  const input = h("input", { ...props, id: `f-${name}`, value: typed[name] });
  if (props.type === "checkbox") input.checked = typed[name];
  input.addEventListener("input", () => {
    typed[name] = props.type === "checkbox" ? input.checked : props.type === "number" ? input.valueAsNumber : input.value;
    if (after) after();
  });
  return h("label", { class: props.type === "checkbox" ? "check" : "" }, label, input);
}
function pick(label, name, options, onchange) {
  if (!options.some(([value]) => value === typed[name])) typed[name] = options.length ? options[0][0] : "";
  const box = h("select", { id: `f-${name}` }, ...options.map(([value, text]) => h("option", { value, text, selected: value === typed[name] })));
  box.addEventListener("change", () => {
    typed[name] = box.value;
    if (onchange) onchange(box.value);
  });
  return h("label", {}, label, box);
}
// A free name is offered until another one is typed.
function fileField(app, kind) {
  const free = app.state.files[kind];
  if (!files[kind] || !files[kind].own) files[kind] = { name: free, own: false };
  const input = h("input", { id: `f-file-${kind}`, value: files[kind].name });
  input.addEventListener("input", () => (files[kind] = { name: input.value, own: input.value !== free }));
  return h("label", {}, "File", input);
}
function takeName(kind) {
  const name = files[kind].name;
  // Where the job is refused nothing is drawn anew, and the button has to work again.
  files[kind] = { name, own: false };
  return name;
}

// A region is drawn anew only where what it shows has changed, so that hands are not disturbed.
const regions = new Map();
function region(key, facts, make) {
  const now = JSON.stringify(facts), kept = regions.get(key);
  if (kept && kept.facts === now) return kept.node;
  const focus = kept && kept.node.contains(document.activeElement) ? document.activeElement.id : "";
  const node = make();
  if (kept && kept.node.isConnected) kept.node.replaceWith(node);
  regions.set(key, { facts: now, node });
  if (focus && $(focus)) $(focus).focus();
  return node;
}
function fill(app, ...nodes) {
  const content = $("content"), wanted = nodes.filter(Boolean);
  if (wanted.length !== content.children.length || wanted.some((n, k) => content.children[k] !== n)) {
    const focus = content.contains(document.activeElement) ? document.activeElement.id : "";
    content.replaceChildren(...wanted);
    if (focus && $(focus)) $(focus).focus();
  }
  $("panel").setAttribute("aria-label", steps[app.step].title);
}

function motionPicker(app, wanted, label, chosen) {
  const names = app.state.motions.filter(wanted).map((m) => m.name);
  return region(`motion-${app.step}`, [names, chosen, app.step], () => {
    const options = [["", "none"], ...names.map((name) => [name, name])];
    typed.motion = names.includes(chosen) ? chosen : "";
    return h("section", {}, pick(label, "motion", options, (name) => app.do("choose", { name })));
  });
}

function marginList(app) {
  const verdict = app.state.verdict, whole = verdict && !app.pose && !app.live ? verdict.margins : [];
  const shown = verdict && !app.pose ? verdict : null;
  const rows = whole.length || (app.live && verdict) ? verdict.margins : app.margins;
  const facts = [shown && [shown.level, shown.words, shown.unjudged, shown.notes], rows, Boolean(shown)];
  const node = region("margins", facts, () => h("section", {},
    h("h3", { text: "Margins" }),
    h("p", { class: "hint", text: shown ? "Share of the limit used. Bar: most in the motion; tick: now." : "Share of the limit used now." }),
    shown ? h("p", { class: `verdict ${shown.level}`, text: shown.words }) : null,
    ...(shown ? [...new Set(shown.unjudged)].map((text) => h("p", { class: "hint warn", text: `Unjudged: ${text}` })) : []),
    rows.length ? h("div", { class: "margins" }, ...sorted(rows).map(margin)) : h("p", { class: "hint", text: "No limit is checked." }),
    shown && shown.notes.length ? h("details", {}, h("summary", { text: "Assumptions" }), ...shown.notes.map((text) => h("p", { class: "hint", text }))) : null));
  for (const one of app.margins) {
    const tick = node.querySelector(`[data-kind="${one.kind}"] u`);
    if (tick) {
      tick.hidden = !shown;
      tick.style.left = `${100 * Math.min(one.used, 1)}%`;
    }
  }
  return node;
}
const sorted = (rows) => [...rows].sort((a, b) => b.used / b.allowed - a.used / a.allowed);
function margin(one) {
  const words = one.distance ? `keeps ${digits(one.value)}, needs ${digits(one.limit)} mm` : `${digits(one.value)} of ${digits(one.limit)} ${one.unit}`;
  const bar = h("i", { class: one.level });
  bar.style.width = `${100 * Math.min(Math.max(one.used, 0), 1)}%`;
  return h("div", { class: "margin", "data-kind": one.kind },
    h("div", {}, h("span", { text: one.name }), h("b", { class: one.level === "good" ? "" : one.level, text: one.used > 5 ? "broken" : `${Math.round(100 * one.used)} %` })),
    h("div", { class: "track" }, bar, h("u", { hidden: true })),
    h("div", { class: "hint" }, h("span", { text: one.what }), h("span", { text: words })));
}

// Progress of the job, and the words that it ended with.
function jobView(app, kinds) {
  // A log may be dropped in any step: that it cannot be read is shown in all of them.
  const job = app.state.job;
  const own = job && (kinds.includes(job.kind) || (job.kind === "import" && (!job.ended || job.level === "bad")));
  const words = app.words || (own && job.ended ? { text: job.words, level: job.level } : null);
  const facts = [words, own && !job.ended && [job.kind, job.ask, job.stopping], app.step, fresh(app, app.step)];
  const shown = $("job");
  const node = region("job", facts, () => {
    const box = h("div", { id: "job", "aria-live": "polite" });
    if (own && !job.ended) {
      box.append(h("p"), h("progress", { max: 1, "aria-label": "Progress" }));
      if (job.ask) {
        typed.word = "";
        box.append(h("p", { class: "warn ask", text: job.ask }), field(`Type ${job.word}`, "word", { autocomplete: "off", spellcheck: "false", after: () => app.render() }));
      } else if (job.kind === "design") box.append(h("button", { class: "quiet wide", text: "Stop, keep the best", onclick: () => app.do("stop") }));
    } else if (words && words.text) box.append(h("p", { class: words.level, text: words.text }));
    const again = { design: "Search again", run: "Run again" }[app.step];
    if (again && fresh(app, app.step)) box.append(h("button", { class: "quiet wide", text: again, onclick: () => steps[app.step].begin(app) }));
    return box;
  });
  if (!node.isConnected) $("job").replaceWith(node);
  // What is asked for may lie below what a small window shows.
  if (node !== shown && $("f-word")) {
    $("f-word").focus({ preventScroll: true });
    $("f-word").scrollIntoView({ block: "center" });
  }
  if (own && !job.ended) {
    const what = job.stopping && !job.over ? "stopping" : job.what;
    set(node.children[0], app.cut ? `last known: ${what}` : what);
    node.children[1].value = job.share;
  }
}
function primary(text, enabled = true) {
  const button = $("primary");
  set(button, text);
  button.disabled = !enabled;
}
// Whether what the last job has made is shown: then the next step is the thing to do.
function fresh(app, kind) {
  const job = app.state.job;
  return job && job.kind === kind && job.ended && job.level === "good" && job.made === app.state.motion;
}
const busy = (app) => Boolean(app.state.job && !app.state.job.ended);
const running = (app, kind) => busy(app) && app.state.job.kind === kind;
const waits = (app) => (app.cut ? "No connection" : app.state.job.over ? "The result is opened" : app.state.job.ask ? "Waiting for confirmation in Run" : { run: "The robot runs", design: "Searching", identify: "Identifying", import: "Reading a log" }[app.state.job.kind]);

function sceneEditor(app) {
  const { shapes } = app.scene, shape = shapes.find((one) => one.number === app.chosen);
  const select = (number) => {
    app.chosen = app.chosen === number ? null : number;
    showHandle();
    app.render();
  };
  const box = region("scene-open", 0, () => h("details", { id: "scene" }, h("summary"), h("div")));
  set(box.children[0], shapes.length ? `Scene (${shapes.length} shape${shapes.length === 1 ? "" : "s"})` : "Scene");
  const inner = region("scene", [shapes.map((s) => [s.number, s.label]), app.chosen, app.state.scene.error, app.state.scene.file], () => h("div", {},
    shapes.length ? null : h("p", { class: "hint", text: "The scene has only the floor. Add the surroundings of the arm." }),
    ...shapes.map((one) => h("button", { id: `shape-${one.number}`, class: "shape", text: one.label, "aria-pressed": String(one.number === app.chosen), onclick: () => select(one.number) })),
    h("div", { class: "pair" }, h("select", { id: "f-kind", "aria-label": "New shape", onchange: (e) => (typed.kind = e.target.value) },
      ...app.state.scene.kinds.map((kind) => h("option", { value: kind, text: kind, selected: kind === typed.kind }))),
      h("button", { id: "f-add", class: "quiet", text: "Add", onclick: async () => {
        const made = await app.do("add", { kind: typed.kind });
        if (made) {
          app.chosen = made.number;
          showHandle();
          app.render();
        }
      } })),
    shape ? h("div", { id: "shape" }) : null,
    app.state.scene.error ? h("p", { class: "bad", text: app.state.scene.error }) : null,
    shapes.length ? h("div", { class: "pair" }, h("input", { id: "f-scene", "aria-label": "Scene file", value: app.state.scene.file }),
      h("button", { id: "f-save", class: "quiet", text: "Save", onclick: () => app.do("save", { file: $("f-scene").value }) })) : null));
  if (inner !== box.children[1]) box.children[1].replaceWith(inner);
  const place = inner.querySelector("#shape");
  if (place && shape && !place.contains(document.activeElement)) place.replaceChildren(...shapeFields(app, shape));
  return box;
}
function shapeFields(app, shape) {
  const number = (label, value, step, change) => {
    const input = h("input", { type: "number", step, value });
    input.addEventListener("change", () => Number.isFinite(input.valueAsNumber) && change(input.valueAsNumber));
    return h("label", {}, label, input);
  };
  const triple = (key, labels, step) => h("div", { class: "three" }, ...labels.map((label, k) =>
    number(label, shape[key][k], step, async (value) => {
      const before = shape[key][k];
      shape[key][k] = value;
      if (!(await app.do("place", { number: shape.number, [key]: shape[key] }))) shape[key][k] = before;
    })));
  const turns = !["floor", "sphere"].includes(shape.kind);
  return [
    triple("position", ["x [m]", "y [m]", "z [m]"], 0.01),
    turns ? triple("rpy_deg", ["Roll [°]", "Pitch [°]", "Yaw [°]"], 5) : "",
    ...Object.entries(shape.sizes).map(([name, value]) => number(`${name[0].toUpperCase()}${name.slice(1)} [m]`, value, 0.01, (x) => app.do("resize", { number: shape.number, name, value: x }))),
    h("button", { class: "quiet wide", text: "Remove", onclick: () => app.do("remove", { number: shape.number }) }),
  ];
}

function poseEditor(app) {
  const box = region("pose", [app.robot.joints, app.state.opened], () => h("details", { id: "pose" }, h("summary", { text: "Manual pose" }),
    ...app.robot.joints.map((name, k) => {
      const input = h("input", { type: "range", min: app.robot.lower[k], max: app.robot.upper[k], step: 0.01 });
      input.addEventListener("input", () => app.showPose(app.poseNow().map((q, j) => (j === k ? input.valueAsNumber : q))));
      return h("label", {}, `${name} [${app.robot.prismatic[k] ? "m" : "rad"}]`, input);
    }),
    h("button", { class: "quiet wide", text: "Back to the motion", onclick: () => app.showPose(null) })));
  const shown = app.poseNow();
  if (!app.pose) box.querySelectorAll("input").forEach((input, k) => (input.value = shown[k]));
  return box;
}
function notes(app) {
  return app.robot.notes.length ? region("notes", app.robot.notes, () => h("details", {}, h("summary", { text: `Not shown (${app.robot.notes.length})` }), ...app.robot.notes.map((text) => h("p", { class: "hint", text })))) : null;
}
function dropHint(app) {
  return region("drop", 0, () => {
    const file = h("input", { type: "file", id: "f-drop", "aria-label": "Open a file", hidden: true, onchange: () => [...file.files].forEach(send) });
    return h("section", {}, h("p", { class: "hint", text: "Drop a log, a URDF, a design or a scene anywhere on this page." }), file,
      h("button", { class: "quiet wide", text: "Open a file", onclick: () => file.click() }));
  });
}

const design = {
  title: "Design",
  render(app) {
    const form = region("design", [app.state.criteria, app.state.files.design], () => h("section", {},
      h("h3", { text: "A motion that excites the arm" }),
      pick("Criterion", "criterion", app.state.criteria.map((name) => [name, name])),
      field("Period [s]", "period_s", { type: "number", min: 1, max: 600, step: 0.5 }),
      field("Search time [s]", "budget_s", { type: "number", min: 1, max: 3600, step: 1 }),
      h("details", {}, h("summary", { text: "More" }),
        field("Harmonics", "harmonics", { type: "number", min: 2, max: 20, step: 1, placeholder: "up to 1 Hz" }),
        field("Seed", "seed", { type: "number", min: 0, step: 1 }), fileField(app, "design"))));
    const has = app.state.motions.some((m) => m.design);
    fill(app, has ? motionPicker(app, () => true, "Shown", app.state.motion) : null, form, sceneEditor(app), marginList(app), poseEditor(app), dropHint(app), notes(app));
    jobView(app, ["design"]);
    this.next = fresh(app, "design");
    primary(this.next ? "Continue to the run" : busy(app) ? waits(app) : "Design a motion", !busy(app));
  },
  act(app) {
    return this.next ? app.go("run") : this.begin(app);
  },
  begin(app) {
    const { criterion, period_s, harmonics, budget_s, seed } = typed;
    const asked = Number.isFinite(harmonics) ? harmonics : null;
    return app.do("design", { criterion, period_s, harmonics: asked, budget_s, seed, file: takeName("design") });
  },
};

const run = {
  title: "Run",
  render(app) {
    const form = region("run", [app.state.files.run], () => h("section", {},
      field("Robot", "target", { autocomplete: "off", spellcheck: "false", after: () => app.render() }),
      h("p", { class: "hint", text: "sim, or ur://HOST for a real robot" }),
      field("Periods", "repeat", { type: "number", min: 1, max: 1000, step: 1 }),
      field("Slow first pass (20 %)", "slow", { type: "checkbox" }), fileField(app, "run")));
    fill(app, motionPicker(app, (m) => m.design, "Design", app.state.design), form, marginList(app));
    jobView(app, ["run"]);
    const job = app.state.job, asks = running(app, "run") && job.ask;
    this.next = fresh(app, "run");
    if (asks) primary("Move the robot", typed.word.trim() === job.word);
    else if (busy(app)) primary(waits(app), false);
    else if (this.next) primary("Continue to identify");
    else if (!app.state.design) primary(app.state.motions.some((m) => m.design) ? "Choose a design" : "Make a design first", false);
    else primary(typed.target.trim() === "sim" ? "Run the simulated robot" : `Run on ${typed.target.replace("ur://", "")}`);
  },
  act(app) {
    const job = app.state.job;
    if (running(app, "run") && job.ask) return app.do("answer", { id: job.id, word: typed.word });
    return this.next ? app.go("identify") : this.begin(app);
  },
  begin(app) {
    return app.do("run", { target: typed.target, repeat: typed.repeat, slow: typed.slow, file: takeName("run") });
  },
};

const identify = {
  title: "Identify",
  render(app) {
    const records = app.state.motions.filter((m) => !m.design).map((m) => m.name);
    if (!typed.record && records.includes(app.state.motion)) typed.record = app.state.motion;
    if (app.state.job && app.state.job.kind !== "identify" && records.includes(app.state.motion)) typed.record = app.state.motion;
    const form = region("identify", [records, typed.record, app.state.files.identify], () => h("section", {},
      h("h3", { text: "A model from a recording" }),
      records.length ? null : h("p", { class: "hint", text: "There is no recording yet: run a design, or drop a log onto this page." }),
      pick("Recording", "record", records.map((name) => [name, name]), (name) => app.do("choose", { name })),
      pick("Validate on", "validate", [["", "nothing"], ...records.map((name) => [name, name])]),
      pick("Preset", "preset", [["best", "best"], ["paper", "paper"]]), fileField(app, "identify")));
    fill(app, form, marginList(app), dropHint(app), notes(app));
    jobView(app, ["identify", "import"]);
    primary(busy(app) ? waits(app) : "Identify", records.length > 0 && !busy(app));
  },
  act(app) {
    return app.do("identify", { record: typed.record, validate: typed.validate, preset: typed.preset, file: takeName("identify") });
  },
};

const use = {
  title: "Use",
  render(app) {
    const { results, estimates } = app.state;
    // What was just identified, or dropped, is shown before what was chosen.
    if (results.length && results[0].name !== this.newest) this.newest = typed.estimate = results[0].name;
    const shown = results.find((item) => item.name === typed.estimate) || results[0];
    const list = region("results", [results, estimates, shown && shown.name], () => h("section", {},
      results.length ? pick("Estimate", "estimate", results.map((item) => [item.name, item.name]), (name) => {
        const item = results.find((one) => one.name === name);
        if (item.record) app.do("choose", { name: item.record });
        app.render();
      }) : h("p", { class: "hint", text: estimates.length ? "The estimates of this folder are not evaluated yet." : "There is no model yet: identify a recording first." }),
      ...(shown ? verdict(shown) : []),
      shown ? pick("Format", "to", [["urdf", "URDF"], ["mjcf", "MuJoCo MJCF"], ["c", "C"], ["python", "Python"], ["json", "JSON"]]) : null,
      shown ? h("button", { class: "quiet wide", text: "Write report.html", onclick: async () => {
        app.words = { text: "writing the report", level: "" };
        app.render();
        await app.do("report");
      } }) : null));
    fill(app, list, marginList(app), notes(app));
    jobView(app, []);
    this.ready = Boolean(shown);
    primary(this.ready ? "Export the model" : "Evaluate the estimates", (this.ready || estimates.length > 0) && !busy(app));
  },
  async act(app) {
    if (!this.ready) {
      primary("Judging", false);
      return app.do("results");
    }
    const made = await app.do("export", { estimate: typed.estimate, to: typed.to });
    app.made.use ||= Boolean(made);
    app.render();
  },
};
function verdict(item) {
  const number = (x) => (x === null ? "–" : x.toPrecision(3).replaceAll("-", "−"));
  const joints = item.joints || [];
  return [
    h("p", { class: `verdict ${item.level}`, text: item.headline }),
    ...item.warnings.map((text) => h("p", { class: "hint", text })),
    joints.length ? h("table", {}, h("thead", {}, h("tr", {}, h("th", { text: "Joint" }), h("th", { text: "Error RMS" }), h("th", { text: "of torque" }))),
      h("tbody", {}, ...joints.map((j) => h("tr", {}, h("td", { text: j.name }), h("td", { text: `${number(j.error)} ${j.unit}` }), h("td", { text: j.torque ? `${(100 * j.error / j.torque).toFixed(1)} %` : "–" }))))) : "",
    joints.length ? h("p", { class: "hint", text: `Predicted: ${item.basis}.` }) : "",
    h("details", {}, h("summary", { text: `Parameters (${item.parameters.length})` }), h("table", {}, h("tbody", {}, ...item.parameters.map((p) =>
      h("tr", {}, h("td", { text: p.expression || p.name, title: p.name }), h("td", { text: `${number(p.value)} ± ${number(p.interval)} ${p.unit}` })))))),
  ];
}

export const steps = { design, run, identify, use };
