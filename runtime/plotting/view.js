// Draws a scene of bodies and joints on a canvas: every face, line and dot, far ones first.
"use strict";
(() => {
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const byId = (id) => document.getElementById(id);
  const COLOURS = ["#4c78a8", "#f58518", "#54a24b", "#e45756", "#2f9e99", "#b279a2", "#c9a227",
    "#9d755d", "#7f7f8f", "#e377a2"];
  const TRACE_PARTS = 300;  // segments of a body's trace
  const SECONDS = 12;       // in which the whole run is shown to begin with

  // ------------------------------------------------------------ numbers

  const floats = (text) =>
    new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => times(1 / (Math.hypot(...a) || 1), a);
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

  /** The number 1, 2 or 5 times a power of ten that is nearest below. */
  function round125(x) {
    const power = 10 ** Math.floor(Math.log10(x));
    return power * (x / power >= 5 ? 5 : x / power >= 2 ? 2 : 1);
  }

  /** R(q) v, body to space axes, q scalar first. */
  function turn(q, v) {
    const u = [q[1], q[2], q[3]], w = cross(u, v);
    return add(v, times(2, add(times(q[0], w), cross(u, w))));
  }

  /** The attitude between two, on the shortest way. */
  function slerp(a, b, s) {
    let c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    const sign = c < 0 ? -1 : 1;
    c = Math.min(c * sign, 1);
    const angle = Math.acos(c), sine = Math.sin(angle);
    const [f, g] = sine < 1e-4 ? [1 - s, s] : [Math.sin((1 - s) * angle) / sine,
      Math.sin(s * angle) / sine];
    return a.map((x, i) => f * x + sign * g * b[i]);
  }

  // ------------------------------------------------------------ the run

  const t = floats(scene.t), energy = floats(scene.energy), last = t.length - 1;
  const end = t[last] || 1;
  const bodies = scene.bodies.map((body, i) => ({
    ...body, q: floats(body.q), x: floats(body.x), shown: true,
    colour: COLOURS[i % COLOURS.length].match(/\w\w/g).map((two) => parseInt(two, 16)),
  }));

  /** Number of the frame before a time, and how far on it is to the next. */
  function frameAt(time) {
    const s = time / end;
    let low = 0, high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] / end <= s) low = middle; else high = middle;
    }
    const step = t[high] - t[low];
    return [low, step ? clamp((time - t[low]) / step, 0, 1) : 0, high];
  }

  function poseAt(body, low, s, high) {
    const quaternion = (i) => Array.from(body.q.subarray(4 * i, 4 * i + 4));
    const place = (i) => {
      const k = body.x.length > 3 ? 3 * i : 0;
      return [body.x[k], body.x[k + 1], body.x[k + 2]];
    };
    const from = place(low);
    return {
      q: slerp(quaternion(low), quaternion(high), s),
      x: add(from, times(s, minus(place(high), from))),
    };
  }

  const pointOf = (pose, r) => add(pose.x, turn(pose.q, r));

  for (const body of bodies) {
    body.path = new Float32Array(3 * t.length);
    for (let i = 0; i <= last; i++) body.path.set(pointOf(poseAt(body, i, 0, i), body.tip), 3 * i);
  }

  // A body whose middle is inside a larger one's box is not seen unless that is of glass.
  const holds = (outer, inner) => {
    const pose = poseAt(outer, 0, 0, 0), middle = pointOf(poseAt(inner, 0, 0, 0), inner.centre);
    const r = minus(middle, pointOf(pose, outer.centre));
    return Math.max(...inner.sizes.box) < Math.max(...outer.sizes.box)
      && outer.axes.every((e, k) => Math.abs(dot(turn(pose.q, e), r)) < outer.sizes.box[k]);
  };
  for (const body of bodies) {
    body.inside = bodies.some((other) => holds(other, body))
      && !bodies.some((other) => holds(body, other));
    if (body.inside) byId("glass").checked = true;
  }

  // ------------------------------------------------------------ the view

  const up = scene.up;
  const first = Math.abs(up[0]) < 0.9 ? unit(minus([1, 0, 0], times(up[0], up))) : [0, 1, 0];
  const second = cross(up, first);
  /** How far a body's box reaches from its middle along the axes of space. */
  const reachOf = (body, pose) => body.axes.map((e) => turn(pose.q, e)).reduce(
    (sum, e, k) => sum.map((x, j) => x + body.sizes.box[k] * Math.abs(e[j])), [0, 0, 0]);
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const wander = [[Infinity, -Infinity], [Infinity, -Infinity]];
  for (const body of bodies) {
    for (let i = 0; i <= last; i += Math.max(1, last >> 8)) {
      const pose = poseAt(body, i, 0, i), middle = pointOf(pose, body.centre);
      const reach = reachOf(body, pose);
      const tip = [body.path[3 * i], body.path[3 * i + 1], body.path[3 * i + 2]];
      for (let j = 0; j < 3; j++) {
        low[j] = Math.min(low[j], middle[j] - reach[j], tip[j]);
        high[j] = Math.max(high[j], middle[j] + reach[j], tip[j]);
      }
      [first, second].forEach((e, j) => {
        wander[j][0] = Math.min(wander[j][0], dot(e, tip));
        wander[j][1] = Math.max(wander[j][1], dot(e, tip));
      });
    }
  }
  const target = times(0.5, add(low, high));
  const radius = 0.5 * Math.hypot(...minus(high, low)) || 1;
  const floor = dot(up, target) - Math.abs(dot(up, times(0.5, minus(high, low))));
  const spread = wander.map(([from, to]) => to - from);
  // A motion in a plane is seen from before it.
  const flat = spread[1] < 0.02 * radius && spread[0] > 0.02 * radius ? -1.25
    : spread[0] < 0.02 * radius && spread[1] > 0.02 * radius ? 0.3 : -1.05;
  const eye = { azimuth: flat, elevation: 0.3, nearness: 1 };

  // Half the width and height of what the first view sees, nearer parts larger.
  const frame = (() => {
    const back = add(times(Math.cos(eye.elevation), add(times(Math.cos(eye.azimuth), first),
      times(Math.sin(eye.azimuth), second))), times(Math.sin(eye.elevation), up));
    const right = unit(cross(up, back)), over = cross(back, right);
    const half = [0.05 * radius, 0.05 * radius];
    for (let corner = 0; corner < 8; corner++) {
      const r = minus([0, 1, 2].map((j) => (corner >> j & 1 ? high[j] : low[j])), target);
      const nearer = 1 / (1 - dot(r, back) / (3.6 * radius));
      half[0] = Math.max(half[0], nearer * Math.abs(dot(r, right)));
      half[1] = Math.max(half[1], nearer * Math.abs(dot(r, over)));
    }
    return half;
  })();

  const canvas = byId("space"), pen = canvas.getContext("2d");
  const chart = byId("energy"), ink = chart.getContext("2d");
  let style = {};
  function readStyle() {
    const computed = getComputedStyle(document.documentElement);
    for (const name of ["ink", "faint", "line", "grid", "mark", "sky"])
      style[name] = computed.getPropertyValue(`--${name}`).trim();
  }

  /** What projects a point of space to the canvas: [across, down, depth]. */
  function camera(width, height) {
    const { azimuth, elevation, nearness } = eye;
    const flatly = add(times(Math.cos(azimuth), first), times(Math.sin(azimuth), second));
    const back = add(times(Math.cos(elevation), flatly), times(Math.sin(elevation), up));
    const right = unit(cross(up, back)), over = cross(back, right), away = 3.6 * radius;
    const zoom = away * nearness * Math.min(0.44 * width / frame[0], 0.44 * height / frame[1]);
    const light = unit(add(add(times(0.35, right), times(0.75, over)), times(0.6, back)));
    return {
      light, back, eyeAt: add(target, times(away, back)),
      project(point) {
        const r = minus(point, target), depth = Math.max(away - dot(r, back), 0.02 * radius);
        const scale = zoom / depth;
        return [width / 2 + scale * dot(r, right), height / 2 - scale * dot(r, over), depth];
      },
    };
  }

  // ------------------------------------------------------------ shapes

  const CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]];

  /** The faces of a box in units of its half edges: [corners, normal, lighter]. */
  const BOX = [0, 1, 2].flatMap((k) => [-1, 1].map((side) => {
    const at = (u, v) => {
      const p = [0, 0, 0];
      p[k] = side; p[(k + 1) % 3] = side * u; p[(k + 2) % 3] = v;
      return p;
    };
    const normal = [0, 0, 0];
    normal[k] = side;
    return [CORNERS.map(([u, v]) => at(u, v)), normal, k === 0 && side > 0];
  }));

  /** The faces of a sphere, in quarters that differ, so that turning is seen. */
  const SPHERE = (() => {
    const faces = [], rings = 10, around = 20;
    const at = (i, j) => {
      const theta = Math.PI * i / rings, phi = 2 * Math.PI * j / around;
      return [Math.sin(theta) * Math.cos(phi), Math.sin(theta) * Math.sin(phi), Math.cos(theta)];
    };
    for (let i = 0; i < rings; i++) for (let j = 0; j < around; j++) {
      const corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
      const middle = at(i + 0.5, j + 0.5);
      faces.push([corners, middle, Math.floor(4 * j / around) % 2 === 0]);
    }
    return faces;
  })();

  function drawBody(body, pose, view, items) {
    const glass = byId("glass").checked && !body.inside;
    const kind = byId("shape").value, half = body.sizes[kind], [e1, e2, e3] = body.axes;
    const axes = [e1, e2, e3].map((e) => turn(pose.q, e)), middle = pointOf(pose, body.centre);
    const place = (p) => add(middle, add(add(times(p[0] * half[0], axes[0]),
      times(p[1] * half[1], axes[1])), times(p[2] * half[2], axes[2])));
    for (const [corners, n, lighter] of kind === "box" ? BOX : SPHERE) {
      const normal = unit(add(add(times(n[0] / half[0], axes[0]), times(n[1] / half[1], axes[1])),
        times(n[2] / half[2], axes[2])));
      const points = corners.map(place);
      const centre = times(0.25, add(add(points[0], points[1]), add(points[2], points[3])));
      if (dot(normal, minus(view.eyeAt, centre)) <= 0) continue;
      const bright = 0.5 + 0.5 * Math.max(0, dot(normal, view.light));
      const rgb = body.colour.map((x) => Math.round((lighter ? x + 0.42 * (255 - x) : x) * bright));
      const colour = `rgb(${rgb})`, flat = points.map(view.project);
      items.push([view.project(centre)[2], () => {
        pen.beginPath();
        flat.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        pen.closePath();
        pen.fillStyle = pen.strokeStyle = colour;
        pen.lineWidth = glass ? 1.2 : 0.8;
        pen.globalAlpha = glass ? 0.35 : 1;
        pen.fill();
        pen.globalAlpha = 1;
        pen.stroke();
      }]);
    }
  }

  function line(from, to, view, items, colour, width, alpha = 1) {
    const a = view.project(from), b = view.project(to);
    items.push([(a[2] + b[2]) / 2, () => {
      pen.globalAlpha = alpha;
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      pen.stroke();
      pen.globalAlpha = 1;
    }]);
  }

  function dotAt(point, view, items, colour, size) {
    const [x, y, depth] = view.project(point);
    items.push([depth - 0.05 * radius, () => {
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(x, y, size, 0, 2 * Math.PI);
      pen.fill();
    }]);
  }

  function drawTie(tie, poses, view, items) {
    const pose = (i) => (i < 0 ? { q: [1, 0, 0, 0], x: [0, 0, 0] } : poses[i]);
    const from = pointOf(pose(tie.a), tie.onA), to = pointOf(pose(tie.b), tie.onB);
    if (tie.kind === "rod") line(from, to, view, items, style.ink, 2.5);
    if (tie.kind === "spring") {
      const along = minus(to, from), side = times(0.03 * radius, unit(cross(along, view.back)));
      let before = from;
      for (let k = 1; k <= 16; k++) {
        const sway = k === 16 ? 0 : k % 2 ? 1 : -1;
        const next = add(add(from, times(k / 16, along)), times(sway, side));
        line(before, next, view, items, style.faint, 1.5);
        before = next;
      }
    }
    if (tie.kind === "hinge") {
      const axis = times(0.13 * radius, turn(pose(tie.b).q, tie.axis));
      line(minus(to, axis), add(to, axis), view, items, style.ink, 2.5);
    }
    dotAt(to, view, items, style.ink, tie.kind === "spring" ? 2.5 : 4);
    if (tie.kind === "rod" || tie.kind === "spring") dotAt(from, view, items, style.ink, 2.5);
  }

  function drawTrace(body, now, pose, view, items) {
    const begin = Math.max(0, now - 2000);
    const stride = Math.max(1, Math.ceil((now - begin) / TRACE_PARTS));
    const at = (i) => [body.path[3 * i], body.path[3 * i + 1], body.path[3 * i + 2]];
    const colour = `rgb(${body.colour})`;
    let before = pointOf(pose, body.tip);
    for (let i = now; i >= begin; i -= stride) {
      line(before, at(i), view, items, colour, 1.6, 0.25 + 0.75 * (i - begin) / (now - begin || 1));
      before = at(i);
    }
  }

  /** Lines of the floor, and the axes of space. */
  function drawSpace(view, items, width, height) {
    const cell = round125(0.5 * radius), count = Math.ceil(1.6 * radius / cell);
    const flatTarget = minus(target, times(dot(up, target) - floor, up));
    const snapped = [first, second].map((e) => Math.round(dot(e, flatTarget) / cell) * cell);
    const base = add(add(times(snapped[0], first), times(snapped[1], second)), times(floor, up));
    pen.strokeStyle = style.grid;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let i = -count; i <= count; i++) for (const [e, f] of [[first, second], [second, first]]) {
      const middle = add(base, times(i * cell, e)), whole = times(count * cell, f);
      const [a, b] = [view.project(minus(middle, whole)), view.project(add(middle, whole))];
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
    }
    pen.stroke();
    pen.fillStyle = style.faint;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillText(`floor: ${Number(cell.toPrecision(2))} m a line`, 10, height - 10);
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((e, k) => {
      const tip = times(0.4 * radius, e), [x, y] = view.project(times(1.12, tip));
      line([0, 0, 0], tip, view, items, style.faint, 1.2);
      items.push([0, () => {
        pen.fillStyle = style.faint;
        pen.textAlign = "center";
        pen.fillText("xyz"[k], x, y + 4);
      }]);
    });
  }

  // ------------------------------------------------------------ pictures

  let time = 0, playing = false, stale = true;

  function fit(board, context) {
    const density = window.devicePixelRatio || 1, box = board.getBoundingClientRect();
    const [width, height] = [Math.round(box.width * density), Math.round(box.height * density)];
    if (board.width !== width) board.width = width;
    if (board.height !== height) board.height = height;
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, box.width, box.height);
    return [box.width, box.height];
  }

  function drawScene() {
    const [width, height] = fit(canvas, pen), view = camera(width, height), items = [];
    const now = frameAt(time), poses = bodies.map((body) => poseAt(body, ...now));
    pen.lineJoin = pen.lineCap = "round";
    drawSpace(view, items, width, height);
    bodies.forEach((body, i) => {
      if (!body.shown) return;
      drawBody(body, poses[i], view, items);
      if (byId("traces").checked) drawTrace(body, now[0], poses[i], view, items);
    });
    for (const tie of scene.ties) drawTie(tie, poses, view, items);
    items.sort((a, b) => b[0] - a[0]);
    for (const [, draw] of items) draw();
  }

  function drawChart() {
    const [width, height] = fit(chart, ink), left = 62, right = width - 8, top = 10;
    const bottom = height - 22;
    let [least, most] = [Infinity, -Infinity];
    for (const e of energy) [least, most] = [Math.min(least, e), Math.max(most, e)];
    if (least === most) [least, most] = [least - 1e-16, most + 1e-16];
    const across = (s) => left + (right - left) * s / end;
    const down = (e) => bottom - (bottom - top) * (e - least) / (most - least);
    ink.font = "11px system-ui, sans-serif";
    ink.fillStyle = style.faint;
    ink.strokeStyle = style.line;
    ink.lineWidth = 1;
    ink.strokeRect(left, top, right - left, bottom - top);
    ink.textAlign = "right";
    for (const e of [least, (least + most) / 2, most])
      ink.fillText(e.toExponential(1), left - 5, down(e) + 4);
    ink.textAlign = "center";
    ink.fillText(`${Number(scene.start.toPrecision(4))} s`, left + 8, height - 6);
    ink.textAlign = "right";
    ink.fillText(`${Number((scene.start + end).toPrecision(4))} s`, right, height - 6);
    ink.strokeStyle = style.ink;
    ink.lineWidth = 1.1;
    ink.lineJoin = "round";
    ink.beginPath();
    const stride = Math.max(1, Math.floor(t.length / 1200));
    for (let i = 0; i <= last; i += stride)
      ink[i ? "lineTo" : "moveTo"](across(t[i]), down(energy[i]));
    ink.stroke();
    const [at, s, next] = frameAt(time), here = energy[at] + s * (energy[next] - energy[at]);
    ink.strokeStyle = ink.fillStyle = style.mark;
    ink.beginPath();
    ink.moveTo(across(time), top);
    ink.lineTo(across(time), bottom);
    ink.stroke();
    ink.beginPath();
    ink.arc(across(time), down(here), 3.5, 0, 2 * Math.PI);
    ink.fill();
  }

  function draw() {
    drawScene();
    drawChart();
    byId("time").value = time / end;
    const digits = clamp(Math.ceil(2 - Math.log10(Math.abs(end))), 0, 6);
    byId("clock").textContent =
      `${(scene.start + time).toFixed(digits)} of ${(scene.start + end).toFixed(digits)} s`;
  }

  // ------------------------------------------------------------ what one can do

  function go(on) {
    playing = on;
    byId("play").textContent = on ? "Pause" : "Play";
  }

  function seek(to) {
    time = to;
    stale = true;
  }

  const rates = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20];
  const usual = round125(Math.abs(end) / SECONDS * 1.2) * Math.sign(end);
  for (const rate of rates.map((factor) => Number((factor * usual).toPrecision(3)))) {
    byId("speed").add(new Option(`${Math.abs(rate)}×`, rate, rate === usual, rate === usual));
  }
  byId("speed").selectedIndex = rates.indexOf(1);
  byId("shape").value = scene.shape;
  byId("play").addEventListener("click", () => go(!playing));
  byId("time").addEventListener("input", (event) => { go(false); seek(event.target.value * end); });
  for (const id of ["shape", "traces", "glass"])
    byId(id).addEventListener("change", () => { stale = true; });
  document.addEventListener("keydown", (event) => {
    if (event.key === " " && !/BUTTON|SELECT|INPUT/.test(event.target.tagName)) {
      event.preventDefault();
      go(!playing);
    }
  });
  bodies.forEach((body) => {
    const label = document.createElement("label"), box = document.createElement("input");
    const swatch = document.createElement("i");
    swatch.style.background = `rgb(${body.colour})`;
    Object.assign(box, { type: "checkbox", checked: true });
    box.addEventListener("change", () => { body.shown = box.checked; stale = true; });
    label.append(box, swatch, body.name);
    byId("bodies").append(label);
  });
  for (const remark of scene.remarks) {
    const line = document.createElement("p");
    line.textContent = remark;
    byId("remarks").append(line);
  }

  function rotate(across, over) {
    eye.azimuth -= across;
    eye.elevation = clamp(eye.elevation + over, -1.5, 1.5);
    stale = true;
  }
  function nearer(factor) {
    eye.nearness = clamp(eye.nearness * factor, 0.2, 20);
    stale = true;
  }
  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const distance = fingers.size === 2 ? apart() : 0;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 1) {
      rotate(0.008 * (event.clientX - before[0]), 0.008 * (event.clientY - before[1]));
    } else if (distance) nearer(apart() / distance);
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    nearer(Math.exp(-0.0012 * event.deltaY));
  }, { passive: false });
  const KEYS = {
    ArrowLeft: [-0.08, 0], ArrowRight: [0.08, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08],
  };
  canvas.addEventListener("keydown", (event) => {
    if (KEYS[event.key]) rotate(...KEYS[event.key]);
    else if (event.key === "+") nearer(1.15);
    else if (event.key === "-") nearer(1 / 1.15);
    else return;
    event.preventDefault();
  });
  const pick = (event) => {
    if (event.buttons !== 1) return;
    const box = chart.getBoundingClientRect();
    go(false);
    seek(end * clamp((event.clientX - box.left - 62) / (box.width - 70), 0, 1));
  };
  chart.addEventListener("pointerdown", pick);
  chart.addEventListener("pointermove", pick);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", () => { readStyle(); stale = true; });
  new ResizeObserver(() => { stale = true; }).observe(document.body);

  readStyle();
  // page.html#t=1.5 opens at that time and waits.
  const wanted = /^#t=([-+.\deE]+)$/.exec(window.location.hash);
  if (wanted) seek(end * clamp((Number(wanted[1]) - scene.start) / end, 0, 1));
  go(!wanted && !window.matchMedia("(prefers-reduced-motion: reduce)").matches && last > 0);
  let before = 0;
  function tick(now) {
    const passed = Math.min((now - before) / 1000, 0.1);
    before = now;
    if (playing) {
      const next = time + passed * Number(byId("speed").value);
      seek(next / end > 1 ? 0 : next);
    }
    if (stale) {
      stale = false;
      draw();
    }
    requestAnimationFrame(tick);
  }
  requestAnimationFrame(tick);
})();
