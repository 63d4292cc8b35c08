"use strict";
// The page holds the places of all points in some hundred frames. Two frames, the one before and the one after the shown
// time, are in textures, and the shaders interpolate between them. A drawn picture thus costs a few draw calls, and a new
// frame costs the upload of one texture.

const data = JSON.parse(document.querySelector("script#data").textContent);
const [DOT, BALL, SUPPORT, HIDDEN] = [0, 1, 2, 3]; // kinds of points
const WIDTH = 256; // texels in a row of a texture
const FAR = 1e30; // the side of a box that is not periodic
const TRAIL = 0.7; // seconds of the film in which a trail is dark
const POLE = 1 - 1e-4; // of an elevation: a camera above the scene still knows what is up
const FEW = 40; // springs that are drawn as coils
const MANY = 1000; // points: more are drawn as sprites, whose size has a limit, and without antialiasing, which is faster
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const SHAPES = { play: "M3 1.5 14 8 3 14.5z", pause: "M3 2h3.5v12H3zM9.5 2H13v12H9.5z" };

const isLarge = data.points > MANY;
const element = id => document.getElementById(id);
const canvas = document.querySelector("main > canvas");
const dark = matchMedia("(prefers-color-scheme: dark)");
const low = new THREE.Vector3(...data.limits[0]), high = new THREE.Vector3(...data.limits[1]);
const extent = Math.max(...new THREE.Vector3().subVectors(high, low).toArray()) || 1;

// Data ----------------------------------------------------------------------------------------------------------------

async function block(id, Type) {
  const text = atob(element(id).textContent);
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Type(await new Response(stream).arrayBuffer());
}

// Integers from differences to a linear prediction; see coding.py.
function restore(bytes, frames, bits) {
  const planes = bits > 8 ? 2 : 1, count = bytes.length / frames / planes, mask = 2 ** bits - 1;
  const q = new (bits > 8 ? Uint16Array : Uint8Array)(frames * count);
  for (let k = 0; k < frames; k++) {
    const from = k * count * planes, now = k * count, last = now - count, before = last - count;
    for (let i = 0; i < count; i++) {
      const z = bytes[from + i] | (planes > 1 ? bytes[from + count + i] << 8 : 0);
      const predicted = k === 0 ? 0 : k === 1 ? q[last + i] : 2 * q[last + i] - q[before + i];
      q[now + i] = (predicted + ((z >> 1) ^ -(z & 1))) & mask;
    }
  }
  return q;
}

class Motion {
  constructor(q, faces) {
    this.q = q;
    this.faces = faces;
    this.axes = data.flat ? 2 : 3;
    this.rows = Math.ceil(data.points / WIDTH);
    this.values = null; // colours of all points in all frames, or null
    this.ends = [0, 1].map(() => this.texture());
    this.normals = faces.length ? [0, 1].map(() => this.texture()) : null;
    this.loaded = [-1, -1];
  }

  texture() {
    const image = new Float32Array(4 * WIDTH * this.rows);
    return new THREE.DataTexture(image, WIDTH, this.rows, THREE.RGBAFormat, THREE.FloatType);
  }

  place(frame, point, axis) {
    if (axis >= this.axes) return 0;
    const [from, to] = data.motion, size = to[axis] - from[axis];
    if (size === 0) return from[axis];
    return from[axis] + (this.q[(frame * this.axes + axis) * data.points + point] + 0.5) * size / 2 ** data.bits;
  }

  load(end, frame) {
    const n = data.points, image = this.ends[end].image.data, [from, to] = data.motion;
    for (let axis = 0; axis < this.axes; axis++) {
      const size = (to[axis] - from[axis]) / 2 ** data.bits, start = from[axis] + 0.5 * size, row = (frame * this.axes + axis) * n;
      for (let i = 0; i < n; i++) image[4 * i + axis] = start + size * this.q[row + i];
    }
    if (this.values) for (let i = 0; i < n; i++) image[4 * i + 3] = this.values[frame * n + i] / 255;
    this.ends[end].needsUpdate = true;
    if (this.normals) this.turnFaces(image, this.normals[end]);
    this.loaded[end] = frame;
  }

