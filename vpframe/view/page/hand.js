// ---- parts in hand: what a person does is asked of the session, and the session does it --------------------------------
let desk = { holder: 0, held: [], undo: 0, redo: 0, script: [], saves: "" };
let drags = null; // { part, local, facing, asked } a point of a part; or { axis, ring, … } the gizmo
let gizmo = null;

const canHold = () => Boolean(socket && world.info && world.info.hand && !looking());
const holding = () => desk.holder !== 0 && desk.holder === world.client && desk.held.length > 0;
const dragging = () => drags !== null;
const letGo = () => send({ action: "release" });

function showDesk(message) {
  desk = message;
  const held = desk.held.map((index) => world.parts[index]);
  const other = desk.holder !== 0 && desk.holder !== world.client;
  $("in-hand").textContent = !held.length ? "nothing in hand"
    : `${groupName(held.map((part) => part.name))} ${other ? "held by another page" : "in hand"}`;
  $("stopped").textContent = desk.stopped ? `stopped: ${desk.stopped}` : desk.holding ? desk.holding.text : "";
  showStop();
  $("undo").disabled = !desk.undo;
  $("redo").disabled = !desk.redo;
  $("done").replaceChildren(...desk.script.map((line) => element("div", "", line)));
  $("done").scrollTop = 1e9;
  $("save").textContent = desk.saves ? `Saved in ${desk.saves}` : "Save script";
  if (world.last) showHeld(world.last);
  showHandOf();
}

// A part by its name, all parts of a subassembly by its name, others as the first of so many.
function groupName(names) {
  if (names.length === 1) return names[0];
  const paths = names.map((name) => name.split("/").slice(0, -1));
  const end = paths[0].findIndex((step, k) => paths.some((path) => path[k] !== step));
  const group = paths[0].slice(0, end < 0 ? paths[0].length : end).join("/");
  const whole = group && world.parts.filter((part) => part.name.startsWith(`${group}/`)).length === names.length;
  return whole ? `${group} (${names.length} parts)` : `${names[0]} and ${names.length - 1} more`;
}

// Light what holds the held part, or the faces that stop it, and say so beside the cursor.
let stops = { key: "", faces: [], ends: [] };

function showStop() {
  const { text, parts, loose } = desk.holding ?? { text: "", parts: [], loose: 0 }, at = desk.stopped_at ?? [];
  const key = JSON.stringify([text, parts, at, desk.stopped]);
  if (key === stops.key) return;
  for (const part of stops.faces) cover(part, "stop", [], 0, 0);
  for (const end of stops.ends) end();
  const faces = new Map();
  for (const [index, face] of at) if (face >= 0) faces.set(world.parts[index], [...(faces.get(world.parts[index]) ?? []), face]);
  for (const [part, own] of faces) cover(part, "stop", own, world.info.colors.colliding, 0.4);
  stops = { key, faces: [...faces.keys()], ends: parts.map((index) => outline(world.parts[index], STOPS)) };
  const words = text || (desk.stopped && at.length ? `stopped: ${desk.stopped}` : ""), box = $("why");
  box.hidden = !words || !holding();
  if (!box.hidden) {
    $("why-text").textContent = words;
    $("why-loosen").hidden = !loose;
    $("why-loosen").textContent = `Take out ${loose === 1 ? shortName(world.parts[parts[0]].name) : `these ${loose}`} first`;
    $("why-free").hidden = !text;
    box.style.left = `${Math.max(8, Math.min(pointer.x + 22, window.innerWidth - 290))}px`;
    box.style.top = `${Math.max(8, Math.min(pointer.y + 18, window.innerHeight - 130))}px`;
  }
  viewer.set_dirty();
}

function showHandOf() {
  if (!world.info || !world.info.hand) return;
  const held = holding();
  $("grab").disabled = !selection.node || desk.holder !== 0 && !held;
  $("release").disabled = !held;
  for (const made of document.querySelectorAll("#exact input, #exact select, #exact button")) made.disabled = !held;
  showGizmo();
  if (world.last) showOffer(world.last);
}

function grabSelected() {
  const { part, level } = selection.node;
  send({ action: "grab", part, level, surface: level ? -1 : selection.surface });
}

// ---- drag

const isMine = (part) => holding() && desk.held.includes(part.index);

