"""One part, cases with known answers: the way, or the proof that there is none. Every way is checked pose by pose."""

from itertools import pairwise

import cases
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vpframe as vp
from collision import CollisionManager, Tolerance
from constraints.freedom.escape import holds
from vpframe.planning import enclosure, tree, ways
from vpframe.planning.assembly import LINEAR, Assembly, Budget, BudgetError
from vpframe.planning.certify import STRAY, least_clearance
from vpframe.planning.pushes import Pushes
from vpframe.planning.verdict import Removal, find
from vpframe.scene.modelling import box, cylinder, sphere
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0
"""s: no case may end by the clock on a slow machine; each ends by itself"""
PRESSED = 1e-11
"""m: no way presses surfaces deeper than where the parts stand by more"""


def angle_of(removal):
    """rad: the greatest turn of the way from where the part stands."""
    return max(float(np.linalg.norm(pin.log3(k.rotation))) for k in removal.way.knots)


def turned(removal):
    """rad: all turns along the way."""
    knots = removal.way.knots
    return sum(float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation))) for a, b in pairwise(knots))


def deepest_beyond(scene, removal, poses=60):
    """m: by how much any surfaces reach deeper into each other on the way than where the parts stand, but for those
    that a fit or thread excuses; poses between the knots a leg."""
    assembly = Assembly(scene)
    out = 0.0
    for name in removal.parts:
        i = scene.index(name)
        for j in set(range(len(scene))) - {scene.index(n) for n in removal.parts}:
            world = CollisionManager(Tolerance(linear=1e-13, depth=1e-2))  # depths are found to within 1e-15 m
            world.add(scene.parts[i].mesh, assembly.poses[i])
            world.add(scene.parts[j].mesh, assembly.poses[j])
            for mine, theirs in assembly.excused(i, j):
                world.ignore_surfaces(0, mine, 1, theirs)
            known = {(r["surface_a"], r["surface_b"]): r["depth"] for r in world.penetration(0, 1)}
            for a, b in pairwise(removal.way.knots):
                way = pin.log6(a.actInv(b))
                for s in np.linspace(0.0, 1.0, poses):
                    world.set_pose(0, a * pin.exp6(way * s) * assembly.poses[i])
                    if len(world.colliding_surfaces()):
                        for r in world.penetration(0, 1):
                            out = max(out, r["depth"] - known.get((r["surface_a"], r["surface_b"]), 0.0))
    return out


def is_clear(scene, removal):
    """Whether a plane across its last direction parts what came out from all that stays."""
    parts = {scene.index(n) for n in removal.parts}
    d, end = removal.way.direction, removal.way.knots[-1]
    assembly = Assembly(scene)
    mine = min(((assembly.sweeps.corners(i) @ end.rotation.T + end.translation) @ d).min() for i in parts)
    return mine > max((assembly.sweeps.corners(j) @ d).max() for j in range(len(scene)) if j not in parts)


def test_a_nut_turns_by_the_engaged_length_over_the_pitch_and_is_not_pulled():
    scene = cases.m16(engaged=0.012)
    found = vp.planning.removal(scene, "nut", budget=LONG)
    assert found.verdict == "removable" and found.way.motion == "screw"
    assert found.way.turns == pytest.approx(0.012 / 0.002)
    assert turned(found) >= 2.0 * np.pi * 6.0
    pulled = vp.planning.removal(scene, "nut", budget=LONG, motion="straight")
    assert pulled.verdict == "not found" and pulled.blockers == ("stud",)
    assert all("thread" in t.why for t in pulled.tried if t.way.endswith("(0, 0, 1)"))


@pytest.mark.parametrize(
    ("scene", "part", "least"),
    [
        pytest.param(cases.c_clip, "clip", cases.clip_angle(), marks=pytest.mark.slow),
        (cases.bayonet, "plug", cases.BAYONET),
        (cases.l_hook, "hook", np.radians(20.0)),
    ],
)
def test_what_has_to_be_turned_is_turned_by_the_analytic_angle(scene, part, least):
    scene = scene()
    straight = vp.planning.removal(scene, part, motion="straight", budget=LONG)
    assert straight.verdict == "not found"
    found = vp.planning.removal(scene, part, budget=LONG)
    assert found.verdict == "removable" and found.way.motion == "slide"
    assert angle_of(found) >= least
    assert deepest_beyond(scene, found) <= PRESSED
    assert is_clear(scene, found)


