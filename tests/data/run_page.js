// Runs a page that integrates with a document that counts: node run_page.js PAGE [#...], prints JSON.
"use strict";
const fs = require("fs");
const page = fs.readFileSync(process.argv[2], "utf8");
const content = page.split('id="content">')[1].split("</script>")[0];
const scripts = page.split("<script>\n").slice(1).map((text) => text.split("</script>")[0]);
const counts = { fill: 0, bad: 0 };
const gl = require("./fake_webgl.js")(counts);
const pen = new Proxy({}, {
  get: (own, name) => own[name] ?? ((...values) => {
    if (values.some((x) => typeof x === "number" && !Number.isFinite(x))) counts.bad += 1;
    if (name in counts) counts[name] += 1;
    return { width: 10 };
  }),
  set: (own, name, value) => { own[name] = value; return true; },
});
const made = {};
class Element {
  constructor(id) {
    Object.assign(this, { id, checked: id === "traces", textContent: id === "content" ? content : "",
      style: {}, options: [], listeners: {}, selectedIndex: 0, box: "0" });
  }
  get value() {
    return this.id === "shape" ? "auto" : this.options[this.selectedIndex]?.value ?? this.box;
  }
  set value(x) { this.box = String(x); }
  get selectedOptions() { return [this.options[this.selectedIndex]]; }
  getContext(kind) { return { "2d": pen, webgl2: gl }[kind] ?? null; }
  before() {}
  getBoundingClientRect() { return { left: 0, width: 800, height: 500 }; }
  addEventListener(name, act) { this.listeners[name] = act; }
  add(option) { this.options.push(option); }
  replaceChildren(...options) { this.options = options; }
  append() {}
  setAttribute(name, value) { this[name] = value; }
  fire(name) { this.listeners[name]({ target: this, preventDefault() {} }); }
}
const element = (id) => (made[id] ??= new Element(id));
global.document = {
  getElementById: element, createElement: () => new Element(""), documentElement: {}, body: {},
  addEventListener() {},
};
global.location = { protocol: "file:", hash: process.argv[3] ?? "" };
global.history = { replaceState(state, title, hash) { location.hash = hash; } };
global.window = {
  devicePixelRatio: 1, addEventListener() {},
  matchMedia: () => ({ matches: false, addEventListener() {} }),
};
global.getComputedStyle = () => ({ getPropertyValue: () => " #123456" });
global.Option = function Option(text, value) { Object.assign(this, { text, value: String(value) }); };
global.ResizeObserver = class { observe() {} };
const waiting = [];
global.requestAnimationFrame = (act) => waiting.push(act);
let now = 0;
const frames = (count) => { while (count--) waiting.shift()((now += 16)); };
new Function(scripts.join("\n"))();
(async () => {
  for (let k = 0; k < 500 && !window.simulation; k++) await new Promise((go) => { setTimeout(go, 10); });
  const { shapes, settings, stepperOf } = window.simulation;
  const stepper = stepperOf(Number(made.scheme.value));
  const bits = Buffer.concat([stepper.q, stepper.p].map(
    (x) => Buffer.from(x.slice().buffer))).toString("hex");
  const said = { bits, q: [...stepper.q], p: [...stepper.p], hash: location.hash, shapes };
  frames(60);
  Object.assign(said, { steps: stepper.steps, drawn: counts.drawn,
    clock: made.clock.textContent, notice: made.notice.textContent, speed: made.speed.value });
  if (process.argv[3]) return console.log(JSON.stringify(said));  // an address alone is looked at
  made.again.fire("click");
  made.play.fire("click");
  frames(10);
  said.paused = stepper.steps;
  made.play.fire("click");
  for (const one of [...settings.values()].slice(0, 5)) {
    one.slider.value = 20;
    one.slider.fire("input");
    one.slider.fire("change");
  }
  frames(10);
  said.resumed = stepper.steps;
  made.defaults.fire("click");
  frames(5);
  said.bad = counts.bad;
  console.log(JSON.stringify(said));
})();
