// Vectors; the triangles of shapes in body axes, of meshes that come with the page.
"use strict";
const solids = (() => {
  const CREASE = 0.77; // cosine of the angle beyond which an edge is sharp

  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => times(1 / (Math.hypot(...a) || 1), a);
  const combine = (x, axes) => add(add(times(x[0], axes[0]), times(x[1], axes[1])),
    times(x[2], axes[2]));

  const rgb = (text) => text.match(/\w\w/g).map((two) => parseInt(two, 16));
  const lighter = (colour, tint) => colour.map((x) => Math.round(x + 0.42 * tint * (255 - x)));

  /** The parts of a shape: [name of a solid or number of a mesh, size, centre along its axis]. */
  function partsOf({ kind, mesh, size }) {
    const widest = Math.max(size[0], size[1]), round = [size[0], size[1], widest];
    if (kind === "bar")
      return [["tube", size, 0], ["ball", round, size[2]], ["ball", round, -size[2]]];
    return [[kind === "mesh" ? mesh : kind === "disc" && size[2] < 0.6 * widest ? "wheel" : kind,
      size, 0]];
  }

  /** All triangles of shapes: {points, normals, colours, index}, of the `meshes` that they name. */
  function trianglesOf(shapes, own, meshes) {
    const points = [], normals = [], colours = [], index = [];
    for (const shape of shapes) for (const [name, size, along] of partsOf(shape)) {
      const middle = add(shape.centre, times(along, shape.axes[2]));
      const order = size[0] * size[1] * size[2] < 0 ? [0, 2, 1] : [0, 1, 2];  // mirrored
      for (const given of meshes[name] ?? []) {
        const first = points.length / 3;
        const colour = shape.colour ? rgb(shape.colour) : lighter(own, given.tint);
        for (let v = 0; v < given.points.length; v += 3) {
          const directed = (of) => combine(size.map((s, k) => of(s, v + k)), shape.axes);
          points.push(...add(middle, directed((s, i) => s * given.points[i])));
          normals.push(...unit(directed((s, i) => given.normals[i] / s))
            .map((x) => Math.round(127 * x)));
          colours.push(...colour);
        }
        for (let i = 0; i < given.index.length; i += 3)
          for (const k of order) index.push(first + given.index[i + k]);
      }
    }
    return { points, normals, colours, index };
  }

  /** The mesh that base64 of deflated numbers is, as runtime/plotting/meshes.py encodes it. */
  async function decoded({ data, low, width, vertices: n, triangles: m, tint = 0 }) {
    const packed = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new DataView(await new Response(plain).arrayBuffer());
    const points = new Float32Array(3 * n), index = new Uint32Array(3 * m);
    for (let k = 0; k < 3; k++) for (let i = 0, x = 0; i < n; i++) {
      x = (x + bytes.getUint16(2 * (k * n + i), true)) & 65535;
      points[3 * i + k] = low[k] + width[k] * x / 65535;
    }
    for (let i = 0, v = 0; i < 3 * m; i++)
      index[i] = v = (v + bytes.getUint32(6 * n + 4 * i, true)) >>> 0;
    return { ...smooth({ points, index }), tint };
  }

  /** Normals of a mesh, smooth but at sharp edges: its corners as vertices, each once. */
  function smooth({ points, index }) {
    const count = index.length / 3, normals = new Float32Array(3 * count);
    const areas = new Float32Array(count), begin = new Uint32Array(points.length / 3 + 1);
    const point = (v) => [points[3 * v], points[3 * v + 1], points[3 * v + 2]];
    for (let f = 0; f < count; f++) {
      const [a, b, c] = [0, 1, 2].map((k) => point(index[3 * f + k]));
      const n = cross(minus(b, a), minus(c, a));
      areas[f] = Math.hypot(...n);
      normals.set(unit(n), 3 * f);
    }
    for (const v of index) begin[v + 1]++;
    for (let v = 1; v < begin.length; v++) begin[v] += begin[v - 1];
    const at = begin.slice(), faces = new Uint32Array(index.length);
    index.forEach((v, i) => { faces[at[v]++] = Math.floor(i / 3); });
    const seen = new Map(), vertices = [], directions = [], corners = new Uint32Array(index.length);
    for (let i = 0; i < index.length; i++) {
      const v = index[i], f = Math.floor(i / 3), sum = [0, 0, 0];
      for (let k = begin[v]; k < begin[v + 1]; k++) {
        const g = faces[k];
        let cosine = 0;
        for (let j = 0; j < 3; j++) cosine += normals[3 * f + j] * normals[3 * g + j];
        if (cosine > CREASE) for (let j = 0; j < 3; j++) sum[j] += areas[g] * normals[3 * g + j];
      }
      const n = unit(sum).map((x) => Math.round(127 * x));
      const key = ((v * 256 + n[0] + 128) * 256 + n[1] + 128) * 256 + n[2] + 128;
      if (!seen.has(key)) {
        seen.set(key, vertices.length / 3);
        vertices.push(...point(v));
        directions.push(...n);
      }
      corners[i] = seen.get(key);
    }
    return { points: vertices, normals: directions, index: corners };
  }

  /** Meshes by name or number: of each, its parts of one tint. */
  async function decodedAll(meshes) {
    const pairs = Object.entries(meshes).map(
      async ([name, parts]) => [name, await Promise.all(parts.map(decoded))]);
    return Object.fromEntries(await Promise.all(pairs));
  }

  /** The corners of the box about points, in pairs of least and most. */
  function boundsOf(points) {
    const bounds = [[Infinity, -Infinity], [Infinity, -Infinity], [Infinity, -Infinity]];
    for (let i = 0; i < points.length; i++) {
      const b = bounds[i % 3];
      b[0] = Math.min(b[0], points[i]);
      b[1] = Math.max(b[1], points[i]);
    }
    return bounds;
  }

  /** The points that are furthest in 26 directions. */
  function extremesOf(points) {
    const found = new Set();
    for (let code = 0; points.length && code < 27; code++) {
      const [x, y, z] = [code % 3 - 1, Math.floor(code / 3) % 3 - 1, Math.floor(code / 9) - 1];
      let furthest = 0, most = -Infinity;
      for (let i = 0; i < points.length; i += 3) {
        const reach = x * points[i] + y * points[i + 1] + z * points[i + 2];
        if (reach > most) [most, furthest] = [reach, i];
      }
      found.add(furthest);
    }
    return [...found].map((i) => [points[i], points[i + 1], points[i + 2]]);
  }

  return { add, minus, times, dot, cross, unit, combine, rgb, boundsOf, decodedAll,
    extremesOf, trianglesOf };
})();
