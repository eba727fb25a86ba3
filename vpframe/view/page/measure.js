// ---- the distance, angle and diameter of two faces --------------------------------------------------------------------
const measured = [];
const measuring = () => $("measure").classList.contains("on");
const mm = (metres) => `${Number(Number((1e3 * metres).toPrecision(7)).toFixed(6))} mm`; // to a nanometre

$("measure").onclick = () => {
  measured.length = 0;
  $("measured").textContent = $("measure").classList.toggle("on") ? "click two faces" : "";
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
  if (measured.length === 2) measured.length = 0;
  measured.push(found);
  selectPart(found.part, found.surface);
  const names = measured.map((face) => faceName(face.part, face.surface));
  const words = measured.length === 2 ? between(...measured) : alone(placed(found));
  $("measured").textContent = [...names, ...words].join("\n");
  $("measured").scrollIntoView({ block: "nearest" });
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
  return [...words, `distance ${mm(distance)} (${what})`];
}
