"""What `vpframe clash` says of scenes whose truth is known."""

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh, Tolerance
from collision.solid import solid_of
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Freeform, Plane
from tests.vpframe.fitted import AT_HOME, at, heap, kinds, worst
from vpframe.analysis.clash import authorised_pairs, clash, document, is_open, table
from vpframe.analysis.fits import ClashReason
from vpframe.analysis.mates import mates
from vpframe.errors import VpframeError
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene, Shape, Surface


def shaft_in_bore(radius, deflection=1e-4):
    block = m.box(0.04, 0.04, 0.03).translated(-0.02, -0.02, 0.0) - m.cylinder(0.010, 0.03)
    shaft = m.cylinder(radius, 0.06).translated(0.0, 0.0, -0.015)
    # turned by an odd angle, so that facets of the shaft meet facets of the bore across
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.123])), np.zeros(3))
    return m.scene({"block": (block, AT_HOME), "shaft": (shaft, turn)}, deflection=deflection)


@pytest.mark.parametrize("deflection", [2e-5, 1e-4, 4e-4])
@pytest.mark.parametrize(
    ("radius", "kind"),
    [
        (0.0104, "clash"),
        (0.01005, "clash"),
        (0.01002, "press fit"),
        (0.010, "contact"),
        (0.00998, "clearance"),
        (0.0099, None),
    ],
)
def test_a_fit_is_judged_on_its_radii_whatever_the_tessellation(radius, kind, deflection):
    found = clash(shaft_in_bore(radius, deflection), clearance=5e-5)
    assert kinds(found) - ({"contact"} if kind == "clash" else set()) == ({kind} if kind else set())
    if kind in ("clash", "press fit"):
        depths = [p.depth for p in found if p.reason is ClashReason.FIT]
        assert depths == pytest.approx([radius - 0.01] * max(1, len(depths)), abs=1e-9)
    if kind == "clearance":
        assert [p.distance for p in found] == pytest.approx([2e-5] * len(found), abs=1e-9)


def test_an_overlap_may_be_authorised_by_name():
    pairs = authorised_pairs(["shaft:block"])
    assert "clash" not in kinds(clash(shaft_in_bore(0.01005), authorised=pairs)) >= {"authorised"}
    assert kinds(clash(shaft_in_bore(0.01002), authorised=pairs)) == {"press fit"}  # it needs no authorisation


def test_a_press_fit_is_no_clash_and_is_counted():
    found = clash(shaft_in_bore(0.01002))
    words = "press fit, 20 µm radial interference, force not checked"
    assert found and all(words in p.why and not is_open(p) for p in found)
    text = table(found)
    head = "0 clashes; 1 press fit, as drawn: --as-drawn judges them as solid (pairs of parts)"
    assert text.splitlines()[0] == head and words in text and "0.020 mm deep" in text
    tight = Tolerance(press_fit="p6")  # Ø20: 35 µm on the diameter
    assert "clash" in kinds(clash(shaft_in_bore(0.01002), tolerance=tight))
    assert kinds(clash(shaft_in_bore(0.0100175), tolerance=tight)) == {"press fit"}
    assert kinds(clash(shaft_in_bore(0.01035), tolerance=Tolerance(press_fit="u8"))) >= {"clash"}
    assert kinds(clash(shaft_in_bore(0.010036), tolerance=Tolerance(press_fit="u8"))) == {"press fit"}


@pytest.mark.parametrize("wall", [5e-4, 2e-5])
def test_a_ring_around_a_bush_is_no_shaft_in_its_bore(wall):
    """Ø24 lies about Ø20 without being in it."""
    ring, bush = (m.cylinder(r, 0.02) - m.cylinder(r - w, 0.02) for r, w in ((0.012, 0.001), (0.01 + wall, wall)))
    assert clash(m.scene({"ring": ring, "bush": bush})) == ()
    wider = m.cylinder(0.01104, 0.02) - m.cylinder(0.010, 0.02)  # 40 µm into the ring
    found = clash(m.scene({"ring": ring, "bush": wider}))
    assert max(p.depth for p in found if p.kind == "clash") == pytest.approx(4e-5, abs=1e-9)


