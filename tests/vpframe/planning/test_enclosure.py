"""What encloses a part, alone and together."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.planning import enclosure
from vpframe.planning.assembly import Assembly
from vpframe.scene.modelling import box, sphere
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


def test_a_ball_in_a_closed_shell_is_enclosed_and_not_where_the_shell_has_a_hole():
    scene = cases.ball_in_shell()
    found = vp.planning.removal(scene, "ball", budget=LONG)
    assert (found.verdict, found.blockers) == ("enclosed", ("shell",))
    assert vp.planning.removal(scene, "shell", budget=0.1, motion="straight").verdict != "enclosed"


def caged(window, radius):
    """A ball in a box of two parts, wall 5 mm, with a square window (m) in its lid."""
    body = box(0.06, 0.06, 0.04) - box(0.05, 0.05, 0.035).translated(0.005, 0.005, 0.005)
    lid = box(0.06, 0.06, 0.005)
    if window:
        lid = lid - box(window, window, 0.005).translated(0.03 - 0.5 * window, 0.03 - 0.5 * window)
    return scene_of(
        {"body": body, "lid": (lid, cases.at(z=0.04)), "ball": (sphere(radius), cases.at(0.03, 0.03, 0.02))}
    )


def test_what_several_parts_enclose_together_is_enclosed_by_them():
    found = vp.planning.removal(cases.latched_box(), "content", budget=LONG)
    assert found.verdict == "enclosed" and {"box", "lid"} <= set(found.blockers)
    found = vp.planning.removal(caged(0.0, 0.01), "ball", budget=LONG)
    assert (found.verdict, found.blockers) == ("enclosed", ("body", "lid"))
    assert vp.planning.removal(caged(0.008, 0.01), "ball", budget=LONG).verdict == "enclosed"
    assert vp.planning.removal(caged(0.022, 0.01), "ball", budget=LONG).verdict == "removable"
    authorised = vp.planning.removal(caged(0.0, 0.01), "ball", budget=LONG, authorise=[("ball", "lid")])
    assert authorised.verdict == "enclosed", "no overlap is drawn"
    ignored = vp.planning.removal(caged(0.0, 0.01), "ball", budget=LONG, ignore=[("ball", "lid")])
    assert ignored.verdict == "removable" and ignored.clearance.ignored


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.floats(0.004, 0.03), st.floats(0.3, 1.7))
def test_what_fits_through_a_window_is_never_enclosed(window, share):
    radius = min(0.5 * window * share, 0.014)
    assembly = Assembly(caged(window, radius))
    held = enclosure.caged_by(assembly, (2,), (0, 1))
    if radius < 0.5 * window:
        assert held is None
    elif radius > 0.9 * window:  # wider than the diagonal, and what the grid and the facets take
        assert held == (0, 1)
