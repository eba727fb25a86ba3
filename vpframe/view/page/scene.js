"use strict";
// The page around meshcat's viewer: it draws the scene it is told of, shows the state of the session, and sends back
// what a person asks for. Live it listens on a web socket; as a file it plays the frames that are embedded in it.
const THREE = MeshCat.THREE;
const $ = (id) => document.getElementById(id);
const canvas = new THREE.WebGLRenderer({ alpha: false, antialias: false, stencil: true, preserveDrawingBuffer: true });
$("pane").append(canvas.domElement);
const viewer = new MeshCat.Viewer($("pane"), true, canvas);
viewer.gui.domElement.remove(); // meshcat's own controls: the panels have all that is needed of them
canvas.localClippingEnabled = true;
const fitCanvas = viewer.set_3d_pane_size.bind(viewer);
viewer.set_3d_pane_size = () => fitCanvas($("pane").clientWidth, $("pane").clientHeight); // what the panels leave free
viewer.set_3d_pane_size();
const plane = new THREE.Plane(new THREE.Vector3(1, 0, 0), 0);
const world = {
  info: null, parts: [], shapes: [], strips: new Map(), symbols: new Map(), red: new Map(), trail: new Map(), last: null,
  client: 0, freedom: new Map(), found: null,
};
let socket = null;

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const floats = (text) => new Float32Array(bytes(text));
const clip = () => ($("section-axis").value ? [plane] : null);

function element(tag, className, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

// ---- the scene -----------------------------------------------------------------------------------------------------

function showScene(info) {
  world.info = info;
  document.title = $("title").textContent = info.title.split("/").pop();
  for (const name of ["Background", "Grid", "Axes"]) viewer.set_property([name], "visible", false);
  for (const name of ["PointLightNegativeX", "PointLightPositiveX", "SpotLight"])
    viewer.set_property(["Lights", name], "visible", false);
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.55);
  viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.12);
  paintGround();
  world.shapes = info.shapes.map((shape) => ({
    positions: new THREE.BufferAttribute(floats(shape.positions), 3),
    normals: new THREE.BufferAttribute(floats(shape.normals), 3),
    index: new THREE.BufferAttribute(new Uint32Array(bytes(shape.triangles)), 1),
    lines: new THREE.BufferAttribute(floats(shape.lines), 3),
    start: shape.vertex_start,
    triangles: shape.triangle_start,
    closed: shape.closed,
    faces: shape.faces,
    measures: shape.measures,
  }));
  world.parts = info.parts.map(addPart);
  nameShort();
  frameCamera();
  const choice = $("opacity-part");
  choice.append(new Option("all parts", ""), ...world.parts.map((part, i) => new Option(part.name, i)));
  viewer.set_dirty();
}

