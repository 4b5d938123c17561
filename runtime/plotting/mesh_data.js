// Meshes of a page: their numbers, and normals that are smooth but at sharp edges.
"use strict";
const meshData = (() => {
  const { minus, cross, unit, CREASE } = solids;

  /** The mesh that base64 of deflated numbers is, as runtime/plotting/meshes.py encodes it. */
  async function decoded({ data, low, width, vertices: n, triangles: m }) {
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
    return smooth({ points, index });
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

  return { decoded };
})();
