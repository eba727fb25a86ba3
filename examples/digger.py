"""Two digger components (a link with its pin, an arm with bored bosses) and a shaft that enters a bore.

The parts that `vpframe bench collision` measures on, tessellated with numpy alone:

- `link()` (14 surfaces, 3,521 triangles) and `arm()` (25 surfaces, 6,205 triangles), the sizes of the pair that
  Tables 1-3 of the paper measure, with `digger_trajectory()`, on which the pin enters the arm's bore until its collar
  sits on the boss, turns there and comes out again;
- `shaft()` (14 surfaces, 3,656 triangles) and `housing()` (25 surfaces, 6,400 triangles), 1 % radial clearance, with
  `shaft_trajectory()`, and `true_pairs()`, which answers on the surfaces of revolution themselves: the truth that the
  faceted answer is measured against.

All lengths in metres; all axes along z. A pose is that of the second part (`arm`, `housing`) in the frame of the first.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from collision import SurfaceMesh

Array = NDArray[np.float64]
Profile = Sequence[tuple[float, float]]
"""(z, r) corners; the outside lies on the left when walking along it in the (z, r) plane."""

SHAFT_PROFILE: Profile = (
    (0.000, 0.0000), (0.000, 0.0085), (0.0015, 0.0100), (0.020, 0.0100), (0.020, 0.0090), (0.023, 0.0090),
    (0.023, 0.0100), (0.060, 0.0100), (0.060, 0.0160), (0.068, 0.0160), (0.069, 0.0150), (0.069, 0.0110),
    (0.085, 0.0110), (0.086, 0.0100), (0.086, 0.0000),
)  # fmt: skip
"""Tip at z = 0, journal r = 10 mm with a groove, flange at z = 60 mm, tail: 14 surfaces."""

HOUSING_PROFILE: Profile = (
    (0.000, 0.0113), (-0.0012, 0.0101), (-0.018, 0.0101), (-0.018, 0.0115), (-0.021, 0.0115), (-0.021, 0.0101),
    (-0.042, 0.0101), (-0.042, 0.0112), (-0.045, 0.0112), (-0.045, 0.0101), (-0.064, 0.0101), (-0.065, 0.0111),
    (-0.065, 0.0200), (-0.064, 0.0210), (-0.040, 0.0210), (-0.040, 0.0240), (-0.030, 0.0240), (-0.030, 0.0220),
    (-0.012, 0.0220), (-0.012, 0.0310), (-0.011, 0.0320), (-0.002, 0.0320), (-0.001, 0.0310), (-0.001, 0.0180),
    (0.000, 0.0180), (0.000, 0.0113),
)  # fmt: skip
"""Mouth of the bore at z = 0, bore r = 10.1 mm with two grooves, through to z = -65 mm: 25 surfaces."""


class _Builder:
    """Collects surfaces as triangles of points; welds them once at the end."""

    def __init__(self) -> None:
        self.corners: list[Array] = []
        self.surface: list[int] = []
        self.n_surfaces = 0

    def add(self, triangles: Array) -> None:
        """One more surface: (m, 3, 3) corners, wound outwards; corners that coincide make no triangle."""
        t = np.round(triangles, 12)
        keep = [len(np.unique(corner, axis=0)) == 3 for corner in t]
        self.corners.append(t[keep])
        self.surface += [self.n_surfaces] * int(np.count_nonzero(keep))
        self.n_surfaces += 1

    def grid(self, points: Array) -> None:
        """One surface from an (n, m, 3) grid of points, normals along (d/dn) x (d/dm)."""
        p00, p10, p01, p11 = points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]
        lower, upper = np.stack([p00, p10, p11], axis=2), np.stack([p00, p11, p01], axis=2)
        self.add(np.stack([lower, upper], axis=2).reshape(-1, 3, 3))

    def revolve(
        self, profile: Profile, center: tuple[float, float], sectors: int, rows: Sequence[int], halves: bool = False
    ) -> None:
        """One surface (two halves if asked) for each segment of the profile, turned about the line through `center`."""
        angle = 2 * np.pi * np.arange(sectors + 1) / sectors
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        circle[-1] = circle[0]
        half = sectors // 2
        for (z0, r0), (z1, r1), n in zip(profile[:-1], profile[1:], rows, strict=True):
            s = np.linspace(0.0, 1.0, n + 1)
            r, z = r0 + s * (r1 - r0), z0 + s * (z1 - z0)
            points = np.empty((n + 1, sectors + 1, 3))
            points[:, :, :2] = center + r[:, None, None] * circle[None, :, :]
            points[:, :, 2] = z[:, None]
            points = points.transpose(1, 0, 2)
            if halves and r0 == r1:
                self.grid(points[: half + 1])
                self.grid(points[half:])
            else:
                self.grid(points)

    def cap(self, outline: Array, holes: Sequence[Array], z: float, up: bool, spacing: float) -> None:
        """A planar surface between an outline (n, 2) and circular holes (k, 2) at height z."""
        low, high = outline.min(axis=0), outline.max(axis=0)
        inner = np.stack(np.meshgrid(*(np.arange(low[i], high[i], spacing) for i in (0, 1))), axis=-1).reshape(-1, 2)
        loops = [outline, *holes]
        distance = np.min([np.linalg.norm(inner[:, None] - loop[None], axis=2).min(axis=1) for loop in loops], axis=0)
        inner = inner[(distance > 0.6 * spacing) & _inside(inner, outline)]
        for hole in holes:
            inner = inner[~_inside(inner, hole)]
        points = np.concatenate([*loops, inner])
        triangles = Delaunay(points).simplices
        middle = points[triangles].mean(axis=1)
        keep = _inside(middle, outline)
        for hole in holes:
            keep &= ~_inside(middle, hole)
        corners = np.concatenate([points[triangles[keep]], np.full((int(keep.sum()), 3, 1), z)], axis=2)
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        turned = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0) != up
        corners[turned] = corners[turned][:, ::-1]
        self.add(corners[np.argsort(middle[keep][:, 0], kind="stable")])

    def wall(self, line: Array, z0: float, z1: float, rows: int) -> None:
        """The surface that a piece (n, 2) of a counter-clockwise outline sweeps from z0 up to z1."""
        z = np.linspace(z0, z1, rows + 1)
        points = np.empty((len(line), rows + 1, 3))
        points[:, :, :2] = line[:, None]
        points[:, :, 2] = z
        self.grid(points)

    def mesh(self, name: str, n_triangles: int | None) -> SurfaceMesh:
        """Weld, refine to exactly `n_triangles` and pack."""
        corners = np.concatenate(self.corners)
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        triangles = index.reshape(-1, 3)
        surface = np.array(self.surface)
        if n_triangles is not None:
            vertices, triangles, surface = refine(vertices, triangles, surface, n_triangles)
        return SurfaceMesh(vertices, triangles, surface, name=name)


def _inside(points: Array, loop: Array) -> NDArray[np.bool_]:
    x, y = points[:, :1], points[:, 1:]
    a, b = loop, np.roll(loop, -1, axis=0)
    crosses = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return (np.count_nonzero(crosses & (x < at), axis=1) % 2) == 1


def refine(
    vertices: Array, triangles: NDArray[np.int_], surface: NDArray[np.int_], n_triangles: int
) -> tuple[Array, NDArray[np.int_], NDArray[np.int_]]:
    """Split edges inside planar surfaces, longest first, until there are `n_triangles`.

    Splitting an edge splits both its triangles, so that the mesh stays closed and its shape stays as it was. A closed
    mesh has an even number of triangles: an odd one needs one edge split on one side only.
    """
    points = [*vertices]
    t = [tuple(int(i) for i in row) for row in triangles]
    s = [int(i) for i in surface]
    normal = np.cross(*(vertices[triangles[:, k]] - vertices[triangles[:, 0]] for k in (1, 2)))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    planar = [np.ptp(normal[surface == k], axis=0).max() < 1e-9 for k in range(int(surface.max()) + 1)]
    if len(t) > n_triangles:
        raise ValueError(f"the mesh has {len(t)} triangles already, {n_triangles} are asked for")
    while len(t) < n_triangles:
        of_edge: dict[tuple[int, int], list[int]] = {}
        for i, row in enumerate(t):
            if planar[s[i]]:
                for a, b in ((row[0], row[1]), (row[1], row[2]), (row[2], row[0])):
                    of_edge.setdefault((min(a, b), max(a, b)), []).append(i)
        edges = [e for e, owner in of_edge.items() if len(owner) == 2]
        edges.sort(key=lambda e: (-round(float(np.linalg.norm(points[e[0]] - points[e[1]])), 9), e))
        used: set[int] = set()
        for a, b in edges:
            owner = of_edge[a, b][: n_triangles - len(t)]
            if not owner or used.intersection(owner):
                continue
            used.update(owner)
            middle = len(points)
            points.append((points[a] + points[b]) / 2)
            for i in owner:
                k = next(k for k in range(3) if {t[i][k], t[i][(k + 1) % 3]} == {a, b})
                p, q, r = t[i][k], t[i][(k + 1) % 3], t[i][(k + 2) % 3]
                t[i] = (p, middle, r)
                t.append((middle, q, r))
                s.append(s[i])
    return np.array(points), np.array(t), np.array(s)


def shaft(sectors: int = 64, n_triangles: int | None = 3656) -> SurfaceMesh:
    """Stepped shaft, 14 surfaces; `n_triangles=None` leaves the count as `sectors` makes it."""
    builder = _Builder()
    builder.revolve(SHAFT_PROFILE, (0.0, 0.0), sectors, (2, 1, 3, 2, 2, 2, 3, 2, 2, 2, 2, 2, 2, 2))
    return builder.mesh("shaft", n_triangles)


def housing(sectors: int = 64, n_triangles: int | None = 6400) -> SurfaceMesh:
    """Bored housing, 25 surfaces; `n_triangles=None` leaves the count as `sectors` makes it."""
    builder = _Builder()
    builder.revolve(HOUSING_PROFILE, (0.0, 0.0), sectors, [2] * 25)
    return builder.mesh("housing", n_triangles)


LINK_LENGTH = 0.34
PIN_RADIUS, BORE_RADIUS = 0.0400, 0.0404
ARM_LENGTH = 1.10
BOSS_HEIGHT = 0.020
ARM_HALF = 0.060
"""half the thickness of the arm between its bosses"""


def _slot(x0: float, r0: float, x1: float, r1: float, sectors: int, steps: int) -> list[Array]:
    """Counter-clockwise outline round two circles on the x axis: flat below, arc at x1, flat above, arc at x0."""
    tilt = np.arccos((r0 - r1) / (x1 - x0))
    right = np.linspace(-tilt, tilt, max(2, round(sectors * tilt / np.pi)) + 1)
    left = np.linspace(tilt, 2 * np.pi - tilt, max(2, round(sectors * (np.pi - tilt) / np.pi)) + 1)
    arc1 = np.stack([x1 + r1 * np.cos(right), r1 * np.sin(right)], axis=1)
    arc0 = np.stack([x0 + r0 * np.cos(left), r0 * np.sin(left)], axis=1)
    s = np.linspace(0.0, 1.0, steps + 1)[:, None]
    below, above = arc0[-1] + s * (arc1[0] - arc0[-1]), arc1[-1] + s * (arc0[0] - arc1[-1])
    return [below, arc1, above, arc0]


def _circle(x: float, r: float, sectors: int) -> Array:
    angle = 2 * np.pi * np.arange(sectors) / sectors
    return np.round(np.stack([x + r * np.cos(angle), r * np.sin(angle)], axis=1), 12)


def link() -> SurfaceMesh:
    """Side link of a bucket linkage with an integral pin along -z: 14 surfaces, 3,521 triangles.

    Origin where the pin's collar would sit on a boss; the plate lies above, a second eye at x = LINK_LENGTH.
    """
    sectors, z0, z1 = 64, 0.012, 0.042
    pieces = _slot(0.0, 0.085, LINK_LENGTH, 0.070, sectors // 2, 12)
    outline = np.concatenate([piece[:-1] for piece in pieces])
    collar, eye = 0.062, 0.034
    builder = _Builder()
    builder.cap(outline, [_circle(0.0, collar, sectors), _circle(LINK_LENGTH, eye, sectors)], z0, False, 0.016)
    builder.cap(outline, [_circle(LINK_LENGTH, eye, sectors)], z1, True, 0.016)
    for piece in pieces:
        builder.wall(piece, z0, z1, 3)
    builder.revolve([(z1, eye), (z0, eye)], (LINK_LENGTH, 0.0), sectors, [3], halves=True)
    end = -2 * (ARM_HALF + BOSS_HEIGHT) - 0.020
    pin_profile = [
        (end - 0.008, 0.0), (end - 0.008, PIN_RADIUS - 0.008), (end, PIN_RADIUS), (-0.006, PIN_RADIUS),
        (0.0, PIN_RADIUS + 0.006), (0.0, collar), (z0, collar),
    ]  # fmt: skip
    builder.revolve(pin_profile, (0.0, 0.0), sectors, [3, 1, 4, 1, 2, 2])
    return builder.mesh("link", 3521)


def arm() -> SurfaceMesh:
    """Digger arm: tapered body, two bored and chamfered bosses, a lightening hole: 25 surfaces, 6,205 triangles.

    Origin on the axis of the bore that the link's pin enters, on the face of its upper boss; the body lies below.
    """
    sectors = 80
    top, bottom = -BOSS_HEIGHT, -BOSS_HEIGHT - 2 * ARM_HALF
    pieces = _slot(0.0, 0.120, ARM_LENGTH, 0.150, sectors // 2, 48)
    upper = pieces[2]
    pieces[2:3] = [upper[:25], upper[24:]]
    lower = pieces[0]
    pieces[0:1] = [lower[:25], lower[24:]]
    outline = np.concatenate([piece[:-1] for piece in pieces])
    bosses = [(0.0, 0.075, BORE_RADIUS), (ARM_LENGTH, 0.095, 0.055)]
    hole = (0.55, 0.060)
    holes = [_circle(x, r, sectors) for x, r, _ in bosses] + [_circle(*hole, sectors)]
    builder = _Builder()
    builder.cap(outline, holes, top, True, 0.028)
    builder.cap(outline, holes, bottom, False, 0.028)
    for piece in pieces:
        builder.wall(piece, bottom, top, 3)
    for x, r_boss, r_bore in bosses:
        chamfer = 0.004
        low, high = bottom - BOSS_HEIGHT, top + BOSS_HEIGHT
        profile = [
            (top, r_boss), (high, r_boss), (high, r_bore + chamfer), (high - chamfer, r_bore), (low + chamfer, r_bore),
            (low, r_bore + chamfer), (low, r_boss), (bottom, r_boss),
        ]  # fmt: skip
        boss, bore = _Builder(), 3
        boss.revolve(profile, (x, 0.0), sectors, [1, 1, 1, 3, 1, 1, 1])
        for k, corners in enumerate(boss.corners):
            if k == bore:  # as CAD systems write it: a bore comes as two half cylinders
                first = corners.mean(axis=1)[:, 1] > 0
                builder.add(corners[first])
                builder.add(corners[~first])
            else:
                builder.add(corners)
    builder.revolve([(top, hole[1]), (bottom, hole[1])], (hole[0], 0.0), sectors, [2])
    return builder.mesh("arm", 6205)


def _along(keys: Sequence[tuple[Sequence[float], Sequence[float]]], n: int) -> list[pin.SE3]:
    """n poses of the first part along screws between keys (rotation vector, translation), given inverted."""
    frames = [pin.SE3(pin.exp3(np.array(rotation)), np.array(translation)) for rotation, translation in keys]
    poses = []
    for u in np.linspace(0.0, len(frames) - 1, n):
        k = min(int(u), len(frames) - 2)
        poses.append(pin.SE3.Interpolate(frames[k], frames[k + 1], float(u - k)).inverse())
    return poses


def digger_trajectory(n: int = 200) -> list[pin.SE3]:
    """Poses of the arm in the frame of the link: the pin comes in askew, seats on the boss, turns, and leaves."""
    depth = 2 * (ARM_HALF + BOSS_HEIGHT)
    return _along(
        [
            ((0.10, 0.05, 0.4), (0.060, 0.030, depth + 0.10)),
            ((0.06, 0.03, 0.4), (0.022, 0.008, depth + 0.02)),
            ((0.004, 0.0, 0.4), (0.0003, 0.0, depth - 0.02)),
            ((0.003, 0.0, 0.4), (0.0006, 0.0, 0.05)),
            ((0.0, 0.0, 0.4), (0.0002, 0.0, -0.0005)),
            ((0.0, 0.0, 2.6), (0.0005, 0.0, -0.0005)),
            ((0.002, 0.001, 2.6), (0.0002, 0.0003, 0.06)),
            ((0.03, 0.02, 2.6), (0.010, 0.010, depth + 0.06)),
        ],
        n,
    )


def shaft_trajectory(n: int = 200) -> list[pin.SE3]:
    """Poses of the housing in the frame of the shaft: the shaft enters off its axis and seats, axes kept parallel."""
    return _along(
        [
            ((0, 0, 0), (0.00150, 0.00000, 0.010)),
            ((0, 0, 0), (0.00120, 0.00030, -0.001)),
            ((0, 0, 0), (0.00005, 0.00002, -0.004)),
            ((0, 0, 0), (0.00012, 0.00000, -0.030)),
            ((0, 0, 0), (0.00003, 0.00003, -0.050)),
            ((0, 0, 0), (0.00008, -0.00008, -0.0599)),
            ((0, 0, 0), (0.00000, 0.00000, -0.0602)),
        ],
        n,
    )


def unrelated_poses(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, n: int = 200, seed: int = 1) -> list[pin.SE3]:
    """n random poses of b in the frame of a, each turned at random, of which the bounding boxes overlap."""
    rng = np.random.default_rng(seed)
    low, high = mesh_a.vertices.min(axis=0), mesh_a.vertices.max(axis=0)
    middle = (mesh_b.vertices.min(axis=0) + mesh_b.vertices.max(axis=0)) / 2
    poses = []
    while len(poses) < n:
        quaternion = rng.normal(size=4)
        rotation = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
        spread = (high - low) / 2 + np.abs(rotation @ (mesh_b.vertices.max(axis=0) - middle))
        target = (low + high) / 2 + rng.uniform(-0.7, 0.7, 3) * spread
        poses.append(pin.SE3(rotation, target - rotation @ middle))
    return poses


def true_pairs(pose: pin.SE3) -> NDArray[np.int32]:
    """(k, 2) surfaces of `shaft()` and `housing()` that meet as surfaces of revolution, whatever their tessellation.

    pose: of the housing in the frame of the shaft, axes parallel. At one height z the two are circles of radii r and R,
    their centres e apart, which meet where |r - R| <= e <= r + R; both radii are linear in z along a profile segment.
    """
    e = float(np.hypot(pose.translation[0], pose.translation[1]))
    dz = float(pose.translation[2])
    pairs = []
    for i, (a0, a1) in enumerate(itertools.pairwise(SHAFT_PROFILE)):
        for j, (b0, b1) in enumerate(itertools.pairwise(HOUSING_PROFILE)):
            low = max(min(a0[0], a1[0]), min(b0[0], b1[0]) + dz)
            high = min(max(a0[0], a1[0]), max(b0[0], b1[0]) + dz)
            if low <= high and _rings_meet(_radii(a0, a1, 0.0, low, high), _radii(b0, b1, dz, low, high), e):
                pairs.append((i, j))
    return np.array(pairs, np.int32).reshape(-1, 2)


def _radii(p: tuple[float, float], q: tuple[float, float], dz: float, low: float, high: float) -> Array:
    """(2, 2) least and greatest radius of a profile segment at z = low and at z = high."""
    z0, z1 = p[0] + dz, q[0] + dz
    if z0 == z1:
        return np.array([[min(p[1], q[1]), max(p[1], q[1])]] * 2)
    at = [p[1] + (z - z0) / (z1 - z0) * (q[1] - p[1]) for z in (low, high)]
    return np.array([[at[0]] * 2, [at[1]] * 2])


def _rings_meet(a: Array, b: Array, e: float) -> bool:
    """Whether for some s in [0, 1] two rings meet whose radii run linearly from row 0 to row 1, centres e apart."""
    first, last = 0.0, 1.0
    for at0, at1 in (
        (a[0, 0] - b[0, 1] - e, a[1, 0] - b[1, 1] - e),
        (b[0, 0] - a[0, 1] - e, b[1, 0] - a[1, 1] - e),
        (e - a[0, 1] - b[0, 1], e - a[1, 1] - b[1, 1]),
    ):  # each linear in s, and needed <= 0
        if at0 > 0 and at1 > 0:
            return False
        if at0 > 0:
            first = max(first, at0 / (at0 - at1))
        elif at1 > 0:
            last = min(last, at0 / (at0 - at1))
    return first <= last


def main() -> None:
    """Print both pairs and what meets along their trajectories."""
    from collision import colliding_surfaces

    for name, a, b, poses in (
        ("digger", link(), arm(), digger_trajectory(48)),
        ("shaft in bore", shaft(), housing(), shaft_trajectory(48)),
    ):
        print(f"{name}: {a.name} {a.n_surfaces} surfaces, {a.n_triangles} triangles;", end=" ")
        print(f"{b.name} {b.n_surfaces} surfaces, {b.n_triangles} triangles")
        before: set[tuple[int, int]] = set()
        for step, pose in enumerate(poses):
            now = {(int(i), int(j)) for i, j in colliding_surfaces(a, b, pose)}
            if now != before:
                text = ", ".join(f"{i}-{j}" for i, j in sorted(now)) or "nothing"
                print(f"  step {step:2d}: {text}")
            before = now


if __name__ == "__main__":
    main()
