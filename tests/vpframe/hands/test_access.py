"""What a straight tool or finger gets to: in the open, in a pot, in a sealed box, past a neighbour."""

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh
from tests.vpframe.bench_scene import at
from vpframe.errors import TaskError
from vpframe.hands.access import OFF, Access, Reach
from vpframe.hands.conditions import constraint
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session

SMALL = Reach(length=0.03, diameter=0.006)


def boxed(lid: bool, wide: float = 0.2) -> Scene:
    """A cube on the floor of a box, open above or sealed by a lid; the box is far larger than the tool."""
    half = wide / 2
    walls = m.box(wide, wide, wide).translated(-half, -half) - m.box(wide - 0.01, wide - 0.01, wide).translated(
        -half + 0.005, -half + 0.005, 0.005
    )
    parts = [
        Part("walls", m.shape(walls), at(0, 0, 0), fixed=True),
        Part("cube", m.shape(m.box(0.02, 0.02, 0.02).translated(-0.01, -0.01)), at(0, 0, 0.005)),
    ]
    cover = m.shape(m.box(wide, wide, 0.005).translated(-half, -half))
    return Scene([*parts, Part("lid", cover, at(0, 0, wide) if lid else at(3 * wide, 0, 0))])


def test_a_part_in_a_sealed_box_is_not_grabbed_and_the_lid_is_named() -> None:
    with Session(boxed(lid=True)) as session:
        hand = session.hand(reach=SMALL)
        with pytest.raises(
            TaskError, match=r"no access to cube for a straight tool 30 mm long, Ø6 mm: .*lid.* in the way"
        ):
            hand.grab("cube")
        assert hand.held is None
        hand.remove("lid", along="up")
        assert hand.grab("cube")
    with Session(boxed(lid=True)) as session:
        assert session.hand().grab("cube")  # off by default


def test_what_has_to_go_first_is_said_of_the_place_with_fewest_parts_in_its_way() -> None:
    """Its sides are behind the walls; above it there is but the lid."""
    words = r"Ø6 mm: lid, walls in the way; remove lid first, or give"
    with Session(boxed(lid=True)) as session, pytest.raises(TaskError, match=words):
        session.hand(reach=SMALL).grab("cube")


def test_a_subassembly_is_taken_by_the_part_of_it_that_is_reached() -> None:
    """Its block, nearest to the hand, is behind the walls; a rod of it comes out of the box."""
    walls, cube, _ = boxed(lid=False).parts
    block = Part("unit/block", cube.shape, cube.pose)
    cover = m.box(0.12, 0.12, 0.005).translated(-0.06, -0.06) - m.cylinder(0.006, 0.005)
    rod = m.cylinder(0.005, 0.1)
    parts = [Part("unit/rod", m.shape(rod), at(0, 0, 0.025)), Part("cover", m.shape(cover), at(0, 0, 0.05))]
    with Session(Scene([walls, block, *parts])) as session:
        hand = session.hand(at=(0.0, 0.0, -0.05), reach=SMALL)
        assert hand.grab("unit")
        assert hand.held == "unit/rod" and hand.carried == ("unit/block",)


def test_at_most_three_parts_in_the_way_are_named_and_never_the_part_itself() -> None:
    """A ring between six panels: its own far side, too, keeps a finger from the faces of its hole."""
    ring = m.box(0.02, 0.02, 0.02).translated(-0.01, -0.01, -0.01) - m.cylinder(0.008, 0.02).translated(0, 0, -0.01)
    parts = [Part("ring", m.shape(ring), at(0, 0, 0))]
    for k in range(3):
        size = np.full(3, 0.1)
        size[k] = 0.005
        for sign in (1.0, -1.0):
            place = np.zeros(3)
            place[k] = 0.02 * sign
            panel = m.box(*size).translated(*(place - 0.5 * size))
            parts.append(Part(f"panel {'xyz'[k]}{'+' if sign > 0 else '-'}", m.shape(panel), at(0, 0, 0)))
    with Session(Scene(parts)) as session:
        with pytest.raises(TaskError, match=r"panel") as caught:
            session.hand(reach=SMALL).grab("ring")
        way = str(caught.value).partition("Ø6 mm: ")[2].partition(" in the way")[0]
        assert len(way.split(", ")) == 3 and way.endswith(" and 3 more") and "ring" not in way


def test_a_finger_takes_the_nearest_place_that_it_gets_to() -> None:
    with Session(boxed(lid=False, wide=0.04), access=SMALL) as session:
        session.scene["cube"]
        hand = session.hand(at=(0.0, 0.0, -0.05))  # nearest is the cube's bottom, through the floor
        assert hand.grab("cube")
        assert hand.pose.translation[2] == pytest.approx(0.025, abs=1e-9)  # by its top
        top = hand.surfaces
        hand.release()
        with pytest.raises(TaskError, match=r"no access to surface \d+ of cube .*walls"):
            hand.grab("cube", surface=next(s for s in range(6) if s not in top))


