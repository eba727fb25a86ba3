// ---- what is under the mouse, and what is selected -------------------------------------------------------------------
// Places of scripts are in metres with z up; three's world has y up.
const toThree = (p) => new THREE.Vector3(p[0], p[2], -p[1]);
const fromThree = (v) => [v.x, -v.z, v.y];

const caster = new THREE.Raycaster();
const pointer = { x: 0, y: 0, moved: false, down: false };
const selection = { parts: [], node: null, surface: -1 };
const HOVER = 0xf08a1c, SELECTED = 0x2f6fe0;

function rayAt(x, y) {
  const box = canvas.domElement.getBoundingClientRect();
  caster.setFromCamera(
    { x: 2 * (x - box.left) / box.width - 1, y: 1 - 2 * (y - box.top) / box.height }, viewer.camera);
  return caster.ray;
}

// Where a point that the camera projected is in the window, pixels.
function onScreen(at) {
  const box = canvas.domElement.getBoundingClientRect();
  return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
}

const isShown = (part) => !part.hidden && part.group.visible;

// The part, face and point (three's world, and the part's frame) that are seen at a place of the window; null of none.
const pick = (x, y) => picks(x, y)[0] ?? null;

// The same of all parts there, nearest first; what was faded is looked through, unless there is nothing else.
function picks(x, y) {
  rayAt(x, y);
  const cut = $("section-axis").value !== "";
  const found = [];
  for (const part of world.parts) {
    if (!isShown(part)) continue;
    const hits = caster.intersectObjects(cut ? [part.solid, part.inside] : [part.solid], false);
    const hit = hits.find((h) => !cut || plane.distanceToPoint(h.point) >= 0);
    if (hit) found.push({ part, distance: hit.distance, hit });
  }
  found.sort((a, b) => Boolean(a.part.faded) - Boolean(b.part.faded) || a.distance - b.distance);
  return found.map(({ part, hit }) => ({
    part, surface: surfaceOf(part, hit.faceIndex), point: hit.point.clone(),
    local: part.solid.worldToLocal(hit.point.clone()).toArray(),
  }));
}

// What is behind the selected part at a place of the window; after the last part the first one again.
function pickBehind(x, y) {
  const found = picks(x, y), at = found.findIndex(({ part }) => selection.parts.includes(part));
  return found[(at + 1) % found.length] ?? null;
}

function surfaceOf(part, triangle) {
  let low = 0, high = part.triangles.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (part.triangles[middle] <= triangle) low = middle; else high = middle;
  }
  return low;
}

const faceName = (part, surface) => `${part.name} · ${part.faces[surface]}`;

// ---- outlines

const OUTLINE = {
  vertexShader: `uniform float width; uniform vec2 size;
    #include <clipping_planes_pars_vertex>
    void main() {
      vec4 mvPosition = modelViewMatrix * vec4(position, 1.0);
      vec4 p = projectionMatrix * mvPosition;
      vec2 d = (projectionMatrix * vec4(normalize(normalMatrix * normal), 0.0)).xy;
      p.xy += d / max(length(d), 1e-6) * width / size * p.w * 2.0;
      gl_Position = p;
      #include <clipping_planes_vertex>
    }`,
  fragmentShader: `uniform vec3 color;
    #include <clipping_planes_pars_fragment>
    void main() {
      #include <clipping_planes_fragment>
      gl_FragColor = vec4(color, 1.0);
    }`,
};

function outline(part, color) {
  const size = canvas.getSize(new THREE.Vector2());
  const shell = new THREE.Mesh(part.geometry, new THREE.ShaderMaterial({
    ...OUTLINE, side: THREE.BackSide, clipping: true, clippingPlanes: clip(),
    uniforms: { width: { value: 3 }, size: { value: size }, color: { value: new THREE.Color(color) } },
  }));
  const lines = new THREE.LineSegments(part.lines.geometry, new THREE.LineBasicMaterial(
    { color, depthTest: false, transparent: true, opacity: 0.65, clippingPlanes: clip() }));
  lines.renderOrder = 3;
  shell.userData.spared = lines.userData.spared = true; // where frames are coarse
  const made = new THREE.Group();
  made.add(shell, lines);
  part.group.add(made);
  return () => { part.group.remove(made); shell.material.dispose(); lines.material.dispose(); };
}

let hovered = null; // { part, surface, end }

function hover(found) {
  if (hovered && found && hovered.part === found.part && hovered.surface === found.surface) return place(found);
  if (hovered) {
    hovered.end();
    cover(hovered.part, "hover", [], HOVER, 0);
  }
  hovered = null;
  if (found) {
    const { part, surface } = found;
    hovered = { part, surface, end: selection.parts.includes(part) ? () => {} : outline(part, HOVER) };
    const red = world.red.get(part.index)?.has(surface), color = red ? new THREE.Color(world.info.colors.colliding) : part.color;
    cover(part, "hover", [surface], color.clone().lerp(new THREE.Color(HOVER), 0.45), 0);
  }
  place(found);
  viewer.set_dirty();

  function place(at) {
    const label = $("hover");
    label.hidden = !at;
    if (!at) return;
    label.textContent = faceName(at.part, at.surface);
    label.style.left = `${pointer.x + 14}px`;
    label.style.top = `${pointer.y + 16}px`;
  }
}

const outlines = new Map();

