"""Clash, contact, clearance and containment on parts whose relation is known."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, CollisionManager, SurfaceMesh
from collision.classify import KINDS, PairClass, Reason, _as_a_whole, _below_the_surface, classify, near_pairs
from collision.query.containment import inside
from collision.query.signed_distance import signed_distances
from collision.solid import is_closed
from tests.collision.brute_force import box, sphere, turned, with_slivers
from tests.collision.shapes import at


def pipe(length: float = 2.0, outer: float = 0.5, inner: float = 0.4, sectors: int = 24) -> SurfaceMesh:
    return turned([(0, inner), (0, outer), (length, outer), (length, inner), (0, inner)], sectors, "pipe")


def two(a: SurfaceMesh, b: SurfaceMesh, pose: pin.SE3) -> CollisionManager:
    world = CollisionManager()
    world.add(a, pin.SE3.Identity())
    world.add(b, pose)
    return world


def kind(found: list[PairClass]) -> str | None:
    """The gravest of the two parts' pairs."""
    return min((pair.kind for pair in found if pair.objects == (0, 1)), key=KINDS.index, default=None)


def test_flush_faces_are_contact() -> None:
    found = classify(two(box(1, 1, 1), box(1, 1, 1), at(0.2, 0.1, 1.0)))
    assert kind(found) == "contact"
    assert ((5, 4), 0.0) in [(pair.surfaces, pair.distance) for pair in found]


def test_a_gap_is_contact_within_the_tolerance_then_clearance_then_nothing() -> None:
    gap = two(box(1, 1, 1), box(1, 1, 1), at(0, 0, 1.0 + 5e-6))
    assert kind(classify(gap)) == "contact"
    gap.set_pose(1, at(0, 0, 1.0 + 5e-4))
    assert classify(gap) == []
    found = classify(gap, clearance=1e-3)
    assert kind(found) == "clearance"
    assert min(pair.distance for pair in found) == pytest.approx(5e-4)
    assert classify(gap, deflection=4e-4) == []
    found = classify(gap, deflection=6e-4)  # the true surfaces may touch
    assert kind(found) == "clearance" and min(pair.distance for pair in found) == pytest.approx(5e-4)


def test_overlap_is_clash_with_its_depth_until_authorised() -> None:
    world = two(box(1, 1, 1), box(0.5, 0.5, 0.5), at(0, 0, 0.75 - 2e-3))
    found = classify(world)
    assert kind(found) == "clash"
    assert max(pair.depth for pair in found) == pytest.approx(2e-3, abs=2e-7)
    assert kind(classify(world, authorised=[(1, 0)])) == "authorised"
    clashes = [pair.surfaces for pair in found if pair.kind == "clash" and pair.surfaces is not None]
    some = classify(world, authorised=[(1, t, 0, s) for s, t in clashes[1:]])
    assert [pair.surfaces for pair in some if pair.kind == "clash"] == clashes[:1]
    assert kind(classify(world, deflection=3e-3)) == "contact"


def test_a_faceted_bolt_in_its_faceted_bore_is_contact_within_the_deflection() -> None:
    radius, sectors = 0.005, 20
    sag = radius * (1 - np.cos(np.pi / sectors))
    plate = turned([(0, radius), (0, 0.02), (0.01, 0.02), (0.01, radius), (0, radius)], sectors)
    bolt = turned([(-0.005, 0), (-0.005, radius), (0.01, radius), (0.01, 0.008), (0.014, 0.008), (0.014, 0)], sectors)
    world = two(plate, bolt, pin.SE3(pin.exp3(np.array([0, 0, np.pi / sectors])), np.zeros(3)))
    assert kind(classify(world)) == "clash"
    found = classify(world, deflection=sag)
    assert kind(found) == "contact"
    assert (3, 1) in [pair.surfaces for pair in found]


def test_a_part_inside_another_is_containment() -> None:
    found = classify(two(sphere(0.1), box(1, 1, 1), at(0.2)))
    assert [pair.kind for pair in found] == ["containment"]
    assert found[0].surfaces is None and found[0].words() == "object 0 lies wholly inside object 1"
    assert found[0].distance == pytest.approx(0.2, abs=1e-12)
    assert found[0].depth == pytest.approx(0.4, abs=1e-12)


@pytest.mark.parametrize("part", [box(1, 1, 1), sphere(0.4), pipe()])
def test_identical_coincident_parts_clash(part: SurfaceMesh) -> None:
    found = classify(two(part, part, pin.SE3.Identity()))
    assert kind(found) == "clash"
    assert found[0].surfaces is None and found[0].reason is Reason.COMMON
    turned_a_bit = pin.SE3(pin.exp3(np.array([0, 0, 1e-9])), np.zeros(3))
    assert kind(classify(two(part, part, turned_a_bit))) == "clash"


@pytest.mark.parametrize("offset", [0.3, 0.6, 0.95])
def test_parallel_overlapping_pipes_clash(offset: float) -> None:
    found = classify(two(pipe(), pipe(), at(offset)))
    assert kind(found) == "clash"
    assert (1, 1) in [pair.surfaces for pair in found if pair.kind == "clash"]