def sampled(scene, part, seed=0, seconds=60.0):
    """What the tree alone finds, without straight ways and pushes; by its questions, not by the clock."""
    assembly, i = Assembly(scene), scene.index(part)
    others = [j for j in range(len(scene)) if j != i]
    cone, _ = ways.cone_of(assembly, (i,), others)
    return tree.search(assembly, (i,), others, cone, Budget(seconds, clock=lambda: 0.0), seed)


@pytest.mark.parametrize(
    ("scene", "part", "least"),
    [
        (cases.c_clip, "clip", cases.clip_angle()),
        (cases.bayonet, "plug", cases.BAYONET),
        (cases.l_hook, "hook", np.radians(20.0)),
        (cases.peg, "peg", 0.0),
        (cases.latched_box, "latch", 0.0),
    ],
)
def test_the_tree_alone_finds_ways_that_deepen_nothing(scene, part, least):
    scene = scene()
    found = sampled(scene, part)
    removal = Removal((part,), "removable", found.way)
    assert angle_of(removal) >= least
    assert deepest_beyond(scene, removal) <= PRESSED
    assert is_clear(scene, removal)


def test_pushes_in_a_turned_frame_deepen_nothing_but_for_rounding():
    cube = box(0.01, 0.01, 0.01), cases.at(0.02, 0.02, 0.01)
    scene, random = scene_of({"plate": box(0.05, 0.05, 0.01), "cube": cube}), np.random.default_rng(0)
    turn = pin.SE3(pin.exp3(np.array([0.4, 1.1, -0.7])), np.zeros(3))
    for part in scene.parts:
        part.pose = turn * part.pose
    pushes = Pushes(Assembly(scene), (1,), (0,), Budget(LONG))
    for _ in range(60):
        start = pushes.nodes[random.integers(len(pushes.nodes))].at
        twist = pin.exp6(random.normal(size=6) * ([2e-3] * 3 + [0.1] * 3))
        around = cases.at(*pushes.center)
        reached, stop = pushes.push(start, start * around * twist * around.inverse())
        pushes.add(0, [reached], stop)
    assert sum(node.normals.size > 0 for node in pushes.nodes) > 20  # it was stopped
    for node in pushes.nodes:
        way = ways.RemovalPath("free", ways.AXES[0], (node.at, node.at))
        assert deepest_beyond(scene, Removal(("cube",), "removable", way), poses=1) <= PRESSED


def test_walls_thinner_than_the_steps_of_the_tree_are_never_passed():
    wall, thin = 2e-5, 2e-5
    shell = box(0.03, 0.03, 0.01) - box(0.03 - 2 * wall, 0.03 - 2 * wall, 0.01 - 2 * wall).translated(wall, wall, wall)
    scene = scene_of({"shell": shell, "plate": box(0.02, 0.02, thin).translated(0.005, 0.005, 0.005)})
    assert wall + thin < tree.STEP * 0.01
    found = sampled(scene, "plate", seconds=4.0)
    assert found.way is None and found.reached > 0.0


def test_the_displacements_of_the_tree_intersect_nothing_and_its_random_numbers_are_its_seed():
    scene = cases.linked_rings()
    assembly = Assembly(scene)
    cone, _ = ways.cone_of(assembly, (1,), (0,))

    def grown(seed):
        pushes = Pushes(assembly, (1,), (0,), Budget(1.0, clock=lambda: 0.0))
        search = tree._Search(pushes, cone, seed)
        with pytest.raises(BudgetError):
            search.run()
        return search

    search = grown(3)
    n = int(search.tree.count[tree.NODES])
    assert n > 100
    world = CollisionManager()
    for part, pose in zip(scene.parts, assembly.poses, strict=True):
        world.add(part.mesh, pose)
    for k in range(0, n, 7):
        world.set_pose(1, search._displacement(search._at(k)) * assembly.poses[1])
        assert not len(world.colliding_surfaces())
        assert search.tree.parent[k] < k
    again, other = grown(3), grown(4)
    assert np.array_equal(again.tree.pose[:n], search.tree.pose[:n])
    assert not np.array_equal(other.tree.pose[:n], search.tree.pose[:n])


