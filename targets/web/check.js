// Behind stepper.js: prints the bits of each stepper of stepper.wasm after the steps of about.json.
const { readFileSync } = await import("node:fs");
const { schemes, steps, start } = JSON.parse(readFileSync("about.json", "utf8"));
const { instance } = await WebAssembly.instantiate(readFileSync("stepper.wasm"));
for (const { name } of schemes) {
  const stepper = new Stepper(instance, name, start);
  stepper.begin(start.dt);
  stepper.advance(steps);
  const bytes = [stepper.q, stepper.p].map((x) => Buffer.from(x.buffer, x.byteOffset, x.byteLength));
  console.log(Buffer.concat(bytes).toString("hex"));
}
