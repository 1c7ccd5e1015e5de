"use strict";
// Draws a run in a page; `run` is made by page.py. Positions in m, times in s, z points up.

const AXES = ["#d62728", "#2ca02c", "#1f77b4"];

// ---- data -----------------------------------------------------------------------------------

/** Base64 of little endian 32-bit floats. */
function floats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

/** The frame before time t and how far it is to the next, 0 to 1. */
function frameAt(time, t) {
  let low = 0, high = time.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= t) low = middle; else high = middle;
  }
  const span = time[high] - time[low];
  return [low, span > 0 ? Math.min(Math.max((t - time[low]) / span, 0), 1) : 0];
}

/** `size` numbers of a table of frames, linear between two of them. */
function between(table, size, frame, share) {
  const next = Math.min((frame + 1) * size, table.length - size);
  return Array.from({length: size}, (_, k) =>
    (1 - share) * table[frame * size + k] + share * table[next + k]);
}

/** Colour of a share, 0 to 1, of the scale. */
function colorOf(scale, share) {
  const at = Math.min(Math.max(share, 0), 1) * (scale.length - 1);
  const k = Math.min(Math.floor(at), scale.length - 2);
  const rgb = [0, 1, 2].map((c) =>
    Math.round(255 * (scale[k][c] + (at - k) * (scale[k + 1][c] - scale[k][c]))));
  return `rgb(${rgb})`;
}

/** Colour of red, green and blue, 0 to 1, times a factor. */
function shadeOf(rgb, factor = 1) {
  return `rgb(${rgb.map((v) => Math.round(255 * Math.min(v * factor, 1)))})`;
}

/** Columns of the rotation matrix of a quaternion x, y, z, w. */
function axesOf([x, y, z, w]) {
  const n = 2 / (x * x + y * y + z * z + w * w);
  return [
    [1 - n * (y * y + z * z), n * (x * y + z * w), n * (x * z - y * w)],
    [n * (x * y - z * w), 1 - n * (x * x + z * z), n * (y * z + x * w)],
    [n * (x * z + y * w), n * (y * z - x * w), 1 - n * (x * x + y * y)],
  ];
}

/** Points of triangles, numbers x, y, z after another, moved to a pose: position, quaternion. */
function moved(points, pose) {
  const [a, b, c] = axesOf(pose.slice(3)), out = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 3) {
    for (let i = 0; i < 3; i++) {
      out[k + i] = pose[i] + a[i] * points[k] + b[i] * points[k + 1] + c[i] * points[k + 2];
    }
  }
  return out;
}

/** Whether a point p lies in a triangle of points x, y, depth and behind it, by more than `slack`. */
function hides(corners, p, slack) {
  const [a, b, c] = corners;
  const area = (q, r, s) => (r[0] - q[0]) * (s[1] - q[1]) - (r[1] - q[1]) * (s[0] - q[0]);
  const u = area(b, c, p), v = area(c, a, p), w = area(a, b, p), whole = u + v + w;
  if (!whole || u * whole < 0 || v * whole < 0 || w * whole < 0) return false;
  // The inverse of the depth is linear in the picture.
  const inverse = (u / a[2] + v / b[2] + w / c[2]) / whole;
  return 1 / inverse < p[2] - slack;
}

/** A round number of about this size: 1, 2 or 5 times a power of ten. */
function round(size) {
  const power = 10 ** Math.floor(Math.log10(size));
  return power * [1, 2, 5, 10].find((f) => f * power >= size * 0.999);
}

/** Smallest and largest corner of points x, y, z. */
function boxOf(points) {
  const low = [Infinity, Infinity, Infinity], high = low.map((v) => -v);
  points.forEach((v, k) => {
    low[k % 3] = Math.min(low[k % 3], v);
    high[k % 3] = Math.max(high[k % 3], v);
  });
  return [low, high];
}

// ---- camera ---------------------------------------------------------------------------------

/** Looks from a distance at a target; yaw and pitch in rad. */
class Camera {
  constructor(target, distance) {
    Object.assign(this, {target: [...target], distance, yaw: -1.1, pitch: 0.3});
  }

  /** Right, up and forward of the picture. */
  get basis() {
    const [cy, sy, cp, sp] =
      [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [-cp * cy, -cp * sy, -sp]];
  }

