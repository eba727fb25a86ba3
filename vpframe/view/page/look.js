// ---- how the scene is looked at ---------------------------------------------------------------------------------------

function setOpacity(part, value) {
  part.opacity = value;
  applyOpacity(part);
}

function applyOpacity(part) {
  const value = part.hidden ? 0 : Math.min(part.opacity, part.faded ? 0.12 : part.glassy ? 0.45 : 1);
  for (const material of part.materials) {
    const before = material.transparent;
    material.transparent = value < 1;
    material.opacity = value;
    material.depthWrite = value === 1;
    if (before !== material.transparent) material.needsUpdate = true;
  }
  part.group.visible = value > 0;
  part.inside.visible = !part.closed || value < 1 || clip() !== null;
}

// Fade all but some parts, and look through those if `glassy`; null ends it.
function focusOn(parts, glassy = false) {
  for (const part of world.parts) {
    const faded = parts !== null && !parts.includes(part), glass = parts !== null && !faded && glassy;
    if (faded === Boolean(part.faded) && glass === Boolean(part.glassy)) continue;
    Object.assign(part, { faded, glassy: glass });
    applyOpacity(part);
  }
  if (parts === null) removeMarker();
  viewer.set_dirty();
}

let marker = null;

function removeMarker() {
  if (marker) viewer.scene.remove(marker);
  marker = null;
}

// Show where two parts meet: others faded, these translucent, the place (world, m) marked and in the middle of the picture,
// seen from the side from which most of it is free.
function showPlace(indices, at, faces = []) {
  const parts = indices.map((index) => world.parts[index]);
  focusOn(parts, true);
  if (at) seeFreely(parts, toThree(at));
  select(parts, null, -1);
  $("selected").textContent = faces.length ? faces.join(" – ") : parts.map((part) => part.name).join(" – ");
  removeMarker();
  const box = boxOf(parts);
  const small = Math.min(...parts.map((part) => part.geometry.boundingSphere.radius));
  if (!at) return frameBox(box);
  const ball = (radius, color, order) => {
    const made = new THREE.Mesh(new THREE.SphereGeometry(radius, 16, 12), new THREE.MeshBasicMaterial(
      { color, depthTest: false, transparent: true, opacity: 0.9 }));
    made.renderOrder = order;
    return made;
  };
  marker = ball(0.04 * small, 0xe01b24, 5);
  marker.add(ball(0.055 * small, 0xffffff, 4)); // a rim: faces that clash are as red
  marker.position.set(...at);
  viewer.scene.add(marker);
  frameBox(new THREE.Box3().setFromCenterAndSize(toThree(at), new THREE.Vector3(1, 1, 1).multiplyScalar(1.6 * small)));
}

// Turn the camera about a place to the direction in which the fewest of two parts hide it, nearest to today's.
function seeFreely(parts, at) {
  const camera = viewer.camera, target = viewer.controls.target, distance = camera.position.distanceTo(target);
  const now = camera.position.clone().sub(target).normalize();
  const sides = [now];
  for (let k = 0; k < 40; k++) { // evenly over the sphere, by the golden angle
    const y = 1 - 2 * (k + 0.5) / 40, r = Math.sqrt(1 - y * y), angle = 2.399963 * k;
    sides.push(new THREE.Vector3(r * Math.cos(angle), y, r * Math.sin(angle)));
  }
  const far = 4 * world.info.camera.radius;
  const hiding = (side) => {
    caster.set(at.clone().addScaledVector(side, far), side.clone().negate());
    caster.far = far;
    const hits = parts.filter(isShown).flatMap((part) => caster.intersectObject(part.solid, false)).filter((hit) => hit.distance < far * (1 - 1e-4));
    caster.far = Infinity;
    return hits.length - 0.9 * side.dot(now);
  };
  const best = sides.map((side) => [hiding(side), side]).sort((a, b) => a[0] - b[0])[0][1];
  camera.position.copy(target).addScaledVector(best, distance);
}