def test_a_dovetail_leaves_one_direction_and_its_opposite():
    scene = cases.dovetail()
    assembly = Assembly(scene)
    free = []
    for d in [np.array(d, float) for d in ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1])]:
        if assembly.straight(1, 0, d) is None:
            free.append(tuple(d))
    assert free == [(0, 1, 0), (0, -1, 0)]
    found = vp.planning.removal(scene, "slide", budget=LONG)
    assert found.verdict == "removable" and abs(found.way.direction[1]) == 1.0
    assert deepest_beyond(scene, found) <= PRESSED


def test_the_blockers_of_a_pin_with_two_heads_are_named():
    found = vp.planning.removal(cases.headed_pin(), "pin", motion="straight", budget=LONG)
    assert found.verdict == "not found"
    assert set(found.blockers) <= {"lower", "upper"}
    up = next(t for t in found.tried if t.way == "straight along (0, 0, 1)")
    assert up.stopped_by == ("lower", "upper")
    assert up.reached == pytest.approx(1e-4, abs=1e-5)
    assert {(a, b) for a, _, b, _ in up.surfaces} >= {("pin", "lower")}


def test_linked_rings_are_not_found_and_never_locked():
    found = vp.planning.removal(cases.linked_rings(), "two", budget=1.0)
    assert found.verdict == "not found" and found.proof is None
    assert max(t.reached for t in found.tried) > 1e-3


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


@pytest.mark.parametrize(
    ("scene", "part"),
    [
        (cases.linked_rings, "two"), (cases.headed_pin, "pin"), (cases.peg, "peg"), (cases.dovetail, "slide"),
        (cases.l_hook, "hook"), (cases.bayonet, "plug"), (cases.interlocked, "one"),
        pytest.param(cases.c_clip, "clip", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_what_can_move_is_neither_locked_nor_enclosed(scene, part):
    scene = scene()
    assembly, i = Assembly(scene), scene.index(part)
    others = [j for j in range(len(scene)) if j != i]
    cone, _ = ways.cone_of(assembly, (i,), others)
    assert cone.lock() is None
    assert enclosure.enclosed_by(assembly, (i,), others) is None
    assert enclosure.caged_by(assembly, (i,), others) is None


def test_a_block_in_its_pocket_is_locked_by_a_proof_that_holds_exactly():
    found = vp.planning.removal(cases.box_in_pocket(), "block", budget=LONG)
    assert found.verdict == "locked"
    proof = found.proof
    assert holds(proof.cone.rows[list(proof.lock.rows)], proof.multipliers)
    assert {(a, b) for a, _, b, _ in proof.surfaces} == {("block", "housing")}
    assert proof.tolerance == LINEAR


@pytest.mark.parametrize("gap", [1e-4, 5e-4, 1e-3])
def test_the_least_clearance_is_that_of_dense_samples_where_surfaces_only_pass_each_other(gap):
    post, mover = cylinder(0.003, 0.03), (box(0.01, 0.01, 0.01), cases.at(-0.03, -0.013 - gap, 0.01))
    assembly = Assembly(scene_of({"post": post, "mover": mover}))
    knots = pin.SE3.Identity(), cases.at(0.06)
    found = least_clearance(assembly, (1,), (0,), knots)
    world = CollisionManager()
    for mesh, pose in zip(assembly.meshes, assembly.poses, strict=True):
        world.add(mesh, pose)
    sampled = []
    for x in np.linspace(0.0, 0.06, 601):
        world.set_pose(1, cases.at(x) * assembly.poses[1])
        sampled += world.contacts(within=2.0 * gap)["distance"].tolist()
    assert 0.9 * min(sampled) <= found.distance <= min(sampled)
    assert found.parts == (1, 0)


def test_the_least_clearance_of_a_way_of_many_legs_is_that_of_dense_samples():
    post, mover = cylinder(0.003, 0.03), (box(0.01, 0.01, 0.01), cases.at(-0.03, -0.0135, 0.01))
    assembly = Assembly(scene_of({"post": post, "mover": mover}))
    knots = [pin.SE3.Identity()]  # past the post, nearer and farther with every leg
    for k in range(1, 25):
        knots.append(pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.01 * (k % 3)])), np.array([0.0025 * k, 1e-4 * (k % 2), 0])))
    found = least_clearance(assembly, (1,), (0,), tuple(knots))
    sampled = [
        assembly.sweeps.near(1, 0, a * pin.exp6(pin.log6(a.actInv(b)) * t), b, 0.01)["distance"].min(initial=0.01)
        for a, b in pairwise(knots)
        for t in np.linspace(0.0, 1.0, 40)
    ]
    assert 0.995 * min(sampled) <= found.distance <= min(sampled)