  /** Pixel and depth of a point. */
  project([x, y, z], width, height) {
    const d = [x - this.target[0], y - this.target[1], z - this.target[2]];
    const [a, b, c] = this.basis.map((e) => e[0] * d[0] + e[1] * d[1] + e[2] * d[2]);
    const depth = Math.max(c + this.distance, 1e-3 * this.distance);
    const scale = 1.6 * Math.min(width, height) / depth;
    return [width / 2 + scale * a, height / 2 - scale * b, depth];
  }

  turn(dx, dy) {
    this.yaw -= 0.008 * dx;
    this.pitch = Math.min(Math.max(this.pitch + 0.008 * dy, -1.55), 1.55);
  }

  move(dx, dy, height) {
    const [right, up] = this.basis, scale = this.distance / (1.6 * height);
    this.target = this.target.map((v, k) => v - scale * (dx * right[k] - dy * up[k]));
  }

  zoom(factor) { this.distance *= factor; }
}

// ---- the view -------------------------------------------------------------------------------

/** The run on a canvas at one time. */
class View {
  constructor(canvas, run) {
    Object.assign(this, {canvas, run, points: false, path: true, color: 0});
    const main = {...run, values: run.colors.map((c) => c.values)};
    this.cables = [main, ...run.others].map((one, k) => ({
      points: one.points,
      controls: one.controls,
      line: floats(one.centerline),
      control: floats(one.control_points),
      values: one.values.map(floats),
      color: run.names.length ? shadeOf(run.shades[k % run.shades.length]) : "#e6801a",
    }));
    this.line = this.cables[0].line;
    this.frames = run.frames && floats(run.frames);
    this.bodies = run.bodies.map((b) => ({...b, triangles: floats(b.triangles), poses: floats(b.poses)}));
    this.forces = run.forces.map(floats);
    const boxes = this.cables.map((one) => boxOf(one.line));
    this.box = [0, 1].map((side) => [0, 1, 2].map((k) =>
      Math[side ? "max" : "min"](...boxes.map((box) => box[side][k]))));
    this.size = Math.max(Math.hypot(...this.box[1].map((v, k) => v - this.box[0][k])), 1e-6);
    this.home();
  }

  home() {
    this.camera = new Camera(this.box[0].map((v, k) => (v + this.box[1][k]) / 2), 1.6 * this.size);
  }

  draw(frame, share) {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = ratio * this.width;
    this.canvas.height = ratio * this.height;
    this.pen = this.canvas.getContext("2d");
    this.pen.scale(ratio, ratio);
    this.pen.lineCap = "round";
    this.drawGround();
    if (this.path) this.drawPath(frame);
    const faces = this.facesOf(frame, share);
    const cable = this.cables.flatMap((one) => this.partsOf(one, frame, share, faces));
    this.drawCable(cable.filter((part) => part.hidden));
    this.drawFaces(faces);
    this.drawCable(cable.filter((part) => !part.hidden));
    this.drawForces(frame);
    if (this.points) for (const one of this.cables) this.drawPoints(one, frame, share);
    if (this.frames) this.drawFrames(frame, share);
  }

  stroke(from, to, color, width) {
    const [a, b] = [from, to].map((p) => this.camera.project(p, this.width, this.height));
    this.pen.strokeStyle = color;
    this.pen.lineWidth = width;
    this.pen.beginPath();
    this.pen.moveTo(a[0], a[1]);
    this.pen.lineTo(b[0], b[1]);
    this.pen.stroke();
  }

  drawGround() {
    const [low, high] = this.box, step = round(this.size / 15);
    const [x0, y0, x1, y1] = [low[0], low[1], high[0], high[1]].map((v, k) =>
      step * (k < 2 ? Math.floor(v / step - 1) : Math.ceil(v / step + 1)));
    const z = low[2] - 0.05 * this.size;
    const lines = (a, b) => Array.from({length: Math.round((b - a) / step) + 1}, (_, k) => a + k * step);
    for (const x of lines(x0, x1)) this.stroke([x, y0, z], [x, y1, z], "#dde1e6", 1);
    for (const y of lines(y0, y1)) this.stroke([x0, y, z], [x1, y, z], "#dde1e6", 1);
    AXES.forEach((color, k) => {
      const tip = [x0, y0, z];
      tip[k] += step;
      this.stroke([x0, y0, z], tip, color, 2);
    });
    this.pen.fillStyle = "#777";
    this.pen.font = "12px sans-serif";
    this.pen.fillText(`grid ${Number(step.toPrecision(3))} m; axes x red, y green, z blue`, 10, this.height - 10);
  }