// ---- the camera

function boxOf(parts) {
  const box = new THREE.Box3();
  for (const part of parts) {
    part.solid.updateWorldMatrix(true, false);
    box.union(part.geometry.boundingBox.clone().applyMatrix4(part.solid.matrixWorld));
  }
  return box;
}

function frameBox(box) {
  const camera = viewer.camera, target = viewer.controls.target;
  const sphere = box.getBoundingSphere(new THREE.Sphere());
  const back = camera.position.clone().sub(target).setLength(4.2 * narrow() * Math.max(sphere.radius, 1e-6));
  target.copy(sphere.center);
  camera.position.copy(target).add(back);
  apart.farther = 1;
  steered();
}

function steered() {
  world.steered = true;
  viewer.controls.update();
  showGizmo(); // its size is of the view
}

const frameParts = (parts) => frameBox(boxOf(parts));

// What the cursor points at stays under it.
function zoomToCursor(event) {
  event.preventDefault();
  event.stopPropagation();
  const camera = viewer.camera, target = viewer.controls.target;
  const found = pick(event.clientX, event.clientY);
  let at = found && found.point;
  if (!at) {
    const facing = new THREE.Plane().setFromNormalAndCoplanarPoint(
      camera.position.clone().sub(target).normalize(), target);
    at = rayAt(event.clientX, event.clientY).intersectPlane(facing, new THREE.Vector3());
  }
  if (!at) return;
  const scale = Math.exp(Math.max(-200, Math.min(200, event.deltaY)) / 600);
  camera.position.sub(at).multiplyScalar(scale).add(at);
  target.sub(at).multiplyScalar(scale).add(at);
  steered();
}

// ---- section, explosion, colours, picture

function applySection() {
  const axis = $("section-axis").value;
  if (axis) {
    const { target, radius } = world.info.camera;
    const i = "xyz".indexOf(axis), sign = plane.flipped ? -1 : 1;
    const place = target[i] + Number($("section").value) * radius;
    const normal = [0, 0, 0];
    normal[i] = -sign; // what the plane's normal points away from is cut
    plane.normal.copy(toThree(normal));
    plane.constant = sign * place;
  }
  for (const part of world.parts) {
    part.group.traverse(({ material }) => {
      if (material) { material.clippingPlanes = clip(); material.needsUpdate = true; }
    });
    applyOpacity(part);
  }
  viewer.set_dirty();
}

// Draw each part away from the middle of the picture; its pose stays as it is. Symbols are where the parts would be.
function explode() {
  const { share } = apart, middle = toThree(world.info.camera.target);
  for (const part of world.parts) {
    const node = part.group.parent.matrixWorld;
    const away = part.geometry.boundingBox.getCenter(new THREE.Vector3()).applyMatrix4(node).sub(middle);
    const turn = new THREE.Matrix4().extractRotation(node).invert();
    part.group.position.copy(away.clampLength(0, world.info.camera.radius).multiplyScalar(share).applyMatrix4(turn));
  }
  viewer.set_dirty();
}

const apart = { share: 0, farther: 1 }; // what is drawn apart, and how much farther away the camera is for it

// Whether a part is in the picture with all of its box.
function isWhole(part) {
  const box = around([part.solid]), { width, height } = canvas.domElement;
  return box !== null && box.min.x > 0 && box.min.y > 0 && box.max.x < width && box.max.y < height;
}

// Draw parts apart; the camera steps back until what would be seen of them, or seen whole, is.
function drawApart(share) {
  stepBack(1 / apart.farther);
  apart.farther = 1;
  apart.share = 0;
  explode();
  const seen = world.parts.filter((part) => isShown(part) && inPicture(part)), whole = seen.filter(isWhole);
  apart.share = share;
  explode();
  while (apart.farther < 4 && !(seen.every(inPicture) && whole.every(isWhole))) { stepBack(1.05); apart.farther *= 1.05; }
  if (world.last) showSymbols(world.last);
}