@pytest.mark.parametrize("along", [0.0, 0.7, 1.9])
def test_coaxial_pipes_of_one_size_that_overlap_in_length_clash(along: float) -> None:
    assert kind(classify(two(pipe(), pipe(), at(0, 0, along)))) == "clash"


def test_coaxial_pipes_end_to_end_and_one_in_the_other_touch() -> None:
    assert kind(classify(two(pipe(), pipe(), at(0, 0, 2.0)))) == "contact"
    inner = pipe(outer=0.4, inner=0.3)
    assert kind(classify(two(pipe(), inner, at(0, 0, 0.1)))) == "contact"


def test_parts_flush_with_a_part_of_slivers_only_touch_it() -> None:
    """Pseudonormals of its slivers, rounding alone, made a clash of one touch in eight."""
    half = np.array([0.5, 0.4, 0.3])
    for seed in range(12):
        rng = np.random.default_rng(seed)
        mesh, rotation = with_slivers(rng, 0.0)
        world = CollisionManager()
        world.add(mesh, pin.SE3.Identity())
        for side in [*np.diag(half + 0.15), *np.diag(-half - 0.15)]:
            beside = side + np.where(side == 0.0, rng.uniform(-0.45, 0.45, 3), 0.0)
            k = world.add(box(0.3, 0.3, 0.3, 6), pin.SE3(rotation, rotation @ beside))
            found = classify(world, objects=[k])
            world.remove(k)
            assert {pair.kind for pair in found} == {"contact"}, (seed, side)


def without(mesh: SurfaceMesh, surface: int) -> SurfaceMesh:
    """The mesh without one of its surfaces."""
    keep = mesh.surface_of_triangle != surface
    numbers = np.unique(mesh.surface_of_triangle[keep], return_inverse=True)[1]
    return SurfaceMesh(mesh.vertices, mesh.triangles[keep], numbers, name="open")


