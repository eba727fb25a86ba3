// ---- painting: on demand, and little while something moves --------------------------------------------------------------
// What stands is drawn once, smoothed, into `still`. While something moves, only the place where it was is taken from
// there, and what moves is drawn on it. While the view moves all is drawn, as finely as keeps up. At rest all is fine.
const REST = 200, SLOW = 30, RETRY = 1e4; // ms: at rest after, too long for a frame, until finer frames are tried again
const FINE = 0, PLAIN = 1, COARSE = 2; // smoothed; not smoothed; of a quarter of the pixels, without edges and outlines
const SETTLED = 600; // ms: what has looked the same for so long during a motion is drawn with what stands again, once
const BANDS = 48; // of one colour each: cheaper than a gradient in software, and no coarser than its colours are
const painter = {
  still: null, targets: [], known: new Map(), loose: new Map(), restless: new WeakSet(), view: "", sweep: true, stale: true, rect: null, changed: 0,
  swept: 0, rested: false, all: true, layered: canvas.capabilities.isWebGL2, level: FINE, coarsened: -RETRY, cost: 0, before: 0, painted: 0, count: 0,
};
canvas.autoClear = false; // `drawBackground` does that
const atRest = (now) => now - painter.changed > (pointer.down ? 5 : 1) * REST; // a slow step of a drag is no rest
viewer.animate = () => {};
viewer.render = () => repaint(performance.now(), true);
requestAnimationFrame(tick);
caster.layers.enableAll();

function tick(now) {
  requestAnimationFrame(tick);
  if (painter.painted > 1) keepUp(now - painter.before); // the first frame may have waited for other things
  painter.before = now;
  const painted = painter.count;
  if (viewer.needs_render || atRest(now) && !painter.rested) repaint(now);
  painter.painted = painter.count > painted ? painter.painted + 1 : 0;
}

// Coarser frames where the last ones took too long.
function keepUp(took) {
  painter.cost = 0.6 * painter.cost + 0.4 * Math.min(took, 4 * SLOW);
  if (painter.cost < SLOW || painter.level >= COARSE) return;
  painter.level++;
  painter.cost = 0;
  painter.coarsened = painter.before;
}

function aspect(object) {
  const { geometry, material, matrixWorld } = object;
  return [geometry.id, geometry.index ? geometry.index.version : 0, material.id, material.version, material.opacity, object.renderOrder,
    material.color ? material.color.getHex() : 0, ...matrixWorld.elements].join();
}

// The objects that are drawn; those that look otherwise than before are loose from then on.
function survey(now) {
  const { scene, camera } = viewer, drawn = [], lights = [];
  scene.updateMatrixWorld();
  camera.updateProjectionMatrix();
  scene.traverseVisible((object) => {
    if (object.isLight) { object.layers.enableAll(); lights.push(object.intensity, object.color.getHex()); }
    else if (object.material && object.material.visible) drawn.push(object);
  });
  const size = canvas.getSize(new THREE.Vector2());
  const view = [size.x, size.y, window.devicePixelRatio, ...lights,
    ...camera.matrixWorld.elements, ...camera.projectionMatrix.elements].join();
  const before = painter.known, moved = view !== painter.view;
  painter.view = view;
  painter.known = new Map();
  let changed = moved;
  for (const object of drawn) {
    const seen = aspect(object);
    painter.known.set(object, seen);
    if (before.get(object) === seen) continue;
    changed = true;
    if (!painter.loose.has(object) && before.has(object)) painter.stale = true;
    painter.loose.set(object, now);
  }
  for (const object of before.keys()) if (!painter.known.has(object)) {
    changed = true;
    if (!painter.loose.delete(object)) painter.stale = true;
  }
  if (changed) {
    if (painter.rested && now - painter.coarsened > RETRY) painter.level = Math.max(painter.level - 1, FINE);
    painter.changed = now;
    painter.rested = false;
    settle(now);
  }
  if (moved) turnCube();
  if (moved || painter.loose.size === drawn.length) painter.swept = now;
  painter.sweep = now - painter.swept <= REST;
  return drawn;
}

// Objects that came or changed once, such as symbols, need not be drawn with every frame.
function settle(now) {
  const settled = [...painter.loose].filter(([object, since]) => now - since > SETTLED && !painter.restless.has(object));
  if (settled.length < 4) return; // a few cost less than all that stands does
  for (const [object] of settled) {
    painter.loose.delete(object);
    painter.restless.add(object);
  }
  painter.stale = true;
}