def test_flush_is_contact_overlap_is_clash_inside_is_containment():
    cube = m.box(0.02, 0.02, 0.02)
    flush = m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.02))})
    assert kinds(clash(flush)) == {"contact"}
    deep = clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.019, y=0.001, z=0.001))}))
    assert kinds(deep) >= {"clash"}
    assert max(p.depth for p in deep) == pytest.approx(1e-3, abs=1e-6)
    inside = clash(m.scene({"a": (cube, AT_HOME), "b": (m.box(0.01, 0.01, 0.01), at(0.005, 0.005, 0.005))}))
    assert [(p.kind, p.surfaces, p.reason) for p in inside] == [("containment", (), ClashReason.INSIDE)]
    assert inside[0].why == "b lies wholly inside a" and "b lies wholly inside a" in table(inside)
    assert clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.03))})) == ()


def test_identical_parts_in_one_place_clash():
    cube = m.box(0.02, 0.02, 0.02)
    assert "clash" in kinds(clash(m.scene({"a": (cube, AT_HOME), "b": (cube, AT_HOME)})))


def test_the_table_names_parts_and_counts_kinds():
    text = table(clash(shaft_in_bore(0.01002)))
    assert text.startswith("0 clashes; 1 press fit, as drawn") and "block – shaft" in text and "0.020 mm deep" in text
    surfaces = table(clash(shaft_in_bore(0.01002)), surfaces=True)
    assert "3 pairs of surfaces" in text and surfaces.startswith("0 clashes; 3 press fits")
    assert table(clash(shaft_in_bore(0.01005))).startswith("1 clash (pairs of parts)")
    assert table([]) == "no two parts touch"


def test_authorised_pairs_are_two_names():
    with pytest.raises(VpframeError, match="A:B"):
        authorised_pairs(["shaft"])


def test_a_row_of_a_fit_has_a_place_and_its_faces_names():
    scene = shaft_in_bore(0.01002)
    (pair,) = document(clash(scene))["pairs"]
    bore, shaft = (face.split(" · ")[1] for face in pair["faces"])
    assert (bore, shaft) == ("bore Ø20", "shaft Ø20.04")
    x, y, z = pair["point"]
    assert np.hypot(x, y) <= 0.0101 and 0.0 <= z <= 0.03


def test_a_subassembly_is_authorised_by_its_name():
    scene = heap()
    assert authorised_pairs(["stack:cube"], scene) == [("stack/plate", "cube"), ("stack/top", "cube")]
    assert "clash" not in kinds(clash(scene, authorised=authorised_pairs(["stack:cube"], scene)))
    with pytest.raises(VpframeError, match="stakc"):
        authorised_pairs(["stakc:cube"], scene)


def screwed(hole, length=0.016):
    """A screw M6 with its head on a plate of 10 mm that has a hole of a given diameter."""
    plate = m.box(0.03, 0.03, 0.01) - m.cylinder(hole / 2.0, 0.01).translated(0.015, 0.015, 0.0)
    screw = m.cylinder(0.003, length) + m.cylinder(0.005, 0.006).translated(z=length)
    return m.scene({"plate": (plate, AT_HOME), "screw": (screw, at(0.015, 0.015, 0.01 - length))})


@pytest.mark.parametrize("length", [0.006, 0.016])
def test_a_screw_drawn_in_its_tap_drill_is_a_thread_and_no_clash(length):
    found = clash(screwed(0.005, length))
    assert kinds(found) == {"thread", "contact"}
    threads = [p for p in found if p.kind == "thread"]
    assert max(p.depth for p in threads) == pytest.approx(5e-4, rel=0.05)
    assert all(p.why.startswith("thread M6: Ø6 in Ø5 mm tapping hole, head Ø10 mm over") for p in threads)
    assert not any(map(is_open, found))
    text = table(found)
    assert text.splitlines()[0] == "0 clashes; 1 thread, as drawn: --as-drawn judges them as solid (pairs of parts)"
    assert "threads, as drawn" in table(found, surfaces=True).splitlines()[0] and "thread M6: Ø6 in Ø5 mm" in text
    # a hole wider than a tap drill holds the screw by a part of its thread; one narrower than its core does not
    assert kinds(clash(screwed(0.0055, length))) == {"thread", "contact"}
    assert "clash" in kinds(clash(screwed(0.0045, length)))


