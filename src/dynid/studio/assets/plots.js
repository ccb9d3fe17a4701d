// Curves of all joints over one time axis, with the cursor that the pose follows.

import { unpack } from "/view.js";

const ROW = 31, AXIS = 34, LEFT = 4, RIGHT = 10;
// Points of a motion that is run again and again, and the fewest of each time.
const MOST = 4000, FEWEST = 12;

export const digits = (x) => {
  const size = Math.abs(x);
  const text = x.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : 2);
  return /[1-9]/.test(text) ? text.replace("-", "−") : text.replace("-", "");
};

const short = (x) => {
  const text = x && Math.abs(x) < 0.01 ? x.toExponential(1) : String(+x.toPrecision(3));
  return text.replaceAll("-", "−");
};

// The index of the last time that is not after t.
export function before(t, at) {
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= at) low = middle;
    else high = middle - 1;
  }
  return low;
}

// Values of one row of numbers at a time, in a straight line between samples.
export function between(t, values, joints, at) {
  const k = before(t, at), next = Math.min(k + 1, t.length - 1);
  const share = next > k ? Math.min(Math.max((at - t[k]) / (t[next] - t[k]), 0), 1) : 0;
  const out = [];
  for (let j = 0; j < joints; j++)
    out.push((1 - share) * values[k * joints + j] + share * values[next * joints + j]);
  return out;
}

export function decode(found) {
  const t = unpack(found.t);
  return {
    duration: found.duration, t, q: unpack(found.q),
    groups: found.groups.map((group) => ({
      ...group, t: group.t ? unpack(group.t) : t,
      series: group.series.map((one) => ({ name: one.name, values: unpack(one.values) })),
    })),
  };
}

