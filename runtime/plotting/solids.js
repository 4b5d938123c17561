// Vectors; faces of shapes and triangles of meshes, in body axes.
"use strict";
const solids = (() => {
  const AROUND = 40;   // sides of a disc
  const CREASE = 0.8;  // cosine of the angle beyond which an edge of a mesh is sharp

  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => times(1 / (Math.hypot(...a) || 1), a);
  const combine = (x, axes) => add(add(times(x[0], axes[0]), times(x[1], axes[1])),
    times(x[2], axes[2]));

  /** Faces between rows and columns of points with normals: [corners, normals, tint]. */
  function grid(rows, columns, at, tintOf) {
    const faces = [];
    for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
      const around = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
      faces.push([around.map(([point]) => point), around.map(([, normal]) => normal), tintOf(j)]);
    }
    return faces;
  }

  const circle = (j, n) => [Math.cos(2 * Math.PI * j / n), Math.sin(2 * Math.PI * j / n)];

  /** The faces of each kind of shape in units of its size, which some need: tint 1 is lighter. */
  const FACES = {
    box: () => [0, 1, 2].flatMap((k) => [-1, 1].map((side) => {
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([u, v]) => {
        const p = [0, 0, 0];
        p[k] = side; p[(k + 1) % 3] = side * u; p[(k + 2) % 3] = v;
        return p;
      });
      const normal = [0, 0, 0];
      normal[k] = side;
      return [corners, corners.map(() => normal), k === 0 && side > 0 ? 1 : 0];
    })),
    sphere: () => grid(12, 24, (i, j) => {  // in quarters that differ, so that turning is seen
      const [c, s] = circle(j, 24), theta = Math.PI * i / 12;
      const p = [Math.sin(theta) * c, Math.sin(theta) * s, Math.cos(theta)];
      return [p, p];
    }, (j) => (Math.floor(j / 6) % 2 ? 0 : 1)),
    disc: () => {
      const wall = grid(1, AROUND, (i, j) => {
        const [c, s] = circle(j, AROUND);
        return [[c, s, 1 - 2 * i], [c, s, 0]];
      }, () => 0);
      const cap = (x, r, side, tint, n) => {
        const corners = Array.from({ length: n }, (_, j) => {
          const [c, s] = circle(side * j, n);
          return [x + r * c, r * s, side * (tint ? 1.03 : 1)];
        });
        return [corners, corners.map(() => [0, 0, side]), tint];
      };
      return [...wall, ...[1, -1].flatMap((side) => [cap(0, 1, side, 0, AROUND),
        cap(0.6, 0.22, side, -1, 16), cap(-0.6, 0.22, side, -1, 16)])];
    },
    bar: ([r, , half]) => grid(9, 16, (i, j) => {  // two halves of a sphere, drawn apart
      const [c, s] = circle(j, 16), theta = Math.PI / 8 * (i < 5 ? i : i - 1);
      const [across, along] = [Math.sin(theta), Math.cos(theta)];
      return [[across * c, across * s, (i < 5 ? 1 : -1) + along * r / half],
        [across * c, across * s, along * half / r]];
    }, () => 0),
  };

  const tinted = (colour, tint) => colour.map((x) => Math.round(
    tint > 0 ? x + 0.42 * (255 - x) : tint < 0 ? 0.4 * x : x));
  const rgb = (text) => text.match(/\w\w/g).map((two) => parseInt(two, 16));

  /** The faces of shapes that are no meshes, in body axes: {corners, normals, colour}. */
  function facesOf(shapes, own) {
    return shapes.filter(({ kind }) => FACES[kind]).flatMap(({ kind, size, centre, axes, colour }) =>
      FACES[kind](size).map(([corners, normals, tint]) => ({
        corners: corners.map((p) => add(centre, combine(p.map((x, k) => x * size[k]), axes))),
        normals: normals.map((n) => unit(combine(n.map((x, k) => x / size[k]), axes))),
        colour: tinted(colour ? rgb(colour) : own, tint),
      })));
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

  /** All triangles of shapes: {points, normals, colours, index}, and their bounds in body axes. */
  function trianglesOf(shapes, own, meshes) {
    const points = [], normals = [], colours = [], index = [];
    for (const { corners, normals: directions, colour } of facesOf(shapes, own)) {
      const first = points.length / 3;
      corners.forEach((p, k) => {
        points.push(...p);
        normals.push(...directions[k].map((x) => Math.round(127 * x)));
        colours.push(...colour);
        if (k > 1) index.push(first, first + k - 1, first + k);
      });
    }
    for (const { kind, mesh, size, centre, axes, colour } of shapes) {
      if (kind !== "mesh" || !meshes[mesh]) continue;
      const { points: given, normals: directions, index: corners } = meshes[mesh];
      const first = points.length / 3, shade = colour ? rgb(colour) : own;
      const mirrored = size[0] * size[1] * size[2] < 0;
      for (let v = 0; v < given.length; v += 3) {
        points.push(...add(centre, combine(size.map((s, k) => s * given[v + k]), axes)));
        normals.push(...unit(combine(size.map((s, k) => directions[v + k] / s), axes)).map(
          (x) => Math.round(127 * x)));
        colours.push(...shade);
      }
      for (let i = 0; i < corners.length; i += 3)
        for (const k of mirrored ? [0, 2, 1] : [0, 1, 2]) index.push(first + corners[i + k]);
    }
    return { points, normals, colours, index };
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

  return { add, minus, times, dot, cross, unit, combine, rgb, facesOf, trianglesOf, boundsOf,
    smooth };
})();
