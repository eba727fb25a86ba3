"""What overlaps as drawn mean: which are excused, which are clashes, and what motions may do to them."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vpframe as vp
from vpframe.analysis.clash import clash, document, is_open, table
from vpframe.analysis.mate_motions import Mates
from vpframe.errors import TaskError
from vpframe.planning.plan import removal
from vpframe.scene import modelling as m
from vpframe.scene import overlap_rules
from vpframe.scene.overlap_rules import OverlapRule

SCREW = "M2.2x8 self tapping screw"
R, BORE, LENGTH, TOP = 1.1e-3, 0.8e-3, 8e-3, 15e-3
"""m: radius of the screw, and of its hole; length below the head; height of the boss"""


def boss(bore=BORE, depth=12e-3, aside=0.0):
    """A boss with a blind hole from its top."""
    block = m.box(12e-3, 12e-3, TOP).translated(-6e-3, -6e-3)
    return block - m.cylinder(bore, depth).translated(aside, 0.0, TOP - depth) if bore else block


def screw(radius=R, length=LENGTH):
    """A screw with a round head that stands on the boss."""
    shank = m.cylinder(radius, length) + m.cylinder(1.75 * radius, 1.6e-3).translated(z=length)
    return shank.translated(z=TOP - length)


def tapped(bore=BORE, depth=12e-3, aside=0.0, name=SCREW, **more):
    out = m.scene({"boss": boss(bore, depth, aside), name: screw(), **more})
    out["boss"].fixed = True
    return out


def gravest(scene, **options):
    rows = clash(scene, **options)
    return min(
        (row.kind for row in rows),
        key=lambda kind: ("clash", "containment", *overlap_rules.MEANT, "contact").index(kind),
    )


@pytest.mark.parametrize(
    ("bore", "kind"),
    [
        (1.2e-3, "contact"),
        (1.05e-3, "thread"),
        (0.8e-3, "thread"),
        (0.78e-3, "thread"),
        (0.7e-3, "clash"),
        (0.0, "clash"),
    ],
)
def test_a_tapping_screw_needs_a_hole_between_its_core_and_its_outside(bore, kind):
    assert gravest(tapped(bore)) == kind


def test_a_thread_says_what_it_is_and_is_no_clash():
    rows = clash(tapped())
    threads = [row for row in rows if row.kind == "thread"]
    assert threads and not any(map(is_open, rows))
    known = threads[0].meaning
    assert known.fit.bores == pytest.approx((BORE, BORE)) and known.fit.radius == pytest.approx(R, rel=1e-6)
    assert known.fit.length == pytest.approx(LENGTH, rel=1e-6) and 0.5e-3 < known.pitch < 1e-3
    assert "Ø2.2 in Ø1.6 mm over 8 mm" in threads[0].why and "ISO 1478" in threads[0].why
    text = document(rows)
    assert text["counts"] == {"clash": 0, "thread": 1}
    assert text["pairs"][0]["meaning"]["kind"] == "thread"
    assert table(rows).splitlines()[0].startswith("0 clashes; 1 thread, as drawn: --as-drawn judges")


def test_as_drawn_judges_it_as_solid():
    assert gravest(tapped(), as_drawn=True) == "clash"


@pytest.mark.parametrize("depth", [7.9e-3, 5e-3])
def test_a_hole_too_short_for_the_screw_is_a_clash(depth):
    """The tip is in solid material, at the core: however like a thread the rest is."""
    assert gravest(tapped(depth=depth)) == "clash"
    assert not Mates(tapped(depth=depth)).meanings


def test_a_head_that_is_sunk_into_the_boss_is_a_clash():
    scene = tapped()
    scene[SCREW].pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, -2e-4]))
    rows = clash(scene)
    assert {row.kind for row in rows} >= {"clash", "thread"}
    assert max(row.depth for row in rows if row.kind == "clash") == pytest.approx(2e-4, abs=2e-5)


@pytest.mark.parametrize(
    ("aside", "kind"), [(0.1e-3, "thread"), (0.38e-3, "thread"), (0.45e-3, "clash"), (2e-3, "clash")]
)
def test_a_tapping_screw_may_be_drawn_off_its_axis_by_half_the_radius_of_its_hole(aside, kind):
    scene = tapped(aside=aside)
    assert gravest(scene) == kind
    if kind == "thread":
        found = next(row for row in clash(scene) if row.kind == kind)
        assert f"axes {1e3 * aside:.4g} mm apart" in found.why or f"axes {1e6 * aside:.4g} µm apart" in found.why


def test_a_machine_screw_in_its_hole_has_the_core_of_its_thread():
    def held(bore):
        block = m.box(20e-3, 20e-3, TOP).translated(-10e-3, -10e-3) - m.cylinder(bore, TOP)
        return gravest(m.scene({"sleeve": block, "M4x8 socket head cap screw": screw(2e-3)}))

    assert [held(bore) for bore in (1.9e-3, 1.75e-3, 1.6e-3, 1.4e-3)] == ["thread", "thread", "thread", "clash"]


@pytest.mark.parametrize("name", ["dowel", "pin", "shaft", "magnet"])
def test_a_part_without_a_thread_is_no_screw(name):
    """Ø10 in Ø9: a clash, and a jam, whatever it is called."""
    block = m.box(30e-3, 30e-3, 20e-3).translated(-15e-3, -15e-3) - m.cylinder(4.5e-3, 20e-3)
    scene = m.scene({"block": block, name: m.cylinder(5e-3, 20e-3)})
    scene["block"].fixed = True
    assert gravest(scene) == "clash"
    assert not Mates(scene).meanings and Mates(scene).jams(0, 1)
    assert removal(scene, name, motion="mates").verdict != "removable"


@pytest.mark.parametrize(
    ("over", "kind"), [(28e-6, "press fit"), (45e-6, "press fit"), (80e-6, "clash"), (5e-4, "clash")]
)
def test_a_magnet_is_pressed_into_its_pocket_by_so_much_and_no_more(over, kind):
    block = m.box(20e-3, 20e-3, 10e-3).translated(-10e-3, -10e-3) - m.cylinder(3e-3, 3e-3).translated(z=7e-3)
    scene = m.scene({"block": block, "magnet 6x3": m.cylinder(3e-3 + over, 3e-3).translated(z=7e-3)})
    scene["block"].fixed = True
    assert gravest(scene) == kind
    out = removal(scene, "magnet 6x3", motion="mates")
    assert (out.verdict == "removable") == (kind == "press fit")
    assert [fit.interference for fit in out.press_fits] == pytest.approx([over] if kind == "press fit" else [])


def test_a_heat_set_insert_is_pressed_into_plastic():
    ring = (m.cylinder(2.3e-3, 4e-3) - m.cylinder(1.25e-3, 4e-3)).translated(z=TOP - 4e-3)
    rows = {bore: gravest(m.scene({"boss": boss(bore), "M3 heat set insert": ring})) for bore in (2.0e-3, 1.8e-3)}
    assert rows == {2.0e-3: "press fit", 1.8e-3: "clash"}


def test_a_seal_is_squeezed_by_a_part_of_its_section():
    shaft = m.cylinder(4e-3, 40e-3)

    def squeezed(inside):
        ring = (m.cylinder(8e-3, 5e-3) - m.cylinder(inside, 5e-3)).translated(z=15e-3)
        return gravest(m.scene({"shaft": shaft, "oil seal": ring}))

    assert [squeezed(inside) for inside in (3.9e-3, 3.0e-3, 1.5e-3)] == ["soft", "soft", "clash"]


def test_only_what_is_in_the_bore_is_too_large_for_it():
    """A seal on a shaft with a shoulder beside it: the shoulder is no part of the overlap, and stops the seal."""
    shaft = m.cylinder(4e-3, 40e-3) + m.cylinder(5e-3, 5e-3).translated(z=25e-3)
    ring = (m.cylinder(8e-3, 5e-3) - m.cylinder(3.9e-3, 5e-3)).translated(z=15e-3)
    scene = m.scene({"shaft": shaft, "oil seal": ring})
    scene["shaft"].fixed = True
    (mate,) = Mates(scene).mates_of(0, 1)
    assert mate.meaning.fit.radius == pytest.approx(4e-3, rel=1e-6) and mate.meaning.solid == 0
    out = removal(scene, "oil seal", motion="straight")
    assert out.verdict == "removable" and out.way.direction[2] < -0.99


# ---- motion


def common(scene, part, at, other):
    """Common volume of two parts, and its part outside of the rim of the screw, m³, by exact booleans of meshes."""
    import manifold3d

    def solid(mesh, pose):
        points = mesh.vertices @ pose.rotation.T + pose.translation
        made = manifold3d.Manifold(manifold3d.Mesh64(points * 1e3, mesh.triangles.astype(np.uint64)))
        assert made.status() == manifold3d.Error.NoError and made.volume() > 0.0
        return made

    both = solid(scene[part].mesh, at) ^ solid(scene[other].mesh, scene[other].pose)
    rim = manifold3d.Manifold.cylinder(100.0, 1e3 * (R + 2e-5), circular_segments=256).translate((0.0, 0.0, -50.0))
    return both.volume() * 1e-9, (both - rim).volume() * 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0.0, 0.3e-3])
def test_the_way_out_shares_only_the_rim_and_never_more_than_drawn(aside):
    scene = tapped(aside=aside)
    way = removal(scene, SCREW, motion="mates")
    assert way.verdict == "removable" and way.way.motion == "screw"
    knots, home = way.way.knots, scene[SCREW].pose
    drawn, _ = common(scene, SCREW, home, "boss")
    assert drawn > 5e-9
    last = drawn
    for t in np.linspace(0.0, len(knots) - 1.0, 50):
        k = min(int(t), len(knots) - 2)
        at = knots[k] * pin.exp6(pin.log6(knots[k].actInv(knots[k + 1])) * (t - k)) * home
        volume, outside = common(scene, SCREW, at, "boss")
        assert outside <= 1e-15 and volume <= last * (1.0 + 5e-3) + 1e-14  # facets turn in facets
        last = max(volume, 1e-16)
    assert last <= 1e-13


def test_a_thread_turns_out_and_lets_nothing_else_pass():
    scene = tapped()
    mates = Mates(scene)
    (mate,) = mates.mates_of(0, 1)
    assert (mate.kind, mate.drawn, mate.meaning.kind) == ("screw", True, "thread") and not mates.jams(0, 1)
    identity = pin.SE3.Identity()
    for way in ((0.0, 0.0, 1e-3), (1e-3, 0.0, 0.0), (0.0, 0.0, -1e-4)):
        assert mates.left_out(1, 0, identity, pin.SE3(np.eye(3), np.array(way))) is None
    assert removal(scene, SCREW, motion="straight").verdict != "removable"
    slipping = Mates(scene, unturned=True)
    assert slipping.left_out(1, 0, identity, pin.SE3(np.eye(3), np.array([0.0, 0.0, 1e-3])))
    assert slipping.left_out(1, 0, identity, pin.SE3(np.eye(3), np.array([1e-3, 0.0, 0.0]))) is None


def test_the_bottom_of_the_hole_ends_the_thread():
    """It may be driven until its tip is at the bottom, and out as far as it likes."""
    (mate,) = Mates(tapped(depth=9e-3)).mates_of(0, 1)
    assert mate.parts == (0, 1) and mate.axis[2] < 0.0  # the boss is the first: it goes up as the screw goes down
    assert mate.travel[0] == pytest.approx(-1e-3, abs=2e-5) and mate.travel[1] == np.inf


def test_another_wall_in_the_way_out_is_not_cut_through():
    """A grub screw in the lower of two walls of one part: the upper one has a hole for its key alone."""
    block = m.box(12e-3, 12e-3, 20e-3).translated(-6e-3, -6e-3)
    block = block - m.cylinder(0.8e-3, 8e-3) - m.box(6e-3, 20e-3, 6e-3).translated(-3e-3, -10e-3, 8e-3)
    for hole, free in ((0.9e-3, False), (1.3e-3, True)):
        scene = m.scene(
            {
                "frame": block - m.cylinder(hole, 6e-3).translated(z=14e-3),
                "M2.2x4 self tapping set screw": m.cylinder(R, 4e-3).translated(z=2e-3),
            }
        )
        scene["frame"].fixed = True
        rules = (OverlapRule("thread", ("M2.2*", "frame"), pitch=0.8e-3),)
        scene.rules = rules
        assert gravest(scene) == "thread"
        (mate,) = Mates(scene).mates_of(0, 1)
        assert np.isfinite(mate.travel[0]) != free and mate.travel[1] == np.inf
        up = removal(scene, "M2.2x4 self tapping set screw", motion="mates")
        assert up.verdict == "removable" and (up.way.direction[2] < 0.0 or free)


def test_a_lid_over_the_head_holds_it():
    lid = m.box(12e-3, 12e-3, 2e-3).translated(-6e-3, -6e-3, TOP + 2e-3)
    scene = tapped(lid=lid)
    scene["lid"].fixed = True
    assert removal(scene, SCREW, motion="mates").verdict != "removable"


def test_a_session_turns_the_screw_out_and_does_not_pull_it():
    scene = tapped()
    with vp.Session(scene) as session:
        session.step()
        assert [held.meaning.kind for held in session.held_by(SCREW)] == ["thread"]
        hand = session.hand()
        hand.grab(SCREW)
        for way in ((2e-3, 0.0, 0.0), (0.0, 0.0, -2e-3)):
            assert not hand.move_by(way, required=False)
            assert scene[SCREW].pose.translation == pytest.approx([0.0, 0.0, 0.0], abs=3e-6)
        outcome = hand.unscrew()
        assert "turns, 8" in outcome.reason and "torque not computed" in outcome.reason, outcome.reason
        assert scene[SCREW].pose.translation[2] == pytest.approx(LENGTH, abs=3e-4)
        assert session.held_by(SCREW) == ()
        assert hand.move_by((0.0, 0.0, 5e-3)) and hand.move_by((0.02, 0.0, 0.0))


def test_remove_and_refit_unscrew_and_screw():
    scene = tapped()
    with vp.Session(scene) as session:
        hand = session.hand()
        hand.remove(SCREW)
        assert np.linalg.norm(scene[SCREW].pose.translation[:2]) > 5e-3
        hand.refit(SCREW)
        assert scene[SCREW].pose.translation == pytest.approx([0.0, 0.0, 0.0], abs=2e-6)


def test_a_magnet_is_pressed_out_and_its_force_not_computed():
    block = m.box(20e-3, 20e-3, 10e-3).translated(-10e-3, -10e-3) - m.cylinder(3e-3, 3e-3).translated(z=7e-3)
    scene = m.scene({"block": block, "magnet 6x3": m.cylinder(3.028e-3, 3e-3).translated(z=7e-3)})
    scene["block"].fixed = True
    with vp.Session(scene) as session:
        hand = session.hand()
        hand.grab("magnet 6x3")
        assert not hand.move_by((3e-3, 0.0, 0.0), required=False) and not hand.move_by(
            (0.0, 0.0, -3e-3), required=False
        )
        outcome = hand.press_out()
        assert "force not computed" in outcome.reason and scene["magnet 6x3"].pose.translation[2] >= 3e-3 - 1e-6
        with pytest.raises(TaskError, match="no press fit holds"):
            hand.press_out()


# ---- rules


def test_a_person_overrules_by_pair_kind_and_name():
    scene = tapped()
    for rule in (
        OverlapRule("clash", (SCREW, "boss")),
        OverlapRule("clash", ("M2.2*",)),
        OverlapRule("clash", kind="thread"),
    ):
        scene.rules = (rule,)
        assert gravest(scene) == "clash", rule
        assert not Mates(scene).meanings
    scene.rules = (OverlapRule("clash", ("nut*",)),)
    assert gravest(scene) == "thread"


def test_a_rule_chooses_the_kind_and_never_the_axis():
    block = m.box(30e-3, 30e-3, 20e-3).translated(-15e-3, -15e-3) - m.cylinder(4.5e-3, 20e-3)
    scene = m.scene({"block": block, "rod": m.cylinder(5e-3, 20e-3)})
    scene.rules = (OverlapRule("press fit", ("rod", "block")),)
    assert gravest(scene) == "press fit" and Mates(scene).meanings
    scene.rules = (OverlapRule("press fit", ("rod", "block"), depth=2e-4),)
    assert gravest(scene) == "clash"
    solid = m.scene(
        {"block": m.box(30e-3, 30e-3, 20e-3), "rod": m.cylinder(5e-3, 40e-3).translated(15e-3, 15e-3, -10e-3)}
    )
    solid.rules = (OverlapRule("thread", ("rod", "block")),)
    assert gravest(solid) == "clash" and not Mates(solid).meanings


def test_rules_are_read_from_the_file_beside_the_model(tmp_path):
    model = tmp_path / "boss.step"
    m.write_step(model, {"boss": boss(), SCREW: screw()})
    assert gravest(vp.load(str(model))) == "thread"
    file = tmp_path / "boss.vpframe.toml"
    file.write_text(f'[[overlap]]\nparts = ["{SCREW}", "boss"]\nmeans = "clash"\n')
    assert overlap_rules.file_beside(model) == file
    assert gravest(vp.load(str(model))) == "clash"


def test_a_session_counts_what_is_meant_and_names_it_where_it_holds():
    scene = tapped()
    with vp.Session(scene) as session:
        session.step()
        session.expect_no_clash()
        assert [meaning.kind for meaning in session.meanings] == ["thread"]
        assert any("1 x thread, as drawn" in event.text for event in session.events)
        hand = session.hand()
        hand.grab(SCREW)
        stopped = hand.move_by((3e-3, 0.0, 0.0), required=False)
        assert "thread (boss)" in stopped.reason or "boss stands in its way" in stopped.reason, stopped.reason
        assert "authorise" not in stopped.reason
    scene.rules = (OverlapRule("clash", (SCREW,)),)
    with vp.Session(scene) as session:
        session.step()
        assert session.meanings == () and session.held_by(SCREW) == ()
        with pytest.raises(TaskError, match="no clash"):
            session.expect_no_clash()


@pytest.mark.slow
@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    bore=st.floats(0.6e-3, 1.2e-3),
    depth=st.floats(2e-3, 14e-3),
    aside=st.sampled_from([0.0, 5e-5, 2e-4, 4e-4, 8e-4]),
    bump=st.sampled_from([None, 2e-3, 6e-3, 12e-3]),
)
def test_a_meaning_never_excuses_what_lies_outside_of_its_rim(bore, depth, aside, bump):
    """By exact booleans: where a meaning is given, all that the two share lies between its core and its outside."""
    import manifold3d

    block = boss(bore, depth, aside)
    if bump is not None:  # a bar across the hole
        block = block + m.box(4e-3, 0.4e-3, 0.4e-3).translated(-2e-3, -0.2e-3, bump)
    scene = m.scene({"boss": block, SCREW: screw()})
    for meaning in Mates(scene).meanings:
        fit = meaning.fit
        solids = []
        for part in scene.parts:
            mesh = manifold3d.Mesh64(part.mesh.vertices * 1e3, part.mesh.triangles.astype(np.uint64))
            mesh.merge()
            solids.append(manifold3d.Manifold(mesh))
            assert solids[-1].status() == manifold3d.Error.NoError and solids[-1].volume() > 0.0
        both = solids[0] ^ solids[1]
        slack = 0.02
        outside, core = (
            manifold3d.Manifold.cylinder(100.0, 1e3 * radius + sign * slack, circular_segments=128).translate(
                (0, 0, -50)
            )
            for radius, sign in ((fit.radius, 1.0), (fit.radius - fit.depth, -1.0))
        )
        assert (both - outside).volume() <= 1e-6 and (both ^ core).volume() <= 1e-6
        assert fit.radius - fit.depth >= 0.5 * bore - 1e-5
        # wherever the travel lets it go, its shank stays in that rim, too
        low, high = max(fit.free[0] - fit.span[0], -12e-3), min(fit.free[1] - fit.span[1], 12e-3)
        shank = manifold3d.Manifold.cylinder(1e3 * LENGTH, 1e3 * R, circular_segments=64)
        for along in np.linspace(low, high, 9):  # positive along the axis, which points down
            at = shank.translate((0.0, 0.0, 1e3 * (TOP - LENGTH - along)))
            assert ((solids[0] ^ at) ^ core).volume() <= 1e-6, along
