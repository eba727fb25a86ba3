"""Bounds in float32 against the same in float64: what eight lanes rule out is never there."""

import numpy as np
import pinocchio as pin
import pytest
from numba import njit

from collision import SurfaceMesh
from collision.bvh.build import bvh_of
from collision.bvh.traverse import fresh_packets, start, workspace_for
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.simd import RATES, TERMS, apart_lane_a, apart_lane_b, perhaps_nearing
from collision.query.signed_distance import triangle_bounds
from collision.query.time_of_impact import Sweep, _set_rates, _set_terms
from tests.collision.brute_force import signed_distances
from tests.collision.packets import distances_between, in_leaf_order, kept_and_bounds, packet, relative


@njit
def bounds_from(bvh, ws, p):
    triangle_bounds(bvh, ws, 0, (p[0], p[1], p[2]))


@njit
def distances_from(corners, p, out):
    for i in range(len(corners)):
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        q, _ = closest_on_triangle((p[0], p[1], p[2]), (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]))
        out[i] = np.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e6])
def test_distances_of_points_are_never_above_and_are_close(scale: float) -> None:
    rng = np.random.default_rng(int(-np.log10(scale)) + 20)
    exact = np.empty(8)
    for _ in range(400):
        mesh = packet(rng, scale, scale * 10.0 ** rng.uniform(-2.0, 1.0), slivers=bool(rng.random() < 0.5))
        bvh, corners = bvh_of(mesh), in_leaf_order(mesh)
        ws = workspace_for(bvh, bvh)
        p = corners.reshape(-1, 3)[rng.integers(24)] + rng.normal(size=3) * scale * 10.0 ** rng.uniform(-6.0, 2.0)
        bounds_from(bvh, ws, p)
        distances_from(corners, p, exact)
        assert (ws.bounds[:8] <= exact).all()
        size = float(bvh.size[0])
        well = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        well = well > 1e-2 * size * size
        assert (ws.bounds[:8][well] >= exact[well] - 1e-3 * size - 1e-3 * exact[well]).all()


def in_contact(rng: np.random.Generator, scale: float, place: float) -> tuple[SurfaceMesh, SurfaceMesh, pin.SE3]:
    """Two packets, some of whose triangles share planes, edges and corners with those of the other, some of them moved
    into each other or apart by little; the second is given in a frame of its own."""
    one = rng.normal(size=(8, 3, 3)) * scale
    other = one[rng.permutation(8)].copy()
    for k, triangle in enumerate(other):
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        normal /= np.linalg.norm(normal)
        if k % 4 == 0:  # in one plane
            triangle += rng.normal() * (triangle[1] - triangle[0])
        elif k % 4 == 1:  # one edge in common
            triangle[2] += rng.normal(size=3) * scale
        elif k % 4 == 2:  # a corner in common
            triangle[1:] += rng.normal(size=(2, 3)) * scale
        triangle += normal * scale * rng.choice([0.0, 1.0, -1.0]) * 10.0 ** rng.uniform(-12.0, 0.0)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), place * rng.normal(size=3))
    apart = (other.reshape(-1, 3) - pose.translation) @ pose.rotation
    meshes = [SurfaceMesh(v, np.arange(24).reshape(8, 3)) for v in (one.reshape(-1, 3), apart)]
    return meshes[0], meshes[1], pose


@pytest.mark.parametrize("scale", [1e-6, 1e-2, 1e3])
@pytest.mark.parametrize("meeting", [False, True])
def test_bounds_of_signed_distances_hold_in_contact_and_are_close(meeting: bool, scale: float) -> None:
    rng = np.random.default_rng(int(meeting) + 2)
    known = close = 0
    for _ in range(150):
        one, other, pose = in_contact(rng, scale, scale * 10.0 ** rng.uniform(-1.0, 2.0))
        corners, others = in_leaf_order(one), in_leaf_order(other) @ pose.rotation.T + pose.translation
        signed = signed_distances(corners, others)
        limit = float(np.quantile(signed, rng.uniform(0.3, 1.0)))
        kept, bounds = kept_and_bounds(one, other, pose, limit, np.zeros(3), meeting)
        rounding = 1e-13 * (np.abs(others).max() + np.abs(corners).max() + np.abs(other.vertices).max())
        assert (signed[~kept] > limit - 1e-6 * abs(limit) - rounding).all()
        looked_at = bounds < np.inf
        assert (bounds[looked_at] <= signed[looked_at] + rounding).all()
        right = kept & ((signed < 0.0) if meeting else (signed > 1e-3 * scale))
        known += int(right.sum())
        close += int((bounds[right] >= signed[right] - 1e-3 * np.abs(signed[right]) - 1e-4 * scale).sum())
    assert known > 300 and close > 0.8 * known


