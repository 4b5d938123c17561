// A context of WebGL 2 that counts what it draws: `drawn` has the number of calls by their triangles.
"use strict";
module.exports = function fakeWebgl(counts) {
  counts.drawn = {};
  const check = (x) => {
    if (typeof x === "number" ? !Number.isFinite(x) : ArrayBuffer.isView(x) || Array.isArray(x)
      ? ![...x].every(Number.isFinite) : false) counts.bad += 1;
  };
  const known = {
    getProgramParameter: (program, name) => (name === "LINK_STATUS" ? true : 0),
    isContextLost: () => false,
    drawElements(mode, count) { counts.drawn[count / 3] = (counts.drawn[count / 3] ?? 0) + 1; },
  };
  return new Proxy({}, {
    get: (own, name) => (/^[A-Z_0-9]+$/.test(name) ? name : known[name]
      ?? ((...values) => { values.forEach(check); return {}; })),
  });
};
