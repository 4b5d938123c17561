// Shows a run that is given: its scene at a time, its energy error, a slider.
"use strict";
(async () => {
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const byId = (id) => document.getElementById(id);
  const { between, clamp, colour, fit, listBodies, pointOf, round125, sceneOn, style } = drawing;
  const SECONDS = 12;       // in which the whole run is shown to begin with

  // ------------------------------------------------------------ the run

  const floats = (text) =>
    new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const t = floats(scene.t), energy = floats(scene.energy), last = t.length - 1;
  const impacts = floats(scene.impacts);  // their times
  const end = t[last] || 1;
  const bodies = scene.bodies.map((body, i) => ({
    ...body, q: floats(body.q), x: floats(body.x), shown: true, colour: colour(i),
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

  function poseOf(body, i) {
    const k = body.x.length > 3 ? 3 * i : 0;
    return {
      q: Array.from(body.q.subarray(4 * i, 4 * i + 4)),
      x: [body.x[k], body.x[k + 1], body.x[k + 2]],
    };
  }

  const traces = bodies.map((body) => {
    const path = new Float32Array(3 * t.length);
    for (let i = 0; i <= last; i++) path.set(pointOf(poseOf(body, i), body.tip), 3 * i);
    return { count: 0, at: (i) => [path[3 * i], path[3 * i + 1], path[3 * i + 2]] };
  });
  const samples = [];
  for (let i = 0; i <= last; i += Math.max(1, last >> 8))
    samples.push(bodies.map((body) => poseOf(body, i)));

  // ------------------------------------------------------------ pictures

  let time = 0, playing = false, stale = true;
  const redraw = () => { stale = true; };
  const chart = byId("energy"), ink = chart.getContext("2d");
  const space = sceneOn(byId("space"), bodies, scene.ties, scene.up, redraw,
    { ground: scene.ground, hasFloor: scene.gravity,
      meshes: await solids.decodedAll(scene.meshes) });
  space.show(samples);
  byId("glass").checked = bodies.some((body) => body.inside)
    && !(scene.shape === "auto" && bodies.some((body) => body.shapes.length));

  function drawChart([at, s, next]) {
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
    for (const e of height < 90 ? [least, most] : [least, (least + most) / 2, most])
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
    ink.strokeStyle = style.mark;
    ink.beginPath();
    for (const at of impacts) {
      ink.moveTo(across(at), bottom);
      ink.lineTo(across(at), bottom - 7);
    }
    ink.stroke();
    const here = energy[at] + s * (energy[next] - energy[at]);
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
    const now = frameAt(time), [low, s, high] = now;
    for (const trace of traces) trace.count = low + 1;
    space.draw(bodies.map((body) => between(poseOf(body, low), poseOf(body, high), s)),
      byId("traces").checked ? traces : null, byId("shape").value, byId("glass").checked);
    drawChart(now);
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
    byId(id).addEventListener("change", redraw);
  document.addEventListener("keydown", (event) => {
    if (event.key === " " && !/BUTTON|SELECT|INPUT/.test(event.target.tagName)) {
      event.preventDefault();
      go(!playing);
    }
  });
  listBodies(byId("bodies"), bodies, redraw);
  for (const remark of scene.remarks) {
    const line = document.createElement("p");
    line.textContent = remark;
    byId("remarks").append(line);
  }

  const pick = (event) => {
    if (event.buttons !== 1) return;
    const box = chart.getBoundingClientRect();
    go(false);
    seek(end * clamp((event.clientX - box.left - 62) / (box.width - 70), 0, 1));
  };
  chart.addEventListener("pointerdown", pick);
  chart.addEventListener("pointermove", pick);
  drawing.watch(redraw);
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