@njit
def certified(a, b, ws, screws, task, most, aim, until, pairs, boxes):
    """Which pairs of triangles, and of boxes, are not ruled out until a time."""
    start(a, b, ws)
    fresh_packets(a, b, ws, 0, 0)
    _set_rates(a.frame, b.frame, ws.pose.matrix, screws, task)
    _set_terms(task, a, b, ws, 0, 0, most, aim)
    task.terms[9] = until
    for j in range(8):
        pairs[j] = perhaps_nearing(ws.prepared, 0, ws.turned, j, task.rates, task.terms)
    aim, until = np.float32(aim), np.float32(until)
    boxes[0] = apart_lane_a(a.boxes, 0, ws.moved, 0, task.rates, aim, until, ws.bounds) & 1
    boxes[1] = apart_lane_b(ws.moved, 0, a.boxes, 0, task.rates, aim, until, ws.bounds) & 1


def certified_pairs(
    one: SurfaceMesh, other: SurfaceMesh, pose: pin.SE3, twists: np.ndarray, most: float, aim: float, until: float
) -> tuple[np.ndarray, np.ndarray]:
    """(8, 8) which triangles, in leaf order, may come within `aim` until a time, and (2,) whether their boxes may."""
    a, b = bvh_of(one), bvh_of(other)
    ws, pairs, boxes = workspace_for(a, b), np.empty(8, np.int64), np.empty(2, np.int64)
    ws.pose.matrix[:12] = [*pose.rotation.ravel(), *pose.translation]
    task = Sweep(
        np.empty(0), LEVEL, 1e-6, np.empty(RATES, np.float32), np.empty(15), np.empty(2),
        np.empty(4, np.int64), np.empty(TERMS, np.float32),
    )  # fmt: skip
    certified(a, b, ws, np.hstack([np.zeros((2, 12)), twists]), task, most, aim, until, pairs, boxes)
    return (pairs[None, :] >> np.arange(8)[:, None]) & 1 == 1, boxes


LEVEL = 1e-5


def test_a_triangle_of_no_area_has_no_normal_along_which_it_stays_apart() -> None:
    """Of surfaces that may reach into each other: along a direction of no length a gap of 0 would be enough."""
    rng = np.random.default_rng(4)
    length, gap = 1e-3, 1e-4
    for _ in range(100):
        x, y, z = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        ends = 1e-5 * rng.normal(size=(8, 1, 2)) @ [x, y] - length * np.array([[0.0], [1.0], [0.5]]) * z
        one = SurfaceMesh(ends.reshape(-1, 3), np.arange(24).reshape(8, 3))
        flat = length * np.array([[-4.0, -3.0], [4.0, -3.0], [0.0, 5.0]]) @ [x, y] + gap * z
        other = SurfaceMesh(np.tile(flat, (8, 1)), np.arange(24).reshape(8, 3))
        twists = np.vstack([np.zeros(6), [*(-z), 0.0, 0.0, 0.0]])
        perhaps, _ = certified_pairs(one, other, pin.SE3.Identity(), twists, 0.0, -1e-5, gap + 0.5 * length)
        assert perhaps.all()
        perhaps, _ = certified_pairs(one, other, pin.SE3.Identity(), twists, 0.0, -1e-5, 0.9 * gap)
        assert not perhaps.any()


def test_what_is_certified_stays_apart() -> None:
    rng = np.random.default_rng(2)
    exact = np.empty((8, 8))
    sure_pairs = sure_boxes = 0
    for _ in range(250):
        one, other = packet(rng, 1e-2, 1e-1), packet(rng, 1e-2, 1e-1)
        start_a, start_b = relative(rng, 0.02), relative(rng, 0.02)
        turn = 10.0 ** rng.uniform(-3.0, 0.5)
        twists = np.concatenate([rng.normal(size=(2, 3)) * 0.1, rng.normal(size=(2, 3)) * turn], axis=1)
        # the acceleration of any point, generously: see `collision.triangle.motion`
        reach = 1.0 + float(np.abs(other.vertices).max())
        speed = np.linalg.norm(twists[:, :3], axis=1).sum() + np.linalg.norm(twists[:, 3:], axis=1).sum() * reach * 3.0
        most = 4.0 * speed * np.linalg.norm(twists[:, 3:], axis=1).sum()
        until = 10.0 ** rng.uniform(-3.0, 0.0)
        perhaps, boxes = certified_pairs(one, other, start_a.actInv(start_b), twists, most, 0.9 * LEVEL, until)
        for t in np.linspace(0.0, until, 12):
            at_t = (start_a * pin.exp6(pin.Motion(t * twists[0]))).actInv(start_b * pin.exp6(pin.Motion(t * twists[1])))
            distances_between(in_leaf_order(one), in_leaf_order(other) @ at_t.rotation.T + at_t.translation, exact)
            assert (exact[~perhaps] > 0.9 * LEVEL).all()
            assert boxes.any() or exact.min() > 0.9 * LEVEL
        sure_pairs += int((~perhaps).sum())
        sure_boxes += int(not boxes.all())
    assert sure_pairs > 1000 and sure_boxes > 10