  // The normal at a corner is the sum of the normals of its faces, weighted by their areas.
  turnFaces(x, texture) {
    const n = texture.image.data.fill(0), f = this.faces;
    for (let k = 0; k < f.length; k += 3) {
      const a = 4 * f[k], b = 4 * f[k + 1], c = 4 * f[k + 2];
      const px = x[b] - x[a], py = x[b + 1] - x[a + 1], pz = x[b + 2] - x[a + 2];
      const qx = x[c] - x[a], qy = x[c + 1] - x[a + 1], qz = x[c + 2] - x[a + 2];
      const nx = py * qz - pz * qy, ny = pz * qx - px * qz, nz = px * qy - py * qx;
      for (const i of [a, b, c]) { n[i] += nx; n[i + 1] += ny; n[i + 2] += nz; }
    }
    for (let i = 0; i < n.length; i += 4) {
      const size = Math.hypot(n[i], n[i + 1], n[i + 2]) || 1;
      n[i] /= size; n[i + 1] /= size; n[i + 2] /= size;
    }
    texture.needsUpdate = true;
  }

  // Put the frames around a place on the film, in frames, into the textures. A texture that has the frame is kept.
  show(place) {
    const first = Math.min(Math.floor(place), data.frames - 2);
    if (this.loaded[1] === first) {
      this.ends.reverse();
      this.normals?.reverse();
      this.loaded.reverse();
    }
    for (const end of [0, 1]) if (this.loaded[end] !== first + end) this.load(end, first + end);
    shared.mixing.value = place - first;
    shared.before.value = this.ends[0];
    shared.after.value = this.ends[1];
    if (this.normals) [shared.normalsBefore.value, shared.normalsAfter.value] = this.normals;
  }

  color(values) {
    this.values = values;
    this.loaded = [-1, -1];
  }
}

// Shaders -------------------------------------------------------------------------------------------------------------

const shared = Object.fromEntries(["before", "after", "normalsBefore", "normalsAfter", "palette"].map(name => [name, { value: null }]));
Object.assign(shared, { mixing: { value: 0 }, frame: { value: 0 }, ratio: { value: 1 }, pixel: { value: 1 }, colored: { value: false }, isDark: { value: 0 } });
shared.sides = { value: new THREE.Vector3(...(data.box ?? [0, 0, 0]).map(side => side || FAR)) };

const PLACES = `
uniform highp sampler2D before, after;
uniform float mixing, pixel;
uniform vec3 sides;
ivec2 texel(float i) { return ivec2(int(i) % ${WIDTH}, int(i) / ${WIDTH}); }
vec4 at(float i) {
  vec4 a = texelFetch(before, texel(i), 0), b = texelFetch(after, texel(i), 0);
  bool leaves = any(greaterThan(abs(b.xyz - a.xyz), 0.5 * sides)); // an atom that leaves the box enters on the other side
  return leaves ? (mixing < 0.5 ? a : b) : mix(a, b, mixing);
}
float pixelAt(vec3 place) { return pixel * max(-place.z, 1e-9); } // the size of a pixel
`;
// Light from above left; a soft edge separates balls of the same colour.
const LIGHT = `
uniform sampler2D palette;
uniform bool colored;
uniform float isDark;
vec3 lit(vec3 color, vec3 normal) {
  float light = 0.5 + 0.5 * dot(normal, normalize(vec3(-0.45, 0.65, 0.75)));
  float shine = pow(max(0.0, dot(normal, normalize(vec3(-0.25, 0.4, 1.0)))), 40.0);
  return color * mix(0.32 + 0.08 * isDark, 1.08, light) * (0.7 + 0.3 * smoothstep(0.0, 0.5, abs(normal.z))) + 0.16 * shine;
}
vec3 inColor(vec3 color, float value) { return colored ? texture2D(palette, vec2(value, 0.5)).rgb : color; }
`;

function material(vertex, fragment, uniforms = {}, options = {}) {
  const own = Object.fromEntries(Object.entries(uniforms).map(([name, value]) => [name, { value }]));
  return new THREE.ShaderMaterial({
    uniforms: { ...shared, ...own }, vertexShader: PLACES + vertex, fragmentShader: LIGHT + fragment,
    side: THREE.DoubleSide, ...options,
  });
}