def cracked(mesh: SurfaceMesh, surface: int) -> SurfaceMesh:
    """One surface meshed anew on its own: its rim has corners that its neighbours do not have."""
    rest, own = without(mesh, surface), mesh.vertices[mesh.triangles[mesh.triangles_of(surface)]]
    a, b, c = own[:, 0], own[:, 1], own[:, 2]
    finer = np.concatenate([np.stack([a, b, (a + c) / 2], axis=1), np.stack([b, c, (a + c) / 2], axis=1)])
    rim = finer + np.array([0, 0, 1e-9]) * (np.arange(finer.size // 3).reshape(-1, 3) % 2)[..., None]
    n = len(rest.vertices)
    return SurfaceMesh(
        np.concatenate([rest.vertices, rim.reshape(-1, 3)]),
        np.concatenate([rest.triangles, n + np.arange(len(finer) * 3).reshape(-1, 3)]),
        np.append(rest.surface_of_triangle, np.full(len(finer), rest.n_surfaces)),
        name="cracked",
    )


OPEN = {"a face lost": without(box(1, 1, 1), 5), "a face of its own mesh": cracked(box(1, 1, 1), 5)}


@pytest.mark.parametrize("case", OPEN)
def test_what_is_inside_a_part_that_is_not_closed_is_found_and_said_to_be_so(case: str) -> None:
    part, chip = OPEN[case], box(0.01, 0.01, 0.01)
    assert not is_closed(part)
    world = two(part, chip, at(0.3, 0.2, 0.4))
    (found,) = classify(world)
    assert found.kind == "containment"
    assert found.words(["housing", "chip"]) == "chip lies wholly inside housing" and found.open == (0,)
    world.set_pose(1, at(0.3, 0.2, 0.52))  # before the face, or where it was
    assert classify(world) == []
    world.set_pose(1, at(0.502, 0.0, 0.0))  # through a wall that is there
    found, *others = classify(world)
    assert all(pair.kind == "clash" and 0 in pair.open for pair in (found, *others))
    assert max(pair.depth for pair in (found, *others)) == pytest.approx(0.003, abs=1e-6)


@pytest.mark.parametrize("case", OPEN)
def test_an_open_part_and_its_double_in_one_place_clash(case: str) -> None:
    (found, *others) = classify(two(OPEN[case], OPEN[case], pin.SE3.Identity()))
    assert found.kind == "clash" and found.reason is Reason.COMMON and found.open == (0, 1)
    assert {pair.kind for pair in others} == {"contact"}


def test_a_lid_on_a_part_without_its_top_only_touches_it() -> None:
    cup, lid = without(box(1, 1, 1, 3), 5), box(1.2, 1.2, 0.1, 3)
    assert kind(classify(two(cup, lid, at(0, 0, 0.55)))) == "contact"
    assert kind(classify(two(lid, cup, at(0, 0, -0.55)))) == "contact"


def test_a_part_that_a_sheet_cuts_clashes() -> None:
    keep = np.flatnonzero(box(3, 3, 1).surface_of_triangle == 5)
    sheet = SurfaceMesh(box(3, 3, 1).vertices, box(3, 3, 1).triangles[keep], name="sheet")
    found = classify(two(sheet, box(0.5, 0.5, 0.5), at(0.2, 0.1, 0.5 + 0.2)))
    assert kind(found) == "clash"
    assert max(pair.depth for pair in found) == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("arguments", [{"clearance": -1.0}, {"deflection": float("nan")}, {"authorised": [(1, 2, 3)]}])
def test_bad_arguments_are_named(arguments: dict) -> None:
    with pytest.raises(CollisionError, match=next(iter(arguments))):
        classify(two(box(1, 1, 1), box(1, 1, 1), at(3.0)), **arguments)


def slowly_as_a_whole(manager: CollisionManager, i: int, j: int, near: float) -> tuple[float, np.ndarray] | None:
    """Deepest point of the material that two touching parts have in common, of all the points that are looked at."""
    a, b, pose = manager.mesh(i), manager.mesh(j), manager.relative_pose(i, j)
    below = _below_the_surface(b, near) @ pose.rotation.T + pose.translation
    points = np.concatenate([_below_the_surface(a, near), below])
    there = (points - pose.translation) @ pose.rotation
    depth = -np.maximum(signed_distances(a, points), signed_distances(b, there))
    for k in np.argsort(-depth, kind="stable"):
        if depth[k] <= near:
            return None
        if inside(a, points[k])[0] and inside(b, there[k])[0]:
            return float(depth[k]), manager.pose(i).act(points[k])
    return None


@pytest.mark.parametrize("seed", range(8))
def test_common_material_is_that_of_all_points_below_the_surfaces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [box(1, 1, 1), pipe(), sphere(0.5, 12), pipe(1.0, 0.5, 0.2), OPEN["a face lost"]]
    a, b = (parts[k] for k in rng.integers(len(parts), size=2))
    shift = rng.choice([0.0, 0.25, 1.0, 1.0 - 2e-5], size=3)
    pose = pin.SE3(pin.exp3(rng.choice([0.0, 1.0]) * rng.normal(size=3)), shift)
    world, near = two(a, b, pose), float(rng.choice([1e-5, 1e-2]))
    row = _as_a_whole(world, 0, 1, True, near, False)
    wanted = slowly_as_a_whole(world, 0, 1, near)
    assert (row is None) == (wanted is None)
    if row is not None and wanted is not None:
        assert row.depth == wanted[0]
        np.testing.assert_array_equal(row.witness, wanted[1])


def test_penetrations_of_many_pairs_are_those_of_each() -> None:
    rng = np.random.default_rng(4)
    world = CollisionManager()
    for _ in range(12):
        world.add(sphere(0.5, 10), pin.SE3(pin.exp3(rng.normal(size=3)), 0.6 * rng.normal(size=3)))
    pairs = [(int(i), int(j)) for i, j in world.object_pairs()]
    assert len(pairs) > 10
    for pair, rows in zip(pairs, world.penetrations(pairs), strict=True):
        np.testing.assert_array_equal(rows, world.penetration(*pair))


def test_instances_placed_alike_are_as_deep_as_each_alone() -> None:
    rng = np.random.default_rng(5)
    world, plate, pin_ = CollisionManager(), box(1, 1, 0.2), sphere(0.3, 8)
    inner = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([0.1, 0.05, 0.3]))
    for _ in range(5):
        outer = pin.SE3(pin.exp3(rng.normal(size=3)), 20.0 * rng.normal(size=3))
        world.add(plate, outer)
        world.add(pin_, outer * inner)
    world.add(pin_, world.pose(0) * inner * at(0, 0, 0.01))
    pairs = [(i, i + 1) for i in range(0, 10, 2)] + [(0, 10)]
    for pair, rows in zip(pairs, world.penetrations(pairs), strict=True):
        alone = world.penetration(*pair)
        assert rows["depth"].max() > 0.05
        for name in rows.dtype.names:
            np.testing.assert_allclose(rows[name], alone[name], rtol=0.0, atol=1e-8)


def test_how_deep_settled_surfaces_are_is_not_searched() -> None:
    world = two(box(1, 1, 1), box(1, 1, 1), at(0.2, 0.1, 0.9))
    near = near_pairs(world)
    (every,) = near.classified()
    (pair,) = near.pairs
    deep = [p for p in every if p.kind == "clash" and p.surfaces is not None]
    s, t = deep[0].surfaces
    (rest,) = near.classified(settled={pair: [([s], [t])]})
    assert [(p.kind, p.depth) for p in rest if p.surfaces == (s, t)] == [("contact", 0.0)]
    others = [(p.surfaces, p.kind, p.depth) for p in every if p.surfaces != (s, t)]
    assert [(p.surfaces, p.kind, p.depth) for p in rest if p.surfaces != (s, t)] == others


def test_penetrations_that_nobody_waits_for_end() -> None:
    world = two(sphere(0.5, 10), sphere(0.5, 10), at(0.3))
    rows = world.penetrations([(0, 1)] * 3)
    assert len(next(rows)) == 1
    rows.close()
    assert next(rows, None) is None