function addPart(info, index) {
  const shape = world.shapes[info.shape];
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", shape.positions);
  geometry.setAttribute("normal", shape.normals);
  geometry.setIndex(shape.index);
  geometry.computeBoundingSphere();
  geometry.computeBoundingBox();
  const color = new THREE.Color(info.color);
  const face = new THREE.MeshLambertMaterial(
    { color: info.color, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  // seen from within, a closed part is seen at its cut: one flat, darker colour fills it
  const cut = new THREE.MeshBasicMaterial({ color: color.clone().multiplyScalar(0.62), side: THREE.BackSide });
  const edge = new THREE.LineBasicMaterial({ color: world.info.colors.edge });
  const lines = new THREE.BufferGeometry();
  lines.setAttribute("position", shape.lines);
  const group = new THREE.Group();
  const solid = new THREE.Mesh(geometry, face);
  const inside = new THREE.Mesh(geometry, cut);
  const drawn = new THREE.LineSegments(lines, edge);
  drawn.userData.spared = true;
  group.add(solid, inside, drawn);
  const path = ["parts", `part/${index}`]; // names are of files: "__proto__" is one
  viewer.set_object(path, group);
  viewer.set_transform(path, info.pose);
  const { start, triangles, faces, measures } = shape;
  inside.visible = !shape.closed; // else only a cut or a look through shows it
  return {
    ...info, index, path, closed: shape.closed, geometry, color, own: color, start, triangles, faces, measures, solid, inside, group,
    materials: [face, cut, edge], lines: drawn, opacity: 1, hidden: false, path_names: info.name.split("/"), covers: {},
  };
}

// Some faces of a part in a colour of their own, over the part's; `name`d, and replaced by others of that name. A part
// itself is not drawn again when a face that it touches turns red.
function cover(part, name, faces, color, nearer) {
  const { geometry, start, triangles, covers } = part;
  if (!covers[name]) {
    if (!faces.length) return;
    const shape = new THREE.BufferGeometry();
    for (const given of ["position", "normal"]) shape.setAttribute(given, geometry.attributes[given]);
    shape.setIndex(new THREE.BufferAttribute(new Uint32Array(geometry.index.count), 1));
    shape.boundingBox = new THREE.Box3();
    shape.boundingSphere = new THREE.Sphere();
    const material = new THREE.MeshLambertMaterial(
      { polygonOffset: true, polygonOffsetFactor: nearer, polygonOffsetUnits: nearer, clippingPlanes: clip() });
    covers[name] = new THREE.Mesh(shape, material);
    part.materials.push(material);
    part.group.add(covers[name]);
    applyOpacity(part);
  }
  const { geometry: shape, material } = covers[name], at = new THREE.Vector3();
  let count = 0;
  shape.boundingBox.makeEmpty();
  for (const face of faces) {
    const indices = geometry.index.array.subarray(3 * triangles[face], 3 * triangles[face + 1]);
    shape.index.array.set(indices, count);
    count += indices.length;
    for (let v = start[face]; v < start[face + 1]; v++)
      shape.boundingBox.expandByPoint(at.fromBufferAttribute(geometry.attributes.position, v));
  }
  shape.boundingBox.getBoundingSphere(shape.boundingSphere);
  shape.setDrawRange(0, count);
  shape.index.updateRange.count = count;
  shape.index.needsUpdate = true;
  material.color.set(color);
  covers[name].visible = count > 0;
}

// one camera for good: meshcat's scene tree fails when an object with controls of its own is replaced twice
let lamp = null;

function frameCamera() {
  const { eye, target, radius, across } = world.info.camera;
  if (lamp === null) {
    const camera = new THREE.PerspectiveCamera(30, 1, 1, 2);
    viewer.set_object(["Cameras", "default", "rotated"], camera);
    viewer.set_camera(camera);
    lamp = new THREE.DirectionalLight(0xffffff, 0.5); // it goes with the camera, from above its left shoulder
    camera.add(lamp, lamp.target);
    viewer.controls.addEventListener("start", () => { world.steered = true; });
    viewer.controls.enableZoom = false; // `zoomToCursor` does that
  }
  const camera = viewer.camera;
  camera.near = 0.02 * radius;
  camera.far = 60 * radius;
  camera.zoom = 1;
  viewer.set_3d_pane_size(); // and with it the camera's projection
  camera.position.copy(toThree(target)).add(toThree(eye).sub(toThree(target)).setLength(4.8 * Math.max(radius, across / camera.aspect)));
  lamp.position.set(-0.35 * radius, 0.9 * radius, 0.4 * radius);
  lamp.target.position.set(0, 0, -4 * radius);
  viewer.controls.target.copy(toThree(target));
  viewer.controls.update();
  world.steered = false;
  apart.farther = 1;
}

const narrow = () => Math.max(1, 1 / viewer.camera.aspect); // how much farther away a picture higher than wide is seen from

// a part that leaves the picture makes the camera step back, until a person has taken the camera in hand
function follow(moved) {
  if (world.steered) return;
  if (!moved.every((index) => inPicture(world.parts[index]))) stepBack(1.03);
}

const indicesOf = (names) => names.map((name) => world.parts.findIndex((part) => part.name === name));

function inPicture(part) {
  part.solid.updateWorldMatrix(true, false);
  const center = part.geometry.boundingSphere.center.clone().applyMatrix4(part.solid.matrixWorld).project(viewer.camera);
  return Math.abs(center.x) <= 0.72 && Math.abs(center.y) <= 0.78;
}

function stepBack(factor) {
  const target = viewer.controls.target;
  viewer.camera.position.sub(target).multiplyScalar(factor).add(target);
  viewer.controls.update();
  viewer.camera.updateMatrixWorld();
}

// ---- a frame -------------------------------------------------------------------------------------------------------

function showFrame(frame) {
  world.last = frame;
  const poses = floats(frame.poses);
  frame.moved.forEach((index, i) => viewer.set_transform(world.parts[index].path, poses.subarray(16 * i, 16 * i + 16)));
  viewer.scene.updateMatrixWorld();
  if (socket && !dragging()) follow(frame.moved);
  if (apart.share > 0) explode();
  showCollisions(frame.colliding);
  showSymbols(frame);
  extendTrail(frame);
  if (gizmo && !dragging()) showGizmo();
  showOffer(frame);
  viewer.set_dirty();
  tellSoon();
}

// What panels say, five times a second at most, half as often in a drag, and with a frame while frames come: text alone
// costs as much as a frame.
const TOLD = 200;
let told = -TOLD, telling = null;

function tellSoon() {
  clearTimeout(telling);
  const wait = dragging() ? 2 * TOLD : TOLD;
  if (performance.now() - told >= wait) tell(world.last);
  else telling = setTimeout(() => tell(world.last), wait);
}

function tell(frame) {
  clearTimeout(telling);
  telling = null;
  told = performance.now();
  placeMarks();
  addEvents(timeline.heard.splice(0));
  if (!frame) return;
  $("time").textContent = `${frame.time.toFixed(3)} s`;
  $("step").textContent = `step ${frame.step}`;
  $("script").textContent = frame.script;
  showHeld(frame);
  showClashes();
  showConstraints(frame.constraints);
}

function showCollisions(rows) {
  const red = new Map(); // faces by part
  const add = (part, face) => { if (red.has(part)) red.get(part).add(face); else red.set(part, new Set([face])); };
  const moved = world.info.hand ? elsewhere() : null; // clashes as drawn are in the list, with their places
  for (const [a, s, b, t] of rows) if (!moved || moved.has(a) || moved.has(b)) { add(a, s); add(b, t); }
  for (const index of new Set([...world.red.keys(), ...red.keys()])) {
    const was = world.red.get(index) ?? new Set(), now = red.get(index) ?? new Set();
    if (was.size !== now.size || [...now].some((face) => !was.has(face)))
      cover(world.parts[index], "red", [...now], world.info.colors.colliding, 0.5);
  }
  world.red = red;
}

function tube(points, radius) {
  const rods = [], up = new THREE.Vector3(0, 1, 0), one = new THREE.Vector3(1, 1, 1);
  for (let i = 0; i + 1 < points.length; i++) {
    const along = points[i + 1].clone().sub(points[i]), length = along.length();
    if (length === 0) continue;
    const rod = new THREE.CylinderGeometry(radius, radius, length, 3, 1, true).translate(0, length / 2, 0);
    const turn = new THREE.Quaternion().setFromUnitVectors(up, along.divideScalar(length));
    rods.push(rod.applyMatrix4(new THREE.Matrix4().compose(points[i], turn, one)));
  }
  return rods;
}

function merge(geometries) {
  const positions = [];
  for (const g of geometries) {
    const flat = g.index ? g.toNonIndexed() : g;
    positions.push(flat.attributes.position.array);
  }
  const all = new Float32Array(positions.reduce((n, p) => n + p.length, 0));
  let at = 0;
  for (const p of positions) { all.set(p, at); at += p.length; }
  const merged = new THREE.BufferGeometry();
  merged.setAttribute("position", new THREE.BufferAttribute(all, 3));
  return merged;
}

function points(text) {
  const values = floats(text), list = [];
  for (let i = 0; i < values.length; i += 3) list.push(new THREE.Vector3(values[i], values[i + 1], values[i + 2]));
  return list;
}

function keepStrips(message) {
  const radius = 0.0011 * world.info.camera.radius * message.width;
  const geometry = merge(message.strips.flatMap((strip) => tube(points(strip), radius)));
  world.strips.set(message.number, { geometry, hidden: message.hidden });
}

// a line is drawn in full where it is seen, and faintly through what hides it
function lineObject({ geometry, hidden: opacity }, color) {
  const group = new THREE.Group();
  const front = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color }));
  const hidden = new THREE.Mesh(
    geometry, new THREE.MeshBasicMaterial({ color, transparent: true, opacity, depthTest: false, depthWrite: false }));
  hidden.renderOrder = 1;
  hidden.userData.spared = true; // where frames are coarse
  front.renderOrder = 2;
  group.add(front, hidden);
  return group;
}

