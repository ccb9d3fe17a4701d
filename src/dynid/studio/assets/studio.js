// The page: its steps, what plays, and the news of the server.

import { View, unpack } from "/view.js";
import { Plots, between, decode } from "/plots.js";
import { steps, h } from "/panels.js";

const $ = (id) => document.getElementById(id);
const dark = matchMedia("(prefers-color-scheme: dark)");
const RUN_FRAME_MS = 120;
const CUT_MS = 2500;
const STOP_MS = 1500;
// Samples of a run that are drawn: what takes seconds to draw would hold up STOP.
const MOST_LIVE = 4000;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

export const app = {
  state: null, robot: null, scene: { changes: -1, shapes: [] }, step: null,
  motion: null, at: 0, playing: false, speed: 1, pose: null, quantity: "Torque",
  margins: [], near: [], chosen: null, live: null, made: { use: false }, words: null,
  path: true, distances: true,
  do: act, render, go, showPose, poseNow,
};
let view, plots, dirty = true, last = 0, asked = 0, frames = [], ink = {};

async function look(what, query = "") {
  return answer(await fetch(`/api/${what}${query}`));
}
async function answer(response) {
  const found = await response.json().catch(() => ({ error: "the studio has ended" }));
  if (!response.ok) throw new Error(found.error);
  return found;
}
// Ask for something; a refusal is shown beside the button. A late answer takes no words away that
// belong to what was asked after it.
let acts = 0, spoke = 0;
async function act(name, fields = {}) {
  const turn = name === "judge" ? 0 : ++acts;
  try {
    const found = await (name === "stop" ? deliverStop() : post(name, fields));
    if (name !== "judge") {
      if (turn > spoke && name !== "stop") {
        spoke = turn;
        app.words = found.words ? { text: found.words, level: "good" } : null;
      }
      await take(await look("state"));
    }
    return found;
  } catch (error) {
    if (name !== "judge" && name !== "stop") {
      spoke = Math.max(spoke, turn);
      app.words = { text: String(error.message), level: "bad" };
    }
    render();
    return null;
  }
}

async function post(name, fields) {
  return answer(await fetch(`/do/${name}`, { method: "POST", body: JSON.stringify(fields) }));
}
// Somebody relies on STOP: that it fails, or takes long, is said over all else.
async function deliverStop() {
  const late = setTimeout(alarm, STOP_MS, "STOP is not answered");
  try {
    const found = await post("stop", {});
    alarm("");
    return found;
  } catch (error) {
    alarm("STOP was not delivered");
    throw error;
  } finally {
    clearTimeout(late);
  }
}
function alarm(said) {
  set($("alarm"), said && `${said}: use the emergency stop of the robot`);
  $("alarm").hidden = !said;
  if (!said || !app.state) return;
  // What is shown is old until the server is heard again.
  app.cut = true;
  hear();
  render();
}

async function start() {
  view = new View($("picture"), $("over"));
  plots = new Plots($("curves"), $("rows"));
  app.view = view;
  view.onLook = () => (dirty = true);
  view.onDrag = drag;
  plots.onSeek = seek;
  listen();
  tint();
  take(await look("state"));
  hear();
  document.addEventListener("visibilitychange", hear);
  requestAnimationFrame(frame);
}
// A tab that nobody sees keeps no connection: a browser has six for all tabs, and STOP needs one.
let news = null, lost = 0;
function hear() {
  if (news) news.close();
  clearTimeout(lost);
  lost = 0;
  news = null;
  if (document.hidden) return;
  news = new EventSource("/news");
  news.onmessage = (event) => take(JSON.parse(event.data));
  news.onopen = () => {
    clearTimeout(lost);
    lost = 0;
    app.cut = false;
    render();
  };
  news.onerror = () => {
    // Where there are many tabs, each asks anew every second.
    lost ||= setTimeout(() => {
      app.cut = true;
      render();
    }, CUT_MS);
  };
}