const FREEDOM = ["#5b6470", "#4c78a8", "#3fa7a0", "#63b04c", "#c9b73c", "#e08b3a", "#d95f5f"];

function colorParts() {
  const byFreedom = $("by-freedom").checked;
  for (const part of world.parts) {
    const freedom = world.freedom.get(part.index);
    part.color = new THREE.Color(!byFreedom ? part.own : freedom === undefined ? "#d0d4da" : FREEDOM[freedom[0]]);
    part.materials[0].color.copy(part.color);
    part.materials[1].color.copy(part.color).multiplyScalar(0.62);
  }
  $("freedoms").hidden = !byFreedom;
  viewer.set_dirty();
}

function showFreedom(rows) {
  rows.forEach((row, index) => world.freedom.set(index, row));
  if ($("by-freedom").checked) colorParts();
}

function screenshot() {
  viewer.render();
  download(canvas.domElement.toDataURL("image/png"), "vpframe.png");
}

function download(address, name) {
  const link = element("a");
  Object.assign(link, { href: address, download: name });
  link.click();
  world.downloaded = name;
}

$("home").onclick = () => { focusOn(null); frameCamera(); drawApart(apart.share); showGizmo(); };
$("opacity").oninput = () => {
  const choice = $("opacity-part").value;
  for (const part of choice === "" ? world.parts : [world.parts[choice]]) setOpacity(part, Number($("opacity").value));
  viewer.set_dirty();
};
$("opacity-part").onchange = () => {
  const choice = $("opacity-part").value;
  $("opacity").value = choice === "" ? 1 : world.parts[choice].opacity;
};
$("section-axis").onchange = $("section").oninput = applySection;
$("section-flip").onclick = () => { plane.flipped = !plane.flipped; applySection(); };
$("edges").onchange = () => {
  for (const part of world.parts) part.lines.visible = $("edges").checked;
  viewer.set_dirty();
};
$("symbols").onchange = () => { if (world.last) showSymbols(world.last); viewer.set_dirty(); };
$("trail").onchange = () => { for (const name of world.trail.keys()) drawTrail(name); viewer.set_dirty(); };
$("explode").oninput = () => drawApart(Number($("explode").value));
$("by-freedom").onchange = colorParts;
$("picture").onclick = screenshot;
$("all").onclick = () => { focusOn(null); setHidden(world.parts, false); };
$("freedoms").append(...FREEDOM.map((color, n) => {
  const made = element("span", "swatch", String(n));
  made.style.background = color;
  return made;
}));

function showLegend() {
  const colors = { ...world.info.colors.state, clash: world.info.colors.colliding };
  $("legend").replaceChildren(...Object.entries(colors).map(([name, color]) => {
    const made = element("span", "", name), dot = element("span", "dot");
    dot.style.cssText = `background: ${color}; display: inline-block; margin-right: 3px`;
    made.prepend(dot);
    return made;
  }));
}

window.addEventListener("keydown", (event) => {
  if (event.target.matches("input:not([type=checkbox]):not([type=range]), select, textarea")) return;
  const key = event.key.toLowerCase(), chosen = selection.parts;
  if ((event.ctrlKey || event.metaKey) && (key === "z" || key === "y")) {
    event.preventDefault();
    return send({ action: key === "y" || event.shiftKey ? "redo" : "undo" });
  }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (key === "f" && chosen.length) frameParts(chosen);
  else if (key === "home") $("home").click();
  else if (key === "h" && chosen.length) setHidden(chosen, true);
  else if (key === "i" && chosen.length) isolate(chosen);
  else if (key === "escape") { focusOn(null); if (holding()) letGo(); select([]); }
  else if ((key === "a" || key === "r") && !$("offer").hidden) $(key === "a" ? "offer-accept" : "offer-refuse").click();
});
