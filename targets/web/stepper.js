// A stepper of profile control as WebAssembly: its C functions, and the memory of one trajectory.

class Stepper {
  /**
   * @param {WebAssembly.Instance} instance - of the module
   * @param {string} name - of the stepper: its functions are `NAME_begin`, `NAME_advance`, ...
   * @param {{real: string, parameters: Object<string, number>, q: number[], p: number[],
   *   velocities: number}} start - parameters in the order of the C struct, the state, and how many
   *   velocities `NAME_start` takes, 0 where there is no such function
   */
  constructor({ exports }, name, { real, parameters, q, p, velocities }) {
    if (!exports[`${name}_work_size`]) {
      throw new Error(`Stepper "${name}" is not in the module; give a name of its schemes.`);
    }
    this.call = (what, ...values) => Number(exports[`${name}_${what}`](...values));
    const Real = real === "float" ? Float32Array : Float64Array, size = Real.BYTES_PER_ELEMENT;
    // Above the module's own memory: the arrays of each trajectory, its options, its work.
    let end = Stepper.ends.get(exports.memory) ?? exports.__heap_base.value;
    const take = (bytes) => {
      const at = Math.ceil(end / 16) * 16;
      end = at + bytes;
      return at;
    };
    const lengths = { values: Math.max(Object.keys(parameters).length, 1), q: q.length,
      p: p.length, velocity: velocities, found: 2 };
    this.at = Object.fromEntries(
      Object.entries(lengths).map(([what, length]) => [what, take(size * length)]));
    this.at.options = take(16);
    this.at.work = take(this.call("work_size"));
    Stepper.ends.set(exports.memory, end);
    const missing = end - exports.memory.buffer.byteLength;
    if (missing > 0) exports.memory.grow(Math.ceil(missing / 65536));
    // Memory that grows gets a new buffer, so the arrays are made when they are asked for.
    for (const [what, length] of Object.entries(lengths)) {
      Object.defineProperty(this, what,
        { get: () => new Real(exports.memory.buffer, this.at[what], length) });
    }
    this.setOptions = (tolerance, iterations) => {
      const view = new DataView(exports.memory.buffer, this.at.options, 16);
      view[size === 4 ? "setFloat32" : "setFloat64"](0, tolerance, true);
      view.setInt32(size, iterations, true);
    };
    this.names = Object.keys(parameters);  // C reads their values in this order
    this.parameters = { ...parameters };
    this.q.set(q);
    this.p.set(p);
    this.dt = this.steps = this.iterations = 0;
  }

  /** Writes the parameters, in any order, where C reads them; returns their address. */
  writeParameters() {
    const unknown = Object.keys(this.parameters).find((name) => !this.names.includes(name));
    const missing = this.names.find((name) => this.parameters[name] === undefined);
    if (unknown !== undefined || missing !== undefined) {
      throw new Error(`Parameter "${unknown ?? missing}" is ` +
        `${unknown === undefined ? "not given" : "unknown"}; give ${this.names.join(", ")}.`);
    }
    this.values.set(this.names.map((name) => this.parameters[name]));
    return this.at.values;
  }

  /** Makes p of q and the velocities, at these parameters; returns the status of C. */
  start() {
    return this.call("start", this.writeParameters(), this.at.q, this.at.velocity, this.at.p);
  }

  /** Makes the velocities of q and p. */
  findVelocity() {
    this.call("velocity", this.writeParameters(), this.at.q, this.at.p, this.at.velocity);
    return this.velocity;
  }

  /** Begins a trajectory at q and p with step dt; returns the status of C. */
  begin(dt, { tolerance = 0, iterations = 50 } = {}) {
    this.setOptions(tolerance, iterations);
    this.dt = dt;
    this.steps = this.iterations = 0;
    return this.call("begin", this.at.work, this.writeParameters(), this.at.options, dt, this.at.q,
      this.at.p);
  }

  /** Other parameters from the next step on; returns the status of C. */
  setParameters() {
    return this.call("set_parameters", this.at.work, this.writeParameters());
  }

  /** Takes steps until one fails; returns the last status of C: 0, or 1 where it is less exact. */
  advance(steps = 1) {
    const status = this.call("repeat", this.at.work, this.at.q, this.at.p, steps, this.at.found);
    const [done, iterations] = this.found;
    this.steps += done;
    this.iterations += iterations;
    return status;
  }

  /** H of the state, at a time. */
  energy(t = 0) {
    return this.call("energy", this.writeParameters(), t, this.at.q, this.at.p);
  }

  /** The largest |g(q)|, and |f(q, p)| of the conditions on momenta, 0 of IMS and EMS. */
  defects() {
    this.call("defects", this.at.work, this.at.q, this.at.p, this.at.found);
    return [...this.found];
  }
}
Stepper.ends = new WeakMap();  // how far the memory of a module is taken
