// Draws triangles by WebGL: one program, meshes of 16-bit vertices, lines that are made anew.
"use strict";
const webgl = (() => {
  const VERTEX = `#version 300 es
    layout(location = 0) in vec3 point;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in vec3 colour;
    uniform mat4 view;
    uniform vec4 attitude, plane;  // vector first; normal and height of the floor
    uniform vec3 place, scale, middle, eye, fall;
    out vec3 paint, direction, ray;
    vec3 turned(vec3 v) {
      return v + 2.0 * cross(attitude.xyz, cross(attitude.xyz, v) + attitude.w * v);
    }
    void main() {
      vec3 at = place + turned(scale * point + middle);
      at -= fall * (dot(plane.xyz, at) - plane.w);  // onto the floor, for a shadow
      paint = colour;
      direction = turned(normal);
      ray = eye - at;
      gl_Position = view * vec4(at, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    uniform vec3 light, cover;
    uniform float alpha, covered;
    in vec3 paint, direction, ray;
    out vec4 result;
    void main() {
      vec3 shown = paint;
      if (dot(direction, direction) > 0.01) {  // lines have none: Lambert, and light at the rim
        vec3 n = normalize(direction), v = normalize(ray);
        n *= dot(n, v) < 0.0 ? -1.0 : 1.0;
        shown = paint * (0.46 + 0.54 * max(dot(n, light), 0.0)) + 0.2 * pow(1.0 - dot(n, v), 3.0);
      }
      result = vec4(mix(shown, cover, covered), alpha);
    }`;

  /** The renderer on a canvas; null where there is no WebGL. */
  function rendererOn(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl) return null;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return null;
    gl.useProgram(program);
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      at[name] = gl.getUniformLocation(program, name);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);

    /** A vertex array of data, each with its place and the type of its numbers. */
    function arrays(...data) {
      const vao = gl.createVertexArray();
      gl.bindVertexArray(vao);
      const buffers = data.map(([values, type, size, normalised], i) => {
        const buffer = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
        gl.enableVertexAttribArray(i);
        gl.vertexAttribPointer(i, 3, type, normalised, size * values.BYTES_PER_ELEMENT, 0);
        return buffer;
      });
      return { vao, buffers };
    }
    /** Triples of numbers, each padded to four. */
    function padded(values, Kind, map) {
      const found = new Kind(values.length / 3 * 4);
      for (let i = 0; i < values.length; i++)
        found[i + Math.floor(i / 3)] = map(values[i], i % 3);
      return found;
    }

    /** Uploads triangles of a body. */
    function mesh({ points, normals, colours, index }) {
      const bounds = solids.boundsOf(points);
      const middle = bounds.map(([low, high]) => (low + high) / 2 || 0);
      const scale = bounds.map(([low, high]) => (high - low) / 65534 || 1);
      const same = (x) => x;
      const held = arrays(
        [padded(points, Int16Array, (x, k) => Math.round((x - middle[k]) / scale[k])), gl.SHORT, 4],
        [padded(normals, Int8Array, same), gl.BYTE, 4, true],
        [padded(colours, Uint8Array, same), gl.UNSIGNED_BYTE, 4, true]);
      const elements = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, elements);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(index), gl.STATIC_DRAW);
      return { ...held, elements, middle, scale, count: index.length };
    }
    function free({ vao, buffers, elements }) {
      gl.deleteVertexArray(vao);
      for (const buffer of [...buffers, elements]) gl.deleteBuffer(buffer);
    }

    /** Begins a picture: `camera` has view, eye, light and sky, all about its target. */
    function begin(camera, width, height) {
      if (canvas.width !== width) canvas.width = width;
      if (canvas.height !== height) canvas.height = height;
      gl.viewport(0, 0, width, height);
      gl.clearColor(...camera.sky.map((x) => x / 255), 1);
      gl.depthMask(true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix4fv(at.view, false, camera.view);
      gl.uniform3fv(at.eye, camera.eye);
      gl.uniform3fv(at.light, camera.light);
      gl.uniform4fv(at.plane, camera.plane);
      cover([0, 0, 0], 0);
      opacity(1);
    }
    function cover(colour, covered, fall = [0, 0, 0]) {
      gl.uniform3fv(at.cover, colour.map((x) => x / 255));
      gl.uniform1f(at.covered, covered);
      gl.uniform3fv(at.fall, fall);
      gl.depthMask(!covered);
    }
    /** Faces turned away alone (-1), or the others at an opacity. */
    function opacity(alpha, side = 0) {
      gl.uniform1f(at.alpha, alpha);
      gl[alpha < 1 ? "enable" : "disable"](gl.BLEND);
      gl.depthMask(alpha === 1);
      gl[side ? "enable" : "disable"](gl.CULL_FACE);
      gl.cullFace(side < 0 ? gl.FRONT : gl.BACK);
    }
    function pose([w, x, y, z], place, { scale, middle }) {
      gl.uniform4f(at.attitude, x, y, z, w);
      gl.uniform3fv(at.place, place);
      gl.uniform3fv(at.scale, scale);
      gl.uniform3fv(at.middle, middle);
    }
    function draw(held, q, place) {
      pose(q, place, held);
      gl.bindVertexArray(held.vao);
      gl.drawElements(gl.TRIANGLES, held.count, gl.UNSIGNED_INT, 0);
    }
    /** Draws triangles of one colour each vertex, without light. */
    function flat(points, colours) {
      if (!points.length) return;
      pose([1, 0, 0, 0], [0, 0, 0], { scale: [1, 1, 1], middle: [0, 0, 0] });
      const held = arrays([new Float32Array(points), gl.FLOAT, 3],
        [new Int8Array(points.length), gl.BYTE, 3, true],
        [new Uint8Array(colours), gl.UNSIGNED_BYTE, 3, true]);
      gl.drawArrays(gl.TRIANGLES, 0, points.length / 3);
      free({ ...held, elements: null });
    }
    return { begin, cover, draw, flat, free, mesh, opacity,
      get lost() { return gl.isContextLost(); } };
  }

  return { rendererOn };
})();
