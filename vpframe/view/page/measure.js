// ---- the distance, angle and diameter of two faces --------------------------------------------------------------------
const measured = [];
const measuring = () => $("measure").classList.contains("on");
const mm = (metres) => `${Number(Number((1e3 * metres).toPrecision(7)).toFixed(6))} mm`; // to a nanometre

$("measure").onclick = () => {
  measured.length = 0;
  $("measured").textContent = $("measure").classList.toggle("on") ? "click two faces" : "";
  drawDimension(null);
};

// What is known of a face in the world: kind, point, direction, radius; of free forms the point that was clicked.
function placed({ part, surface, point }) {
  const known = part.measures[surface];
  if (!known) return { kind: "free", point, radius: 0 };
  const [kind, at, along, radius] = known, matrix = part.solid.matrixWorld;
  const direction = new THREE.Vector3(...along).transformDirection(matrix);
  return { kind, radius, direction, point: new THREE.Vector3(...at).applyMatrix4(matrix) };
}

function measure(found) {
  if (measured.length === 2) { measured.length = 0; drawDimension(null); }
  measured.push(found);
  selectPart(found.part, found.surface);
  const names = measured.map((face) => faceName(face.part, face.surface));
  const words = measured.length === 2 ? between(...measured) : alone(placed(found));
  $("measured").textContent = [...names, ...words].join("\n");
  $("measured").scrollIntoView({ block: "nearest" });
}

let dimension = null;

// A line between the two places that a distance is of, with a mark at each end.
function drawDimension(ends) {
  if (dimension) viewer.scene.remove(dimension);
  dimension = null;
  viewer.set_dirty();
  if (!ends) return;
  dimension = new THREE.Group();
  const material = new THREE.LineBasicMaterial({ color: HOVER, depthTest: false }), size = 0.012 * world.info.camera.radius;
  const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(ends), material);
  line.renderOrder = 7;
  dimension.add(line, ...ends.map((end) => {
    const mark = new THREE.Mesh(new THREE.SphereGeometry(size, 12, 8), new THREE.MeshBasicMaterial({ color: HOVER, depthTest: false }));
    mark.position.copy(end);
    mark.renderOrder = 7;
    return mark;
  }));
  viewer.scene.add(dimension);
}

const alone = (face) => (face.radius > 0 ? [`diameter ${mm(2 * face.radius)}`] : []);

function between(first, second) {
  const a = placed(first), b = placed(second), words = [...alone(a), ...alone(b)];
  const apart = b.point.clone().sub(a.point);
  const directed = (face) => face.kind === "plane" || face.kind === "axis";
  let distance = first.point.distanceTo(second.point), what = "between the points clicked";
  if (directed(a) && directed(b)) {
    const cosine = Math.min(1, Math.abs(a.direction.dot(b.direction)));
    let angle = Math.acos(cosine) * 180 / Math.PI;
    if (a.kind !== b.kind) angle = 90 - angle; // of an axis to a plane
    if (Math.abs(angle) < 1e-4) angle = 0;
    words.push(`angle ${Number(angle.toFixed(4))}°`);
    const normal = a.kind === "plane" ? a.direction : b.kind === "plane" ? b.direction : null;
    if (angle === 0 && normal) [distance, what] = [Math.abs(apart.dot(normal)), "along the normal"];
    else if (!normal && angle === 0)
      [distance, what] = [apart.clone().addScaledVector(a.direction, -apart.dot(a.direction)).length(), "between the axes"];
    else if (!normal)
      [distance, what] = [Math.abs(apart.dot(a.direction.clone().cross(b.direction).normalize())), "between the axes"];
  } else if (a.kind === "point" && b.kind === "point") [distance, what] = [apart.length(), "between the centres"];
  else if ([a.kind, b.kind].includes("point") && (directed(a) || directed(b))) {
    const line = directed(a) ? a : b, along = apart.dot(line.direction);
    [distance, what] = line.kind === "plane" ? [Math.abs(along), "of the centre from the plane"]
      : [apart.clone().addScaledVector(line.direction, -along).length(), "of the centre from the axis"];
  }
  drawDimension(across(a, b, first, second, distance));
  return [...words, `distance ${mm(distance)} (${what})`];
}

// The two ends of a measured distance (three's world): of planes and axes from the first point clicked along the shortest way.
function across(a, b, first, second, distance) {
  if (a.kind === "point" && b.kind === "point") return [a.point, b.point];
  const foot = (face, p) => {
    const off = p.clone().sub(face.point);
    if (face.kind === "plane") return p.clone().addScaledVector(face.direction, -off.dot(face.direction));
    return face.point.clone().addScaledVector(face.direction, off.dot(face.direction));
  };
  const directed = (face) => face.kind === "plane" || face.kind === "axis";
  let ends = [first.point, second.point];
  if (directed(a) && directed(b)) {
    const from = a.kind === "axis" ? foot(a, first.point) : first.point;
    ends = [from, foot(b, from)];
  } else if (directed(a) && b.kind === "point") ends = [foot(a, b.point), b.point];
  else if (directed(b) && a.kind === "point") ends = [a.point, foot(b, a.point)];
  // askew axes and faces have no such pair beside the point clicked: the points clicked then
  return Math.abs(ends[0].distanceTo(ends[1]) - distance) <= 1e-6 + 1e-3 * distance ? ends : [first.point, second.point];
}