// Take the part under the mouse along, if it is selected (or in hand already), or turn the gizmo; whether it is.
function beginDrag(event) {
  if (!canHold() || measuring() || apart.share > 0) return false;
  rayAt(event.clientX, event.clientY);
  const handle = gizmo && caster.intersectObjects(gizmo.handles, false)[0];
  if (handle) return beginGizmo(handle.object.userData);
  const found = pick(event.clientX, event.clientY);
  if (!found || !(selection.parts.includes(found.part) || isMine(found.part))) return false;
  const facing = new THREE.Plane().setFromNormalAndCoplanarPoint(
    viewer.camera.getWorldDirection(new THREE.Vector3()), found.point);
  drags = { part: found.part, local: found.local, facing, surface: found.surface, begun: false };
  return true;
}

function drag(x, y) {
  const ray = rayAt(x, y);
  if (drags.gizmo) return dragGizmo(ray);
  const at = ray.intersectPlane(drags.facing, new THREE.Vector3());
  if (!at) return;
  if (!drags.begun) {
    if (!isMine(drags.part)) grabSelected();
    drags.begun = true;
  }
  // a point of what is held: of a subassembly the held part is not the one under the mouse
  const lead = isMine(drags.part) ? world.parts[desk.held[0]] : drags.part;
  if (lead !== drags.lead) {
    drags.lead = lead;
    drags.point = lead === drags.part ? drags.local
      : lead.solid.worldToLocal(drags.part.solid.localToWorld(new THREE.Vector3(...drags.local))).toArray();
  }
  if (!isMine(drags.part)) return; // the grab is under way
  send({ action: "drag", point: drags.point, to: fromThree(at), free: $("free").checked });
}

function endDrag() {
  const was = drags !== null && (drags.begun || drags.gizmo);
  if (was) send({ action: "rest" });
  drags = null;
  return Boolean(was);
}

// ---- the gizmo: arrows and rings about the middle of what is held, along the world's axes

const STOPS = 0xd92b2b;
const AXES = [["x", 0xd94a4a, [1, 0, 0]], ["y", 0x3c9a4e, [0, 1, 0]], ["z", 0x2f6fe0, [0, 0, 1]]];

function showGizmo() {
  if (gizmo) {
    viewer.scene.remove(gizmo.group);
    gizmo.group.traverse(({ geometry, material }) => { if (geometry) { geometry.dispose(); material.dispose(); } });
  }
  gizmo = null;
  viewer.set_dirty();
  if (!holding() || !$("gizmo").checked || !canHold()) return;
  const lead = world.parts[desk.held[0]];
  const sphere = boxOf(desk.held.map((index) => world.parts[index])).getBoundingSphere(new THREE.Sphere());
  const camera = viewer.camera, view = camera.position.distanceTo(sphere.center) * Math.tan(camera.fov * Math.PI / 360);
  const size = THREE.MathUtils.clamp(1.25 * sphere.radius, 0.15 * view, 0.5 * view), group = new THREE.Group(), handles = [];
  group.position.set(...fromThree(sphere.center)); // meshcat's scene is as scripts have it, z up
  for (const [name, color, direction] of AXES) {
    const along = new THREE.Vector3(...direction);
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
    const material = new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.85 });
    const unseen = new THREE.MeshBasicMaterial({ visible: false });
    const add = (geometry, shown, data) => {
      const mesh = new THREE.Mesh(geometry, shown);
      mesh.quaternion.copy(turn);
      mesh.renderOrder = 6;
      group.add(mesh);
      if (data) { mesh.userData = data; handles.push(mesh); }
    };
    add(new THREE.CylinderGeometry(0.012 * size, 0.012 * size, size, 8).translate(0, size / 2, 0), material);
    add(new THREE.ConeGeometry(0.05 * size, 0.16 * size, 16).translate(0, 1.08 * size, 0), material);
    add(new THREE.CylinderGeometry(0.07 * size, 0.07 * size, 0.6 * size, 8).translate(0, 0.9 * size, 0), unseen,
      { name, direction, ring: false });
    add(new THREE.TorusGeometry(0.8 * size, 0.01 * size, 6, 64).rotateX(Math.PI / 2), material);
    add(new THREE.TorusGeometry(0.8 * size, 0.05 * size, 6, 48).rotateX(Math.PI / 2), unseen,
      { name, direction, ring: true });
  }
  viewer.scene.add(group);
  group.updateMatrixWorld(true);
  gizmo = { group, handles, lead };
}