const BALLS = [`
attribute float number, radius;
attribute vec3 tint;
uniform float dot_, ratio;
#ifndef SPRITES
varying vec2 uv_;
#endif
varying vec3 color, centre;
varying float size, value;
void main() {
  vec4 here = at(number);
  centre = (modelViewMatrix * vec4(here.xyz, 1.0)).xyz;
  float one = pixelAt(centre);
  size = radius > 0.0 ? max(radius, 0.8 * one) : dot_ * one;
  color = tint;
  value = here.w;
#ifdef SPRITES
  gl_Position = projectionMatrix * vec4(centre, 1.0);
  gl_PointSize = 2.0 * size / one * ratio;
#else
  uv_ = position.xy * (1.0 + one / size);
  gl_Position = projectionMatrix * vec4(centre + vec3(uv_ * size, 0.0), 1.0);
#endif
}`, `
uniform mat4 projectionMatrix;
#ifndef SPRITES
varying vec2 uv_;
#endif
varying vec3 color, centre;
varying float size, value;
void main() {
#ifdef SPRITES
  vec2 uv_ = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
#endif
  float square = dot(uv_, uv_);
#ifdef SMOOTH
  float edge = fwidth(square);
  float cover = 1.0 - smoothstep(1.0 - edge, 1.0 + edge, square);
  if (cover < 0.02) discard;
#else
  const float cover = 1.0;
  if (square > 1.0) discard;
#endif
  vec3 normal = vec3(uv_, sqrt(max(0.0, 1.0 - square)));
  vec4 front = projectionMatrix * vec4(centre + size * normal, 1.0);
  gl_FragDepth = 0.5 + 0.5 * front.z / front.w;
  vec3 shown = color.r < 0.0 ? inColor(vec3(0.0), value) : color;
  gl_FragColor = vec4(lit(shown, normal), cover);
}`];

const LINKS = [`
attribute vec2 ends;
attribute float until;
uniform float thickness, turns, coil, frame;
varying float across;
varying vec3 side, front;
vec3 first, along, right, up;
vec3 curve(float s) {
  if (turns == 0.0) return first + s * along;
  float inside = clamp((s - 0.12) / 0.76, 0.0, 1.0), angle = 6.2831853 * turns * inside;
  float wide = coil * smoothstep(0.0, 0.05, inside) * smoothstep(1.0, 0.95, inside);
  return first + s * along + wide * (cos(angle) * right + sin(angle) * up);
}
void main() {
  first = at(ends.x).xyz;
  along = at(ends.y).xyz - first;
  along -= sides * floor(along / sides + 0.5); // to the nearest image
  vec3 other = abs(along.z) < 0.9 * length(along) ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
  right = normalize(cross(along, other) + 1e-20);
  up = normalize(cross(right, along) + 1e-20);
  float s = position.x;
  vec3 place = (modelViewMatrix * vec4(curve(s), 1.0)).xyz;
  vec3 tangent = (modelViewMatrix * vec4(curve(s + 1e-3) - curve(s - 1e-3), 0.0)).xyz;
  side = normalize(cross(tangent, place) + 1e-20);
  front = normalize(cross(side, tangent) + 1e-20);
  front *= front.z < 0.0 ? -1.0 : 1.0;
  across = position.y;
  place += side * across * max(thickness, 0.75 * pixelAt(place));
  gl_Position = frame > until ? vec4(2.0, 2.0, 2.0, 1.0) : projectionMatrix * vec4(place, 1.0);
}`, `
varying float across;
varying vec3 side, front;
uniform vec3 tint;
void main() {
  gl_FragColor = vec4(lit(tint, normalize(side * across + front * sqrt(max(0.0, 1.0 - across * across)))), 1.0);
}`];

const FACES = [`
attribute float number;
uniform highp sampler2D normalsBefore, normalsAfter;
varying vec3 normal_, seen;
varying float value;
void main() {
  vec4 here = at(number);
  value = here.w;
  seen = (modelViewMatrix * vec4(here.xyz, 1.0)).xyz;
  normal_ = normalMatrix * mix(texelFetch(normalsBefore, texel(number), 0), texelFetch(normalsAfter, texel(number), 0), mixing).xyz;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(here.xyz, 1.0);
}`, `
varying vec3 normal_, seen;
varying float value;
uniform vec3 tint;
void main() {
  vec3 flat_ = normalize(cross(dFdx(seen), dFdy(seen))), smooth_ = normalize(normal_);
  float same = dot(flat_, smooth_);
  if (same < 0.0) smooth_ = -smooth_;
  vec3 normal = normalize(mix(flat_, smooth_, smoothstep(0.8, 0.97, abs(same)))); // edges stay sharp
  gl_FragColor = vec4(lit(inColor(tint, value), normal.z < 0.0 ? -normal : normal), 1.0);
}`];