  drawPath(frame) {
    const size = 3 * this.run.points, end = (k) => this.line.slice((k + 1) * size - 3, (k + 1) * size);
    for (let k = 0; k < frame; k++) this.stroke(end(k), end(k + 1), "#b9c2cc", 1);
  }

  /** The faces of obstacles that are turned to the eye: corners in the picture, colour, depth. */
  facesOf(frame, share) {
    const found = [], near = 0.02 * this.camera.distance;
    const light = [0.35, -0.5, 0.8];
    for (const body of this.bodies) {
      const pose = between(body.poses, 7, frame, share);
      if (!pose.every(Number.isFinite)) continue;
      const points = moved(body.triangles, pose);
      for (let k = 0; k < points.length; k += 9) {
        const corners = [0, 3, 6].map((j) => this.camera.project(points.subarray(k + j, k + j + 3), this.width, this.height));
        const [a, b, c] = corners;
        const turned = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        // Seen from outside, corners are counter-clockwise; in a picture y points down.
        const flat = body.triangles.length < 27;
        if ((turned >= 0 && !flat) || Math.min(a[2], b[2], c[2]) < near) continue;
        const [p, q] = [3, 6].map((j) => [0, 1, 2].map((i) => points[k + j + i] - points[k + i]));
        const n = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        const lit = (n[0] * light[0] + n[1] * light[1] + n[2] * light[2]) / (Math.hypot(...n) || 1);
        const gray = Math.round(165 + 45 * lit);
        const color = body.color ? shadeOf(body.color, 1 + 0.3 * lit) : `rgb(${gray},${gray},${gray + 8})`;
        found.push({corners, color, depth: a[2] + b[2] + c[2]});
      }
    }
    return found.sort((a, b) => b.depth - a.depth);
  }

  /** Faces are drawn elsewhere and then laid over the picture, so that one shows through no other. */
  drawFaces(faces) {
    if (!faces.length) return;
    this.layer = this.layer || document.createElement("canvas");
    this.layer.width = this.canvas.width;
    this.layer.height = this.canvas.height;
    const pen = this.layer.getContext("2d"), ratio = window.devicePixelRatio || 1;
    pen.scale(ratio, ratio);
    for (const {corners, color} of faces) {
      pen.fillStyle = pen.strokeStyle = color;
      pen.beginPath();
      corners.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
      pen.closePath();
      pen.fill();
      pen.stroke();  // closes the seams between triangles
    }
    this.pen.globalAlpha = 0.8;
    this.pen.drawImage(this.layer, 0, 0, this.width, this.height);
    this.pen.globalAlpha = 1;
  }

  drawForces(frame) {
    const lines = this.forces[this.run.looks[frame]] || [];
    for (let k = 0; k < lines.length; k += 6) {
      this.stroke(lines.subarray(k, k + 3), lines.subarray(k + 3, k + 6), "#d33", 1);
      const [x, y] = this.camera.project(lines.subarray(k, k + 3), this.width, this.height);
      this.pen.fillStyle = "#d33";
      this.pen.fillRect(x - 1, y - 1, 2, 2);
    }
  }

  drawCable(parts) {
    for (const {from, to, color} of parts) this.stroke(from, to, color, 5);
  }

  /** A cable in pieces: ends, colour, and whether a face hides it. */
  partsOf(cable, frame, share, faces) {
    const parts = [];
    const m = cable.points, at = between(cable.line, 3 * m, frame, share);
    const shown = this.run.colors[this.color];
    const values = shown && between(cable.values[this.color], m, frame, share);
    for (let k = 0; k + 1 < m; k++) {
      let color = cable.color;
      if (shown) {
        const value = (values[k] + values[k + 1]) / 2;
        color = colorOf(this.run.scale, (value - shown.low) / (shown.high - shown.low || 1));
      }
      const [from, to] = [at.slice(3 * k, 3 * k + 3), at.slice(3 * k + 3, 3 * k + 6)];
      const middle = this.camera.project(from.map((v, i) => (v + to[i]) / 2), this.width, this.height);
      const hidden = faces.some(({corners}) => hides(corners, middle, 0.01 * this.size));
      parts.push({from, to, color, hidden});
    }
    return parts;
  }

