"""Clash, contact, clearance and containment on parts whose relation is known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, CollisionManager, SurfaceMesh
from collision.classify import KINDS, PairClass, classify
from tests.collision.reference import box, sphere, turned


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


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
    assert classify(gap, deflection=6e-4) == []  # deflection excuses depth; it brings nothing nearer


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
    assert found[0].surfaces is None and "object 0 lies wholly inside object 1" in found[0].reason
    assert found[0].distance == pytest.approx(0.2, abs=1e-12)
    assert found[0].depth == pytest.approx(0.4, abs=1e-12)


@pytest.mark.parametrize("part", [box(1, 1, 1), sphere(0.4), pipe()])
def test_identical_coincident_parts_clash(part: SurfaceMesh) -> None:
    found = classify(two(part, part, pin.SE3.Identity()))
    assert kind(found) == "clash"
    assert found[0].surfaces is None and "material in common" in found[0].reason
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


@pytest.mark.parametrize("arguments", [{"clearance": -1.0}, {"deflection": float("nan")}, {"authorised": [(1, 2, 3)]}])
def test_bad_arguments_are_named(arguments: dict) -> None:
    with pytest.raises(CollisionError, match=next(iter(arguments))):
        classify(two(box(1, 1, 1), box(1, 1, 1), at(3.0)), **arguments)