export class Plots {
  constructor(canvas, rows) {
    this.canvas = canvas;
    this.rows = rows;
    this.joints = [];
    this.group = null;
    this.live = null;
    this.duration = 1;
    this.period = 0;
    this.at = 0;
    this.onSeek = () => {};
    this.shown = [];
    const seek = (e) => {
      const box = canvas.getBoundingClientRect();
      const share = (e.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      this.onSeek(Math.min(Math.max(share, 0), 1) * this.duration);
    };
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      seek(e);
    });
    canvas.addEventListener("pointermove", (e) => e.buttons && seek(e));
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 }[e.key];
      if (step) this.onSeek(Math.min(Math.max(this.at + step * this.duration / 200, 0), this.duration));
      else if (e.key === "Home") this.onSeek(0);
      else if (e.key === "End") this.onSeek(this.duration);
      else return;
      e.preventDefault();
    });
  }
  setJoints(names) {
    this.joints = names;
    this.rows.replaceChildren(...names.map((name) => {
      const row = document.createElement("li");
      for (const text of [name, "", ""]) row.append(Object.assign(document.createElement("span"), { textContent: text }));
      return row;
    }));
    this.shown = [];
  }
  // group: curves of one quantity; live: measured samples of a run, or null.
  show(group, duration, period, live) {
    Object.assign(this, { group, duration, period, live });
    this.size = this.joints.map(() => 0);
    for (const { values } of this.all()) {
      for (let k = 0; k < values.length; k++) {
        const j = k % this.joints.length;
        if (Math.abs(values[k]) > this.size[j]) this.size[j] = Math.abs(values[k]);
      }
    }
    this.centre = this.joints.map(() => 0);
    if (group && this.size.length && /Position|Temperature/.test(group.title)) this.spread();
    this.size = this.size.map((x) => nice(x));
    this.shown = [];
  }
  // Of what stands far from zero its range is drawn.
  spread() {
    const n = this.joints.length, low = Array(n).fill(Infinity), high = Array(n).fill(-Infinity);
    for (const { values } of this.all())
      for (let k = 0; k < values.length; k++) {
        low[k % n] = Math.min(low[k % n], values[k]);
        high[k % n] = Math.max(high[k % n], values[k]);
      }
    for (let j = 0; j < n; j++) {
      this.centre[j] = (low[j] + high[j]) / 2;
      this.size[j] = Math.max((high[j] - low[j]) / 2, 1e-3);
    }
  }
  all() {
    const made = this.group ? this.group.series.map((one) => ({ ...one, t: this.group.t })) : [];
    if (this.live && this.group && this.live.values[this.group.title])
      made.unshift({ name: "measured", t: this.live.t, values: this.live.values[this.group.title] });
    return made;
  }
  draw(at, ink) {
    this.at = at;
    const canvas = this.canvas, n = this.joints.length, ratio = Math.min(devicePixelRatio || 1, 2);
    const height = n * ROW + AXIS;
    canvas.style.height = `${height}px`;
    const wide = canvas.clientWidth, pen = canvas.getContext("2d");
    const size = [Math.round(wide * ratio), Math.round(height * ratio)];
    const stamp = `${size}|${ink.dark}|${this.live ? this.live.t.length : 0}`;
    if (!this.back || this.stamp !== stamp || !this.shown.length) this.redraw(size, ratio, ink, stamp);
    [canvas.width, canvas.height] = size;
    pen.drawImage(this.back, 0, 0);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = this.x(at);
    pen.fillStyle = ink.ink;
    pen.fillRect(x - 1, 0, 2, n * ROW + 6);
    const words = `${at.toFixed(2)} s`;
    pen.font = "700 12px system-ui, sans-serif";
    const half = pen.measureText(words).width / 2 + 6, place = Math.min(Math.max(x, half), wide - half);
    pen.beginPath();
    pen.roundRect(place - half, n * ROW + 5, 2 * half, 18, 3);
    pen.fill();
    pen.fillStyle = ink.paper;
    pen.fillText(words, place - half + 6, n * ROW + 18);
    this.say(at);
  }
  x(t) {
    const wide = this.canvas.clientWidth - LEFT - RIGHT;
    return LEFT + wide * t / Math.max(this.duration, 1e-9);
  }
  say(at) {
    const all = this.all();
    const values = all.length ? between(all[0].t, all[0].values, this.joints.length, this.inside(all[0], at)) : [];
    for (let j = 0; j < this.joints.length; j++) {
      const cells = this.rows.children[j].children;
      const size = this.centre && this.centre[j] ? `${digits(this.centre[j])} ±${digits(this.size[j])}` : `±${digits(this.size ? this.size[j] : 0)}`;
      const said = [values.length ? digits(values[j]) : "", values.length ? size : ""];
      for (const k of [0, 1]) if (cells[k + 1].textContent !== said[k]) cells[k + 1].textContent = said[k];
    }
    const canvas = this.canvas;
    canvas.setAttribute("aria-valuemax", this.duration.toFixed(2));
    canvas.setAttribute("aria-valuenow", at.toFixed(2));
    canvas.setAttribute("aria-valuetext", `${at.toFixed(2)} of ${this.duration.toFixed(2)} seconds`);
  }
  // A motion that is run again and again is drawn so.
  inside(one, at) {
    return this.period && one.name !== "measured" ? at % this.period : at;
  }
  redraw(size, ratio, ink, stamp) {
    this.stamp = stamp;
    this.back = Object.assign(document.createElement("canvas"), { width: size[0], height: size[1] });
    const pen = this.back.getContext("2d"), n = this.joints.length;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const end = this.x(this.duration);
    for (let j = 0; j < n; j++) {
      pen.fillStyle = ink.line;
      pen.fillRect(LEFT, Math.round((j + 0.5) * ROW) - 0.5, end - LEFT, 1);
    }
    if (this.period)
      for (let t = this.period; t < this.duration - 1e-6; t += this.period) {
        pen.strokeStyle = ink.ink2;
        pen.setLineDash([2, 3]);
        pen.beginPath();
        pen.moveTo(this.x(t), 0);
        pen.lineTo(this.x(t), n * ROW);
        pen.stroke();
        pen.setLineDash([]);
      }
    for (const one of this.all()) this.curve(pen, one, ink);
    pen.fillStyle = ink.ink2;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    const step = nice(this.duration / Math.max(2, Math.min(8, end / 110)));
    for (let t = 0; t <= this.duration + 1e-9; t += step)
      pen.fillText(String(+t.toFixed(3)), Math.min(Math.max(this.x(t), 6), end - 6), n * ROW + 18);
    pen.textAlign = "end";
    pen.fillText("time [s]", end, n * ROW + 32);
    this.shown = [true];
  }
  curve(pen, one, ink) {
    const n = this.joints.length, measured = one.name === "measured";
    pen.strokeStyle = measured ? ink.meas : ink.pred;
    pen.lineWidth = measured ? 3.2 : 1.5;
    pen.lineJoin = "round";
    const periods = this.period && !measured ? Math.ceil(this.duration / this.period - 1e-6) : 1;
    const count = one.t.length, most = periods > 1 ? Math.max(MOST / periods, FEWEST) : count;
    const step = Math.max(1, Math.floor(count / most));
    for (let j = 0; j < n; j++) {
      const middle = (j + 0.5) * ROW, scale = 0.44 * ROW / (this.size[j] || 1);
      pen.beginPath();
      let column = -1, low = 0, high = 0, first = true;
      const flush = () => {
        if (column < 0) return;
        first ? pen.moveTo(column, high) : pen.lineTo(column, high);
        if (low !== high) pen.lineTo(column, low);
        first = false;
      };
      for (let p = 0; p < periods; p++)
        for (let k = 0; k < count; k += step) {
          // Peaks are kept: of the samples of a pixel the lowest and the highest.
          const x = Math.round(2 * this.x(one.t[k] + p * this.period)) / 2;
          const y = middle - scale * (one.values[k * n + j] - this.centre[j]);
          if (x === column) {
            low = Math.min(low, y);
            high = Math.max(high, y);
          } else {
            flush();
            [column, low, high] = [x, y, y];
          }
        }
      flush();
      pen.stroke();
    }
  }
  // The criterion of a search as it falls. That of d-opt, a logarithm itself, is below zero.
  drawSearch(history, ink) {
    const positive = history.every(([, v]) => v > 0);
    const canvas = this.canvas, ratio = Math.min(devicePixelRatio || 1, 2);
    const wide = canvas.clientWidth, height = this.joints.length * ROW + AXIS;
    canvas.style.height = `${height}px`;
    [canvas.width, canvas.height] = [Math.round(wide * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = ink.ink2;
    pen.fillText(`Criterion, best so far${positive ? " (logarithmic)" : ""}`, 52, 14);
    pen.textAlign = "end";
    pen.fillText("time [s]", wide - 6, height - 2);
    if (history.length < 1) return;
    const end = Math.max(history.at(-1)[0] * 1.05, 1), values = history.map(([, v]) => (positive ? Math.log(v) : v));
    const low = Math.min(...values), high = Math.max(...values, low + 1e-6);
    const x = (t) => 52 + (wide - 62) * t / end;
    const y = (v) => 28 + (height - 62) * (high - v) / (high - low);
    for (const v of [high, low]) {
      pen.fillText(short(positive ? Math.exp(v) : v), 46, y(v) + 4);
      pen.fillRect(52, y(v), wide - 62, 0.5);
    }
    pen.strokeStyle = ink.pred;
    pen.lineWidth = 2;
    pen.beginPath();
    history.forEach(([t], k) => {
      if (k) pen.lineTo(x(t), y(values[k - 1]));
      pen.lineTo(x(t), y(values[k]));
    });
    pen.lineTo(x(end), y(values.at(-1)));
    pen.stroke();
    pen.textAlign = "center";
    pen.fillText("0", x(0), height - 18);
    pen.fillText(end.toFixed(0), x(end) - 8, height - 18);
    this.shown = [];
  }
}

function nice(x) {
  if (!(x > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((k) => k * power >= x * 0.999) * power;
}