  drawPoints(cable, frame, share) {
    const at = between(cable.control, 3 * cable.controls, frame, share);
    for (let k = 0; k < at.length; k += 3) {
      if (k) this.stroke(at.slice(k - 3, k), at.slice(k, k + 3), "#4d7fe566", 1);
      const [x, y] = this.camera.project(at.slice(k, k + 3), this.width, this.height);
      this.pen.fillStyle = "#4d7fe5";
      this.pen.fillRect(x - 2.5, y - 2.5, 5, 5);
    }
  }

  drawFrames(frame) {
    const m = this.run.points, ends = [0, 3 * (m - 1)];
    ends.forEach((offset, end) => {
      const at = 3 * m * frame + offset, from = [...this.line.slice(at, at + 3)];
      const q = this.frames.slice(8 * frame + 4 * end, 8 * frame + 4 * end + 4);
      axesOf(q).forEach((axis, k) =>
        this.stroke(from, from.map((v, i) => v + 0.06 * this.size * axis[i]), AXES[k], 2.5));
    });
  }
}

// ---- plots ----------------------------------------------------------------------------------

/** SVG of one plot, and where its times lie: left and right edge, first and last time. */
function plotSvg(plot, first, last, names = [], shades = []) {
  const [width, height, left, right, top, bottom] = [1000, 150, 70, 985, 22, 128];
  const time = floats(plot.time), rows = plot.values.map((v) => floats(v.values));
  const [low, high] = plot.limits;
  const x = (t) => left + (right - left) * (t - first) / (last - first || 1);
  const y = (v) => bottom - (bottom - top) * (v - low) / (high - low);
  const parts = [`<text x="${left}" y="14" font-size="13">${plot.title}</text>`];
  const step = round((high - low) / 4);
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
    const label = Number((Math.abs(v) < step / 2 ? 0 : v).toPrecision(4));
    parts.push(`<path d="M${left} ${y(v).toFixed(1)}H${right}" stroke="#e4e7eb"/>`,
      `<text x="${left - 6}" y="${(y(v) + 4).toFixed(1)}" font-size="11" fill="#666" text-anchor="end">${label}</text>`);
  }
  const second = round((last - first || 1) / 8);
  for (let t = Math.ceil(first / second) * second; t <= last * (1 + 1e-9); t += second) {
    parts.push(`<text x="${x(t).toFixed(1)}" y="${bottom + 15}" font-size="11" fill="#666" text-anchor="middle">${Number(t.toPrecision(4))}</text>`);
  }
  const named = plot.values.map((v) => names.indexOf(v.name));
  const colors = rows.length < 2 ? ["#444"] : named.includes(-1) ? AXES : named.map((k) => shades[k % shades.length]);
  rows.forEach((row, k) => {
    const points = Array.from(row, (v, i) => `${x(time[i]).toFixed(1)},${y(v).toFixed(1)}`);
    parts.push(`<polyline points="${points.join(" ")}" fill="none" stroke="${colors[k % colors.length]}" stroke-width="1.5"/>`);
    if (rows.length > 1) parts.push(
      `<text x="${right - 60 * (rows.length - 1 - k)}" y="14" font-size="12" text-anchor="end" fill="${colors[k % colors.length]}">${plot.values[k].name}</text>`);
  });
  parts.push(`<path class="now" d="M0 ${top}V${bottom}" stroke="#222" stroke-dasharray="3 3"/>`);
  return {svg: `<svg viewBox="0 0 ${width} ${height}">${parts.join("")}</svg>`, x, left, right, width};
}

// ---- the page -------------------------------------------------------------------------------