PITCH, RADIUS, DEPTH, PER_TURN = 2e-3, 7.35e-3, 5e-4, 64


def threaded_part(name, height, air=0.0, outer=None):
    """A bar with a thread of rounded profile about z, or a nut of radius `outer` that is `air` wider all round."""
    rows = round(height / PITCH * 24) + 1
    z, angle = np.linspace(0.0, height, rows)[:, None], 2.0 * np.pi * np.arange(PER_TURN)[None] / PER_TURN
    wave = RADIUS + air + DEPTH * np.sin(2.0 * np.pi * z / PITCH - angle)
    rings = [(wave, z + 0.0 * angle)]
    inner = 0.0 if outer is None else outer
    rings.append((np.full((2, PER_TURN), inner), np.repeat([[0.0], [height]], PER_TURN, axis=1)))
    vertices = np.concatenate(
        [np.stack([r * np.cos(angle), r * np.sin(angle), h], axis=-1).reshape(-1, 3) for r, h in rings]
    )
    triangles, faces = [], []

    def strip(low, high, face):
        for j in range(PER_TURN):
            k = (j + 1) % PER_TURN
            for t in ((low + j, low + k, high + k), (low + j, high + k, high + j)):
                triangles.append(t)
                faces.append(face)

    bottom, top = rows * PER_TURN, (rows + 1) * PER_TURN
    for i in range(rows - 1):
        strip(i * PER_TURN, (i + 1) * PER_TURN, 0)
    strip(bottom, 0, 1)
    strip((rows - 1) * PER_TURN, top, 2)
    if outer is not None:
        strip(top, bottom, 3)
    corners = np.array(triangles)
    if outer is not None:
        corners = corners[:, ::-1]
    solid = np.linalg.norm(np.cross(*(vertices[corners[:, k]] - vertices[corners[:, 0]] for k in (1, 2))), axis=1) > 0
    used, corners = np.unique(corners[solid], return_inverse=True)
    vertices = vertices[used]
    if outer is None:  # the rings of radius 0 are the axis
        vertices, merged = np.unique(np.round(vertices, 12), axis=0, return_inverse=True)
        corners = merged.reshape(-1)[corners]
    mesh = SurfaceMesh(vertices, corners.reshape(-1, 3), np.array(faces)[solid], name)
    assert solid_of(mesh).closed
    flat = {1: Plane([0, 0, 0], [0, 0, -1.0]), 2: Plane([0, 0, height], [0, 0, 1.0])}
    surfaces = tuple(
        Surface(i, f"{name}/{i}", flat.get(i, Freeform()), "flat" if i in flat else "free", 0.0, 1.0)
        for i in range(mesh.n_surfaces)
    )
    return Part(name, Shape(mesh, surfaces, ()), AT_HOME)


def real_thread(advance=0.0, air=5e-5):
    """A bolt and a nut whose threads are geometry; the nut on by 4 mm, two turns, and more."""
    nut = threaded_part("nut", 6e-3, air, outer=0.012)
    nut.pose = at(z=4e-3 + advance)
    return Scene([threaded_part("bolt", 16e-3), nut])


def test_a_real_thread_in_its_nut_is_a_thread_in_and_out_of_phase():
    assert kinds(clash(real_thread(air=7e-5))) == set()
    assert kinds(clash(real_thread())) <= {"thread"}  # freeform flanks: apart by less than their deflection
    assert kinds(clash(real_thread(air=5e-6))) == {"thread", "contact"}  # its ends are as near as its flanks
    found = clash(real_thread(advance=5e-4))
    assert kinds(found) >= {"thread"}
    (flanks,) = [p for p in found if p.surfaces == (0, 0)]
    assert flanks.kind == "thread" and flanks.reason is ClashReason.THREAD and 1e-4 < flanks.depth < PITCH
    assert flanks.why.startswith("threads on one axis over 6 mm")
    across = real_thread()
    across["nut"].pose = at(x=1e-3, z=4e-3)  # off the axis: no thread any more
    assert "thread" not in kinds(clash(across)) and "clash" in kinds(clash(across))


