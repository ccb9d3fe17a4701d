// The arm, its floor and the scene in WebGL2; the tool's path and handles on a canvas above.

const SHADOW = 1024;
const LIGHT = normal([0.5, -0.62, 1.25]), FIELD = 0.62;

export function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// Matrices are column-major, as WebGL takes them.
function times(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}
function apply(m, [x, y, z]) {
  return [0, 1, 2].map((r) => m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r]);
}
const fromRows = (rows) => rows.map((_, k) => rows[4 * (k % 4) + (k >> 2)]);
const unit = () => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const add = (a, b, s = 1) => a.map((x, k) => x + s * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function normal(v) {
  const size = Math.hypot(...v) || 1;
  return v.map((x) => x / size);
}
function turn([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  return [
    c + x * x * d, y * x * d + z * s, z * x * d - y * s, 0,
    x * y * d - z * s, c + y * y * d, z * y * d + x * s, 0,
    x * z * d + y * s, y * z * d - x * s, c + z * z * d, 0, 0, 0, 0, 1,
  ];
}
function lookAt(eye, target, up) {
  const z = normal(add(eye, target, -1));
  const x = normal(cross(up, z)), y = cross(z, x);
  return [
    x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
    -dot(x, eye), -dot(y, eye), -dot(z, eye), 1,
  ];
}
function perspective(height, aspect, near, far) {
  const f = 1 / Math.tan(height / 2), d = near - far;
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / d, -1, 0, 0, 2 * far * near / d, 0];
}
function box(half, depth) {
  return [1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -2 / depth, 0, 0, 0, 0, 1];
}
// The turn that brings a direction upright.
function upright(up) {
  const axis = cross(up, [0, 0, 1]);
  const size = Math.hypot(...axis);
  if (size < 1e-9) return up[2] > 0 ? unit() : turn([1, 0, 0], Math.PI);
  return turn(axis.map((x) => x / size), Math.atan2(size, up[2]));
}

const SHADED = {
  vertex: `#version 300 es
    layout(location=0) in vec3 place; layout(location=1) in vec3 turned;
    uniform mat4 model, camera, sun; out vec3 at, n; out vec4 lit;
    void main() {
      vec4 p = model * vec4(place, 1.0);
      at = p.xyz; n = mat3(model) * turned; lit = sun * p; gl_Position = camera * p;
    }`,
  fragment: `#version 300 es
    precision highp float; precision highp sampler2DShadow;
    in vec3 at, n; in vec4 lit; out vec4 pixel;
    uniform vec3 colour, eye, light; uniform float opacity, dark;
    uniform sampler2DShadow shade;
    void main() {
      vec3 s = normalize(n), v = normalize(eye - at);
      if (dot(s, v) < 0.0) s = -s;
      float turnedTo = dot(s, light);
      vec3 c = lit.xyz * 0.5 + 0.5;
      c.z -= 0.0025 + 0.004 * (1.0 - max(turnedTo, 0.0));
      float seen = 0.0, w = 1.2 / ${SHADOW}.0;
      seen += texture(shade, c + vec3(-w, -w, 0)) + texture(shade, c + vec3(w, -w, 0));
      seen += texture(shade, c + vec3(-w, w, 0)) + texture(shade, c + vec3(w, w, 0));
      seen *= 0.25;
      vec3 sky = mix(vec3(0.80, 0.85, 0.93), vec3(0.40, 0.44, 0.52), dark);
      vec3 ground = mix(vec3(0.46, 0.45, 0.45), vec3(0.10, 0.11, 0.13), dark);
      vec3 soft = mix(ground, sky, 0.5 + 0.5 * s.z) * mix(0.50, 0.62, dark);
      float fill = 0.16 * max(dot(s, normalize(vec3(-light.x, -light.y, 0.25))), 0.0);
      float key = max(turnedTo, 0.0) * seen;
      vec3 h = normalize(light + v);
      float gloss = pow(max(dot(s, h), 0.0), 46.0) * seen * 0.26;
      float rim = pow(1.0 - max(dot(s, v), 0.0), 3.0) * mix(0.06, 0.16, dark);
      vec3 sum = colour * colour * (soft + fill + key * mix(0.88, 0.92, dark)) + gloss + rim * sky;
      sum = sum / (1.0 + 0.16 * sum);
      pixel = vec4(pow(sum, vec3(1.0 / 2.2)) * opacity, opacity);
    }`,
};
const FLOOR = {
  vertex: `#version 300 es
    uniform mat4 camera, sun; uniform float size, height; out vec3 at; out vec4 lit;
    void main() {
      vec2 c = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
      at = vec3(c * size, height); lit = sun * vec4(at, 1.0); gl_Position = camera * vec4(at, 1.0);
    }`,
  fragment: `#version 300 es
    precision highp float; precision highp sampler2DShadow;
    in vec3 at; in vec4 lit; out vec4 pixel;
    uniform vec3 eye; uniform float dark, size, cell; uniform sampler2DShadow shade;
    void main() {
      vec2 g = at.xy / cell, d = fwidth(g);
      vec2 line = 1.0 - smoothstep(d * 0.2, d * 1.05, abs(fract(g - 0.5) - 0.5));
      float far = length(at.xy) / size;
      float fade = clamp(1.15 - 1.25 * far, 0.0, 1.0);
      float grid = max(line.x, line.y) * fade * fade * mix(0.34, 0.30, dark)
        / (1.0 + 3.0 * max(d.x, d.y));
      vec3 c = lit.xyz * 0.5 + 0.5; c.z -= 0.002;
      float shadow = 0.0;
      // Nothing throws a shadow beyond the map.
      if (all(lessThan(abs(c.xy - 0.5), vec2(0.5)))) {
        float w = 1.7 / ${SHADOW}.0;
        for (int k = 0; k < 4; k++)
          shadow += 1.0 - texture(shade, c + vec3(float(2 * (k % 2) - 1), float(k - k % 2 - 1), 0.0) * w);
        shadow *= fade / 4.0;
      }
      vec3 ink = mix(vec3(0.34, 0.40, 0.50), vec3(0.62, 0.68, 0.78), dark);
      float under = shadow * mix(0.34, 0.58, dark);
      vec3 black = mix(vec3(0.08, 0.10, 0.15), vec3(0.0), dark);
      float alpha = under + grid * (1.0 - under);
      pixel = vec4(black * under + ink * grid * (1.0 - under), alpha);
    }`,
};
const DEPTH = {
  vertex: `#version 300 es
    layout(location=0) in vec3 place; uniform mat4 model, sun;
    void main() { gl_Position = sun * model * vec4(place, 1.0); }`,
  fragment: `#version 300 es
    void main() {}`,
};

class Program {
  constructor(gl, { vertex, fragment }) {
    this.gl = gl;
    this.id = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.id, shader);
    }
    gl.linkProgram(this.id);
    if (!gl.getProgramParameter(this.id, gl.LINK_STATUS))
      throw new Error(gl.getProgramInfoLog(this.id) || "the shaders do not link");
    this.places = {};
  }
  use(values) {
    const gl = this.gl;
    gl.useProgram(this.id);
    for (const [name, value] of Object.entries(values)) this.set(name, value);
  }
  set(name, value) {
    const gl = this.gl;
    const place = (this.places[name] ??= gl.getUniformLocation(this.id, name));
    if (typeof value === "number") gl.uniform1f(place, value);
    else if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
    else gl.uniform3fv(place, value);
  }
}