/** Puts the run into the page and lets the controls move it. */
function start(document, run) {
  const get = (id) => document.getElementById(id);
  const time = floats(run.time), first = time[0], last = time[time.length - 1];
  const view = new View(get("view"), run);
  let now = first, playing = false, drawn = 0;

  const plots = run.plots.map((plot) => {
    const made = plotSvg(plot, first, last, run.names, run.shades.map((one) => shadeOf(one))), box = document.createElement("div");
    box.innerHTML = made.svg;
    get("plots").append(box);
    const svg = box.firstChild;
    svg.addEventListener("click", (event) => {
      const edge = svg.getBoundingClientRect();
      const x = made.width * (event.clientX - edge.left) / edge.width;
      go(first + (last - first) * (x - made.left) / (made.right - made.left));
    });
    return {line: svg.querySelector(".now"), x: made.x};
  });

  function draw() {
    view.draw(...frameAt(time, now));
    get("clock").textContent = `${now.toFixed(3)} / ${last.toFixed(3)} s`;
    get("scrub").value = now;
    for (const plot of plots) plot.line.setAttribute("transform", `translate(${plot.x(now)})`);
  }
  function go(t) {
    now = Math.min(Math.max(t, first), last);
    draw();
  }
  function play(flag) {
    playing = flag;
    get("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    if (now >= last) now = first;
    drawn = performance.now();
    requestAnimationFrame(tick);
  }
  function tick(at) {
    if (!playing) return;
    const elapsed = Math.max(at - drawn, 0) * 1e-3 * Number(get("speed").value);
    drawn = at;
    go(now + elapsed);
    if (now >= last) play(false); else requestAnimationFrame(tick);
  }
  function step(frames) {
    play(false);
    const at = Math.min(Math.max(frameAt(time, now + 1e-9)[0] + frames, 0), time.length - 1);
    go(time[at]);
  }
  function recolor() {
    view.color = Number(get("color").value);
    const shown = run.colors[view.color];
    get("legend").hidden = !shown;
    get("names").hidden = Boolean(shown);
    if (shown) {
      get("low").textContent = Number(shown.low.toPrecision(3));
      get("high").textContent = Number(shown.high.toPrecision(3));
    }
    draw();
  }

  get("scrub").min = first;
  get("scrub").max = last;
  const net = run.names.length > 0;
  [...run.colors.map((c) => c.title), net ? "by cable" : "one colour"].forEach((title, k) => {
    const option = document.createElement("option");
    option.value = k;
    option.textContent = title;
    get("color").append(option);
  });
  if (net) get("color").value = run.colors.length;
  run.names.forEach((name, k) => {
    const label = document.createElement("b");
    label.textContent = `${name} `;
    label.style.color = view.cables[k].color;
    get("names").append(label);
  });
  const bar = get("bar").getContext("2d");
  for (let k = 0; k < 140; k++) {
    bar.fillStyle = colorOf(run.scale, k / 139);
    bar.fillRect(k, 0, 1, 10);
  }
  get("play").onclick = () => play(!playing);
  get("scrub").oninput = (event) => { play(false); go(Number(event.target.value)); };
  get("color").onchange = recolor;
  get("points").onchange = (event) => { view.points = event.target.checked; draw(); };
  get("path").onchange = (event) => { view.path = event.target.checked; draw(); };
  get("home").onclick = () => { view.home(); draw(); };

  const canvas = get("view");
  canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = (event) => {
    if (!event.buttons) return;
    if (event.shiftKey || event.buttons === 2) view.camera.move(event.movementX, event.movementY, view.height);
    else view.camera.turn(event.movementX, event.movementY);
    draw();
  };
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.camera.zoom(Math.exp(1e-3 * event.deltaY));
    draw();
  }, {passive: false});
  document.addEventListener("keydown", (event) => {
    const actions = {
      " ": () => play(!playing),
      ArrowRight: () => step(event.shiftKey ? 10 : 1),
      ArrowLeft: () => step(event.shiftKey ? -10 : -1),
      Home: () => go(first),
      End: () => go(last),
    };
    if (["SELECT", "INPUT", "BUTTON"].includes(event.target.tagName) && event.target.type !== "range") return;
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  window.addEventListener("resize", draw);
  recolor();
}

start(document, JSON.parse(document.getElementById("run").textContent));
