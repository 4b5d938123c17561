// Draws bodies and joints on a canvas: every face, line and dot, far ones first. The pages of runs
// and the pages that integrate share it.
"use strict";
const drawing = (() => {
  const COLOURS = ["#4c78a8", "#f58518", "#54a24b", "#e45756", "#2f9e99", "#b279a2", "#c9a227",
    "#9d755d", "#7f7f8f", "#e377a2"];
  const TRACE_PARTS = 300;  // segments of a body's trace

  // ------------------------------------------------------------ numbers

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

  /** The pose between two: attitude `q` and place `x` of the body axes. */
  const between = (from, to, s) =>
    ({ q: slerp(from.q, to.q, s), x: add(from.x, times(s, minus(to.x, from.x))) });

  const pointOf = (pose, r) => add(pose.x, turn(pose.q, r));
  const colour = (i) => COLOURS[i % COLOURS.length].match(/\w\w/g).map((two) => parseInt(two, 16));

  // ------------------------------------------------------------ styles and canvases

  const style = {};
  function readStyle() {
    const computed = getComputedStyle(document.documentElement);
    for (const name of ["ink", "faint", "line", "grid", "mark", "sky"])
      style[name] = computed.getPropertyValue(`--${name}`).trim();
  }

  /** Reads the colours of the page, and calls `changed` when they or its size change. */
  function watch(changed) {
    readStyle();
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => { readStyle(); changed(); });
    new ResizeObserver(changed).observe(document.body);
  }

  /** Clears a canvas of the size and density of the screen: [width, height]. */
  function fit(board, context) {
    const density = window.devicePixelRatio || 1, box = board.getBoundingClientRect();
    const [width, height] = [Math.round(box.width * density), Math.round(box.height * density)];
    if (board.width !== width) board.width = width;
    if (board.height !== height) board.height = height;
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, box.width, box.height);
    return [box.width, box.height];
  }

  /** A check box, with its colour, for each body to be shown, in `list`. */
  function listBodies(list, bodies, changed) {
    for (const body of bodies) {
      const label = document.createElement("label"), box = document.createElement("input");
      const swatch = document.createElement("i");
      swatch.style.background = `rgb(${body.colour})`;
      Object.assign(box, { type: "checkbox", checked: true });
      box.addEventListener("change", () => { body.shown = box.checked; changed(); });
      label.append(box, swatch, body.name);
      list.append(label);
    }
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

  /** How far a body's box reaches from its middle along the axes of space. */
  const reachOf = (body, pose) => body.axes.map((e) => turn(pose.q, e)).reduce(
    (sum, e, k) => sum.map((x, j) => x + body.sizes.box[k] * Math.abs(e[j])), [0, 0, 0]);

  /**
   * The drawing of `bodies`, each with name, colour, axes, centre, sizes of its shapes, tip and
   * shown, and of `ties` between them, on a canvas whose view a pointer and keys turn.
   *
   * Returns `show(samples)`, which comes first, and `draw(...)`; `changed` is called where there is
   * something to draw again.
   */
  function sceneOn(canvas, bodies, ties, up, changed) {
    const pen = canvas.getContext("2d");

    // ---------------------------------------------------------- the view

    const first = Math.abs(up[0]) < 0.9 ? unit(minus([1, 0, 0], times(up[0], up))) : [0, 1, 0];
    const second = cross(up, first);
    const eye = { azimuth: null, elevation: 0.3, nearness: 1 };
    let target, radius, floor, frame;

    /** Sets a view of all `samples`, lists of poses with one for each body. */
    function show(samples) {
      // A body whose middle is inside a larger one's box is not seen unless that is of glass.
      const holds = (outer, inner) => {
        const pose = samples[0][bodies.indexOf(outer)];
        const middle = pointOf(samples[0][bodies.indexOf(inner)], inner.centre);
        const r = minus(middle, pointOf(pose, outer.centre));
        return Math.max(...inner.sizes.box) < Math.max(...outer.sizes.box)
          && outer.axes.every((e, k) => Math.abs(dot(turn(pose.q, e), r)) < outer.sizes.box[k]);
      };
      for (const body of bodies)
        body.inside = bodies.some((other) => holds(other, body))
          && !bodies.some((other) => holds(body, other));

      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      const wander = [[Infinity, -Infinity], [Infinity, -Infinity]];
      for (const poses of samples) bodies.forEach((body, i) => {
        const middle = pointOf(poses[i], body.centre), reach = reachOf(body, poses[i]);
        const tip = pointOf(poses[i], body.tip);
        for (let j = 0; j < 3; j++) {
          low[j] = Math.min(low[j], middle[j] - reach[j], tip[j]);
          high[j] = Math.max(high[j], middle[j] + reach[j], tip[j]);
        }
        [first, second].forEach((e, j) => {
          wander[j][0] = Math.min(wander[j][0], dot(e, tip));
          wander[j][1] = Math.max(wander[j][1], dot(e, tip));
        });
      });
      target = times(0.5, add(low, high));
      radius = 0.5 * Math.hypot(...minus(high, low)) || 1;
      floor = dot(up, target) - Math.abs(dot(up, times(0.5, minus(high, low))));
      const spread = wander.map(([from, to]) => to - from);
      // A motion in a plane is seen from before it.
      const flat = spread[1] < 0.02 * radius && spread[0] > 0.02 * radius ? -1.25
        : spread[0] < 0.02 * radius && spread[1] > 0.02 * radius ? 0.3 : -1.05;
      eye.azimuth ??= flat;

      // Half the width and height of what the first view sees, nearer parts larger.
      const back = add(times(Math.cos(0.3), add(times(Math.cos(flat), first),
        times(Math.sin(flat), second))), times(Math.sin(0.3), up));
      const right = unit(cross(up, back)), over = cross(back, right);
      frame = [0.05 * radius, 0.05 * radius];
      for (let corner = 0; corner < 8; corner++) {
        const r = minus([0, 1, 2].map((j) => (corner >> j & 1 ? high[j] : low[j])), target);
        const nearer = 1 / (1 - dot(r, back) / (3.6 * radius));
        frame[0] = Math.max(frame[0], nearer * Math.abs(dot(r, right)));
        frame[1] = Math.max(frame[1], nearer * Math.abs(dot(r, over)));
      }
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

    function drawBody(body, pose, view, items, kind, seeThrough) {
      const glass = seeThrough && !body.inside, half = body.sizes[kind];
      const axes = body.axes.map((e) => turn(pose.q, e)), middle = pointOf(pose, body.centre);
      const place = (p) => add(middle, add(add(times(p[0] * half[0], axes[0]),
        times(p[1] * half[1], axes[1])), times(p[2] * half[2], axes[2])));
      for (const [corners, n, lighter] of kind === "box" ? BOX : SPHERE) {
        const normal = unit(add(add(times(n[0] / half[0], axes[0]),
          times(n[1] / half[1], axes[1])), times(n[2] / half[2], axes[2])));
        const points = corners.map(place);
        const centre = times(0.25, add(add(points[0], points[1]), add(points[2], points[3])));
        if (dot(normal, minus(view.eyeAt, centre)) <= 0) continue;
        const bright = 0.5 + 0.5 * Math.max(0, dot(normal, view.light));
        const rgb = body.colour.map(
          (x) => Math.round((lighter ? x + 0.42 * (255 - x) : x) * bright));
        const fill = `rgb(${rgb})`, flat = points.map(view.project);
        items.push([view.project(centre)[2], () => {
          pen.beginPath();
          flat.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
          pen.closePath();
          pen.fillStyle = pen.strokeStyle = fill;
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

    /** The way of a body's tip: point k of `trace` of `count`, the last one before its pose. */
    function drawTrace(body, pose, { count, at }, view, items) {
      const begin = Math.max(0, count - 2000);
      const stride = Math.max(1, Math.ceil((count - begin) / TRACE_PARTS));
      const colour = `rgb(${body.colour})`;
      let before = pointOf(pose, body.tip);
      for (let i = count - 1; i >= begin; i -= stride) {
        const alpha = 0.25 + 0.75 * (i - begin) / (count - 1 - begin || 1);
        line(before, at(i), view, items, colour, 1.6, alpha);
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
      for (let i = -count; i <= count; i++) {
        for (const [e, f] of [[first, second], [second, first]]) {
          const middle = add(base, times(i * cell, e)), whole = times(count * cell, f);
          const [a, b] = [view.project(minus(middle, whole)), view.project(add(middle, whole))];
          pen.moveTo(a[0], a[1]);
          pen.lineTo(b[0], b[1]);
        }
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

    // ---------------------------------------------------------- pointer and keys

    function rotate(across, over) {
      eye.azimuth -= across;
      eye.elevation = clamp(eye.elevation + over, -1.5, 1.5);
      changed();
    }
    function nearer(factor) {
      eye.nearness = clamp(eye.nearness * factor, 0.2, 20);
      changed();
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

    /** Draws poses, one for each body, in a shape; `traces` too unless they are null. */
    function draw(poses, traces, kind, seeThrough) {
      const [width, height] = fit(canvas, pen), view = camera(width, height), items = [];
      pen.lineJoin = pen.lineCap = "round";
      drawSpace(view, items, width, height);
      bodies.forEach((body, i) => {
        if (!body.shown) return;
        drawBody(body, poses[i], view, items, kind, seeThrough);
        if (traces) drawTrace(body, poses[i], traces[i], view, items);
      });
      for (const tie of ties) drawTie(tie, poses, view, items);
      items.sort((a, b) => b[0] - a[0]);
      for (const [, draw] of items) draw();
    }

    return { draw, show };
  }

  return { between, clamp, colour, fit, listBodies, pointOf, round125, sceneOn, style, watch };
})();