const SOLIDS = [`
attribute vec4 corners;
varying vec3 normal_;
varying float value;
void main() {
  vec4 here = at(corners.x);
  value = here.w;
  vec3 centre = here.xyz, x = at(corners.y).xyz - centre, y = at(corners.z).xyz - centre;
  vec3 z = corners.w < 0.0 ? normalize(cross(x, y)) * 0.4 * min(length(x), length(y)) : at(corners.w).xyz - centre;
  vec3 turned = normal.x * x / dot(x, x) + normal.y * y / dot(y, y) + normal.z * z / dot(z, z);
  normal_ = normalMatrix * turned;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(centre + position.x * x + position.y * y + position.z * z, 1.0);
}`, `
varying vec3 normal_;
varying float value;
uniform vec3 tint;
uniform float cover;
void main() {
  vec3 normal = normalize(normal_);
  gl_FragColor = vec4(lit(inColor(tint, value), normal.z < 0.0 ? -normal : normal), cover);
}`, `
uniform vec3 tint;
void main() { gl_FragColor = vec4(0.55 * tint, 1.0); }`];

// The picture ---------------------------------------------------------------------------------------------------------

THREE.ColorManagement.enabled = false; // the shaders write the colours of the screen
const BLUE = [0.29, 0.5, 0.78], GREY = [0.5, 0.53, 0.57], CLOTH = [0.42, 0.64, 0.9], BODY = [0.86, 0.62, 0.32];
let renderer;
try {
  renderer = new THREE.WebGLRenderer({ canvas, antialias: !isLarge });
} catch (error) {
  element("message").textContent = "This browser has no WebGL 2, which the view needs: open the page in another browser.";
  throw error;
}
renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(28, 1, extent / 500, extent * 100);
camera.up.set(...(data.flat ? [0, 1, 0] : [0, 0, 1]));
const controls = new THREE.OrbitControls(camera, canvas);
const axes = new THREE.Group();
const labels = []; // { place, span }
let motion, trails = [];

function add(geometry, made, order = 0, Kind = THREE.Mesh) {
  const mesh = new Kind(geometry, made);
  mesh.frustumCulled = false; // the places are known to the shader only
  mesh.renderOrder = order;
  scene.add(mesh);
}

// Copies of a geometry in one draw call. They are no instances, because software renderers draw these one by one.
function copies(base, attributes) {
  const geometry = new THREE.BufferGeometry(), vertices = base.attributes.position.count;
  const count = Math.max(...Object.values(attributes).map(([values, size]) => values.length / size));
  for (const name of ["position", "normal"]) {
    if (!base.attributes[name]) continue;
    const all = new Float32Array(3 * vertices * count);
    for (let k = 0; k < count; k++) all.set(base.attributes[name].array, 3 * vertices * k);
    geometry.setAttribute(name, new THREE.BufferAttribute(all, 3));
  }
  for (const [name, [values, size]] of Object.entries(attributes)) {
    const all = new Float32Array(size * vertices * count);
    for (let i = 0; i < all.length; i++) all[i] = values[size * Math.floor(i / (size * vertices)) + i % size];
    geometry.setAttribute(name, new THREE.BufferAttribute(all, size));
  }
  const index = new Uint32Array(base.index.count * count);
  for (let i = 0; i < index.length; i++) index[i] = base.index.array[i % base.index.count] + vertices * Math.floor(i / base.index.count);
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  return geometry;
}

function addPoints(kinds, radii) {
  const numbers = [...kinds.keys()].filter(i => kinds[i] !== HIDDEN);
  if (!numbers.length) return;
  const tints = numbers.flatMap(i => kinds[i] === SUPPORT ? GREY : data.colors.length ? [-1, 0, 0] : BLUE);
  const given = { number: [numbers, 1], radius: [numbers.map(i => radii[i]), 1], tint: [tints, 3] };
  const defines = isLarge ? { SPRITES: 1 } : { SMOOTH: 1 };
  const fragment = BALLS[1].replace("vec3(0.0), value", `vec3(${BLUE}), value`);
  const made = material(BALLS[0], fragment, { dot_: numbers.length > 300 ? 2.2 : numbers.length > 20 ? 4 : 6 }, { alphaToCoverage: !isLarge, defines });
  if (!isLarge) add(copies(new THREE.PlaneGeometry(2, 2), given), made);
  if (!isLarge) return;
  const one = new THREE.BufferGeometry();
  one.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3), 3));
  one.setIndex([0]);
  add(copies(one, given), made, 0, THREE.Points);
}

