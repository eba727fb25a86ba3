// ---- panels that fold, drawers on narrow windows, a sheet on phones; the cube of standard views ------------------------
const WIDE = window.matchMedia("(min-width: 1100px)"), DARK = window.matchMedia("(prefers-color-scheme: dark)");
const DRAWERS = { left: "tab-left", right: "tab-right", events: "tab-events" };

// Top and bottom colour of the ground behind the scene.
const ground = () => (DARK.matches ? ["#353c47", "#15181d"] : world.info.colors.background);

function paintGround() {
  if (!world.info) return;
  document.body.style.background = `linear-gradient(${ground()})`; // goes on beside the canvas
  painter.stale = true;
  viewer.set_dirty();
}

function fold(side, off = !document.body.classList.contains(`${side}-off`)) {
  document.body.classList.toggle(`${side}-off`, off);
  $(`fold-${side}`).textContent = (side === "left") === off ? "»" : "«";
  $(`fold-${side}`).setAttribute("aria-expanded", String(!off));
}

function openDrawer(name) {
  document.body.dataset.open = document.body.dataset.open === name ? "" : name;
  for (const [key, tab] of Object.entries(DRAWERS))
    $(tab).setAttribute("aria-expanded", String(document.body.dataset.open === key));
  document.querySelector("footer").classList.toggle("open", document.body.dataset.open === "events");
}

for (const side of ["left", "right"]) {
  $(`fold-${side}`).onclick = () => fold(side);
  fold(side, false);
}
for (const [name, tab] of Object.entries(DRAWERS)) $(tab).onclick = () => openDrawer(name);
document.body.dataset.open = "";
DARK.addEventListener("change", paintGround);
new ResizeObserver(() => {
  viewer.set_3d_pane_size();
  if (world.info && !world.steered) frameCamera();
}).observe($("pane"));

// Faces of the cube: name, normal and upward direction in the scene's axes, z up.
const SIDES = [
  ["front", [0, -1, 0], [0, 0, 1]], ["back", [0, 1, 0], [0, 0, 1]], ["left", [-1, 0, 0], [0, 0, 1]],
  ["right", [1, 0, 0], [0, 0, 1]], ["top", [0, 0, 1], [0, 1, 0]], ["bottom", [0, 0, -1], [0, -1, 0]],
];
const HALF = 22; // px
const FLIP = new THREE.Matrix4().makeScale(1, -1, 1); // the page's y goes down
const block = element("div");
$("cube").append(block);
for (const [name, normal, up] of SIDES) {
  const n = toThree(normal), u = toThree(up), right = u.clone().cross(n), side = element("button", "", name);
  const place = new THREE.Matrix4().makeBasis(right, u.clone().negate(), n).setPosition(n.clone().multiplyScalar(HALF));
  side.style.transform = `matrix3d(${FLIP.clone().multiply(place).elements.join()})`;
  side.title = `view from the ${name}`;
  side.onclick = () => lookFrom(normal, up);
  block.append(side);
}

function turnCube() {
  const turn = new THREE.Matrix4().extractRotation(viewer.camera.matrixWorldInverse);
  block.style.transform = `matrix3d(${FLIP.clone().multiply(turn).multiply(FLIP).elements.join()})`;
}

// See what is selected, or everything, from a side.
function lookFrom(normal) {
  const { controls, camera } = viewer, distance = camera.position.distanceTo(controls.target);
  const away = toThree(normal);
  if (Math.abs(away.y) === 1) away.add(new THREE.Vector3(0, 0, 1e-3)); // straight down there is no up
  camera.position.copy(controls.target).add(away.setLength(distance));
  frameParts(selection.parts.length ? selection.parts : world.parts.filter(isShown));
}