function showSymbols(frame) {
  const shown = $("symbols").value && apart.share === 0 ? frame.symbols : [], unseen = unseenSymbols(frame);
  const poses = floats(frame.symbol_poses), names = new Set();
  shown.forEach((symbol, i) => {
    if (unseen.has(symbol.name)) return;
    names.add(symbol.name);
    const key = `${symbol.strips} ${symbol.color}`;
    const path = ["symbols", symbol.name];
    if (world.symbols.get(symbol.name) !== key) {
      viewer.set_object(path, lineObject(world.strips.get(symbol.strips), symbol.color));
      world.symbols.set(symbol.name, key);
    }
    viewer.set_transform(path, poses.subarray(16 * i, 16 * i + 16));
  });
  for (const name of [...world.symbols.keys()].filter((name) => !names.has(name))) {
    viewer.delete_path(["symbols", name]);
    world.symbols.delete(name);
  }
}

// Names of the symbols of which all parts are hidden, or none is selected or moved, unless all are asked for.
function unseenSymbols(frame) {
  const hidden = new Set(world.parts.filter((part) => part.hidden).map((part) => part.name));
  const near = new Set([...selection.parts.map((part) => part.name), ...frame.held, ...Object.keys(frame.freedom)]);
  const far = (names) => $("symbols").value === "near" && !names.some((name) => near.has(name));
  const unseen = frame.constraints.filter((c) => c.parts.every((name) => hidden.has(name)) || far(c.parts));
  return new Set([...unseen.map((c) => `constraint/${c.id}`), ...[...hidden].map((name) => `freedom/${name}`)]);
}