let taking = Promise.resolve();
function take(state) {
  return taking = taking.then(() => follow(state)).catch((error) => {
    app.words = { text: String(error.message), level: "bad" };
    render();
  });
}
async function follow(state) {
  const old = app.state;
  // What was asked for may arrive after the news that followed it.
  if (old && old.opened === state.opened && state.version < old.version) return;
  app.state = state;
  // It has ended without that STOP; of what another studio had started, this one knows nothing.
  if (old && old.opened === state.opened && !(state.job && !state.job.ended)) alarm("");
  if (!old || old.opened !== state.opened) {
    app.robot = { ...(await look("robot")), opened: state.opened };
    view.setRobot(app.robot);
    plots.setJoints(app.robot.joints);
    app.motion = app.motionName = app.pose = null;
    document.title = "dynid studio";
  }
  if (app.scene.changes !== state.scene.changes || !old || old.opened !== state.opened) {
    app.scene = await look("scene");
    view.setScene(app.scene.shapes);
    if (!app.scene.shapes.some((s) => s.number === app.chosen)) app.chosen = null;
    showHandle();
    judge(true);
  }
  const known = `${state.motion}|${state.results.map((r) => r.name + r.record)}|${state.opened}`;
  if (known !== app.motionName) {
    const another = !app.motionName || app.motionName.split("|")[0] !== state.motion;
    const found = state.motion ? await look("curves", `?name=${encodeURIComponent(state.motion)}&opened=${state.opened}`) : null;
    // Another robot was opened meanwhile: the news of it follows.
    if (found && !found.groups) return;
    app.motionName = known;
    app.motion = found && decode(found);
    if (another) {
      app.at = 0;
      app.playing = false;
      app.pose = null;
    }
    frameArm();
  }
  followRun(state, old);
  if (!app.step || (old && old.opened !== state.opened)) app.step = first(state);
  advance(state, old);
  arrange();
  render();
  dirty = true;
  judge(true);
}

// The step of the job that is there, or the one that is next for what lies in the folder.
function first(state) {
  if (state.job && !state.job.ended) return state.job.kind === "import" ? "identify" : state.job.kind;
  if (state.estimates.length) return "use";
  if (state.motions.some((m) => !m.design)) return "identify";
  return state.motions.some((m) => m.design) ? "run" : "design";
}
// What has ended well is followed by the results of it, in the same step.
function advance(state, old) {
  const job = state.job, before = old && old.job;
  if (!job || !before || job.id !== before.id || !job.ended || before.ended) return;
  app.words = null;
  if (job.kind === "identify" && job.level !== "bad") go("use");
  if (job.kind === "import" && job.level !== "bad") go("identify");
}

function followRun(state, old) {
  const job = state.job, running = job && job.kind === "run" && !job.ended;
  if (!running) {
    if (app.live) {
      app.live = null;
      frameArm();
    }
    return;
  }
  if (!app.live || app.live.id !== job.id) {
    app.live = { id: job.id, t: [], q: [], values: {}, at: 0, samples: 0 };
    app.playing = false;
    app.pose = null;
  }
  const tail = state.tail, live = app.live;
  if (!tail || tail.samples === live.samples) return;
  live.samples = tail.samples;
  const t = unpack(tail.t), q = unpack(tail.q), n = app.robot.joints.length;
  const rows = Object.entries(tail.groups).map(([title, text]) => [title, unpack(text)]);
  const end = live.t.length ? live.t.at(-1) : -1;
  for (let k = 0; k < t.length; k++) {
    if (t[k] <= end) continue;
    live.t.push(t[k]);
    for (let j = 0; j < n; j++) live.q.push(q[k * n + j]);
    for (const [title, values] of rows) {
      const kept = (live.values[title] ??= []);
      for (let j = 0; j < n; j++) kept.push(values[k * n + j]);
    }
  }
  while (live.t.length > MOST_LIVE) {
    const last = live.t.length - 1;
    const half = (values, width) => values.filter((_, k) => (last - Math.floor(k / width)) % 2 === 0);
    for (const title in live.values) live.values[title] = half(live.values[title], n);
    live.q = half(live.q, n);
    live.t = half(live.t, 1);
  }
}

