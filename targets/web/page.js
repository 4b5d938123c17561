// Integrates a model while it is looked at: generated C as WebAssembly, drawn as runs are.
"use strict";
(async () => {
  const content = JSON.parse(document.getElementById("content").textContent);
  const byId = (id) => document.getElementById(id);
  const { between, clamp, colour, fit, listBodies, pointOf, round125, sceneOn, style } = drawing;
  const DEGREE = Math.PI / 180;
  const KEPT = 2000, CURVE = 700;   // points of a trace; of a curve, beyond which pairs are joined
  const PARTS = 8, BUDGET = 12;     // of a picture: points of a trace, ms of integration
  const AHEAD = [128, 32];          // parts and steps of the motion that the first view shows
  const [OK, NOT_CONVERGED, SINGULAR, NOT_FINITE, , DIVERGED, INVALID] = Array(8).keys();
  const FAILED = {
    [SINGULAR]: "the equations of the step have no unique solution",
    [NOT_FINITE]: "a number of the state is not finite any more",
    [DIVERGED]: "the iteration does not approach a solution",
    [INVALID]: "a number is outside of its domain, or the start violates the constraints",
  };

  // ------------------------------------------------------------ the stepper

  const packed = Uint8Array.from(atob(content.wasm), (c) => c.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const { instance } = await WebAssembly.instantiate(await new Response(plain).arrayBuffer());
  const steppers = content.schemes.map(() => null);
  const stepperOf = (i) => (steppers[i] ??= new Stepper(instance, content.schemes[i].name,
    content.start));
  let stepper = stepperOf(0);
  const hasVelocity = content.start.velocities > 0;
  const velocity0 = hasVelocity ? [...stepper.findVelocity()] : [];

  // ------------------------------------------------------------ settings

  /** Precession, nutation and spin of an attitude, z-x-z, in degrees. */
  function eulerOf([w, x, y, z]) {
    const sum = Math.atan2(z, w), difference = Math.atan2(y, x);
    const nutation = 2 * Math.atan2(Math.hypot(x, y), Math.hypot(w, z));
    const turns = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
    return [sum + difference, nutation, sum - difference].map((a) => turns(a) / DEGREE);
  }
  function attitudeOf(angles) {
    const [a, b, c] = angles.map((angle) => angle * DEGREE / 2);
    return [Math.cos(b) * Math.cos(a + c), Math.sin(b) * Math.cos(a - c),
      Math.sin(b) * Math.sin(a - c), Math.cos(b) * Math.sin(a + c)];
  }

  const GREEK = { gamma: "γ", alpha: "α", omega: "ω", theta: "θ", phi: "φ", psi: "ψ", mu: "μ" };
  const SMALL = "₀₁₂₃₄₅₆₇₈₉", HIGH = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const pretty = (name) => name.split("_").map((word) => GREEK[word]
    ?? word.replace(/^(\D)(\d+)$/, (all, letter, digits) => letter
      + digits.replace(/\d/g, (d) => SMALL[d]))).join(" ");
  const unitOf = (unit) => (unit ?? "").replace(/\./g, " ")
    .replace(/([a-z])(-?)(\d)/gi, (all, letter, sign, d) => letter + (sign && "⁻") + HIGH[d]);
  const shownAs = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3
    ? Number(x.toPrecision(4)).toExponential().replace("e+", "e")
    : String(Number(x.toPrecision(4)))).replaceAll("-", "−");

  /** A setting: its value moves over `reach` about `start`, on a log scale by that factor. */
  const settings = new Map();
  function setting(group, name, { text, unit, start, log = 0, reach = 0, low, high, live }) {
    settings.set(name, { group, name, text, unit, start, log, reach, low, high, live,
      value: start });
  }
  const group = (title) => (name, about) => setting(title, name, about);
  setting("", "dt", { text: "step Δt", unit: "s", start: content.start.dt, log: 40 });

  const free = !content.jointed, coordinates = content.start.q;
  for (const body of content.bodies) {
    if (!free || !hasVelocity) break;
    const add = group(content.bodies.length > 1 ? `Start: ${body.name}` : "Start");
    const angles = eulerOf(body.q.map((k) => coordinates[k]));
    ["precession", "nutation", "spin"].forEach((text, i) => add(`${body.name}.${text}`,
      { text, unit: "°", start: angles[i], low: i === 1 ? 0 : -180, high: 180 }));
  }
  if (hasVelocity && free) {
    const fastest = Math.max(...velocity0.map(Math.abs)) || 1;
    content.velocities.forEach((about, i) => {
      const { body, text, unit } = about, computed = velocity0[i];
      const start = Math.abs(computed) < 1e-12 * fastest ? 0 : computed;  // 0 but for round-off
      const title = content.bodies.length > 1 && body ? `Start: ${body}` : "Start";
      setting(title, about.name, { text, unit, start,
        reach: Math.max(1.5 * Math.abs(start), 0.3 * fastest) });
    });
  } else if (velocity0.some((v) => v !== 0)) {
    setting("Start", "velocities", { text: "all velocities", unit: "×", start: 1, low: -3,
      high: 3 });
  }
  for (const { name, domain, unit, role } of content.numbers) {
    const start = content.start.parameters[name];
    const log = start !== 0 && domain !== "real" ? 10 : 0;
    setting(role === "input" ? "Inputs" : "Parameters", name, { text: pretty(name),
      unit: unitOf(unit), start, log, reach: 2 * Math.abs(start) || 1, live: role === "input" });
  }

  const ROUGH = 100;  // positions of a slider to each side of its start
  function valueAt({ start, log, reach, low, high }, position) {
    if (position === 0) return start;
    const s = position / ROUGH;
    const value = log ? start * log ** s
      : low === undefined ? start + s * reach
        : s > 0 ? start + s * (high - start) : start - s * (low - start);
    return Number(value.toPrecision(3));
  }
  function positionOf({ start, log, reach, low, high }, value) {
    const s = log ? Math.log(value / start) / Math.log(log)
      : low === undefined ? (value - start) / reach
        : value > start ? (value - start) / (high - start) : (start - value) / (low - start);
    return Number.isFinite(s) ? clamp(Math.round(ROUGH * s), -ROUGH, ROUGH) : 0;
  }
  function tell(one) {
    const text = [shownAs(one.value), one.unit].filter(Boolean).join(" ");
    one.slider.value = positionOf(one, one.value);
    one.slider.setAttribute("aria-valuetext", text);
    one.output.textContent = text;
  }
  const groups = new Map([["", byId("method")]]);
  for (const one of settings.values()) {
    if (!groups.has(one.group)) {
      const details = document.createElement("details"), title = document.createElement("summary");
      title.textContent = one.group;
      details.open = groups.size === 1 || settings.size <= 16;
      details.append(title);
      byId("groups").append(details);
      groups.set(one.group, details);
    }
    const row = document.createElement("div"), label = document.createElement("label");
    row.className = "row";
    label.textContent = one.text;
    one.slider = document.createElement("input");
    one.output = document.createElement("output");
    Object.assign(one.slider, { type: "range", min: -ROUGH, max: ROUGH, id: `set-${one.name}` });
    label.htmlFor = one.output.htmlFor = one.slider.id;
    row.append(label, one.slider, one.output);
    groups.get(one.group).append(row);
    one.slider.addEventListener("input", () => {
      one.value = valueAt(one, Number(one.slider.value));
      tell(one);
      changed(one.live);
    });
    one.slider.addEventListener("change", () => { if (!one.live) look(); });
  }
  content.schemes.forEach(({ label }, i) => byId("scheme").add(new Option(label, i)));
  byId("scheme").addEventListener("change", () => changed(false));

  const isDefault = (one) => one.value === one.start;
  const value = (name) => settings.get(name)?.value;

  /** The state at the start of these settings, begun; says so where there is none. */
  function begin() {
    stepper = stepperOf(Number(byId("scheme").value));
    const { start } = content;
    for (const name of Object.keys(start.parameters))
      stepper.parameters[name] = value(name) ?? start.parameters[name];
    stepper.q.set(start.q);
    stepper.p.set(start.p);
    let status = OK;
    const moved = [...settings.values()].some(
      (one) => one.name !== "dt" && !one.live && !isDefault(one));
    if (hasVelocity && moved) {
      for (const body of content.bodies) {
        const angles = ["precession", "nutation", "spin"].map(
          (angle) => settings.get(`${body.name}.${angle}`));
        if (free && !angles.every(isDefault)) {
          const attitude = attitudeOf(angles.map((angle) => angle.value));
          body.q.forEach((k, i) => { stepper.q[k] = attitude[i]; });
        }
      }
      stepper.velocity.set(free ? content.velocities.map(({ name }) => value(name))
        : velocity0.map((v) => v * (value("velocities") ?? 1)));
      status = stepper.start();
    }
    return status || stepper.begin(value("dt"));
  }

  // ------------------------------------------------------------ bodies

  /** Moments of inertia and principal axes of a tensor: Jacobi's rotations. */
  function principal(tensor) {
    const A = tensor.map((row) => [...row]), V = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const least = 1e-15 * (A[0][0] + A[1][1] + A[2][2]);
    for (let round = 0; round < 12; round++) for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(A[i][j]) <= least) continue;
      const angle = 0.5 * Math.atan2(2 * A[i][j], A[j][j] - A[i][i]);
      const c = Math.cos(angle), s = Math.sin(angle);
      for (const row of A) [row[i], row[j]] = [c * row[i] - s * row[j], s * row[i] + c * row[j]];
      for (const rows of [A, V]) {
        [rows[i], rows[j]] = [rows[i].map((x, k) => c * x - s * rows[j][k]),
          rows[j].map((x, k) => s * rows[i][k] + c * x)];
      }
    }
    return [[A[0][0], A[1][1], A[2][2]], V];
  }

  /** The inverse of a symmetric matrix of entries 11, 12, 13, 22, 23, 33. */
  function inverseOf([a, b, c, d, e, f]) {
    const C = [[d * f - e * e, c * e - b * f, b * e - c * d],
      [c * e - b * f, a * f - c * c, b * c - a * e], [b * e - c * d, b * c - a * e, a * d - b * b]];
    const determinant = a * C[0][0] + b * C[0][1] + c * C[0][2];
    return C.map((row) => row.map((x) => x / determinant));
  }

  const entry = (e) => (typeof e === "string" ? stepper.parameters[e] : e);
  const FACTORS = { box: 2 / 3, ellipsoid: 2 / 5 };  // I_j + I_k − I_i = factor m a_i²

  /** The shape of a body of these parameters, as runtime/plotting/scene.py has it. */
  function shape(body) {
    const mass = body.mass === null ? null : entry(body.mass);
    const centre = body.centre.length ? body.centre.map(entry) : [0, 0, 0];
    const I = body.inertia.map(entry), square = centre.reduce((sum, x) => sum + x * x, 0);
    const J = (I.length === 3 ? I.map((x, i) => [0, 1, 2].map((j) => (i === j ? x : 0)))
      : inverseOf(I)).map((row, i) => row.map((x, j) => x
        - (mass ?? 0) * ((i === j ? square : 0) - centre[i] * centre[j])));
    const [moments, axes] = principal(J), trace = moments[0] + moments[1] + moments[2];
    let half = moments.map((x) => Math.sqrt(Math.max(trace - 2 * x, 0) / (mass ?? 1)));
    half = half.map((x) => Math.max(x, 0.03 * Math.max(...half)));
    const scale = (factor) => half.map((x) => x / (mass === null ? Math.max(...half)
      : Math.sqrt(factor)));
    const sizes = Object.fromEntries(Object.entries(FACTORS).map(([k, f]) => [k, scale(f)]));
    const moves = body.x.length || square;
    const tip = moves ? centre : [0, 0, 1.3 * Math.max(...sizes.box, ...sizes.ellipsoid)];
    Object.assign(body, { axes, sizes, tip, at: body.origin.map(entry), middle: centre });
    if (mass === null && !body.x.length && stepper.parameters.mgl)
      Object.assign(body, topOf(moments, stepper.parameters.mgl));
  }

  /** A top of these moments and m g l about its foot, as runtime/plotting/body_shapes.py has it. */
  function topOf([a, b, c], mgl) {
    const ml = mgl / 9.81, ml2 = Math.max(a + b - c, 0) / 2, mass = ml2 ? ml ** 2 / ml2 : 1;
    const [height, ...half] = [ml2, Math.max(c + b - a, 0), Math.max(c + a - b, 0)].map(
      (x) => Math.sqrt(x / mass));
    const r = Math.max(...half), up = Math.sign(mgl);
    const thick = Math.min(0.14 * r, 0.35 * height), stem = 0.05 * Math.max(r, height);
    const knob = height + Math.max(0.7 * r, 0.4 * height);
    const one = (kind, z, size, colour) => ({ kind, size, colour, centre: [0, 0, up * z],
      axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] });
    const bar = (from, to, thin) => one("bar", (from + to) / 2, [thin, thin, (to - from) / 2],
      "#575c66");
    return { tip: [0, 0, up * (height + Math.max(0.75 * r, 0.35 * height))], shapes: [
      one("disc", height, [...half, thick], ""),
      one("disc", height, [2 * stem, 2 * stem, 1.5 * thick], "#2c3038"),
      bar(2.4 * stem, knob - stem, stem), bar(0.45 * stem, 2.4 * stem, 0.45 * stem)] };
  }
  const bodies = content.bodies.map((body, i) => ({ ...body, shown: true, colour: colour(i) }));
  const shapes = bodies.map((body) => ({ ...body }));  // what is drawn: `centre` in numbers
  const ties = content.ties.map((tie) => ({ ...tie }));
  function measure() {
    bodies.forEach((body, i) => {
      shape(body);
      Object.assign(shapes[i], { ...body, centre: body.middle, shown: shapes[i].shown });
    });
    content.ties.forEach((tie, i) => ["onA", "onB", "axis"].forEach((key) => {
      ties[i][key] = tie[key] && tie[key].map(entry);
    }));
  }
  const poses = () => bodies.map((body) => ({
    q: body.q.map((k) => stepper.q[k]),
    x: body.x.length ? body.x.map((k) => stepper.q[k]) : body.at,
  }));
  function upOf(parameters) {
    const gravity = ["x", "y", "z"].map((axis) => parameters[`gravity_${axis}`] ?? 0);
    const size = Math.hypot(...gravity);
    return size ? gravity.map((x) => -x / size) : [0, 0, 1];
  }

  // ------------------------------------------------------------ the motion

  const redraw = () => { stale = true; };
  const space = sceneOn(byId("space"), shapes, ties, upOf(content.start.parameters), redraw,
    { meshes: await solids.decodedAll(content.meshes) });
  const chart = byId("errors"), ink = chart.getContext("2d");
  let stale = true, playing = false, failed = false, rate = 1, late = 0;
  let before, now, energy0, curve, joined, paths, slow;

  const notice = (text) => { byId("notice").textContent = text; };
  function go(on) {
    playing = on && !failed;
    byId("play").textContent = playing ? "Pause" : "Play";
  }

  /** Sets the view, and the usual speed, by the motion of these settings. */
  function look() {
    let status = begin(), fastest = 0;
    measure();
    const samples = [poses()];
    for (let k = 0; k < AHEAD[0] && status <= NOT_CONVERGED; k++) {
      status = stepper.advance(AHEAD[1]);
      if (status <= NOT_CONVERGED) samples.push(poses());
      if (hasVelocity) {
        const v = stepper.findVelocity();
        for (const i of content.spins) fastest = Math.max(fastest, Math.abs(v[i]));
      }
    }
    space.show(samples);
    // bodies that slide turn by round-off, less than a radian
    const ahead = AHEAD[0] * AHEAD[1] * Math.abs(value("dt"));
    const usual = round125(fastest * ahead > 1 ? 16 / fastest : ahead / 12);
    restart();
    return usual;
  }

  function restart() {
    const status = begin();
    measure();
    space.build();
    failed = status !== OK;
    notice(failed ? `There is no start with these settings: ${FAILED[status]}. `
      + "Move a slider back, or press Defaults." : "");
    before = now = poses();
    energy0 = stepper.energy();
    curve = [];
    joined = 1;
    late = slow = 0;
    paths = bodies.map((body, i) => [pointOf(now[i], body.tip)]);
    if (failed) go(false); else note();
    redraw();
  }

  const timeNow = () => stepper.steps * stepper.dt;

  /** Adds a point to the traces and to the curves, which keep the whole run. */
  function note() {
    bodies.forEach((body, i) => {
      paths[i].push(pointOf(now[i], shapes[i].tip));
      if (paths[i].length > 2 * KEPT) paths[i].splice(0, KEPT);
    });
    const errors = [Math.abs(stepper.energy(timeNow()) - energy0), ...stepper.defects()];
    const last = curve.at(-1);
    if (last && last.count < joined) {
      Object.assign(last, { t: timeNow(), count: last.count + 1,
        errors: last.errors.map((e, i) => Math.max(e, errors[i])) });
    } else curve.push({ t: timeNow(), count: 1, errors });
    if (curve.length > CURVE) {
      joined *= 2;
      curve = curve.filter((_, i) => i % 2).map((point, i) => ({ ...point, count: joined,
        errors: point.errors.map((e, k) => Math.max(e, curve[2 * i].errors[k])) }));
    }
  }

  /** Takes so many steps, the last of them alone, so that pictures between two are possible. */
  function take(steps) {
    let left = steps;
    for (const part of [steps - 1, 1]) {
      if (part <= 0) continue;
      if (left === 1) before = poses();
      const status = stepper.advance(part);
      left -= part;
      slow += status === NOT_CONVERGED;
      if (status > NOT_CONVERGED) {
        failed = true;
        go(false);
        notice(`The step at t = ${shownAs(timeNow())} s fails: ${FAILED[status]}. `
          + "Choose a shorter step, or another scheme.");
        break;
      }
    }
    now = poses();
    note();
    if (slow > 0 && !failed) {
      notice("Some steps end before the iteration reaches round-off: choose a shorter step.");
    }
  }

  function integrate(seconds) {
    const { dt } = stepper, begun = performance.now();
    late += seconds * rate;
    let steps = Math.floor(Math.abs(late / dt) + 1e-9);
    if (steps < 1) return;
    late -= steps * Math.abs(dt);
    const parts = Math.min(PARTS, steps);
    for (let part = parts; part > 0 && steps > 0 && !failed; part--) {
      let some = Math.ceil(steps / part);
      steps -= some;
      while (some > 0 && !failed) {
        const now = Math.min(some, 2000);
        take(now);
        some -= now;
        if (performance.now() - begun > BUDGET) { steps = some = 0; late = 0; }
      }
    }
  }

  // ------------------------------------------------------------ pictures

  const CURVES = [["|H − H₀| in J", "energy", []], ["|g(q)|", "constraint", [6, 3]],
    ["|f(q, p)|", "momentum", [2, 2]]].slice(0, content.curves);
  function drawErrors() {
    const [width, height] = fit(chart, ink), left = 46, right = width - 6, top = 24;
    const bottom = height - 20, low = -17;
    const computed = getComputedStyle(document.documentElement);
    const highest = Math.max(...curve.flatMap(({ errors }) => errors), 1e-12);
    const high = Math.min(Math.ceil(Math.log10(highest) + 0.3), 12);
    const down = (e) => top + (bottom - top) * (high - Math.log10(clamp(e, 10 ** low, 10 ** high)))
      / (high - low);
    const end = curve.at(-1)?.t || stepper.dt, across = (t) => left + (right - left) * t / end;
    ink.font = "11px system-ui, sans-serif";
    ink.lineWidth = 1;
    ink.textAlign = "right";
    const every = high - low > 14 ? 4 : 3;
    for (let k = Math.floor(high / every) * every; k >= low; k -= every) {
      ink.strokeStyle = style.line;
      ink.beginPath();
      ink.moveTo(left, down(10 ** k));
      ink.lineTo(right, down(10 ** k));
      ink.stroke();
      ink.fillStyle = style.faint;
      const digits = String(k).replace(/\d/g, (d) => HIGH[d]).replace("-", "⁻");
      ink.fillText(k === 0 ? "1" : `10${digits}`, left - 5, down(10 ** k) + 4);
    }
    ink.fillText(`${shownAs(end)} s`, right, height - 5);
    ink.textAlign = "left";
    ink.fillText("0 s", left, height - 5);
    let x = left;
    CURVES.forEach(([text, name, dashes], i) => {
      ink.fillStyle = ink.strokeStyle = computed.getPropertyValue(`--${name}`).trim();
      ink.lineWidth = 1.6;
      ink.setLineDash(dashes);
      ink.beginPath();
      ink.moveTo(x, 10);
      ink.lineTo(x + 20, 10);
      ink.stroke();
      ink.fillText(text, x + 25, 14);
      x += 40 + ink.measureText(text).width;
      ink.beginPath();
      curve.forEach(({ t, errors }, k) => ink[k ? "lineTo" : "moveTo"](across(t), down(errors[i])));
      ink.stroke();
      ink.setLineDash([]);
    });
  }

  function draw() {
    const s = clamp(late / Math.abs(stepper.dt), 0, 1);
    const seen = playing ? now.map((pose, i) => between(before[i], pose, s)) : now;
    const traces = byId("traces").checked ? paths.map((path) => {
      const count = Math.min(path.length - (playing ? 1 : 0), KEPT), from = path.length
        - (playing ? 1 : 0) - count;
      return { count, at: (i) => path[from + i] };
    }) : null;
    space.draw(seen, traces, byId("shape").value, byId("glass").checked);
    drawErrors();
    byId("clock").textContent = `${timeNow().toFixed(clamp(2 - Math.floor(
      Math.log10(Math.abs(stepper.dt) * 10)), 0, 6))} s`;
    const mean = stepper.iterations / (stepper.steps || 1);
    byId("numbers").textContent = `${stepper.steps.toLocaleString("en")} steps`
      + (mean ? `, ${mean.toFixed(1)} iterations a step` : "");
  }

  // ------------------------------------------------------------ what one can do

  function link() {
    const changes = new URLSearchParams();
    if (byId("scheme").selectedIndex > 0)
      changes.set("scheme", content.schemes[byId("scheme").value].label);
    for (const one of settings.values())
      if (!isDefault(one)) changes.set(one.name, one.value);
    byId("link").href = `#${changes}`;
    // A page inside another, as srcdoc, has no address of its own.
    byId("link").hidden = location.protocol === "about:";
    if (location.protocol !== "about:" && (location.hash || "#") !== `#${changes}`)
      history.replaceState(null, "", `#${changes}`);
  }
  function changed(live) {
    link();
    if (!live) restart();
    else if (!failed) {
      const former = { ...stepper.parameters };
      for (const one of settings.values()) if (one.live) stepper.parameters[one.name] = one.value;
      const status = stepper.setParameters();
      if (status !== OK) stepper.parameters = former;
      notice(status === OK ? "" : `The run keeps its former settings: ${FAILED[status]}. `
        + "Move a slider back, or press Defaults.");
    }
  }

  /** Takes the settings of an address; returns the time that it asks for, NaN for none. */
  function read(hash) {
    const unknown = [], wanted = new URLSearchParams(hash.replace(/^#/, ""));
    for (const one of settings.values()) one.value = one.start;
    byId("scheme").selectedIndex = 0;
    for (const [name, text] of wanted) {
      const one = settings.get(name), number = Number(text);
      const scheme = content.schemes.findIndex(({ label }) => label === text);
      if (name === "scheme" && scheme >= 0) byId("scheme").selectedIndex = scheme;
      else if (one && text !== "" && Number.isFinite(number)) one.value = number;
      else if (name !== "t" || !Number.isFinite(number)) unknown.push(name);
    }
    for (const one of settings.values()) tell(one);
    return [unknown, wanted.has("t") ? Number(wanted.get("t")) : NaN];
  }

  /** Begins with the settings of an address. */
  function open(hash) {
    const [unknown, until] = read(hash), usual = look();
    const rates = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].map(
      (factor) => Number((factor * usual).toPrecision(3)));
    byId("speed").replaceChildren(...rates.map((x) => new Option(`${x}×`, x)));
    byId("speed").selectedIndex = 6;
    rate = usual;
    byId("glass").checked = shapes.some((body) => body.inside && !body.shapes);
    const steps = Math.min(Math.round(until / value("dt")), 1e7);
    const part = Math.max(1, Math.ceil(steps / KEPT));
    for (let done = 0; done < steps && !failed; done += part) take(Math.min(part, steps - done));
    if (unknown.length)
      notice(`This page has no such setting, or not as a number: ${unknown.join(", ")}.`);
    go(Number.isNaN(until) && !window.matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  byId("play").addEventListener("click", () => go(!playing));
  byId("step").addEventListener("click", () => { go(false); if (!failed) take(1); redraw(); });
  byId("again").addEventListener("click", () => { look(); go(true); });
  byId("defaults").addEventListener("click", () => { open(""); link(); });
  byId("speed").addEventListener("change", () => { rate = Number(byId("speed").value); });
  for (const id of ["shape", "traces", "glass"]) byId(id).addEventListener("change", redraw);
  document.addEventListener("keydown", (event) => {
    if (event.key === " " && !/BUTTON|SELECT|INPUT|SUMMARY|^A$/.test(event.target.tagName)) {
      event.preventDefault();
      go(!playing);
    }
  });
  listBodies(byId("bodies"), shapes, redraw);
  byId("about").textContent = content.about;
  if (!content.conserves) byId("balance").textContent = "Change of energy, errors of constraints";
  window.addEventListener("hashchange", () => open(location.hash));

  drawing.watch(redraw);
  open(location.hash);
  link();
  let last = 0;
  function tick(time) {
    const passed = clamp((time - last) / 1000, 0, 0.1);
    last = time;
    if (playing) integrate(passed);
    if (playing || stale) {
      stale = false;
      draw();
    }
    requestAnimationFrame(tick);
  }
  requestAnimationFrame(tick);
  window.simulation = { content, settings, shapes, stepperOf, take };  // for tests and consoles
})();