function beginGizmo({ direction, ring }) {
  const center = toThree(gizmo.group.position.toArray()), axis = toThree(direction);
  drags = {
    gizmo: true, ring, axis, center, begin: gizmo.lead.group.parent.matrix.clone(), from: null,
    flat: new THREE.Plane().setFromNormalAndCoplanarPoint(axis, center),
  };
  return true;
}

// Where the mouse is on a gizmo's handle: metres along an arrow, radians about a ring; null where that is not told.
function onHandle(ray) {
  const { axis, center, flat, ring } = drags;
  if (ring) {
    const at = ray.intersectPlane(flat, new THREE.Vector3());
    if (!at) return null;
    const side = Math.abs(axis.y) < 0.9 ? new THREE.Vector3(0, 1, 0) : new THREE.Vector3(1, 0, 0);
    const u = side.cross(axis).normalize(), v = axis.clone().cross(u);
    at.sub(center);
    return Math.atan2(at.dot(v), at.dot(u));
  }
  const apart = ray.origin.clone().sub(center), cosine = ray.direction.dot(axis), rest = 1 - cosine * cosine;
  return rest < 1e-4 ? null : (apart.dot(axis) - cosine * apart.dot(ray.direction)) / rest;
}

function dragGizmo(ray) {
  const value = onHandle(ray);
  if (value === null) return;
  if (drags.from === null) { drags.from = value; return; }
  const by = value - drags.from, axis = new THREE.Vector3(...fromThree(drags.axis));
  const center = new THREE.Vector3(...fromThree(drags.center)), pose = drags.begin.clone();
  if (drags.ring) pose.premultiply(new THREE.Matrix4().makeTranslation(-center.x, -center.y, -center.z))
    .premultiply(new THREE.Matrix4().makeRotationAxis(axis, by))
    .premultiply(new THREE.Matrix4().makeTranslation(center.x, center.y, center.z));
  else pose.premultiply(new THREE.Matrix4().makeTranslation(by * axis.x, by * axis.y, by * axis.z));
  const at = new THREE.Vector3(), turn = new THREE.Quaternion(), scale = new THREE.Vector3();
  pose.decompose(at, turn, scale);
  send({ action: "place", pose: [...at.toArray(), turn.x, turn.y, turn.z, turn.w], free: $("free").checked });
}

// ---- offers beside the cursor

let offered = null;

function showOffer(frame) {
  const held = desk.held.map((index) => world.parts[index].name);
  const best = holding() && !looking()
    ? frame.constraints.find((c) => c.state === "candidate" && c.parts.some((name) => held.includes(name))) : undefined;
  const box = $("offer");
  if (!best) { offered = null; box.hidden = true; return; }
  if (offered === best.id && !box.hidden) return;
  if (offered !== best.id) { // it stays where it came up, so that it can be clicked
    offered = best.id;
    box.style.left = `${Math.min(pointer.x + 22, window.innerWidth - 260)}px`;
    box.style.top = `${Math.min(pointer.y + 18, window.innerHeight - 90)}px`;
  }
  $("offer-text").textContent = `${best.kind} with ${best.parts.find((name) => !held.includes(name)) ?? best.parts[1]}?`;
  box.hidden = false;
}

$("offer-accept").onclick = () => { send({ action: "accept", id: offered }); $("offer").hidden = true; };
$("offer-refuse").onclick = () => { send({ action: "refuse", id: offered }); $("offer").hidden = true; };
$("why-loosen").onclick = () => { $("why").hidden = true; send({ action: "loosen" }); };
$("why-free").onclick = () => { $("why").hidden = true; $("free").checked = true; say("drag it again: its mates are dropped"); };
$("grab").onclick = grabSelected;
$("release").onclick = letGo;
$("gizmo").onchange = showGizmo;
$("undo").onclick = () => send({ action: "undo" });
$("redo").onclick = () => send({ action: "redo" });
$("save").onclick = () => send({ action: "save" });
$("exact").onsubmit = (event) => {
  event.preventDefault();
  const along = $("exact-axis").value, by = Number($("exact-by").value);
  if (!Number.isFinite(by) || by === 0) return;
  if ($("exact-unit").value === "mm") send({ action: "slide", along, distance: by / 1e3 });
  else send({ action: "turn", about: along, angle: by * Math.PI / 180 });
};
