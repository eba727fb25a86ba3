"""Faces that a shaft and its bore cannot make collide, on turned parts whose answer is plain."""

import numpy as np
import pytest

from collision import SurfaceMesh
from constraints.geometry.sleeve import faces_behind, faces_within, faces_without
from constraints.geometry.surfaces import Cylinder, Plane


def turned(profile: list[tuple[float, float]], sections: int, turn: float = 0.0) -> SurfaceMesh:
    """The closed polygon of (radius, z) points turned about z: one surface an edge of the profile."""
    angles = turn + np.arange(sections) * 2 * np.pi / sections
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.concatenate([np.column_stack([r * ring, np.full(sections, z)]) for r, z in profile])
    triangles, surface = [], []
    for s in range(len(profile)):
        t = (s + 1) % len(profile)
        for k in range(sections):
            a, b = s * sections + k, s * sections + (k + 1) % sections
            c, d = t * sections + k, t * sections + (k + 1) % sections
            for face in ((a, b, d), (a, d, c)):
                corners = vertices[list(face)]
                if np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) > 0:
                    triangles.append(face)
                    surface.append(s)
    kept, numbered = np.unique(surface, return_inverse=True)
    assert len(kept) == len(profile) or profile[0][0] == 0.0
    return SurfaceMesh(vertices, triangles, numbered)


def test_what_is_behind_a_plane_is_all_but_the_boss_that_stands_on_it() -> None:
    # plate with a bore, and a boss on its top: bore, boss' top, boss' side, top, outside, underside
    plate = turned([(5.0, 0.0), (5.0, 14.0), (8.0, 14.0), (8.0, 10.0), (30.0, 10.0), (30.0, 0.0)], 24)
    assert faces_behind(plate, Plane([0.0, 0.0, 10.0], [0.0, 0.0, 1.0]), 1e-5) == (3, 4, 5)
    assert faces_behind(plate, Plane([0.0, 0.0, 14.0], [0.0, 0.0, 1.0]), 1e-5) == (0, 1, 2, 3, 4, 5)
    assert faces_behind(plate, Plane([0.0, 0.0, 0.0], [0.0, 0.0, -1.0]), 1e-5) == (0, 1, 2, 3, 4, 5)


AXIS = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("sections", [7, 24, 36])
def test_a_flange_is_not_within_its_shaft_but_the_tip_is(sections: int) -> None:
    # tip, chamfer, journal, flange's underside, flange's rim, top
    shaft = turned(
        [(0.0, 0.0), (8.0, 0.0), (10.0, 2.0), (10.0, 40.0), (20.0, 40.0), (20.0, 50.0), (0.0, 50.0)], sections
    )
    assert faces_within(shaft, Cylinder(np.zeros(3), AXIS, 10.0), 1e-5) == (0, 1, 2)


@pytest.mark.parametrize("sections", [7, 24, 36])
def test_a_blind_bottom_and_a_shoulder_are_not_without_the_bore(sections: int) -> None:
    # bottom of the bore, bore, mouth, outside, underside
    blind = turned([(0.0, 5.0), (10.0, 5.0), (10.0, 40.0), (20.0, 40.0), (20.0, 0.0), (0.0, 0.0)], sections)
    assert faces_without(blind, Cylinder(np.zeros(3), AXIS, 10.0), (1,)) == (1, 2, 3)
    # narrow bore, shoulder, wide bore, top, outside, underside
    stepped = turned([(9.9, 0.0), (9.9, 10.0), (12.0, 10.0), (12.0, 40.0), (20.0, 40.0), (20.0, 0.0)], sections)
    assert faces_without(stepped, Cylinder(np.zeros(3), AXIS, 12.0), (2,)) == (2, 3, 4)
    assert faces_without(stepped, Cylinder(np.zeros(3), AXIS, 9.9), (0,)) == (0, 1, 2, 3, 4, 5)


def test_a_nut_and_its_bolt_of_the_same_radius_cannot_meet_but_by_the_head() -> None:
    bolt = turned([(0.0, 0.0), (3.5, 0.0), (4.0, 0.5), (4.0, 20.0), (7.0, 20.0), (7.0, 25.0), (0.0, 25.0)], 24)
    nut = turned([(4.0, 0.0), (4.0, 6.0), (7.0, 6.0), (7.0, 0.0)], 24, turn=0.07)
    thread = Cylinder(np.zeros(3), AXIS, 4.0)
    assert faces_within(bolt, thread, 1e-5) == (0, 1, 2)
    assert faces_without(nut, thread, (0,)) == (0, 1, 2, 3)