// The shortest end of each part's path that no other part's path has; the whole path is its name.
function nameShort() {
  const counts = new Map(), ends = (part) => part.path_names.map((_, k) => part.path_names.slice(k).join("/")).reverse();
  for (const part of world.parts) for (const end of ends(part)) counts.set(end, (counts.get(end) ?? 0) + 1);
  for (const part of world.parts) part.short = ends(part).find((end) => counts.get(end) === 1) ?? part.name;
}

const shortName = (name) => world.parts.find((part) => part.name === name)?.short ?? name;

function extendTrail(frame) {
  for (const [name, place] of Object.entries(frame.hands)) {
    const trail = world.trail.get(name) ?? [];
    const last = trail[trail.length - 1];
    const here = new THREE.Vector3(...place);
    if (last && last.distanceTo(here) <= 0.004 * world.info.camera.radius) continue;
    trail.push(here);
    if (trail.length > 4000) trail.splice(0, 1000);
    world.trail.set(name, trail);
    drawTrail(name);
  }
}

function drawTrail(name) {
  const trail = world.trail.get(name);
  const geometry = new THREE.BufferGeometry().setFromPoints($("trail").checked ? trail : []);
  viewer.set_object(["trail", `hand/${name}`], new THREE.Line(
    geometry, new THREE.LineBasicMaterial({ color: world.info.colors.trail })));
}

