// Lobes to turn around: unpacks the tables that the page holds, interpolates between their scenes as vrte.interpolate does,
// and draws. Conventions are those of vrte: cosines and azimuths along the directions of travel, phi = 0 forward.
"use strict";
const content = JSON.parse(document.getElementById("content").textContent);
const find = (id) => document.getElementById(id);
const RAD = Math.PI / 180, MIRROR = [1, 1, -1, -1];
const INCIDENT = {
  "unpolarized": [1, 0, 0, 0],
  "linear, in the plane of incidence": [1, 1, 0, 0],
  "linear, across it": [1, -1, 0, 0],
  "linear, at 45°": [1, 0, 1, 0],
  "circular, V = I": [1, 0, 0, 1],
};
const share = (part) => (light) => (light[0] > 0 ? part(light) / light[0] : 0);
const angle = (light) => (((Math.atan2(light[2], light[1]) / RAD / 2) % 180) + 180) % 180;
const QUANTITIES = {
  "radiance I": { of: (light) => light[0], unit: "sr⁻¹" },
  "degree of linear polarization": { of: share((light) => Math.hypot(light[1], light[2])), unit: "" },
  "angle of linear polarization": { of: angle, unit: "°", cyclic: true },
  "Q/I": { of: share((light) => light[1]), unit: "", signed: true },
  "U/I": { of: share((light) => light[2]), unit: "", signed: true },
  "V/I, degree of circular polarization": { of: share((light) => light[3]), unit: "", signed: true },
};
for (let row = 0; row < 4; row++) {
  for (let column = 0; column < 4; column++) {
    const incident = [0, 1, 2, 3].map((k) => (k === column ? 1 : 0));
    QUANTITIES[`Mueller element f${row}${column}`] = { of: (light) => light[row], unit: "sr⁻¹", signed: row + column > 0, incident };
  }
}