// Select parts: those of a node of the tree ({part, level}), or none. `surface`: the face that was clicked, or -1.
function select(parts, node = null, surface = -1) {
  hover(null);
  for (const end of outlines.values()) end();
  outlines.clear();
  Object.assign(selection, { parts, node, surface });
  for (const part of parts) outlines.set(part, outline(part, SELECTED));
  const name = node && node.level ? parts[0].path_names.slice(0, node.level).join("/") : parts.length ? parts[0].name : "";
  $("selected").textContent = !parts.length ? "nothing selected"
    : surface >= 0 ? faceName(parts[0], surface) : parts.length > 1 ? `${name} · ${parts.length} parts` : name;
  if (parts.length === 1) $("opacity-part").value = parts[0].index;
  for (const row of document.querySelectorAll("#tree .node"))
  {
    const chosen = Boolean(node) && row.dataset.key === `${node.part}:${node.level}`;
    row.classList.toggle("chosen", chosen);
    row.setAttribute("aria-selected", String(chosen));
  }
  showHandOf();
  if (world.last && world.info) { showSymbols(world.last); if ($("only-selected").checked) showLists(); }
  viewer.set_dirty();
}

const selectPart = (part, surface = -1) => select([part], { part: part.index, level: 0 }, surface);

// ---- the mouse

function listenToMouse() {
  const pane = $("pane");
  pane.addEventListener("pointermove", (event) => {
    Object.assign(pointer, { x: event.clientX, y: event.clientY, moved: true });
  });
  pane.addEventListener("pointerleave", () => { if (!pointer.down) hover(null); });
  let start = null;
  pane.addEventListener("pointerdown", (event) => {
    Object.assign(pointer, { x: event.clientX, y: event.clientY, down: true });
    start = event.button === 0 ? { x: event.clientX, y: event.clientY } : null;
    hover(null);
    if (start && beginDrag(event)) event.stopPropagation(); // the camera stays
  }, true);
  window.addEventListener("pointerup", (event) => {
    pointer.down = false;
    const still = start && Math.hypot(event.clientX - start.x, event.clientY - start.y) < 4;
    start = null;
    const dragged = endDrag();
    if (!still || dragged) return;
    const found = (event.altKey ? pickBehind : pick)(event.clientX, event.clientY);
    if (measuring() && found) return measure(found);
    focusOn(null);
    if (found) selectPart(found.part, found.surface); else select([]);
  });
  document.body.addEventListener("pointerdown", (event) => { // beside the canvas and the panels
    if (event.target !== document.body) return;
    focusOn(null);
    select([]);
  });
  pane.addEventListener("dblclick", (event) => {
    const found = pick(event.clientX, event.clientY);
    if (found) frameParts([found.part]);
  });
  pane.addEventListener("wheel", zoomToCursor, { passive: false, capture: true });
  const look = () => {
    if (pointer.moved && world.info) {
      pointer.moved = false;
      if (dragging()) drag(pointer.x, pointer.y);
      else if (!pointer.down) hover(pick(pointer.x, pointer.y));
    }
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}

// ---- the tree

function showTree() {
  const root = { children: new Map() };
  for (const part of world.parts) {
    let node = root;
    part.path_names.forEach((name, k) => {
      const last = k + 1 === part.path_names.length;
      const key = last ? `${name} ${part.index}` : name;
      if (!node.children.has(key))
        node.children.set(key, { name, children: new Map(), parts: [], part: part.index, level: last ? 0 : k + 1 });
      node = node.children.get(key);
      node.parts.push(part);
    });
  }
  const build = (node, depth) => {
    const row = element("div", "node");
    row.dataset.key = `${node.part}:${node.level}`;
    row.style.paddingLeft = `${10 * depth}px`;
    Object.assign(row, { tabIndex: 0, role: "treeitem" });
    row.setAttribute("aria-level", depth + 1);
    row.setAttribute("aria-selected", "false");
    if (node.children.size) row.setAttribute("aria-expanded", "true");
    row.onkeydown = (event) => {
      if (event.target !== row) return;
      if (event.key === "Enter") name.click();
      else if (node.children.size && event.key === (rest.hidden ? "ArrowRight" : "ArrowLeft")) fold.click();
    };
    const fold = element("span", "fold", node.children.size ? "▾" : "");
    const eye = element("input");
    Object.assign(eye, { type: "checkbox", checked: true, title: "show", ariaLabel: `show ${node.name}` });
    eye.onchange = () => { setHidden(node.parts, !eye.checked); };
    const name = element("span", "what", node.name);
    name.title = node.name;
    name.onclick = () => { focusOn(null); select(node.parts, { part: node.part, level: node.level }); };
    name.ondblclick = () => frameParts(node.parts);
    const only = element("button", "small", "only");
    only.title = "show nothing else";
    only.onclick = () => isolate(node.parts);
    row.append(fold, eye, name, only);
    const rest = element("div");
    for (const child of node.children.values()) rest.append(build(child, depth + 1));
    fold.onclick = () => {
      rest.hidden = !rest.hidden;
      fold.textContent = rest.hidden ? "▸" : "▾";
      row.setAttribute("aria-expanded", String(!rest.hidden));
    };
    const all = element("div");
    all.append(row, rest);
    all.parts = node.parts;
    return all;
  };
  $("tree").replaceChildren(...[...root.children.values()].map((node) => build(node, 0)));
}

function setHidden(parts, hidden) {
  for (const part of parts) { part.hidden = hidden; applyOpacity(part); }
  for (const row of document.querySelectorAll("#tree .node"))
    row.querySelector("input").checked = row.parentElement.parts.some((part) => !part.hidden);
  if (world.last) showSymbols(world.last);
  viewer.set_dirty();
}

function isolate(parts) {
  setHidden(world.parts, true);
  setHidden(parts, false);
}