// A ribbon that the shader turns to the camera.
function ribbon(pieces) {
  const geometry = new THREE.BufferGeometry(), places = [], index = [];
  for (let k = 0; k <= pieces; k++) places.push(k / pieces, -1, 0, k / pieces, 1, 0);
  for (let k = 0; k < 2 * pieces; k += 2) index.push(k, k + 1, k + 2, k + 2, k + 1, k + 3);
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
  geometry.setIndex(index);
  return geometry;
}

function addLinks(links) {
  const count = links.length / 2, springs = new Set(data.springs.length <= FEW ? data.springs : []);
  const until = new Map(data.until), numbers = [...Array(count).keys()];
  const thickness = extent * (count > 300 ? 0.0012 : count > 60 ? 0.003 : 0.005);
  for (const isSpring of [false, true]) {
    const some = numbers.filter(k => springs.has(k) === isSpring);
    if (!some.length) continue;
    const given = { ends: [some.flatMap(k => [links[2 * k], links[2 * k + 1]]), 2], until: [some.map(k => until.get(k) ?? FAR), 1] };
    const uniforms = { thickness: isSpring ? 0.7 * thickness : thickness, turns: isSpring ? 9 : 0, coil: 0.022 * extent, tint: new THREE.Vector3(...GREY) };
    add(copies(ribbon(isSpring ? 240 : 1), given), material(...LINKS, uniforms));
  }
}

function addFaces(faces) {
  if (!faces.length) return;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * data.points), 3));
  geometry.setAttribute("number", new THREE.BufferAttribute(Float32Array.from(Array(data.points).keys()), 1));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  add(geometry, material(...FACES, { tint: new THREE.Vector3(...CLOTH) }));
}

function unit(kind, slenderness) {
  if (kind === "box") return new THREE.BoxGeometry(2, 2, 2);
  if (kind === "sphere") return new THREE.SphereGeometry(1, 40, 24);
  if (kind === "cylinder") return new THREE.CylinderGeometry(1, 1, 2, 40).rotateX(Math.PI / 2);
  const radius = Math.min(slenderness, 1);
  return new THREE.CapsuleGeometry(radius, 2 - 2 * radius, 12, 32).rotateX(Math.PI / 2).scale(1 / radius, 1 / radius, 1);
}

// Bodies that links hold are transparent, so that the mechanism is visible.
function addSolids(links) {
  const held = new Set(links), [vertex, fragment, edge] = SOLIDS;
  const length = (a, b) => Math.hypot(...[0, 1, 2].map(axis => motion.place(0, a, axis) - motion.place(0, b, axis)));
  const groups = new Map();
  for (const { kind, points } of data.solids) {
    const slenderness = kind === "capsule" ? length(points[1], points[0]) / length(points.at(-1), points[0]) : 1;
    const cover = held.has(points[0]) ? 0.3 : 1, key = `${kind} ${cover} ${slenderness.toFixed(3)}`;
    if (!groups.has(key)) groups.set(key, { kind, cover, base: unit(kind, slenderness), corners: [] });
    groups.get(key).corners.push(...points, ...(points.length < 4 ? [-1] : []));
  }
  const tint = new THREE.Vector3(...BODY);
  for (const { kind, cover, base, corners } of groups.values()) {
    const look = { transparent: cover < 1, depthWrite: cover === 1, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    add(copies(base, { corners: [corners, 4] }), material(vertex, fragment, { tint, cover }, look), cover < 1 ? 2 : 0);
    if (kind !== "box") continue;
    const edges = new THREE.EdgesGeometry(base), places = edges.attributes.position;
    edges.setIndex([...Array(places.count).keys()]).setAttribute("normal", places);
    add(copies(edges, { corners: [corners, 4] }), material(vertex, edge, { tint }), 0, THREE.LineSegments);
  }
}

function addPlanes() {
  for (const corners of data.planes) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(corners.flat()), 3));
    geometry.setIndex(corners.slice(2).flatMap((_, k) => [0, k + 1, k + 2]));
    const look = { color: 0x8a949e, transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false };
    add(geometry, new THREE.MeshBasicMaterial(look), 1);
    const edges = corners.flatMap((corner, k) => [...corner, ...corners[(k + 1) % corners.length]]);
    scene.add(line(edges, 0x8a949e, 0.7));
  }
}

function line(places, color, opacity = 1) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
  const made = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color, transparent: opacity < 1, opacity }));
  made.frustumCulled = false;
  return made;
}