// From where an arm is seen at its widest: across the direction in which its places scatter most.
function widest(points) {
  let best = -0.86, most = 0;
  for (let k = 0; k < 24; k++) {
    const angle = -0.86 + k * Math.PI / 12, across = [-Math.sin(angle), Math.cos(angle)];
    const along = points.map((p) => p[0] * across[0] + p[1] * across[1]);
    const wide = Math.max(...along) - Math.min(...along);
    // The light comes from the front where one is as good as another.
    const score = wide * (1 + 0.12 * Math.cos(angle + 0.86));
    if (score > most) [best, most] = [angle, score];
  }
  return best;
}

// Whether the processor draws: fewer points then, each of them once.
function inSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

const GREY = [0.86, 0.87, 0.885], STEEL = [0.56, 0.585, 0.62];

export class View {
  // canvas: the picture; over: the canvas above it; both fill one box.
  constructor(canvas, over) {
    this.canvas = canvas;
    this.over = over;
    const slow = inSoftware();
    const gl = canvas.getContext("webgl2", { antialias: !slow, premultipliedAlpha: true, alpha: true });
    if (!gl) throw new Error("this browser has no WebGL 2");
    this.gl = gl;
    this.shaded = new Program(gl, SHADED);
    this.floor = new Program(gl, FLOOR);
    this.depth = new Program(gl, DEPTH);
    this.nothing = gl.createVertexArray();
    this.meshes = [];
    this.bodies = [];
    this.shapes = [];
    this.showBodies = false;
    this.scale = slow ? 0.75 : Math.min(devicePixelRatio || 1, 2);
    this.poses = [unit()];
    this.paths = { past: [], next: [] };
    this.near = [];
    this.handle = null;
    this.makeShadow();
    this.camera = { turn: -0.78, rise: 0.3, far: 3, target: [0, 0, 0.4] };
    this.moved = false;
    this.listen();
  }
  makeShadow() {
    const gl = this.gl;
    this.map = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.map);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW, SHADOW);
    for (const [name, value] of [
      [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE], [gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL],
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    this.buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.map, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  upload(corners) {
    const gl = this.gl, data = unpack(corners);
    const array = gl.createVertexArray(), buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    for (const k of [0, 1]) {
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 24, 12 * k);
    }
    gl.bindVertexArray(null);
    return { array, buffer, count: data.length / 6 };
  }
  forget(items) {
    for (const item of items) {
      this.gl.deleteVertexArray(item.array);
      this.gl.deleteBuffer(item.buffer);
    }
  }
  setRobot(robot) {
    this.forget([...this.meshes, ...this.bodies]);
    this.robot = robot;
    this.placements = robot.placements.map(fromRows);
    const down = Math.hypot(...robot.gravity) > 1e-9 ? robot.gravity : [0, 0, -1];
    this.base = upright(normal(down.map((x) => -x)));
    const last = robot.joints.length;
    const made = (list) => list.map((item) => ({
      ...this.upload(item.corners), name: item.name, link: item.link,
      colour: item.link === 0 || item.link === last ? STEEL : GREY,
    }));
    this.meshes = made(robot.meshes);
    this.bodies = made(robot.bodies);
    this.ground = robot.standing ? 0 : -1.15 * robot.reach;
    this.cell = 10 ** Math.round(Math.log10(robot.reach / 8)) * 2;
    this.moved = false;
  }
  setScene(shapes) {
    this.forget(this.shapes);
    this.shapes = shapes.map((s) => ({ ...s, ...this.upload(s.corners), model: fromRows(s.pose) }));
  }
  // Joint frames in the base frame at q.
  kinematics(q) {
    const poses = [unit()];
    for (let k = 0; k < this.placements.length; k++) {
      const axis = this.robot.axes[k];
      const step = this.robot.prismatic[k] ? unit() : turn(axis, q[k]);
      if (this.robot.prismatic[k]) for (let r = 0; r < 3; r++) step[12 + r] = axis[r] * q[k];
      poses.push(times(times(poses[k], this.placements[k]), step));
    }
    return poses;
  }
  tool(q) {
    const poses = this.kinematics(q);
    return apply(this.base, apply(poses[poses.length - 1], this.robot.tool));
  }
  // Places of the joints and the tool at some poses: what a picture has to hold.
  frame(rows) {
    const points = [[0, 0, this.ground]];
    for (const q of rows) {
      const poses = this.kinematics(q);
      for (const pose of poses) points.push(apply(this.base, [pose[12], pose[13], pose[14]]));
      points.push(apply(this.base, apply(poses[poses.length - 1], this.robot.tool)));
    }
    this.framed = points;
    if (!this.moved) this.fit();
  }
  fit() {
    const points = this.framed;
    const box = [0, 1, 2].map((k) => {
      const values = points.map((p) => p[k]);
      return [Math.min(...values), Math.max(...values)];
    });
    this.camera = { turn: -0.86, rise: 0.3, far: 3, target: box.map(([a, b]) => (a + b) / 2) };
    this.camera.turn = widest(points);
    const room = 0.085 * this.robot.reach;
    for (let round = 0; round < 4; round++) {
      let low = 0.3 * this.robot.reach, high = 12 * this.robot.reach;
      for (let k = 0; k < 24; k++) {
        this.camera.far = (low + high) / 2;
        const { wide, tall } = this.extent(points, room);
        if (wide[1] - wide[0] > 1.86 || tall[1] - tall[0] > 1.6) low = this.camera.far;
        else high = this.camera.far;
      }
      const { wide, tall } = this.extent(points, room);
      const reach = this.camera.far * Math.tan(FIELD / 2);
      const { x, y } = this.axes();
      const shift = [(wide[0] + wide[1]) / 2 * this.aspect * reach, ((tall[0] + tall[1]) / 2 + 0.04) * reach];
      this.camera.target = add(add(this.camera.target, x, shift[0]), y, shift[1]);
    }
  }
  extent(points, room) {
    const view = lookAt(this.eye(), this.camera.target, [0, 0, 1]);
    const f = 1 / Math.tan(FIELD / 2), wide = [9, -9], tall = [9, -9];
    for (const p of points) {
      const [x, y, z] = apply(view, p);
      const depth = Math.max(-z, 0.05);
      for (const s of [-room, room]) {
        const u = (x + s) * f / depth / this.aspect, v = (y + s) * f / depth;
        wide[0] = Math.min(wide[0], u); wide[1] = Math.max(wide[1], u);
        tall[0] = Math.min(tall[0], v); tall[1] = Math.max(tall[1], v);
      }
    }
    return { wide, tall };
  }
  get aspect() {
    return Math.max(this.canvas.clientWidth, 1) / Math.max(this.canvas.clientHeight, 1);
  }
  eye() {
    const { turn: a, rise: b, far, target } = this.camera;
    return add(target, [Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.sin(b)], far);
  }
  axes() {
    const z = normal(add(this.eye(), this.camera.target, -1));
    const x = normal(cross([0, 0, 1], z));
    return { x, y: cross(z, x) };
  }
  draw(dark) {
    const gl = this.gl, canvas = this.canvas;
    const width = Math.round(canvas.clientWidth * this.scale);
    const height = Math.round(canvas.clientHeight * this.scale);
    if (!width || !height || !this.robot) return;
    if (canvas.width !== width || canvas.height !== height) {
      [canvas.width, canvas.height] = [width, height];
      if (!this.moved && this.framed) this.fit();
    }
    const size = 1.3 * this.robot.reach, eye = this.eye();
    const middle = [0, 0, this.ground + 0.45 * size];
    const sun = times(box(size, 6 * size), lookAt(add(middle, LIGHT, 1), middle, [0, 1, 0]));
    this.projection = times(
      perspective(FIELD, this.aspect, 0.03 * this.camera.far, this.camera.far + 12 * size),
      lookAt(eye, this.camera.target, [0, 0, 1]),
    );
    gl.enable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.buffer);
    gl.viewport(0, 0, SHADOW, SHADOW);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.depth.use({ sun });
    const arm = this.showBodies ? this.bodies : this.meshes;
    const solid = this.shapes.filter((shape) => !shape.endless);
    this.each(this.depth, [...arm, ...solid]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const common = { camera: this.projection, sun, eye, dark: dark ? 1 : 0 };
    this.shaded.use({ ...common, light: LIGHT, opacity: 1 });
    this.each(this.shaded, arm);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.floor.use({ ...common, size: 5 * this.robot.reach, height: this.ground, cell: this.cell });
    gl.bindVertexArray(this.nothing);
    gl.depthMask(false);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.depthMask(true);
    this.shaded.use({ ...common, light: LIGHT });
    for (const shape of this.shapes) {
      this.shaded.set("opacity", shape.endless ? 0.22 : 0.82);
      this.each(this.shaded, [shape]);
    }
    gl.disable(gl.BLEND);
    this.drawOver(dark);
  }
  each(program, items) {
    const gl = this.gl;
    for (const item of items) {
      program.set("model", times(this.base, item.model || this.poses[item.link]));
      if (program === this.shaded) program.set("colour", this.colourOf(item));
      gl.bindVertexArray(item.array);
      gl.drawArrays(gl.TRIANGLES, 0, item.count);
    }
  }
  colourOf(item) {
    if (item.model) return item.number === this.chosen ? [0.93, 0.68, 0.25] : [0.74, 0.68, 0.58];
    const hit = this.near.find((one) => one.too_near && one.names.includes(item.name));
    return hit ? [0.9, 0.38, 0.3] : item.colour;
  }
  // Where a point of the world is on the page, in pixels of the canvas above.
  project(p) {
    const m = this.projection;
    if (!m) return null;
    const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
    if (w <= 0.01) return null;
    const [x, y] = apply(m, p);
    return [(x / w + 1) / 2 * this.over.clientWidth, (1 - y / w) / 2 * this.over.clientHeight];
  }
  drawOver(dark) {
    const over = this.over, ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.round(over.clientWidth * ratio), height = Math.round(over.clientHeight * ratio);
    if (over.width !== width || over.height !== height) [over.width, over.height] = [width, height];
    const pen = over.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width / ratio, height / ratio);
    pen.lineCap = pen.lineJoin = "round";
    const blue = dark ? "#58a9ff" : "#0a5cad", amber = dark ? "#f0b24d" : "#a86400";
    this.line(pen, this.paths.next, blue, 2, [1, 6]);
    this.line(pen, this.paths.past, blue, 2.5, []);
    const tip = this.paths.past.length ? this.project(this.paths.past.at(-1)) : null;
    if (tip) this.dot(pen, tip, 4.5, dark ? "#10151c" : "#fff", blue);
    let above = null;
    for (const item of this.near) {
      const colour = item.too_near ? (dark ? "#ff8077" : "#b3221b") : amber;
      const ends = [item.start, item.end].map((p) => apply(this.base, p));
      this.line(pen, ends, colour, 2, []);
      const places = ends.map((p) => this.project(p)).filter(Boolean);
      for (const place of places) this.dot(pen, place, 2.5, colour, colour);
      if (places.length === 2) {
        const words = `${item.distance_mm.toFixed(0)} mm`;
        pen.font = "600 12px system-ui, sans-serif";
        const x = (places[0][0] + places[1][0]) / 2 + 8;
        let y = (places[0][1] + places[1][1]) / 2;
        if (above && Math.abs(above[0] - x) < 50 && Math.abs(above[1] - y) < 16) y = above[1] + 16;
        above = [x, y];
        pen.lineWidth = 4;
        pen.strokeStyle = dark ? "#14171cd0" : "#ffffffd8";
        pen.strokeText(words, x, y);
        pen.fillStyle = colour;
        pen.fillText(words, x, y);
      }
    }
    if (this.handle) this.drawHandle(pen, dark);
  }
  line(pen, points, colour, width, dash) {
    pen.beginPath();
    let open = false;
    for (const point of points) {
      const place = this.project(point);
      if (place) open ? pen.lineTo(...place) : pen.moveTo(...place);
      open = Boolean(place);
    }
    pen.setLineDash(dash);
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
    pen.setLineDash([]);
  }
  dot(pen, [x, y], radius, fill, stroke) {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 7);
    pen.fillStyle = fill;
    pen.strokeStyle = stroke;
    pen.lineWidth = 2;
    pen.fill();
    pen.stroke();
  }
  // Three arrows by which a shape is dragged, along the axes of the base.
  arrows() {
    const { position, axes } = this.handle, size = 0.2 * this.robot.reach;
    return axes.map((k) => {
      const end = position.map((x, j) => x + (j === k ? size : 0));
      return { axis: k, from: apply(this.base, position), to: apply(this.base, end), size };
    });
  }
  drawHandle(pen, dark) {
    const colours = dark ? ["#ff8077", "#4fcba3", "#58a9ff"] : ["#b3221b", "#006b52", "#0a5cad"];
    for (const { axis, from, to } of this.arrows()) {
      this.line(pen, [from, to], colours[axis], 3, []);
      const end = this.project(to);
      if (end) {
        this.dot(pen, end, 7, colours[axis], dark ? "#14171c" : "#fff");
        pen.fillStyle = dark ? "#14171c" : "#fff";
        pen.font = "700 10px system-ui, sans-serif";
        pen.fillText("xyz"[axis], end[0] - 3, end[1] + 3);
      }
    }
  }
  grabbed(x, y) {
    if (!this.handle || !this.projection) return null;
    for (const arrow of this.arrows()) {
      const [a, b] = [this.project(arrow.from), this.project(arrow.to)];
      if (a && b && Math.hypot(b[0] - x, b[1] - y) < 16)
        return { ...arrow, pixels: [b[0] - a[0], b[1] - a[1]], start: [...this.handle.position] };
    }
    return null;
  }
  listen() {
    const over = this.over, held = new Map();
    let grip = null, spread = 0;
    const local = (e) => {
      const r = over.getBoundingClientRect();
      return [e.clientX - r.left, e.clientY - r.top];
    };
    over.addEventListener("pointerdown", (e) => {
      over.setPointerCapture(e.pointerId);
      held.set(e.pointerId, local(e));
      grip = held.size === 1 ? this.grabbed(...local(e)) : null;
      if (grip) grip.from2 = local(e);
      spread = 0;
    });
    over.addEventListener("pointermove", (e) => {
      if (!held.has(e.pointerId)) {
        over.style.cursor = this.grabbed(...local(e)) ? "move" : "grab";
        return;
      }
      const before = held.get(e.pointerId), now = local(e);
      held.set(e.pointerId, now);
      const d = [now[0] - before[0], now[1] - before[1]];
      if (grip) {
        const p = grip.pixels, along = (now[0] - grip.from2[0]) * p[0] + (now[1] - grip.from2[1]) * p[1];
        const moved = grip.size * along / Math.max(p[0] * p[0] + p[1] * p[1], 400);
        this.onDrag(grip.start.map((x, k) => (k === grip.axis ? x + moved : x)));
      } else if (held.size === 2) {
        const [a, b] = [...held.values()], now2 = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (spread) this.zoom(spread / now2);
        spread = now2;
        this.pan(d[0] / 2, d[1] / 2);
      } else if (e.shiftKey || e.buttons & 6) this.pan(...d);
      else this.orbit(-0.007 * d[0], 0.006 * d[1]);
    });
    const up = (e) => {
      held.delete(e.pointerId);
      grip = null;
    };
    over.addEventListener("pointerup", up);
    over.addEventListener("pointercancel", up);
    over.addEventListener("contextmenu", (e) => e.preventDefault());
    over.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom(Math.exp(0.0012 * e.deltaY));
    }, { passive: false });
    over.addEventListener("keydown", (e) => {
      const steps = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] };
      if (steps[e.key]) this.orbit(...steps[e.key]);
      else if (e.key === "+" || e.key === "-") this.zoom(e.key === "+" ? 0.9 : 1.1);
      else if (e.key === "0") this.reset();
      else return;
      e.preventDefault();
    });
  }
  onDrag() {}
  onLook() {}
  orbit(a, b) {
    this.camera.turn += a;
    this.camera.rise = Math.min(Math.max(this.camera.rise + b, -0.2), 1.5);
    this.look();
  }
  pan(dx, dy) {
    const { x, y } = this.axes();
    const step = 2 * this.camera.far * Math.tan(FIELD / 2) / Math.max(this.over.clientHeight, 1);
    this.camera.target = add(add(this.camera.target, x, -dx * step), y, dy * step);
    this.look();
  }
  zoom(factor) {
    const r = this.robot.reach;
    this.camera.far = Math.min(Math.max(this.camera.far * factor, 0.4 * r), 14 * r);
    this.look();
  }
  look() {
    this.moved = true;
    this.onLook();
  }
  reset() {
    this.moved = false;
    this.fit();
    this.onLook();
  }
}