def test_crests_and_roots_of_a_loose_thread_are_the_thread():
    """Faces of the crests and of the roots that lie on cylinders, by their radii 58.7 µm into each other."""
    scene = real_thread()
    for part, sense, radius in zip(scene.parts, (1, -1), (RADIUS + DEPTH, RADIUS + DEPTH - 5.87e-5), strict=True):
        mesh = part.mesh
        aside = np.hypot(*mesh.vertices[mesh.triangles].mean(axis=1)[:, :2].T)
        outermost = (mesh.surface_of_triangle == 0) & (aside > aside[mesh.surface_of_triangle == 0].max() - 5e-5)
        last = mesh.n_surfaces
        split = SurfaceMesh(
            mesh.vertices, mesh.triangles, np.where(outermost, last, mesh.surface_of_triangle), part.name
        )
        used, triangles = np.unique(split.triangles[split.triangles_of(last)], return_inverse=True)
        crest = Cylinder([0, 0, 0], [0, 0, 1], radius)
        feature = Feature(
            crest, (last,), sense, split.vertices[used], triangles.reshape(-1, 3).astype(np.int32), 0.0, 1.0
        )
        surface = Surface(last, f"{part.name}/{last}", crest, "convex" if sense > 0 else "concave", 0.0, 1.0)
        part.shape = Shape(split, (*part.surfaces, surface), (feature,))
    pairs = clash(scene)
    assert {p.kind for p in pairs} <= {"thread", "contact"} and not any(p.reason is ClashReason.FIT for p in pairs)
    assert [c.kind for c in mates(scene).constraints] == ["screw"]


def test_a_row_of_a_fit_names_two_faces_that_are_near():
    """A pin in the lowest of three lands of one bore: the others are up to 40 mm away, and no contact."""
    bar = m.box(0.02, 0.02, 0.06) - m.cylinder(0.005, 0.06).translated(0.01, 0.01, 0.0)
    for z in (0.015, 0.035):
        bar = bar - m.cylinder(0.007, 0.01).translated(0.01, 0.01, z)
    scene = m.scene({"bar": (bar, AT_HOME), "pin": (m.cylinder(0.005, 0.012), at(0.01, 0.01, 0.001))})
    pairs = clash(scene)
    assert pairs
    for pair in pairs:
        assert face_distance(scene, pair) < 2e-4


def face_distance(scene, pair):
    """m: least distance of the vertices and middles of two faces, along z: enough to tell the lands apart."""
    spans = []
    for name, surface in zip(pair.parts, pair.surfaces, strict=True):
        part = scene[name]
        z = part.mesh.vertices[part.mesh.triangles[part.mesh.triangles_of(surface)]][..., 2] + part.pose.translation[2]
        spans.append((z.min(), z.max()))
    (low, high), (below, above) = spans
    return max(low - above, below - high, 0.0)


def test_parts_that_overlap_sideways_only_touch_end_to_end():
    """Two posts of which one stands on the other, 30 µm inside the other's outline: no material is common."""
    post = m.cylinder(0.006, 0.01)
    beside = {"a": post, "b": (post, at(0.012 - 3e-5, 0.0, 0.01))}
    assert kinds(clash(m.scene(beside), 1e-4)) == {"contact"}
    level = {"a": post, "b": (post, at(0.012 - 3e-5))}
    assert worst(level).depth == pytest.approx(3e-5, abs=1e-9)


def test_rows_are_handed_over_pair_by_pair_with_the_share_done():
    parts = {f"block_{k}": (m.box(0.01, 0.01, 0.01), at(0.009 * k)) for k in range(5)}
    scene, groups, shares = m.scene(parts), [], []
    rows = clash(scene, decided=groups.append, progress=lambda share, text: shares.append((share, text)))
    assert sum(groups, ()) == rows
    assert [{row.parts for row in group} for group in groups] == [{(f"block_{k}", f"block_{k + 1}")} for k in range(4)]
    assert shares == sorted(shares, key=lambda share: share[0]) and shares[-1][0] < 1.0
    assert shares[-1][1] == "4 of 4 pairs of parts, 4 clash"


def test_what_is_done_with_rows_may_end_the_search():
    scene = m.scene({name: (m.box(0.01, 0.01, 0.01), at(shift)) for name, shift in (("a", 0.0), ("b", 0.009))})

    def stop(rows):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        clash(scene, decided=stop)