def test_a_ring_in_a_counterbore_is_reached_from_above() -> None:
    """The largest triangles of a ring are on its outside, where the wall is 1.3 mm away."""
    seat = m.box(0.06, 0.06, 0.02).translated(-0.03, -0.03) - m.cylinder(0.018, 0.006).translated(0.0, 0.0, 0.014)
    ring = m.torus(0.0155, 0.0012).translated(0.0, 0.0, 0.0152)
    scene = Scene([Part("seat", m.shape(seat), at(0, 0, 0), fixed=True), Part("ring", m.shape(ring), at(0, 0, 0))])
    with Session(scene) as session:
        hand = session.hand(at=(0.05, 0.0, 0.01), reach=Reach(length=0.1, diameter=0.003))
        assert hand.grab("ring")


@pytest.mark.parametrize("diameter", [0.008, 0.02])
def test_a_screw_is_turned_where_the_tool_reaches_its_head(diameter: float) -> None:
    """A bolt in a plate; a wall stands 8 mm beside its axis: a thin tool passes, a thick one does not."""
    plate = m.box(0.06, 0.06, 0.02).translated(-0.03, -0.03, -0.02) - m.cylinder(0.00302, 0.02).translated(0, 0, -0.02)
    bolt = m.cylinder(0.003, 0.015).translated(0, 0, -0.015) + m.cylinder(0.005, 0.004)
    scene = Scene(
        [
            Part("plate", m.shape(plate), at(0, 0, 0), fixed=True),
            Part("wall", m.shape(m.box(0.01, 0.06, 0.1).translated(0.008, -0.03)), at(0, 0, 0), fixed=True),
            Part("bolt", m.shape(bolt), at(0, 0, 0)),
        ]
    )
    with Session(scene) as session:
        session.thread("bolt", 0.002)
        hand = session.hand(at=(-0.005, 0.0, 0.02))
        hand.grab("bolt")
        assert session.hand(reach=Reach(0.05, diameter)) is hand
        if diameter < 0.016:
            assert hand.unscrew(until=~constraint("against"), rate=4.0)
        else:
            with pytest.raises(TaskError, match=r"unscrew: no access to bolt .*Ø20 mm: wall in the way"):
                hand.unscrew(turns=1.0)


def test_the_tools_mesh_holds_the_capsule_closely() -> None:
    reach = Reach(length=0.1, diameter=0.012)
    mesh = reach.mesh()
    assert isinstance(mesh, SurfaceMesh)
    corners = mesh.vertices[mesh.triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    true = np.pi * 0.006**2 * (0.1 - 0.012) + 4.0 / 3.0 * np.pi * 0.006**3
    assert true < volume < 1.15 * true
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # the support of the capsule along each face's normal lies behind the face: it is inside
    ends = np.array([[0, 0, 0.006], [0, 0, 0.094]])
    support = (normals @ ends.T).max(axis=1) + 0.006
    assert (support <= (normals * corners[:, 0]).sum(axis=1) + 1e-12).all()


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.5, 6))
def test_access_is_what_a_plain_distance_says(angle: float) -> None:
    """Straight down a slot between two walls: free exactly where the slot is wider than the tool."""
    turn = pin.SE3(pin.exp3(np.array([0.0, angle, 0.0])), np.zeros(3))
    for wide, free in ((0.0066, True), (0.0058, False)):
        left = m.box(0.01, 0.04, 0.04).translated(-0.01 - wide / 2, -0.02)
        right = m.box(0.01, 0.04, 0.04).translated(wide / 2, -0.02)
        scene = Scene([Part("left", m.shape(left), turn), Part("right", m.shape(right), turn)])
        with Session(scene) as session:
            tip, axis = turn.act(np.array([0.0, 0.0, OFF])), turn.rotation[:, 2]
            met = Access(session.scene, session.tolerance, SMALL).obstacles(tip, axis)
            assert met == (() if free else ("left", "right"))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda s: s.hand(reach=0.1), "hand: reach=0.1; give True, False, or vp.Reach"),
        (lambda s: Reach(length=-1.0), "Reach: length=-1.0"),
        (lambda s: Reach(length=0.01, diameter=0.02), "swap them"),
        (lambda s: Session(boxed(False), access="yes"), "access='yes'"),
    ],
)
def test_a_reach_that_is_none_is_refused(given, words: str) -> None:
    with Session(boxed(lid=False)) as session, pytest.raises(TaskError, match=words):
        given(session)