function frameArm() {
  const rows = [], n = app.robot.joints.length;
  if (app.motion) {
    const { t, q, duration } = app.motion;
    for (let k = 0; k <= 60; k++) rows.push(between(t, q, n, duration * k / 60));
  } else rows.push(poseNow());
  view.frame(rows);
  dirty = true;
}

function poseNow() {
  const n = app.robot.joints.length;
  if (app.live && app.live.t.length) return between(app.live.t, app.live.q, n, app.live.at);
  if (app.pose) return app.pose;
  if (app.motion) return between(app.motion.t, app.motion.q, n, app.at);
  return app.rest ?? app.robot.lower.map((low, k) => rest(low, app.robot.upper[k], k));
}
// A UR stands upright in the middle of its limits.
function rest(low, high, k) {
  const ur = app.robot.name.startsWith("ur") && app.robot.joints.length === 6;
  return ur && (k === 1 || k === 3) ? -Math.PI / 2 : (low + high) / 2;
}

function duration() {
  const job = app.state.job;
  if (app.live && app.motion) return app.motion.duration * (job.repeat || 1);
  return app.motion ? app.motion.duration : 1;
}

// One picture of everything that has changed.
function frame(now) {
  requestAnimationFrame(frame);
  if (!app.robot || document.hidden) return;
  const step = Math.min((now - last) / 1000, 0.25), moving = app.playing || app.live;
  if (app.live && now - last < RUN_FRAME_MS) return;
  if (!moving && !dirty) {
    last = now;
    return;
  }
  if (app.playing && app.motion) {
    app.at = (app.at + step * app.speed) % app.motion.duration;
    slow(now - last);
  }
  if (app.live && app.live.t.length) {
    // A little behind the newest sample, so that the arm moves without jumps.
    const newest = app.live.t.at(-1), behind = newest - app.live.at;
    app.live.at = Math.min(newest, app.live.at + step * Math.max(1, 1.5 * (behind - 0.4)));
  }
  last = now;
  dirty = false;
  draw();
  if (moving) judge(false);
}

// A machine that draws in software gets fewer points.
function slow(ms) {
  frames.push(ms);
  if (frames.length < 12) return;
  const mean = frames.reduce((a, b) => a + b) / frames.length;
  frames = [];
  if (mean > 60 && view.scale > 0.55) view.scale *= 0.8;
}

function draw() {
  const q = poseNow(), at = app.live ? app.live.at : app.at;
  view.poses = view.kinematics(q);
  drawPath(at);
  view.near = app.distances ? app.near : [];
  view.draw(dark.matches);
  const job = app.state.job;
  if (job && job.kind === "design" && !job.ended) plots.drawSearch(job.history, ink);
  else if (app.motion) plots.draw(at, ink);
  headline(at);
}

// Where the tool was and will be, in the world of the picture.
function drawPath(at) {
  view.paths = { past: [view.tool(poseNow())], next: [] };
  if (!app.path || !app.motion || app.pose) return;
  const n = app.robot.joints.length, { t, q, duration: whole } = app.motion;
  const place = (s) => {
    if (app.live && s <= app.live.at) return view.tool(between(app.live.t, app.live.q, n, Math.max(s, 0)));
    return view.tool(between(t, q, n, app.live ? s % whole : s));
  };
  const past = [], next = [];
  for (let k = 0; k <= 24; k++) {
    if (at - k / 24 >= 0) past.unshift(place(at - k / 24));
    if (at + k / 32 <= duration()) next.push(place(at + k / 32));
  }
  app.toolSpeed = past.length > 1 ? Math.hypot(...past.at(-1).map((x, k) => x - past.at(-2)[k])) * 24 : 0;
  view.paths = { past, next };
}