function repaint(now, fine = false) {
  if (!world.info) return;
  viewer.controls.update();
  viewer.needs_render = false;
  const drawn = survey(now);
  const rests = fine || atRest(now);
  if (painter.changed !== now && (painter.rested || !rests) && !fine) return; // all looks as it did
  if (rests) {
    painter.rested = painter.stale = true;
    painter.sweep = false;
    painter.swept = -REST;
    painter.loose.clear();
    painter.restless = new WeakSet();
  }
  const { camera } = viewer, { loose, sweep } = painter, level = painter.rested ? FINE : painter.level;
  const ratio = window.devicePixelRatio * (level === COARSE ? 0.5 : 1);
  if (canvas.getPixelRatio() !== ratio) {
    canvas.setPixelRatio(ratio);
    painter.stale = true;
  }
  const all = loose.size === 0 || sweep;
  if (all !== painter.all) painter.stale = true;
  painter.all = all;
  for (const object of drawn) { // what can be looked through is drawn after what moves behind it
    const { transparent, depthTest } = object.material, over = !all && (loose.has(object) || transparent && depthTest);
    object.layers.set(level === COARSE && object.userData.spared ? 2 : over ? 1 : 0);
  }
  camera.layers.set(0);
  if (sweep && level !== FINE || !painter.layered) {
    painter.stale = true;
    drawAll();
  } else {
    const fresh = painter.stale || sweep;
    if (fresh) drawStill(level === FINE);
    painter.stale = sweep;
    const rect = all ? null : around(drawn.filter((object) => object.layers.mask === 2));
    copyStill(fresh || !rect || !painter.rect ? null : rect.clone().union(painter.rect));
    painter.rect = rect;
    if (!all) drawLoose();
  }
  painter.count++;
}

function drawStill(smooth) {
  const { width, height } = canvas.domElement;
  const kind = smooth ? THREE.WebGLMultisampleRenderTarget : THREE.WebGLRenderTarget;
  painter.still = painter.targets[Number(smooth)] ??= new kind(1, 1, { stencilBuffer: true });
  painter.still.setSize(width, height);
  canvas.setRenderTarget(painter.still);
  drawAll();
  canvas.setRenderTarget(null);
}

function drawAll() {
  drawBackground();
  canvas.render(viewer.scene, viewer.camera);
}

function drawBackground() {
  const gl = canvas.getContext(), { width, height, clientHeight } = canvas.domElement;
  const page = window.innerHeight, below = page - clientHeight; // the page's background goes on below the canvas
  const [top, bottom] = ground().map((color) => new THREE.Color(color)), color = new THREE.Color();
  gl.enable(gl.SCISSOR_TEST);
  for (let k = 0; k < BANDS; k++) {
    const from = Math.floor(k * height / BANDS), to = Math.floor((k + 1) * height / BANDS);
    color.lerpColors(bottom, top, (below + (k + 0.5) / BANDS * clientHeight) / page);
    gl.scissor(0, from, width, to - from);
    gl.clearColor(color.r, color.g, color.b, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }
  gl.disable(gl.SCISSOR_TEST);
  gl.clear(gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
}

// Colour and depth of what stands, onto the canvas: all of it, or a rectangle (pixels).
function copyStill(rect) {
  const gl = canvas.getContext(), { width, height } = canvas.domElement;
  const from = canvas.properties.get(painter.still).__webglFramebuffer;
  const [x, y, X, Y] = rect ? [rect.min.x, rect.min.y, rect.max.x, rect.max.y] : [0, 0, width, height];
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from); // the canvas is bound to be drawn on
  gl.blitFramebuffer(x, y, X, Y, x, y, X, Y, gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT, gl.NEAREST);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
  if (painter.count === 0 && gl.getError()) painter.layered = false; // this canvas keeps depth in another way
}

function drawLoose() {
  viewer.camera.layers.set(1);
  canvas.render(viewer.scene, viewer.camera);
  viewer.camera.layers.set(0);
}

// The rectangle of the canvas (pixels) that objects are in, with room for outlines; null: it may be all of it.
function around(objects) {
  const { width, height } = canvas.domElement, rect = new THREE.Box2(), corner = new THREE.Vector3();
  for (const { geometry, matrixWorld } of objects) {
    if (!geometry.boundingBox) geometry.computeBoundingBox();
    const { min, max } = geometry.boundingBox;
    if (min.x > max.x) continue; // nothing is in it
    for (let k = 0; k < 8; k++) {
      corner.set(k & 1 ? min.x : max.x, k & 2 ? min.y : max.y, k & 4 ? min.z : max.z).applyMatrix4(matrixWorld);
      if (corner.clone().applyMatrix4(viewer.camera.matrixWorldInverse).z >= 0) return null; // behind the eye
      corner.project(viewer.camera);
      rect.expandByPoint(new THREE.Vector2((corner.x + 1) / 2 * width, (corner.y + 1) / 2 * height));
    }
  }
  if (rect.isEmpty()) rect.set(new THREE.Vector2(), new THREE.Vector2());
  rect.expandByScalar(5);
  rect.min.floor().clampScalar(0, Infinity);
  rect.max.ceil().min(new THREE.Vector2(width, height)).max(rect.min);
  return rect;
}