def test_a_peg_comes_out_of_ten_micrometres_and_its_clearance_is_told():
    scene = cases.peg(1e-5)
    found = vp.planning.removal(scene, "peg", budget=LONG)
    assert found.verdict == "removable"
    assert found.clearance.distance == pytest.approx(1e-5, rel=0.06)
    assert deepest_beyond(scene, found) == 0.0
    wider = vp.planning.removal(scene, "peg", budget=LONG, clearance=9e-6)
    assert wider.verdict == "removable"


def test_the_clearance_of_a_way_that_leaves_a_fit_at_once_is_that_of_its_surfaces():
    shell = box(0.01, 0.016, 0.01).translated(-0.015, -0.008, 0.0) - cylinder(0.01005, 0.01)
    scene = scene_of({"post": cylinder(0.01, 0.03), "shell": (shell, cases.at(0.0, 0.0, 0.01))})
    assembly = Assembly(scene)
    assert assembly.mates_of(0, 1)
    near = assembly.sweeps.near(1, 0, pin.SE3.Identity(), cases.at(-0.001), 0.001)["distance"].min()
    found = least_clearance(assembly, (1,), (0,), (pin.SE3.Identity(), cases.at(-0.02)))
    assert 0.99 * near <= found.distance <= near
    along = least_clearance(assembly, (1,), (0,), (pin.SE3.Identity(), cases.at(0.0, 0.0, 0.03)))
    assert along.distance > 10.0 * near


def test_the_track_is_what_a_hand_follows_and_keeps_to_the_certified_way():
    scene = cases.bayonet()
    found = vp.planning.removal(scene, "plug", budget=LONG)
    track, pose = found.track, Assembly(scene).poses[scene.index("plug")]
    assert track.poses[0].isApprox(pose)
    assert track.poses[-1].isApprox(found.way.knots[-1] * pose, 1e-9)
    lines = track.text().splitlines()
    assert lines[0] == "t,x,y,z,qx,qy,qz,qw" and len(lines) == len(track.times) + 1
    fine = [
        a * pin.exp6(pin.log6(a.actInv(b)) * s) * pose
        for a, b in pairwise(found.way.knots)
        for s in np.linspace(0, 1, 200)
    ]
    points = scene["plug"].mesh.vertices[:5]
    for a, b in pairwise(track.poses):
        middle = pin.SE3(
            a.rotation @ pin.exp3(0.5 * pin.log3(a.rotation.T @ b.rotation)), 0.5 * (a.translation + b.translation)
        )
        way = min(np.abs([middle.act(p) - f.act(p) for p in points]).max() for f in fine)
        assert way < STRAY + 2e-4  # the fine poses are as far apart as that


def test_the_same_seed_gives_the_same_answer_and_another_seed_another():
    def once(seed):
        budget = Budget(0.6, clock=lambda: 0.0)  # 300 questions, whatever time they take
        found = find(Assembly(cases.linked_rings()), (1,), (0,), budget, seed=seed)
        return [(t.way, t.reached, t.stopped_by) for t in found.tried], found.questions

    assert once(3) == once(3)
    assert once(3) != once(4)


def test_a_search_ends_when_its_questions_are_used_up():
    budget = Budget(0.2, clock=lambda: 0.0)
    found = find(Assembly(cases.linked_rings()), (1,), (0,), budget)
    assert found.verdict == "not found" and not budget.by_clock
    assert budget.questions == 100 and 100 <= found.questions < 120


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"part": "nut2"}, "no part"),
        ({"part": ("nut", "nut")}, "name each once"),
        ({"part": "nut", "motion": "up"}, "known are straight"),
        ({"part": "nut", "budget": -1.0}, "positive number of seconds"),
        ({"part": "nut", "clearance": float("nan")}, "length of at least 0"),
        ({"part": "nut", "authorise": [("nut", "bolt")]}, "no part 'bolt'"),
    ],
)
def test_bad_questions_are_answered_in_one_line(arguments, words):
    with pytest.raises(vp.VpframeError, match=words):
        vp.planning.removal(cases.m16(0.01), **arguments)
