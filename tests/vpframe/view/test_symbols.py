import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.watching import pressing_frames
from vpframe.events import ConstraintView
from vpframe.view import palette
from vpframe.view.symbols import constraint_symbol, frame_at, frame_symbols, freedom_symbol, hand_symbols

KINDS = (
    "against", "coplanar", "concentric", "conical", "spherical", "toroidal", "tangent", "line", "point", "parallel",
    "perpendicular", "angle", "distance", "fixed", "screw", "gear", "rack-and-pinion", "belt",
)  # fmt: skip


def view(kind="concentric", state="active", origin=(0.1, 0.2, 0.3), direction=(0, 0, 1), size=0.01):
    return ConstraintView(
        4, kind, ("a", "b"), ((0,), (1,)), 0.0, state, np.array(origin, float), np.array(direction, float), size
    )


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_drawn_where_it_is_and_as_large_as_it_is(kind):
    for scale in (1e-4, 1e-2, 1e3):
        points = np.concatenate(constraint_symbol(view(kind, size=scale)).world())
        reach = np.linalg.norm(points - [0.1, 0.2, 0.3], axis=1).max()
        assert 0.3 * scale < reach < 3 * scale


@pytest.mark.parametrize("seed", range(5))
def test_ring_of_a_concentric_lies_about_its_axis(seed):
    rng = np.random.default_rng(seed)
    origin, direction = rng.normal(size=3), rng.normal(size=3)
    axis, ring = constraint_symbol(view("concentric", origin=origin, direction=direction)).world()
    unit = direction / np.linalg.norm(direction)
    np.testing.assert_allclose(np.cross(axis - origin, unit), 0, atol=1e-12)
    np.testing.assert_allclose((ring - origin) @ unit, 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ring - origin, axis=1), 0.0115)


def test_colour_tells_the_state_and_the_key_changes_with_it():
    symbols = [constraint_symbol(view(state=state)) for state in ("candidate", "active", "refused")]
    assert [s.color for s in symbols] == [palette.CANDIDATE, palette.ACTIVE, palette.REFUSED]
    assert len({s.key for s in symbols}) == 3
    assert len({s.name for s in symbols}) == 1


def test_key_stays_while_a_symbol_only_moves():
    here, there = view(origin=(0, 0, 0)), view(origin=(1, 0, 0), direction=(1, 0, 0))
    assert constraint_symbol(here).key == constraint_symbol(there).key
    for a, b in zip(constraint_symbol(here).strips, constraint_symbol(there).strips, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("joint", "strips"),
    # an arrow is a shaft and four barbs, and slides both ways; a turn is an arc and two barbs
    [("prismatic", 10), ("revolute", 3), ("cylindrical", 13), ("planar", 23), ("spherical", 9), ("universal", 6)],
)
def test_arrows_show_each_freedom_of_a_lower_pair(joint, strips):
    symbol = freedom_symbol("part", joint, pin.SE3.Identity(), 1.0)
    assert symbol is not None
    assert len(symbol.strips) == strips


def test_what_cannot_move_has_no_arrows():
    assert freedom_symbol("part", "rigid", pin.SE3.Identity(), 1.0) is None
    assert freedom_symbol("part", "free", pin.SE3.Identity(), 1.0) is None


def test_refused_ones_are_drawn_too_but_dim():
    frame = pressing_frames()[32]
    refused = frame.__class__(**{**frame.__dict__, "constraints": (view(state="refused"),), "held": ()})
    (symbol,) = frame_symbols(refused)
    active = constraint_symbol(view(state="active"))
    assert symbol.width < active.width and symbol.hidden < active.hidden
    assert symbol.color == palette.REFUSED
    names = [s.name for s in frame_symbols(frame)]
    assert names == ["constraint/0", "freedom/rod"]


def test_frame_at_is_a_rotation_onto_the_direction():
    rng = np.random.default_rng(0)
    for direction in [*rng.normal(size=(20, 3)), [0, 0, 1], [0, 0, -1], [1, 0, 0]]:
        pose = frame_at([1, 2, 3], direction)
        unit = np.array(direction) / np.linalg.norm(direction)
        np.testing.assert_allclose(pose.rotation[:, 2], unit, atol=1e-12)
        np.testing.assert_allclose(pose.rotation.T @ pose.rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    np.testing.assert_array_equal(frame_at([0, 0, 0], [0, 0, 0]).rotation[:, 2], [0, 0, 1])


def test_hands_have_a_symbol_each():
    poses = {"left": pin.SE3.Identity(), "right": frame_at([1, 0, 0], [1, 0, 0])}
    assert [s.name for s in hand_symbols(poses, 0.1)] == ["hand/left", "hand/right"]
