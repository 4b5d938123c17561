// Vectors; the faces of shapes, which are boxes, surfaces of revolution and meshes, in body axes.
"use strict";
const solids = (() => {
  const AROUND = 32;   // segments of a circle
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

  /** The faces of a box, in units of its half edges: [corners, normals, tint]. */
  function boxFaces() {
    return [0, 1, 2].flatMap((k) => [-1, 1].map((side) => {
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([u, v]) => {
        const p = [0, 0, 0];
        p[k] = side; p[(k + 1) % 3] = side * u; p[(k + 2) % 3] = v;
        return p;
      });
      const normal = [0, 0, 0];
      normal[k] = side;
      return [corners, corners.map(() => normal), k === 0 && side > 0 ? 1 : 0];
    }));
  }

  /** Points [radius, height] on a half circle about a height, from its lower end, on one side. */
  const arc = (r, height, side) => [...Array(9).keys()].map((k) => {
    const angle = Math.PI / 2 * (side < 0 ? k / 8 : 1 - k / 8);
    return [k === (side < 0 ? 0 : 8) ? 0 : r * Math.sin(angle), height + side * r * Math.cos(angle)];
  });

  /** Profile, from its lower end, and number of sectors that differ, of what is round. */
  const ROUND = {
    sphere: () => [[...arc(1, 0, -1), ...arc(1, 0, 1)], 4],
    bar: ([r, , half]) => [[...arc(r, -half, -1), ...arc(r, half, 1)], 0],
    disc([a, b, half]) {
      const r = Math.max(a, b), wheel = half < 0.6 * r, bevel = 0.15 * Math.min(r, half);
      const lower = [[0, -half], [r - bevel, -half], [r, bevel - half]];
      const rim = [[0, -0.5 * half], [0.8 * r, -0.5 * half], [0.8 * r, -half], ...lower.slice(1)];
      const side = wheel ? rim : lower;
      return [[...side, ...side.map(([x, z]) => [x, -z]).reverse()], 6];
    },
  };

  /** The faces of what is round, each sector in turn lighter, so that turning is seen. */
  function roundFaces(kind, size) {
    const [profile, sectors] = ROUND[kind](size);
    const parts = profile.slice(1).map((to, k) => [profile[k], to])
      .filter(([[r, h], [s, i]]) => r !== s || h !== i);
    const normals = parts.map(([[r, h], [s, i]]) => {
      const size = Math.hypot(i - h, s - r);
      return [(i - h) / size, (r - s) / size];
    });
    const smoothed = (n, other) => (other && n[0] * other[0] + n[1] * other[1] > CREASE
      ? [n[0] + other[0], n[1] + other[1]] : n);
    const faces = [];
    parts.forEach(([from, to], k) => {
      const ends = [[from, smoothed(normals[k], normals[k - 1])],
        [to, smoothed(normals[k], normals[k + 1])]];
      for (let j = 0; j < AROUND; j++) {
        const corners = [[0, j], [0, j + 1], [1, j + 1], [1, j]].filter(([end], c) =>
          ends[end][0][0] > 0 || c === 0 || c === 2).map(([end, at]) => {
          const angle = 2 * Math.PI * at / AROUND, [c, s] = [Math.cos(angle), Math.sin(angle)];
          const [[r, h], [across, along]] = ends[end];
          return [[r * c, r * s, h], [across * c, across * s, along]];
        });
        faces.push([corners.map(([p]) => p), corners.map(([, n]) => n),
          Math.floor(j * sectors / AROUND) % 2]);
      }
    });
    return faces;
  }

  const rgb = (text) => text.match(/\w\w/g).map((two) => parseInt(two, 16));
  const lighter = (colour, tint) => colour.map((x) => Math.round(x + 0.42 * tint * (255 - x)));

  /** The faces of shapes that are no meshes, in body axes: {corners, normals, colour}. */
  function facesOf(shapes, own) {
    return shapes.filter(({ kind }) => kind !== "mesh").flatMap((shape) => {
      const { kind, size, centre, axes } = shape, colour = shape.colour ? rgb(shape.colour) : own;
      const widest = Math.max(size[0], size[1]);
      const scale = kind === "bar" || kind === "disc" ? [size[0] / widest, size[1] / widest, 1] : size;
      return (kind === "box" ? boxFaces() : roundFaces(kind, size)).map(
        ([corners, normals, tint]) => ({
          corners: corners.map((p) => add(centre, combine(p.map((x, k) => x * scale[k]), axes))),
          normals: normals.map((n) => unit(combine(n.map((x, k) => x / scale[k]), axes))),
          colour: lighter(colour, shape.colour ? 0 : tint),
        }));
    });
  }

  /** All triangles of shapes: {points, normals, colours, index}, of `meshes` those they name. */
  function trianglesOf(shapes, own, meshes) {
    const points = [], normals = [], colours = [], index = [];
    const vertex = (p, n, colour) => {
      points.push(p[0], p[1], p[2]);
      for (const x of n) normals.push(Math.round(127 * x));
      colours.push(colour[0], colour[1], colour[2]);
    };
    for (const { corners, normals: directions, colour } of facesOf(shapes, own)) {
      const first = points.length / 3;
      corners.forEach((p, k) => {
        vertex(p, directions[k], colour);
        if (k > 1) index.push(first, first + k - 1, first + k);
      });
    }
    for (const shape of shapes) {
      const { kind, mesh, size, centre, axes } = shape, colour = shape.colour ? rgb(shape.colour) : own;
      if (kind !== "mesh" || !meshes[mesh]) continue;
      const given = meshes[mesh], first = points.length / 3;
      const order = size[0] * size[1] * size[2] < 0 ? [0, 2, 1] : [0, 1, 2];  // mirrored
      for (let v = 0; v < given.points.length; v += 3)
        vertex(add(centre, combine(size.map((s, k) => s * given.points[v + k]), axes)),
          unit(combine(size.map((s, k) => given.normals[v + k] / s), axes)), colour);
      for (let i = 0; i < given.index.length; i += 3)
        for (const k of order) index.push(first + given.index[i + k]);
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

  return { CREASE, add, minus, times, dot, cross, unit, combine, rgb, boundsOf, extremesOf, facesOf,
    trianglesOf };
})();