// ---- tables: unpacked when they are chosen
async function unpack(table) {
  if (table.steps) return;
  const bytes = Uint8Array.from(atob(table.packed.text), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const shape = table.packed.shape, count = planes.length / 2, steps = new Int16Array(count);
  for (let k = 0; k < count; k++) {
    const folded = planes[k] | (planes[count + k] << 8);
    steps[k] = (folded >> 1) ^ -(folded & 1);
  }
  const strides = shape.map((_, axis) => shape.slice(axis + 1).reduce((a, b) => a * b, 1));
  for (let axis = Math.max(1, shape.length - 4); axis < shape.length; axis++) {
    const stride = strides[axis], length = shape[axis];
    for (let k = 0; k < count; k++) if (Math.floor(k / stride) % length) steps[k] += steps[k - stride]; // wraps as it did
  }
  table.strides = strides;
  table.steps = steps;
}

// ---- between the scenes: cubic polynomials through four values, along a decade in its logarithm
function findNeighbours(values, wanted, scale) {
  const exact = values.indexOf(wanted);
  if (exact >= 0 || values.length === 1) return [[Math.max(exact, 0), 1]];
  const above = values.findIndex((value) => value >= wanted);
  const start = Math.max(0, Math.min((above < 0 ? values.length : above) - 2, values.length - 4));
  const near = values.slice(start, start + 4).map(scale), x = scale(wanted);
  return near.map((a, i) => [start + i, near.reduce((w, b, j) => (i === j ? w : (w * (x - b)) / (a - b)), 1)]);
}
function listNeighbours(table, point, incidence) {
  const along = table.axes.map((axis, k) => findNeighbours(axis.values, point[k], axis.log ? Math.log : (x) => x));
  along.push([[incidence, 1]]); // never between incidences: peaks move with them
  let found = [[[], 1]];
  for (const some of along) found = found.flatMap(([places, w]) => some.map(([place, v]) => [[...places, place], w * v]));
  return found;
}
// Mueller matrices, element by element, (16, mu_o, phi)
function interpolateMatrices(table, point, incidence) {
  const { packed, steps, strides } = table, size = table.mu_o.length * table.phi.length;
  const found = new Float64Array(16 * size);
  for (const [places, weight] of listNeighbours(table, point, incidence)) {
    const base = places.reduce((sum, place, axis) => sum + place * strides[axis + 1], 0);
    for (let element = 0; element < 16; element++) {
      const from = base + element * strides[0], to = element * size;
      for (let k = 0; k < size; k++) found[to + k] += weight * steps[from + k];
    }
  }
  for (let k = 0; k < size; k++) {
    found[k] = Math.exp(packed.middle + packed.step * found[k]);
    for (let element = 1; element < 16; element++) found[element * size + k] *= found[k] / 1024;
  }
  return found;
}
// a share of the light, or a matrix of them, at a scene and an incidence
function interpolateShares(table, name, point, incidence) {
  const near = listNeighbours(table, point, incidence).map(([places, weight]) => [places.reduce((value, k) => value[k], table.shares[name]), weight]);
  const summed = (of) => near.reduce((sum, [value, weight]) => sum + weight * of(value), 0);
  const first = Array.isArray(near[0][0]) ? (value) => value[0][0] : (value) => value;
  const lit = near.every(([value]) => first(value) > 0);
  const size = lit ? Math.exp(summed((value) => Math.log(first(value)))) : summed(first);
  if (!Array.isArray(near[0][0])) return size;
  const over = lit ? first : () => 1, times = lit ? size : 1;
  return near[0][0].map((row, i) => row.map((_, j) => times * summed((value) => value[i][j] / over(value))));
}

// ---- between the directions: the splines of vrte, as weights; Q and U in axes that do not turn with the azimuth
function turn(light, at, degrees) {
  const c = Math.cos(2 * degrees * RAD), s = Math.sin(2 * degrees * RAD), q = light[at + 1], u = light[at + 2];
  light[at + 1] = c * q - s * u;
  light[at + 2] = s * q + c * u;
}
function spreadLight(table, matrices, incident) {
  const mesh = content.meshes[table.mesh], rings = mesh.theta.length, spokes = mesh.spokes, n = table.mu_o.length;
  const circle = table.phi.map((phi, k) => [phi, k, false]);
  for (let k = table.phi.length - 1; k >= 0; k--) if (table.phi[k] > 0 && table.phi[k] < 180) circle.push([360 - table.phi[k], k, true]);
  const m = circle.length, given = new Float64Array(4 * n * m), around = new Float64Array(4 * n * spokes);
  const size = n * table.phi.length;
  for (let t = 0; t < n; t++) {
    circle.forEach(([phi, k, mirrored], c) => {
      const at = 4 * (t * m + c), from = t * table.phi.length + k;
      for (let i = 0; i < 4; i++) {
        for (let j = 0; j < 4; j++) {
          given[at + i] += (mirrored ? MIRROR[i] * MIRROR[j] : 1) * matrices[(4 * i + j) * size + from] * incident[j];
        }
      }
      turn(given, at, -phi);
    });
    for (let s = 0; s < spokes; s++) {
      for (let c = 0; c < m; c++) {
        const weight = mesh.around[s * m + c];
        for (let i = 0; i < 4; i++) around[4 * (t * spokes + s) + i] += weight * given[4 * (t * m + c) + i];
      }
    }
  }
  const rows = [...mesh.behind.map((place) => [place, spokes / 2]), ...table.mu_o.map((_, place) => [place, 0])];
  const found = new Float64Array(4 * rings * spokes);
  for (let r = 0; r < rings; r++) {
    for (let s = 0; s < spokes; s++) {
      const at = 4 * (r * spokes + s);
      rows.forEach(([place, aside], row) => {
        const weight = mesh.over[r * rows.length + row], from = 4 * (place * spokes + ((s + aside) % spokes));
        for (let i = 0; i < 4; i++) found[at + i] += weight * around[from + i];
      });
      turn(found, at, (s * 360) / spokes);
    }
  }
  return found;
}
const unit = (theta, phi) => [Math.sin(theta * RAD) * Math.cos(phi * RAD), Math.sin(theta * RAD) * Math.sin(phi * RAD), Math.cos(theta * RAD)];

// ---- colours
const SEQUENTIAL = ["#1b1464", "#5b209c", "#98318f", "#cb4778", "#ef7a50", "#fcb14a", "#f6ec7d"];
const DIVERGING = ["#123f7a", "#3a7fbf", "#9cc6e3", "#f4f4f2", "#f3b193", "#cf5f4b", "#7d1029"];
const CYCLIC = ["#b4546a", "#b08a3a", "#5f9c63", "#3d8fb5", "#8268b8", "#b4546a"];
const split = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
const choosePalette = (quantity) => (quantity.cyclic ? CYCLIC : quantity.signed ? DIVERGING : SEQUENTIAL);
function mixColour(palette, place) {
  const along = Math.min(1, Math.max(0, place)) * (palette.length - 1), first = Math.min(Math.floor(along), palette.length - 2);
  const [a, b] = [split(palette[first]), split(palette[first + 1])];
  return a.map((value, k) => value + (along - first) * (b[k] - value));
}

// ---- the state, and what follows from it
const state = { table: null, point: [], incidence: 0, angle: 30, theta: 30, phi: 0, around: -1.25, up: 0.42, near: 1, held: null };
let shown = null;
const format = (value, digits = 3) => {
  if (!Number.isFinite(value)) return "-";
  return value !== 0 && Math.abs(value) < 1e-3 ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));
};
function compute() {
  const { table } = state, mesh = content.meshes[table.mesh];
  const mu = table.mu_i[state.incidence], at = state.incidence, incident = INCIDENT[find("incident").value];
  const matrices = interpolateMatrices(table, state.point, at);
  const [height, colour] = ["height", "colour"].map((id) => QUANTITIES[find(id).value]);
  const light = spreadLight(table, matrices, incident), cache = new Map();
  const values = (quantity) => {
    const given = quantity.incident ?? incident, key = given.join();
    if (!cache.has(key)) cache.set(key, quantity.incident ? spreadLight(table, matrices, given) : light);
    const here = cache.get(key), found = new Float64Array(here.length / 4);
    for (let k = 0; k < found.length; k++) found[k] = quantity.of(here.subarray(4 * k, 4 * k + 4));
    return found;
  };
  const sizes = values(height), colours = values(colour);
  const most = (some) => some.reduce((a, b) => Math.max(a, Math.abs(b)), 0) || 1;
  const key = [find("height").value, find("colour").value].join();
  if (!find("hold").checked || state.held?.key !== key) state.held = { key, height: most(sizes), colour: most(colours) };
  const low = colour.signed ? -state.held.colour : 0, high = colour.cyclic ? 180 : state.held.colour;
  shown = { table, mesh, mu, light, height, colour, sizes, colours, largest: most(sizes), scale: state.held.height, low, high, matrices, incident };
  shown.beam = table.shares.specular ? interpolateShares(table, "specular", state.point, at)[0].reduce((sum, f, j) => sum + f * incident[j], 0) : 0;
  shown.reflectance = interpolateShares(table, "reflectance", state.point, at);
}
// the ring and spoke next to the direction that is read
function findPlace() {
  const { mesh } = shown, last = mesh.theta.length - 1;
  const ring = Math.round(((state.theta - mesh.theta[0]) / (mesh.theta[last] - mesh.theta[0])) * last);
  return [Math.min(last, Math.max(0, ring)), Math.round(state.phi / (360 / mesh.spokes)) % mesh.spokes];
}

