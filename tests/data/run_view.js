// Runs the script of a page with a canvas that counts: node run_view.js PAGE, prints JSON.
"use strict";
const fs = require("fs");
const page = fs.readFileSync(process.argv[2], "utf8");
const between = (from, to) => page.split(from)[1].split(to)[0];
const scene = between('<script type="application/json" id="scene">', "</script>");
const scripts = page.split("<script>\n").slice(1).map((text) => text.split("</script>")[0]);
const counts = { fill: 0, stroke: 0, bad: 0, texts: [] };
const gl = require("./fake_webgl.js")(counts);
const listeners = {};
const pen = new Proxy({}, {
  get: (own, name) => own[name] ?? ((...values) => {
    if (values.some((x) => typeof x === "number" && !Number.isFinite(x))) counts.bad += 1;
    if (name in counts) counts[name] += 1;
  }),
  set: (own, name, value) => { own[name] = value; return true; },
});
const made = {};
function element(id) {
  made[id] ??= {
    id, value: id === "shape" ? "auto" : "0", checked: id === "traces", textContent: id === "scene" ? scene : "",
    style: {}, options: [], width: 0, height: 0,
    getContext: (kind) => ({ "2d": pen, webgl2: gl }[kind] ?? null), before() {},
    getBoundingClientRect: () => ({ left: 0, width: 800, height: 500 }),
    addEventListener: (name, act) => { listeners[`${id}.${name}`] = act; },
    add(option) { this.options.push(option); }, append() {}, setPointerCapture() {},
  };
  return made[id];
}
global.document = {
  getElementById: element, createElement: () => element(`made${Object.keys(made).length}`),
  documentElement: {}, body: {}, addEventListener: () => {},
};
global.window = {
  devicePixelRatio: 2, location: { hash: process.argv[3] ?? "" },
  matchMedia: () => ({ matches: false, addEventListener: () => {} }),
};
global.getComputedStyle = () => ({ getPropertyValue: () => " #123456" });
global.Option = function Option(text, value) { Object.assign(this, { text, value }); };
global.ResizeObserver = class { observe() {} };
const waiting = [];
global.requestAnimationFrame = (act) => waiting.push(act);
new Function(scripts.join("\n"))();
let now = 0;
const frame = () => waiting.shift()((now += 16));
(async () => {
  for (let k = 0; k < 500 && !waiting.length; k++)
    await new Promise((go) => { setTimeout(go, 10); });
  frame();
  const said = { drawn: { ...counts.drawn }, clock: made.clock.textContent };
  made.shape.value = "ellipsoid";
  listeners["shape.change"]();
  listeners["play.click"]();
  frame();
  listeners["time.input"]({ target: { value: 1 } });
  listeners["space.wheel"]({ deltaY: -100, preventDefault() {} });
  listeners["space.keydown"]({ key: "ArrowUp", preventDefault() {} });
  listeners["energy.pointerdown"]({ buttons: 1, clientX: 400 });
  frame();
  console.log(JSON.stringify({ ...said, glass: made.glass.checked, bad: counts.bad,
    speeds: made.speed.options.map((option) => option.text) }));
})();