async function addTrails() {
  for (let k = 0; k < data.trails.length; k++) {
    if (!element(`trail${k}`)) continue;
    const rows = await block(`trail${k}`, Float32Array), times = [], places = [];
    for (let i = 0; i + 4 < rows.length; i += 4) {
      times.push(rows[i + 4]);
      places.push(...rows.slice(i + 1, i + 4), ...rows.slice(i + 5, i + 8));
    }
    const color = [0x3f7fc4, 0xe0862c, 0x3a9d5d, 0xc0504d, 0x8064a2][k % 5];
    const trail = { times, all: line(places, color, 0.35), last: line(places, color) };
    scene.add(trail.all, trail.last);
    trails.push(trail);
  }
}

function addLabel(text, place, kind = "") {
  const span = document.createElement("span");
  span.textContent = text;
  span.className = kind;
  element("labels").append(span);
  labels.push({ place, span, isMark: kind === "mark" });
}

// Axes: the edges of a box, and round numbers along three of them.
function addAxes() {
  const a = low.toArray(), b = high.toArray(), dimensions = data.flat ? 2 : 3, places = [];
  for (let axis = 0; axis < dimensions; axis++) {
    const others = [0, 1, 2].filter(other => other !== axis && other < dimensions);
    for (const ends of dimensions === 2 ? [[a], [b]] : [[a, a], [a, b], [b, a], [b, b]]) {
      const from = [0, 0, 0];
      others.forEach((other, k) => { from[other] = ends[k][other]; });
      for (const end of [a, b]) places.push(...from.with(axis, end[axis]));
    }
    const foot = dimensions === 2 ? [a[0], a[1], 0] : [[0, a[1], a[2]], [b[0], 0, a[2]], [a[0], a[1], 0]][axis]; // where its numbers stand
    const out = [0, 0, 0];
    others.forEach(other => { out[other] = (foot[other] === b[other] ? 0.03 : -0.03) * extent; }); // away from the box
    if (!data.labels[axis]) continue;
    const step = roundStep((b[axis] - a[axis]) / (b[axis] - a[axis] > 0.4 * extent ? 4 : 2));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let value = Math.ceil(a[axis] / step - 1e-9) * step; value <= b[axis] + 1e-9 * step; value += step) {
      const tick = foot.with(axis, value);
      places.push(...tick, ...tick.map((x, k) => x + 0.4 * out[k]));
      addLabel((Math.abs(value) < 1e-9 * step ? 0 : value).toFixed(digits), new THREE.Vector3(...tick.map((x, k) => x + out[k])));
    }
    const middle = foot.with(axis, (a[axis] + b[axis]) / 2).map((x, k) => x + 3.4 * out[k]);
    addLabel(data.labels[axis], new THREE.Vector3(...middle), "axis");
  }
  axes.add(line(places, 0x8a949e, data.box ? 0.9 : 0.45));
  scene.add(axes);
  for (const { name, place } of data.marks) addMark(name, place);
}

function addMark(name, place) {
  addLabel(name, new THREE.Vector3(...place), "mark");
  const ball = new THREE.Mesh(new THREE.SphereGeometry(0.015 * extent, 24, 16), new THREE.MeshBasicMaterial({ color: 0xf0a030 }));
  ball.position.set(...place);
  scene.add(ball);
}

function roundStep(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return power * [1, 2, 5, 10].find(factor => factor * power >= 0.999 * step);
}

// The direction to a camera, from its azimuth and elevation in degrees.
function sightOf([azimuth, elevation]) {
  const [turn, rise] = [azimuth, POLE * elevation].map(angle => angle * Math.PI / 180);
  return new THREE.Vector3(Math.cos(rise) * Math.cos(turn), Math.cos(rise) * Math.sin(turn), Math.sin(rise));
}

// Put the camera where the whole box is visible.
function resetView() {
  const middle = new THREE.Vector3().addVectors(low, high).multiplyScalar(0.5);
  const sight = (data.camera ? sightOf(data.camera) : data.flat ? new THREE.Vector3(0, 0, 1) : new THREE.Vector3(0.58, -0.82, 0.42)).normalize();
  const right = new THREE.Vector3().crossVectors(camera.up, sight).normalize(), up = new THREE.Vector3().crossVectors(sight, right);
  const slope = Math.tan(camera.fov * Math.PI / 360);
  let distance = 0;
  for (let k = 0; k < 8; k++) {
    const corner = new THREE.Vector3(...[0, 1, 2].map(axis => ((k >> axis & 1) ? high : low).getComponent(axis))).sub(middle);
    const across = Math.max(Math.abs(corner.dot(right)) / camera.aspect, Math.abs(corner.dot(up)));
    distance = Math.max(distance, across / slope + corner.dot(sight));
  }
  controls.target.copy(middle);
  camera.position.copy(middle).addScaledVector(sight, 1.22 * distance * (data.camera?.[2] ?? 1));
  controls.update();
}