// ---- numbers and the cut
function write() {
  const { table, mesh, height, colour } = shown, [ring, spoke] = findPlace(), place = ring * mesh.spokes + spoke;
  const theta = mesh.theta[ring], phi = (spoke * 360) / mesh.spokes, light = shown.light.subarray(4 * place, 4 * place + 4);
  find("theta-said").textContent = `${theta.toFixed(1)}°`;
  find("phi-said").textContent = `${phi}°`;
  const polarized = QUANTITIES["degree of linear polarization"].of(light);
  const rows = [
    ["radiance I for an irradiance of 1", `${format(light[0], 4)} sr⁻¹`],
    ["degree of linear polarization", `${format(100 * polarized)} %`],
    ["angle of linear polarization", polarized > 1e-3 ? `${format(angle(light))}°` : "-"],
    ...["Q", "U", "V"].map((name, k) => [`${name}/I`, format(light[0] > 0 ? Number((light[k + 1] / light[0]).toFixed(4)) + 0 : NaN)]),
  ];
  for (const [id, values] of [["height", shown.sizes], ["colour", shown.colours]]) {
    const name = find(id).value;
    if (name.startsWith("Mueller")) rows.push([name, `${format(values[place], 4)} sr⁻¹`]);
  }
  find("numbers").tBodies[0].replaceChildren(...rows.map((row) => {
    const line = document.createElement("tr");
    row.forEach((text) => (line.insertCell().textContent = text));
    return line;
  }));
  const beam = table.shares.specular ? ` ${format(100 * shown.beam)} % of this light is mirrored as a beam, the green arrow, and in no lobe.` : "";
  const scale = `rim of the disc = ${format(shown.scale)}${height.cyclic ? "°" : height.unit ? ` ${height.unit}` : ""}`;
  find("summary").textContent =
    `Largest ${find("height").value} ${format(shown.largest)} ${height.unit}; ${scale}. Diffuse reflectance of unpolarized light ${format(100 * shown.reflectance)} %.${beam}`;
  find("colour-name").textContent = `${find("colour").value}${colour.unit && colour.unit !== "°" ? ` [${colour.unit}]` : ""}`;
  const palette = choosePalette(colour), ends = [shown.low, (shown.low + shown.high) / 2, shown.high];
  find("bar").style.background = `linear-gradient(to right, ${palette.join()})`;
  ["low", "middle", "high"].forEach((id, k) => (find(id).textContent = format(ends[k]) + (colour.cyclic ? "°" : "")));
  find("error").textContent =
    `Computed by ${table.source}. At ${table.error.points} random points between its scenes and directions this page is off by at most ` +
    `${format(100 * table.error.largest, 2)} % of the lobe's largest value (median ${format(100 * table.error.median, 2)} %). ` +
    (table.surface ? "Light outside the surface." : "Light as it leaves the layer, in the particles' medium.") +
    " The angle of incidence, and what has fewer than four values, goes in steps.";
  drawCut();
}
function drawCut() {
  const { mesh, sizes, scale, mu } = shown, [ring, spoke] = findPlace();
  const R = 182, x0 = 210, y0 = 212, at = (radius, theta) => [x0 + R * radius * Math.sin(theta * RAD), y0 - R * radius * Math.cos(theta * RAD)];
  const write = (points) => points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
  const cut = (first) => {
    const side = (s, sign) => mesh.theta.map((theta, r) => at(Math.min(1.15, Math.abs(sizes[r * mesh.spokes + (s % mesh.spokes)]) / scale), sign * theta));
    return [side(first + mesh.spokes / 2, -1).reverse(), side(first, 1)];
  };
  const line = (points, style) => `<polyline points="${write(points)}" fill="none" ${style}/>`;
  const arc = (radius) => line(Array.from({ length: 61 }, (_, k) => at(radius, 3 * k - 90)), 'stroke="var(--line)"');
  const parts = [arc(0.5), arc(1)];
  for (let theta = -90; theta <= 90; theta += 30) {
    const [x, y] = at(1.1, theta);
    parts.push(line([at(0, 0), at(1, theta)], 'stroke="var(--line)"'), `<text x="${x}" y="${y + 4}" text-anchor="middle">${Math.abs(theta)}°</text>`);
  }
  for (const radius of [0.5, 1]) {
    const [x, y] = at(radius, 90);
    parts.push(`<text x="${x}" y="${y + 19}" text-anchor="middle">${format(radius * scale)}</text>`);
  }
  parts.push(`<text x="${x0}" y="${y0 + 33}" text-anchor="middle">left: back, right: forward</text>`);
  const whole = mesh.theta[0] === 0; // else nothing is known around the normal
  for (const [first, style] of [[mesh.spokes / 4, 'stroke="var(--across)" stroke-width="2" stroke-dasharray="6 4"'], [0, 'stroke="var(--accent)" stroke-width="2.5"']]) {
    const halves = cut(first);
    parts.push(...(whole ? [line(halves.flat(), style)] : halves.map((half) => line(half, style))));
  }
  const incidence = Math.acos(mu) / RAD, ray = 'stroke-width="2"';
  parts.push(line([at(1.02, -incidence), at(0, 0)], `${ray} stroke="var(--in)"`));
  if (shown.beam > 0) parts.push(line([at(1.02, incidence), at(0, 0)], `${ray} stroke="var(--mirrored)" stroke-dasharray="3 3"`));
  if (spoke % (mesh.spokes / 2) === 0) {
    const [x, y] = at(Math.min(1.15, Math.abs(sizes[ring * mesh.spokes + spoke]) / scale), (spoke ? -1 : 1) * mesh.theta[ring]);
    parts.push(`<circle cx="${x}" cy="${y}" r="5" fill="var(--paper)" stroke="var(--ink)" stroke-width="2"/>`);
  }
  find("cut").innerHTML = `<title id="cut-title">${find("height").value} as a polar diagram in the plane of incidence and across it</title>${parts.join("")}`;
}

