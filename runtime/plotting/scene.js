// Draws bodies and joints in space, by WebGL below a canvas that has the labels. The pages of runs
// and the pages that integrate share it.
"use strict";
const drawing = (() => {
  const COLOURS = ["#4c78a8", "#f58518", "#54a24b", "#e45756", "#2f9e99", "#b279a2", "#c9a227",
    "#9d755d", "#7f7f8f", "#e377a2"];
  const TRACE_PARTS = 300;  // segments of a body's trace
  const MOST_SHADED = 3e5;  // corners of triangles beyond which there are no shadows
  const { add, minus, times, dot, cross, unit, combine, rgb } = solids;

  // ------------------------------------------------------------ numbers

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
  const colour = (i) => rgb(COLOURS[i % COLOURS.length]);

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

  /** The shapes of a body: as it is to be drawn, or the box or ellipsoid of its inertia. */
  function shapesOf(body, kind) {
    if (kind === "auto" && body.shapes?.length) return body.shapes;
    return [{ kind: kind === "ellipsoid" ? "sphere" : "box", centre: body.centre, axes: body.axes,
      size: body.sizes[kind === "auto" ? "box" : kind] }];
  }

  /** Units in which a length has few digits. */
  function lengthText(x) {
    const [factor, name] = x < 1e-6 ? [1e9, "nm"] : x < 1e-3 ? [1e6, "µm"] : x < 0.01 ? [1e3, "mm"]
      : x < 1 ? [100, "cm"] : x < 1e3 ? [1, "m"] : [1e-3, "km"];
    return `${Number((factor * x).toPrecision(2))} ${name}`;
  }

  /**
   * The drawing of `bodies`, each with name, colour, axes, centre, sizes of its inertia, shapes, tip
   * and shown, and of `ties` between them, on a canvas whose view a pointer and keys turn.
   *
   * Of the options `meshes` are the triangles of shapes by kind or number, `ground` shapes in space.
   * Returns `show(samples)`, which comes first, `build()` after a change of shapes, and `draw(...)`;
   * `changed` is called where there is something to draw again.
   */
  function sceneOn(canvas, bodies, ties, up, changed, options) {
    const { meshes, ground = [], hasFloor = true } = options;
    const pen = canvas.getContext("2d"), below = document.createElement("canvas");
    const painter = webgl.rendererOn(below);
    if (painter) {
      below.className = "below";
      canvas.before(below);
    }

    // ---------------------------------------------------------- solids

    const SPACE = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], INK = [88, 98, 110];
    const RAIL = [154, 161, 172];
    let built = null, drawn = [], joints = [], still = {};

    const meshOf = (shapes, own) => {
      const triangles = solids.trianglesOf(shapes, own, meshes);
      return { triangles, mesh: painter && triangles.index.length ? painter.mesh(triangles) : null };
    };

    /** Makes the faces and meshes of all bodies and joints. */
    function build(kind = built ?? "auto") {
      for (const one of [...drawn, ...drawn.map(({ glass }) => glass), ...joints, still])
        if (one?.mesh) painter.free(one.mesh);
      built = kind;
      drawn = bodies.map((body) => {
        const { triangles, mesh } = meshOf(shapesOf(body, kind), body.colour);
        const sides = kind === "auto" && body.glass ? shapesOf(body, "box") : [];
        return { mesh, glass: meshOf(sides, body.colour), count: triangles.index.length,
          isOwn: kind === "auto" && body.own,
          ends: solids.extremesOf(triangles.points) };
      });
      still = meshOf(ground, [150, 158, 166]);
      joints = ties.map((tie) => {
        if (tie.kind === "spring" || !radius) return {};
        const isRod = tie.kind === "rod", third = isRod || !tie.axis ? [0, 0, 1] : unit(tie.axis);
        const first = unit(cross(Math.abs(third[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], third));
        if (tie.slides && tie.rail) return meshOf([tie.rail(0.011 * radius)], RAIL);
        const r = (tie.kind === "ball" ? 0.032 : isRod ? 0.011 : 0.022) * radius;
        const half = tie.kind === "ball" ? 0 : isRod ? tie.reach / 2 : 0.08 * radius;
        return meshOf([{ kind: "bar", size: [r, r, half], centre: isRod ? [0, 0, 0] : tie.onB,
          axes: [first, cross(third, first), third] }], INK);
      });
    }

    // ---------------------------------------------------------- the view

    const first = Math.abs(up[0]) < 0.9 ? unit(minus([1, 0, 0], times(up[0], up))) : [0, 1, 0];
    const second = cross(up, first);
    const eye = { azimuth: null, elevation: 0.3, nearness: 1 };
    let target, radius, floor, frame;
    const SPACE_POSE = { q: [1, 0, 0, 0], x: [0, 0, 0] };
    const poseOf = (poses, i) => (i < 0 ? SPACE_POSE : poses[i]);

    /** The bar in body a along which the centre of b slides: a function of its radius. */
    function railOf(tie, samples) {
      const travels = samples.map((poses) => {
        const [a, b] = [poseOf(poses, tie.a), poseOf(poses, tie.b)];
        const way = minus(pointOf(b, bodies[tie.b]?.centre ?? tie.onB), pointOf(a, tie.onA));
        return dot(turn(b.q, tie.axis), way);
      });
      const [[w, x, y, z], b] = [poseOf(samples[0], tie.a).q, poseOf(samples[0], tie.b)];
      const along = unit(turn([w, -x, -y, -z], turn(b.q, tie.axis)));
      const [low, high] = [Math.min(...travels), Math.max(...travels)];
      const first = unit(cross(Math.abs(along[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], along));
      return (r) => ({ kind: "bar", size: [r, r, (high - low) / 2 + 12 * r], axes: [first,
        cross(along, first), along], centre: add(tie.onA, times((low + high) / 2, along)) });
    }

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
      if (!built) build();

      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      const reach = (point) => {
        for (let j = 0; j < 3; j++) {
          low[j] = Math.min(low[j], point[j]);
          high[j] = Math.max(high[j], point[j]);
        }
      };
      const extents = [[Infinity, -Infinity], [Infinity, -Infinity]];
      for (const poses of samples) bodies.forEach((body, i) => {
        const tip = pointOf(poses[i], body.tip);
        for (const end of drawn[i].ends) reach(pointOf(poses[i], end));
        reach(tip);
        [first, second].forEach((e, j) => {
          extents[j][0] = Math.min(extents[j][0], dot(e, tip));
          extents[j][1] = Math.max(extents[j][1], dot(e, tip));
        });
      });
      for (const tie of ties) {
        const [from, to] = [pointOf(poseOf(samples[0], tie.a), tie.onA),
          pointOf(poseOf(samples[0], tie.b), tie.onB)];
        reach(from);
        tie.reach = Math.hypot(...minus(to, from));
        if (tie.slides && tie.axis) tie.rail = railOf(tie, samples);
      }
      for (const end of solids.extremesOf(still.triangles.points)) reach(end);
      target = times(0.5, add(low, high));
      radius = 0.5 * Math.hypot(...minus(high, low)) || 1;
      floor = dot(up, target) - Math.abs(dot(up, times(0.5, minus(high, low))));
      const spread = extents.map(([from, to]) => to - from);
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
      build();  // joints, whose size is that of the scene
    }

    /** What projects a point of space to the canvas: [across, down, depth]. */
    function camera(width, height) {
      const { azimuth, elevation, nearness } = eye;
      const flatly = add(times(Math.cos(azimuth), first), times(Math.sin(azimuth), second));
      const back = add(times(Math.cos(elevation), flatly), times(Math.sin(elevation), up));
      const right = unit(cross(up, back)), over = cross(back, right), away = 3.6 * radius;
      const zoom = away * nearness * Math.min(0.44 * width / frame[0], 0.44 * height / frame[1]);
      const light = unit(add(add(times(0.3, right), times(0.55, over)), times(0.8, back)));
      const [near, far] = [0.2 * radius, 12 * radius], depth = (far + near) / (far - near);
      const columns = [0, 1, 2].map((k) => [2 * zoom / width * right[k],
        2 * zoom / height * over[k], -depth * back[k], -back[k]]);
      return {
        light, back, zoom, eyeAt: add(target, times(away, back)), eye: times(away, back),
        view: [...columns.flat(), 0, 0, depth * away - 2 * far * near / (far - near), away],
        plane: [...up, floor - dot(up, target)], sky: rgb(style.sky),
        project(point) {
          const r = minus(point, target), depth = Math.max(away - dot(r, back), 0.02 * radius);
          const scale = zoom / depth;
          return [width / 2 + scale * dot(r, right), height / 2 - scale * dot(r, over), depth];
        },
      };
    }

    // ---------------------------------------------------------- lines

    const mixed = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));

    /** The segments of a spring: [from, to]. */
    function springOf(from, to, view) {
      const along = minus(to, from), side = unit(cross(along, view.back));
      const other = unit(cross(along, side)), found = [];
      let before = from;
      for (let k = 1; k <= 96; k++) {
        const s = k / 96, [c, d] = [Math.cos(k * Math.PI / 6), Math.sin(k * Math.PI / 6)];
        const sway = add(times(0.03 * radius * c, side), times(0.03 * radius * d, other));
        const next = s === 1 ? to : add(add(from, times(s, along)), sway);
        found.push([before, next]);
        before = next;
      }
      return found;
    }

    /** The segments of the way of a body's tip, from its pose back: [from, to, strength]. */
    function traceOf(body, pose, { count, at }) {
      const begin = Math.max(0, count - 2000), found = [];
      const stride = Math.max(1, Math.ceil((count - begin) / TRACE_PARTS));
      let before = pointOf(pose, body.tip);
      for (let i = count - 1; i >= begin; i -= stride) {
        found.push([before, at(i), 0.25 + 0.75 * (i - begin) / (count - 1 - begin || 1)]);
        before = at(i);
      }
      return found;
    }

    /** The lines of the floor, which end in the sky: [from, to, strength, strength]; their cell. */
    function floorLines() {
      const cell = round125(0.3 * radius), count = Math.ceil(2.2 * radius / cell), lines = [];
      const flatTarget = minus(target, times(dot(up, target) - floor, up));
      const snapped = [first, second].map((e) => Math.round(dot(e, flatTarget) / cell) * cell);
      const base = add(add(times(snapped[0], first), times(snapped[1], second)), times(floor, up));
      const strength = (point) => clamp(
        1.25 - Math.hypot(...minus(point, flatTarget)) / (1.7 * radius), 0, 1);
      for (let i = -count; hasFloor && i <= count; i++) for (const [e, f] of [[first, second], [second, first]])
        for (let j = -count; j < count; j += 2) {
          const middle = add(base, times(i * cell, e));
          const [a, b] = [j, j + 2].map((k) => add(middle, times(Math.min(k, count) * cell, f)));
          if (strength(a) || strength(b)) lines.push([a, b, strength(a), strength(b)]);
        }
      return [lines, cell];
    }

    /** The text of the floor, and arrows of the axes of space. */
    function drawLabels(view, cell, height) {
      pen.fillStyle = style.faint;
      pen.font = "12px system-ui, sans-serif";
      pen.textAlign = "left";
      if (hasFloor && bodies.some((body) => body.scaled !== false))
        pen.fillText(`floor: ${lengthText(cell)} a line`, 10, height - 10);
      pen.textAlign = "center";
      SPACE.forEach((e, k) => {
        const [x, y] = view.project(times(0.45 * radius, e));
        pen.fillText("xyz"[k], x, y + 4);
      });
    }

    // ---------------------------------------------------------- WebGL

    /** The attitude that turns the third axis along a vector. */
    function towards(v) {
      const [x, y, z] = unit(v);
      if (z < -0.999999) return [0, 1, 0, 0];
      const size = Math.hypot(1 + z, x, y);
      return [(1 + z) / size, -y / size, x / size, 0];
    }

    function paint(poses, traces, seeThrough, view, size) {
      const density = window.devicePixelRatio || 1;
      painter.begin(view, ...size.map((x) => Math.round(x * density)));
      const points = [], colours = [], local = (x) => minus(x, target);
      const line = (from, to, width, tint, end = tint) => {
        const [a, b] = [local(from), local(to)], along = minus(b, a);
        const sides = [a, b].map((x) => {
          const ray = minus(view.eye, x);
          return times(0.5 * width * Math.hypot(...ray) / view.zoom, unit(cross(along, ray)));
        });
        const corners = [add(a, sides[0]), minus(a, sides[0]), add(b, sides[1]), minus(b, sides[1])];
        for (const k of [0, 1, 2, 2, 1, 3]) {
          points.push(...corners[k]);
          colours.push(...(k < 2 ? tint : end));
        }
      };
      const flush = () => {
        painter.flat(points, colours);
        points.length = colours.length = 0;
      };

      const [lines, cell] = floorLines(), paper = view.sky, grid = rgb(style.grid);
      painter.opacity(0.999);  // what lies on the floor hides nothing
      for (const [a, b, s, e] of lines)
        line(a, b, 1.2, mixed(paper, grid, s), mixed(paper, grid, e));
      flush();
      const placed = (one, pose) => one.mesh && painter.draw(one.mesh, pose.q, local(pose.x));
      const seen = bodies.map((body, i) => i).filter((i) => bodies[i].shown);
      const sun = unit(add(up, times(0.35, add(first, second))));
      const total = drawn.reduce((sum, { count }) => sum + count, 0);
      if (hasFloor && total < MOST_SHADED && dot(up, view.eye) > view.plane[3]) {
        painter.cover(mixed(paper, [0, 0, 0], 0.13), 1, times(1 / dot(sun, up), sun));
        for (const i of seen) placed(drawn[i], poses[i]);
        placed(still, SPACE_POSE);
        painter.cover([0, 0, 0], 0);
      }
      painter.opacity(1);
      const glass = seen.filter((i) => seeThrough && !bodies[i].inside);
      placed(still, SPACE_POSE);
      for (const i of seen) if (!glass.includes(i)) placed(drawn[i], poses[i]);
      painter.opacity(1, -1);
      for (const i of glass) placed(drawn[i], poses[i]);
      painter.opacity(1);

      const faint = rgb(style.faint);
      for (const e of SPACE)
        line([0, 0, 0], times(0.4 * radius, e), 1.3, faint);
      ties.forEach((tie, i) => {
        const a = poseOf(poses, tie.a), b = poseOf(poses, tie.b);
        const [from, to] = [pointOf(a, tie.onA), pointOf(b, tie.onB)];
        if (tie.kind === "spring") {
          for (const [u, v] of springOf(from, to, view)) line(u, v, 2, faint);
        } else if (tie.kind === "rod") {
          placed(joints[i], { q: towards(minus(to, from)), x: times(0.5, add(from, to)) });
        } else if (tie.slides) {
          placed(joints[i], a);
        } else if (![tie.a, tie.b].some((k) => drawn[k]?.isOwn)) {  // nearer to the eye by a little: it sits in a body
          placed(joints[i], { q: b.q, x: add(b.x, times(0.05 * radius, unit(minus(view.eyeAt, to)))) });
        }
      });
      if (traces) for (const i of seen)
        for (const [a, b, s] of traceOf(bodies[i], poses[i], traces[i]))
          line(a, b, 2, mixed(paper, bodies[i].colour, s));
      flush();
      painter.opacity(0.22, 1);
      for (const i of glass) placed(drawn[i], poses[i]);
      for (const i of seen) placed(drawn[i].glass, poses[i]);
      return cell;
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
      if (kind !== built) build(kind);
      const size = fit(canvas, pen), view = camera(...size);
      if (painter && !painter.lost) {
        drawLabels(view, paint(poses, traces, seeThrough, view, size), size[1]);
        return;
      }
      pen.fillStyle = style.ink;
      pen.font = "14px system-ui, sans-serif";
      pen.textAlign = "left";
      pen.fillText("The bodies are drawn by WebGL 2, which this browser does not have.", 12, 28);
    }

    return { build, draw, show };
  }

  return { between, clamp, colour, fit, listBodies, pointOf, round125, sceneOn, style, watch };
})();