// Time ----------------------------------------------------------------------------------------------------------------

const { start, end, scale, unit: timeUnit } = data.time;
const perSecond = (data.frames - 1) * data.speed / (end - start); // frames in a second of the film
const digits = Math.max(0, Math.ceil(-Math.log10((end - start) / scale / (data.frames - 1))));
const pace = element("pace"), slider = element("time");
let place = 0, playing = true, changed = true, drawn = [];

const timeAt = frame => start + (end - start) * frame / (data.frames - 1);

function seek(frame) {
  place = Math.max(0, Math.min(data.frames - 1, frame));
  slider.value = place;
  const text = `t = ${(timeAt(place) / scale).toFixed(digits)} ${timeUnit}`.trim();
  element("clock").textContent = text;
  slider.setAttribute("aria-valuetext", text);
  changed = true;
}

function play(yes) {
  playing = yes;
  document.querySelector("#play path").setAttribute("d", yes ? SHAPES.pause : SHAPES.play);
  element("play").setAttribute("aria-label", yes ? "Pause" : "Play");
  if (ratio < sharp) resize();
}

function step(frames) {
  play(false);
  seek(Math.round(place) + frames);
}

// Drawing -------------------------------------------------------------------------------------------------------------

const sharp = Math.min(devicePixelRatio, 2); // pixels in the picture for a pixel of the page
let last = 0, ratio = sharp, slow = 0;

function resize() {
  const { clientWidth, clientHeight } = canvas.parentElement;
  camera.aspect = clientWidth / clientHeight;
  camera.updateProjectionMatrix();
  renderer.setPixelRatio(playing ? ratio : sharp);
  shared.ratio.value = renderer.getPixelRatio();
  renderer.setSize(clientWidth, clientHeight, false);
  shared.pixel.value = 2 * Math.tan(camera.fov * Math.PI / 360) / clientHeight;
  changed = true;
}

function draw() {
  motion.show(place);
  shared.frame.value = place;
  for (const { times, all, last } of trails) {
    const now = times.findLastIndex(t => t <= timeAt(place)) + 2; // up to the point itself
    const since = times.findLastIndex(t => t <= timeAt(place) - TRAIL * data.speed) + 1;
    all.geometry.setDrawRange(0, 2 * now);
    last.geometry.setDrawRange(2 * since, 2 * (now - since));
  }
  renderer.render(scene, camera);
  const { clientWidth, clientHeight } = canvas, seen = new THREE.Vector3();
  for (const { place: where, span, isMark } of labels) {
    seen.copy(where).project(camera);
    const x = (seen.x + 1) / 2 * clientWidth, y = (1 - seen.y) / 2 * clientHeight;
    span.hidden = seen.z > 1 || !(axes.visible || isMark);
    span.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, ${isMark ? "40%" : "-50%"})`;
  }
}

// A slow computer gets fewer pixels while the motion runs.
function lighten(seconds) {
  slow = seconds > 1 / 22 ? slow + 1 : Math.max(0, slow - 1);
  if (slow < 4 || ratio <= 0.6 * sharp) return;
  slow = 0;
  ratio = Math.max(0.6 * sharp, 0.75 * ratio);
  resize();
}

function tick(now) {
  requestAnimationFrame(tick);
  const seconds = Math.min((now - last) / 1000, 0.25);
  last = now;
  if (playing) seek((place + seconds * perSecond * Number(pace.value)) % (data.frames - 1));
  if (!changed) return;
  changed = false;
  draw();
  drawn = [...drawn.filter(t => t > now - 2000), now];
  if (playing) lighten(seconds);
}

// Controls ------------------------------------------------------------------------------------------------------------

async function chooseColor(name) {
  const color = data.colors.find(color => color.name === name);
  motion.color(color ? restore(await block(color.block, Uint8Array), data.frames, 8) : null);
  shared.colored.value = Boolean(color);
  element("legend").hidden = !color;
  if (color) {
    element("low").textContent = short(color.low);
    element("high").textContent = `${short(color.high)} ${color.unit}`;
  }
  changed = true;
}

const short = value => Number(value.toPrecision(3)).toString();

function palette() {
  const scaleCanvas = element("scale"), pen = scaleCanvas.getContext("2d"), ramp = pen.createLinearGradient(0, 0, scaleCanvas.width, 0);
  VIRIDIS.forEach((color, k) => ramp.addColorStop(k / (VIRIDIS.length - 1), color));
  pen.fillStyle = ramp;
  pen.fillRect(0, 0, scaleCanvas.width, 1);
  const pixels = pen.getImageData(0, 0, scaleCanvas.width, 1).data;
  const texture = new THREE.DataTexture(new Uint8Array(pixels), scaleCanvas.width, 1);
  texture.magFilter = texture.minFilter = THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

function paint() {
  renderer.setClearColor(getComputedStyle(document.body).backgroundColor);
  shared.isDark.value = dark.matches ? 1 : 0;
  changed = true;
}

// A picture has the labels too.
function savePicture() {
  draw();
  const copy = document.createElement("canvas"), dots = canvas.width / canvas.clientWidth;
  copy.width = canvas.width;
  copy.height = canvas.height;
  const pen = copy.getContext("2d"), colors = getComputedStyle(document.body);
  pen.drawImage(canvas, 0, 0);
  pen.fillStyle = colors.color;
  pen.font = `${12 * dots}px system-ui, sans-serif`;
  pen.fillText(`${data.name}   ${element("clock").textContent}`, 14 * dots, 24 * dots);
  pen.textAlign = "center";
  const frame = canvas.getBoundingClientRect();
  for (const { span } of labels.filter(label => !label.span.hidden)) {
    const box = span.getBoundingClientRect();
    pen.fillText(span.textContent, (box.x + box.width / 2 - frame.x) * dots, (box.y + box.height * 0.75 - frame.y) * dots);
  }
  copy.toBlob(file => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(file);
    link.download = `${data.name.replace(/[^\p{L}\p{N}._ -]/gu, "_")}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  });
}