function headline(at) {
  const { state } = app, job = state.job, [big, small] = $("title").children;
  let text = app.motion ? state.motion : state.robot, more = `${at.toFixed(1)} of ${duration().toFixed(1)} s`;
  if (!app.motion) more = "no motion yet";
  else if (app.path) more += ` · tool at ${app.toolSpeed ? app.toolSpeed.toFixed(2) : "0.00"} m/s`;
  if (app.pose) [text, more] = ["Manual pose", "the motion is kept"];
  if (job && !job.ended) {
    if (job.kind === "run") {
      // Somebody may have chosen to show no motion meanwhile.
      text = app.motion && app.live && app.live.t.length
        ? `Period ${Math.min(Math.floor(at / app.motion.duration) + 1, job.repeat)} of ${job.repeat}`
        : job.ask ? "Waiting for confirmation" : job.what;
    } else [text, more] = [{ design: "Searching", identify: "Identifying", import: "Reading the log" }[job.kind], job.what];
    if (job.over) [text, more] = [`The ${job.kind} is over`, job.what];
    else if (job.stopping) text = "Stopping";
  }
  if (app.cut) [text, more] = ["No connection", `last known: ${text}`];
  set(big, text);
  set(small, more);
}
export function set(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Limits and nearest bodies now, not more often than they can be read.
let judging = false, again = false;
async function judge(force) {
  const now = performance.now(), pause = app.live ? 500 : 160;
  again ||= judging && force;
  if (judging || (!force && now - asked < pause) || !app.robot) return;
  judging = true;
  asked = now;
  const fields = app.motion && !app.pose && !app.live ? { t: app.at } : { q: poseNow() };
  fields.opened = app.robot.opened;
  if (app.live && app.live.values.Velocity) {
    fields.dq = between(app.live.t, app.live.values.Velocity, fields.q.length, app.live.at);
  }
  const found = await act("judge", fields);
  judging = false;
  // What was asked for meanwhile may be of another pose.
  if (again) {
    again = false;
    judge(true);
  }
  if (!found || !found.margins) return;
  app.margins = found.margins;
  app.near = found.near;
  if (!app.playing && !app.live) dirty = true;
  render();
}

function seek(at) {
  if (app.live || !app.motion) return;
  app.playing = false;
  app.pose = null;
  app.at = plots.at = at;
  changed();
}
function changed() {
  dirty = true;
  render();
  judge(false);
  clearTimeout(changed.later);
  changed.later = setTimeout(() => judge(true), 200);
}
function togglePlay() {
  if (!app.motion || app.live) return;
  app.playing = !app.playing;
  app.pose = null;
  last = performance.now();
  frames = [];
  changed();
}
function showPose(q) {
  app.playing = false;
  app.pose = q;
  changed();
}
function go(step) {
  app.step = step;
  app.words = null;
  render();
  $("content").scrollTop = 0;
}
function stop() {
  app.playing = false;
  // Always: what runs may be unknown here, and where nothing runs the server does nothing.
  act("stop");
  if (app.state) changed();
}

// What the curves show.
function arrange() {
  const groups = app.motion ? app.motion.groups : [];
  const group = groups.find((g) => g.title === app.quantity) || groups[0] || null;
  $("plots").hidden = !group && !(app.state.job && app.state.job.kind === "design" && !app.state.job.ended);
  if (group) {
    const job = app.state.job, period = app.live && job.repeat > 1 ? app.motion.duration : 0;
    plots.show(group, duration(), period, app.live);
  }
  app.group = group;
  dirty = true;
}

function plotHead() {
  const searching = app.state.job && app.state.job.kind === "design" && !app.state.job.ended;
  const names = app.group ? app.group.series.map((s) => s.name) : [];
  const key = JSON.stringify([app.playing, Boolean(app.live), app.motion && app.motionName, app.group && app.group.title, names, searching, app.speed]);
  if (key === plotHead.key) return;
  plotHead.key = key;
  $("rows").hidden = Boolean(searching);
  if (searching || !app.group) return $("plothead").replaceChildren(h("h3", { text: searching ? "Search" : "" }));
  const titles = app.motion.groups.map((g) => g.title);
  if (app.live && !names.includes("measured")) names.unshift("measured");
  const focus = document.activeElement && document.activeElement.id;
  $("plothead").replaceChildren(
    h("button", { id: "play", class: "quiet play", text: app.playing ? "Pause" : "Play", disabled: Boolean(app.live), onclick: togglePlay }),
    h("select", { id: "speed", "aria-label": "Speed", onchange: (e) => (app.speed = Number(e.target.value)) },
      ...SPEEDS.map((s) => h("option", { value: s, text: `${s} ×`, selected: s === app.speed }))),
    h("select", { id: "quantity", "aria-label": "Quantity", onchange: (e) => {
      app.quantity = e.target.value;
      arrange();
      render();
    } }, ...titles.map((t) => h("option", { value: t, text: `${t} [${app.motion.groups.find((g) => g.title === t).unit}]`, selected: t === app.group.title }))),
    h("div", { id: "legend" },
      ...names.map((name) => h("span", {}, h("i", { class: name }), name)),
      app.live && app.state.job.repeat > 1 ? h("span", {}, h("i", { class: "turn" }), "new period") : ""),
  );
  if (focus && $(focus)) $(focus).focus();
}

function render() {
  const { state } = app;
  if (!state || !app.robot || !app.step) return;
  const job = state.job, busy = Boolean(job && !job.ended);
  set($("robot"), app.robot.name.toUpperCase());
  const link = $("link");
  link.className = app.cut ? "cut" : busy ? "busy" : "";
  set(link.children[1], app.cut ? "Cut off" : busy && job.over ? "Finishing" : busy ? { run: "Running", design: "Searching", identify: "Identifying", import: "Reading" }[job.kind] : "Connected");
  set(link.lastElementChild, app.cut ? "what is shown is old" : busy && job.kind === "run" ? `${app.live ? app.live.samples : 0} samples` : `${state.folder}`);
  $("stop").classList.toggle("moving", busy && job.kind === "run" && !job.over);
  $("stop").setAttribute("aria-label", busy || app.cut ? "STOP" : "STOP, nothing runs");
  renderSteps(state);
  renderTools();
  plotHead();
  steps[app.step].render(app);
  dirty = true;
}

function renderSteps(state) {
  const done = {
    design: state.motions.some((m) => m.design), run: state.motions.some((m) => !m.design),
    identify: state.estimates.length > 0, use: app.made.use,
  };
  const key = JSON.stringify([done, app.step]);
  if (key === renderSteps.key) return;
  renderSteps.key = key;
  const focused = $("steps").contains(document.activeElement);
  $("steps").replaceChildren(...Object.entries(steps).map(([name, step], k) => h("li", {},
    h("button", {
      class: done[name] && name !== app.step ? "done" : "", "aria-current": name === app.step ? "step" : null,
      onclick: () => go(name),
    }, h("i", { text: done[name] && name !== app.step ? "✓" : String(k + 1), "aria-hidden": "true" }), step.title))));
  if (focused) $("steps").querySelector("[aria-current]").focus();
}

function renderTools() {
  const tools = $("tools");
  if (!tools.children.length)
    tools.append(
      ...[["path", "Path"], ["distances", "Distances"], ["bodies", "Bodies"]].map(([key, text]) =>
        h("button", { text, "data-key": key, onclick: () => {
          if (key === "bodies") view.showBodies = !view.showBodies;
          else app[key] = !app[key];
          render();
        } })),
      h("button", { text: "Reset view", onclick: () => view.reset() }));
  for (const button of tools.querySelectorAll("[data-key]")) {
    const key = button.dataset.key;
    button.setAttribute("aria-pressed", String(key === "bodies" ? view.showBodies : app[key]));
  }
  const key = `${app.path && Boolean(app.motion)}|${app.distances && app.near.length > 0}`;
  if (key !== renderTools.key) {
    renderTools.key = key;
    $("key").replaceChildren(
      ...(app.path && app.motion ? [h("span", {}, h("i"), "tool, last 1 s"), h("span", {}, h("i", { class: "next" }), "next 0.8 s")] : []),
      ...(app.distances && app.near.length ? [h("span", {}, h("i", { class: "near" }), "nearest bodies")] : []),
      h("span", { text: `grid ${+view.cell.toFixed(2)} m` }));
  }
}

// The chosen shape has arrows to drag it by.
export function showHandle() {
  const shape = app.scene.shapes.find((s) => s.number === app.chosen);
  // News of an earlier place take no shape away from who drags it.
  const held = placing && view.handle && view.chosen === app.chosen;
  view.chosen = app.chosen;
  view.handle = shape ? { position: held ? view.handle.position : shape.position, axes: shape.kind === "floor" ? [2] : [0, 1, 2] } : null;
  dirty = true;
}
let placing = false, wanted = null;
async function drag(position) {
  if (!view.handle) return;
  view.handle.position = position.map((x) => Math.round(1000 * x) / 1000);
  wanted = { number: app.chosen, position: view.handle.position };
  dirty = true;
  if (placing) return;
  placing = true;
  // One after the other, the last of them for certain.
  while (wanted) {
    const place = wanted;
    wanted = null;
    await act("place", place);
  }
  placing = false;
  showHandle();
}

function listen() {
  addEventListener("keydown", (e) => {
    if (e.key === "Escape") return stop();
    const typing = /INPUT|SELECT/.test(e.target.tagName), pressing = /BUTTON|SUMMARY/.test(e.target.tagName);
    if (typing || !app.step || e.ctrlKey || e.metaKey || e.altKey) return;
    if (e.key === " " && pressing) return;
    if (e.key === " ") togglePlay();
    else if ("1234".includes(e.key)) go(Object.keys(steps)[Number(e.key) - 1]);
    else return;
    e.preventDefault();
  });
  // When it is pressed, not when it is let go; keys press it by a click alone.
  for (const press of ["pointerdown", "click"]) $("stop").addEventListener(press, stop);
  let pressed = false;
  $("primary").addEventListener("click", async () => {
    if (!app.step || pressed) return;
    pressed = true;
    try {
      await steps[app.step].act(app);
    } finally {
      pressed = false;
    }
  });
  let over = 0;
  addEventListener("dragenter", (e) => {
    e.preventDefault();
    over += 1;
    $("drop").hidden = false;
  });
  addEventListener("dragleave", () => {
    over -= 1;
    $("drop").hidden = over <= 0;
  });
  addEventListener("dragover", (e) => e.preventDefault());
  addEventListener("drop", (e) => {
    e.preventDefault();
    over = 0;
    $("drop").hidden = true;
    for (const file of e.dataTransfer.files) send(file);
  });
  dark.addEventListener("change", tint);
  new ResizeObserver(() => (dirty = true)).observe(document.body);
  document.addEventListener("visibilitychange", () => (dirty = true));
}
export async function send(file) {
  app.words = { text: `${file.name} is sent`, level: "" };
  render();
  try {
    const found = await answer(await fetch(`/drop?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file }));
    app.words = { text: found.words, level: "good" };
    take(await look("state"));
  } catch (error) {
    app.words = { text: String(error.message), level: "bad" };
    render();
  }
}

function tint() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ink", "ink2", "line", "paper", "meas", "pred"]) ink[name] = style.getPropertyValue(`--${name}`).trim();
  ink.dark = dark.matches;
  dirty = true;
}

start().catch((error) => set($("title").children[0], `The page cannot be drawn: ${error.message}`));