// ---- drawing in space: one list of triangles, seen from far away
const canvas = find("lobe"), gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
const VERTEX = `attribute vec3 point; attribute vec3 normal; attribute vec4 tint; uniform mat3 view; uniform vec3 fit; varying vec4 shade;
  void main() { vec3 p = view * point; vec3 n = view * normal; float size = length(n);
    float lit = size > 0.0 ? 0.62 + 0.38 * abs(dot(n / size, normalize(vec3(-0.35, 0.55, 0.75)))) : 1.0;
    gl_Position = vec4(p.x * fit.x, (p.y - 0.3) * fit.y, -p.z * 0.2, 1.0); shade = vec4(tint.rgb * lit, tint.a); }`;
const FRAGMENT = "precision mediump float; varying vec4 shade; void main() { gl_FragColor = vec4(shade.rgb * shade.a, shade.a); }";
let program = null, scene = null;
function begin() {
  if (!gl) {
    find("trouble").textContent = "This browser draws nothing in space (no WebGL): the diagram and the numbers below work all the same.";
    find("trouble").hidden = false;
    return;
  }
  program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  ["point", "normal", "tint"].forEach((name, k) => {
    const where = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(where);
    gl.vertexAttribPointer(where, k === 2 ? 4 : 3, gl.FLOAT, false, 40, 12 * k);
  });
  gl.enable(gl.DEPTH_TEST);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
}
const minus = (a, b) => a.map((value, k) => value - b[k]);
const plus = (a, b, times = 1) => a.map((value, k) => value + times * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, size) => a.map((value) => (value * size) / (Math.hypot(...a) || 1));
const readTint = (name) => split(getComputedStyle(document.documentElement).getPropertyValue(name).trim().replace(/^#(.)(.)(.)$/, "#$1$1$2$2$3$3"));
// a cone or a cylinder around the way from a to b
function addTube(triangles, a, b, first, last, tint) {
  const along = minus(b, a), aside = scaled(cross(along, Math.abs(along[2]) < 0.9 * Math.hypot(...along) ? [0, 0, 1] : [1, 0, 0]), 1);
  const other = scaled(cross(along, aside), 1), rim = (k) => plus(aside.map((x) => x * Math.cos((k * Math.PI) / 8)), other, Math.sin((k * Math.PI) / 8));
  for (let k = 0; k < 16; k++) {
    const [n, m] = [rim(k), rim(k + 1)], corners = [[a, n, first], [b, n, last], [b, m, last], [a, n, first], [b, m, last], [a, m, first]];
    for (const [point, normal, radius] of corners) triangles.push(...plus(point, normal, radius), ...normal, ...tint, 1);
  }
}
function addArrow(triangles, from, to, tint) {
  const along = scaled(minus(to, from), 1), neck = plus(to, along, -0.13);
  addTube(triangles, from, neck, 0.013, 0.013, tint);
  addTube(triangles, neck, to, 0.045, 0, tint);
}
function build() {
  const { mesh, sizes, colours, scale, low, high, colour, mu } = shown, { spokes } = mesh, rings = mesh.theta.length, triangles = [];
  const palette = choosePalette(colour), points = [], tints = [];
  mesh.theta.forEach((theta, r) => {
    for (let s = 0; s < spokes; s++) {
      const k = r * spokes + s, radius = Math.min(1.6, Math.abs(sizes[k]) / scale);
      points.push(unit(theta, (s * 360) / spokes).map((x) => x * radius));
      tints.push(mixColour(palette, (colours[k] - low) / (high - low || 1)));
    }
  });
  const place = (r, s) => r * spokes + ((s + spokes) % spokes);
  const normals = points.map((_, k) => {
    const r = Math.floor(k / spokes), s = k % spokes, ring = Math.max(r, 1);
    const down = minus(points[place(Math.min(ring + 1, rings - 1), s)], points[place(ring - 1, s)]);
    return cross(down, minus(points[place(ring, s + 1)], points[place(ring, s - 1)]));
  });
  const faces = [];
  for (let r = 0; r + 1 < rings; r++) {
    for (let s = 0; s < spokes; s++) {
      const [a, b, c, d] = [place(r, s), place(r + 1, s), place(r + 1, s + 1), place(r, s + 1)];
      faces.push([a, b, c], [a, c, d]);
    }
  }
  for (const face of faces) for (const k of face) triangles.push(...points[k], ...normals[k], ...tints[k], 1);
  const sine = Math.sqrt(1 - mu * mu), away = [-sine, 0, mu], back = [sine, 0, mu];
  addArrow(triangles, away.map((x) => 1.42 * x), away.map((x) => 1.06 * x), readTint("--in"));
  if (shown.beam > 0) addArrow(triangles, back.map((x) => 1.06 * x), back.map((x) => 1.42 * x), readTint("--mirrored"));
  const [ring, spoke] = findPlace(), mark = points[place(ring, spoke)], out = unit(mesh.theta[ring], (spoke * 360) / spokes);
  addTube(triangles, mark, plus(mark, out, 0.16), 0.008, 0.008, readTint("--ink"));
  addTube(triangles, plus(mark, out, 0.05), mark, 0.035, 0, readTint("--ink"));
  const flat = (radius, width, tint, alpha) => {
    for (let k = 0; k < 96; k++) {
      const rim = (size, j) => unit(90, j * 3.75).map((x, axis) => (axis === 2 ? 0 : x * size));
      const [a, b, c, d] = [rim(radius - width, k), rim(radius, k), rim(radius, k + 1), rim(radius - width, k + 1)];
      for (const point of [a, b, c, a, c, d]) triangles.push(...point, 0, 0, 0, ...tint, alpha);
    }
  };
  flat(1, 0.012, readTint("--note"), 1);
  flat(0.5, 0.008, readTint("--note"), 1);
  const solid = triangles.length / 10;
  flat(1, 1, readTint("--line"), 0.45);
  scene = { points, faces, solid, count: triangles.length / 10 };
  if (gl) gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(triangles), gl.DYNAMIC_DRAW);
}
function look() {
  const { around, up } = state, right = [-Math.sin(around), Math.cos(around), 0];
  const toward = [Math.cos(up) * Math.cos(around), Math.cos(up) * Math.sin(around), Math.sin(up)];
  return [right, cross(toward, right), toward];
}
function fit() {
  const { clientWidth: w, clientHeight: h } = canvas, size = (state.near * Math.min(w / 2.9, h / 2.3)) || 1;
  return [size, w, h];
}
const project = (point, view, [size, w, h]) => [w / 2 + size * dot(view[0], point), h / 2 - size * (dot(view[1], point) - 0.3)];
function draw() {
  const view = look(), [size, w, h] = fit(), sharp = Math.min(2, window.devicePixelRatio || 1);
  if (gl) {
    if (canvas.width !== Math.round(w * sharp) || canvas.height !== Math.round(h * sharp)) [canvas.width, canvas.height] = [Math.round(w * sharp), Math.round(h * sharp)];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "view"), false, [0, 1, 2].flatMap((k) => view.map((row) => row[k])));
    gl.uniform3f(gl.getUniformLocation(program, "fit"), (2 * size) / w, (2 * size) / h, 1);
    gl.disable(gl.BLEND);
    gl.drawArrays(gl.TRIANGLES, 0, scene.solid);
    gl.enable(gl.BLEND);
    gl.drawArrays(gl.TRIANGLES, scene.solid, scene.count - scene.solid);
  }
  ["0° forward", "90°", "180° back", "270°"].forEach((text, k) => {
    const span = find("labels").children[k] ?? find("labels").appendChild(document.createElement("span"));
    const there = unit(90, 90 * k).map((value) => 1.15 * value), [x, y] = project(there, view, [size, w, h]);
    span.hidden = (findFace(x, y)?.depth ?? -9) > dot(view[2], there);
    span.textContent = text;
    span.style.left = `${Math.min(w - 30, Math.max(30, x))}px`;
    span.style.top = `${y}px`;
  });
}
let waiting = false;
function update(what = "all") {
  if (what === "all") compute();
  if (what !== "view") write(), build();
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => ((waiting = false), draw()));
}