function showAxes(yes) {
  axes.visible = yes;
  element("axes").setAttribute("aria-pressed", yes);
  changed = true;
}

const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: event => step(event.shiftKey ? -10 : -1),
  ArrowRight: event => step(event.shiftKey ? 10 : 1),
  Home: () => step(-data.frames),
  End: () => step(data.frames),
  "+": () => { pace.selectedIndex = Math.min(pace.selectedIndex + 1, pace.length - 1); },
  "-": () => { pace.selectedIndex = Math.max(pace.selectedIndex - 1, 0); },
  a: () => showAxes(!axes.visible),
  r: () => resetView(),
  p: () => savePicture(),
};

function press(event) {
  if (event.target.tagName === "SELECT" || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.tagName === "BUTTON" && event.key === " ") return; // it clicks the button
  const isDigit = /^[0-9]$/.test(event.key);
  const action = isDigit ? () => seek((data.frames - 1) * Number(event.key) / 10) : KEYS[event.key];
  if (!action) return;
  event.preventDefault();
  action(event);
}

async function begin() {
  const [bytes, radii, kinds, links, faces] = await Promise.all([
    block("positions", Uint8Array), block("radii", Float32Array), block("kinds", Uint8Array),
    block("links", Uint32Array), block("faces", Uint32Array),
  ]);
  motion = new Motion(restore(bytes, data.frames, data.bits), faces);
  shared.palette.value = palette();
  addPlanes();
  addLinks(links);
  addFaces(faces);
  addSolids(links);
  addPoints(kinds, radii);
  addAxes();
  await addTrails();
  for (const { name } of data.colors) element("color").add(new Option(name, name, false, name === data.colored));
  await chooseColor(element("color").value);
  element("lines").textContent = data.lines.join(" · ");
  slider.max = data.frames - 1;
  new ResizeObserver(resize).observe(canvas.parentElement);
  resize();
  resetView();
  paint();
  play(true);
  element("message").hidden = true;
  slider.oninput = () => { play(false); seek(slider.valueAsNumber); };
  element("play").onclick = () => play(!playing);
  element("color").onchange = event => chooseColor(event.target.value);
  element("axes").onclick = () => showAxes(!axes.visible);
  element("reset").onclick = resetView;
  element("picture").onclick = savePicture;
  controls.addEventListener("change", () => { changed = true; });
  dark.addEventListener("change", paint);
  addEventListener("keydown", press);
  requestAnimationFrame(tick);
}

// For tests: the number of pictures a second that were drawn in the last two seconds.
window.rate = () => drawn.length < 2 ? 0 : 1000 * (drawn.length - 1) / (drawn.at(-1) - drawn[0]);
begin().catch(error => {
  element("message").textContent = `The data of this page cannot be read: ${error.message}`;
  throw error;
});