// ---- the pointer: drags turn, a click reads the direction below it
function findFace(x, y) {
  const view = look(), where = fit(), flat = scene.points.map((point) => project(point, view, where)), deep = scene.points.map((point) => dot(view[2], point));
  let best = null;
  for (const face of scene.faces) {
    const [a, b, c] = face.map((k) => flat[k]);
    const side = (p, q) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
    const [u, v, w] = [side(a, b), side(b, c), side(c, a)];
    if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) continue;
    const depth = Math.max(...face.map((k) => deep[k]));
    if (!best || depth > best.depth) best = { depth, face };
  }
  if (!best) return null;
  const off = (k) => Math.hypot(flat[k][0] - x, flat[k][1] - y);
  return { depth: best.depth, nearest: best.face.reduce((a, b) => (off(b) < off(a) ? b : a)) };
}
function pick(x, y) {
  const found = findFace(x, y), { mesh } = shown;
  if (!found) return;
  const { nearest } = found;
  setDirection(mesh.theta[Math.floor(nearest / mesh.spokes)], ((nearest % mesh.spokes) * 360) / mesh.spokes);
}
function setDirection(theta, phi) {
  [state.theta, state.phi] = [theta, phi];
  find("theta").value = theta;
  find("phi").value = phi;
  update("direction");
}
const fingers = new Map();
let moved = 0;
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  if (fingers.size === 1) moved = 0;
});
canvas.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId), now = [event.offsetX, event.offsetY];
  if (!before) return;
  const [dx, dy] = minus(now, before);
  moved += Math.hypot(dx, dy);
  if (fingers.size === 2) {
    const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    bring(Math.hypot(...minus(now, other)) / (Math.hypot(...minus(before, other)) || 1));
  } else turnView(-0.01 * dx, 0.01 * dy);
  fingers.set(event.pointerId, now);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, (event) => {
    if (name === "pointerup" && fingers.size === 1 && moved < 5) pick(event.offsetX, event.offsetY);
    fingers.delete(event.pointerId);
  });
}
canvas.addEventListener("wheel", (event) => (event.preventDefault(), bring(Math.exp(-0.001 * event.deltaY))), { passive: false });
function turnView(around, up) {
  state.around += around;
  state.up = Math.min(1.57, Math.max(-1.57, state.up + up));
  update("view");
}
function bring(times) {
  state.near = Math.min(6, Math.max(0.4, state.near * times));
  update("view");
}
canvas.addEventListener("keydown", (event) => {
  const step = Math.PI / 24;
  const moves = {
    ArrowLeft: () => turnView(-step, 0), ArrowRight: () => turnView(step, 0), ArrowUp: () => turnView(0, step), ArrowDown: () => turnView(0, -step),
    "+": () => bring(1.1), "=": () => bring(1.1), "-": () => bring(1 / 1.1), 0: () => (Object.assign(state, { around: -1.25, up: 0.42, near: 1 }), update("view")),
  };
  if (!moves[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  moves[event.key]();
});

// ---- controls
const STEPS = 100; // of a slider along an axis
function addSlider(label, unit, least, most, value, format, change, step) {
  const line = document.createElement("label"), said = document.createElement("output"), slider = document.createElement("input");
  line.className = "line";
  Object.assign(slider, { type: "range", min: least, max: most, step, disabled: least === most });
  slider.value = value;
  const say = () => (said.textContent = `${format(Number(slider.value))}${unit === "°" ? "°" : unit ? ` ${unit}` : ""}`);
  slider.addEventListener("input", () => (change(Number(slider.value)), say(), update()));
  slider.setAttribute("aria-label", label);
  line.append(`${label} `, said, slider);
  slider.addEventListener("keydown", (event) => { // even steps, along logarithms too
    const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!way || step === 1) return;
    event.preventDefault();
    slider.value = Number(slider.value) + (way * (most - least)) / STEPS;
    slider.dispatchEvent(new Event("input"));
  });
  say();
  find("sliders").append(line);
}
async function choose(table) {
  await unpack(table);
  state.table = table;
  state.point = table.axes.map((axis) => axis.values[Math.floor(axis.values.length / 2)]);
  state.held = null;
  find("sliders").replaceChildren();
  const angles = table.mu_i.map((mu) => Math.acos(mu) / RAD), off = (k) => Math.abs(angles[k] - state.angle);
  state.incidence = angles.reduce((best, _, k) => (off(k) < off(best) ? k : best), 0);
  const takeIncidence = (k) => ([state.incidence, state.angle] = [k, angles[k]]);
  addSlider("angle of incidence", "°", 0, angles.length - 1, state.incidence, (k) => format(angles[k]), takeIncidence, 1);
  table.axes.forEach((axis, k) => {
    const { values, between } = axis, last = values.length - 1;
    const [into, back] = axis.log ? [Math.log, Math.exp] : [(x) => x, (x) => x];
    const take = (at) => (between ? Math.min(values[last], Math.max(values[0], back(at))) : values[at]); // whatever the rounding
    const [least, most, now] = between ? [values[0], values[last], state.point[k]].map(into) : [0, last, values.indexOf(state.point[k])];
    addSlider(axis.label, axis.unit, least, most, now, (at) => format(take(at)), (at) => (state.point[k] = take(at)), between ? "any" : 1);
  });
  const mesh = content.meshes[table.mesh], last = mesh.theta.at(-1);
  Object.assign(find("theta"), { min: mesh.theta[0], max: last, step: (last - mesh.theta[0]) / (mesh.theta.length - 1) });
  Object.assign(find("phi"), { max: 360 - 360 / mesh.spokes, step: 360 / mesh.spokes });
  state.theta = Math.min(last, Math.max(mesh.theta[0], state.theta));
  find("theta").value = state.theta;
  find("phi").value = state.phi;
  document.body.dataset.table = table.name;
  update();
}
const fill = (id, names, chosen) => find(id).append(...names.map((name) => new Option(name, name, name === chosen, name === chosen)));
fill("pick", content.tables.map((table) => table.name), content.tables[0].name);
fill("incident", Object.keys(INCIDENT), "unpolarized");
fill("height", Object.keys(QUANTITIES).filter((name) => !QUANTITIES[name].cyclic), "radiance I");
fill("colour", Object.keys(QUANTITIES), "degree of linear polarization");
find("pick-line").hidden = content.tables.length < 2;
find("pick").addEventListener("change", () => choose(content.tables[find("pick").selectedIndex]));
for (const id of ["incident", "height", "colour", "hold"]) find(id).addEventListener("change", () => update());
find("theta").addEventListener("input", () => setDirection(Number(find("theta").value), state.phi));
find("phi").addEventListener("input", () => setDirection(state.theta, Number(find("phi").value)));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => update("direction"));
const follow = () => { // a page around this one may say which theme: #dark or #light
  const theme = location.hash.slice(1);
  if (["dark", "light"].includes(theme)) document.documentElement.dataset.theme = theme;
  if (scene) update("direction");
};
addEventListener("hashchange", follow);
new ResizeObserver(() => scene && update("view")).observe(canvas);
begin();
follow();
choose(content.tables[0]);
