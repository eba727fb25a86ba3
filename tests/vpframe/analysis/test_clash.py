"""What `vpframe clash` says of scenes whose truth is known."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh, Tolerance
from collision.solid import solid_of
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Freeform, Plane
from vpframe.analysis.clash import authorised_pairs, clash, document, is_open, merged, table
from vpframe.analysis.fits import ClashReason
from vpframe.analysis.mates import mates
from vpframe.analysis.pairs import ClashRow, by_parts
from vpframe.errors import VpframeError
from vpframe.scene import modelling as m
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Part, Scene, Shape, Surface

AT_HOME = pin.SE3.Identity()


def at(x=0.0, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


def kinds(rows):
    return {row.kind for row in rows}


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
    assert text.startswith("1 press fit (pairs of parts)") and words in text and "0.020 mm deep" in text
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
    assert text.startswith("1 press fit") and "block – shaft" in text and "0.020 mm deep" in text
    surfaces = table(clash(shaft_in_bore(0.01002)), surfaces=True)
    assert "3 pairs of surfaces" in text and surfaces.startswith("3 press fit")
    assert table(clash(shaft_in_bore(0.01005))).startswith("1 clash (pairs of parts)")
    assert table([]) == "no two parts touch"


def test_scenes_of_several_files_keep_their_parts_apart():
    one = m.scene({"cube": (m.box(0.01, 0.01, 0.01), AT_HOME)})
    one.source = "folder/a.step"
    both = merged([one, one])
    assert both.names == ("a/cube", "a_2/cube")
    assert merged([one]) is one
    assert clash(Scene()) == ()


def test_authorised_pairs_are_two_names():
    with pytest.raises(VpframeError, match="A:B"):
        authorised_pairs(["shaft"])


@pytest.mark.parametrize("angular", [0.1, 0.35, 0.7])
def test_deflection_is_that_of_the_chords(angular):
    radius = 0.01
    shape = m.shape(m.cylinder(radius, 0.03), deflection=1.0, angular=angular)
    mesh = shape.mesh
    sides = next(s for s in shape.surfaces if s.orientation == "convex")
    ring = np.unique(
        np.round(mesh.vertices[mesh.triangles[mesh.triangles_of(sides.index)]].reshape(-1, 3)[:, :2], 12), axis=0
    )
    sagitta = radius * (1.0 - np.cos(np.pi / len(ring)))
    # the flat ends end at the same chords
    assert deflections(shape) == pytest.approx([sagitta] * 3, rel=0.02)


def test_the_table_puts_the_deepest_first_and_tells_no_length_of_zero():
    def row(kind, depth=0.0, distance=0.0, b="b"):
        faces = tuple(Surface(i, "", Freeform(), "free", 0.0, 1.0) for i in (0, 1))
        gap = (distance - depth,) * 2
        return ClashRow(kind, ("a", b), (0, 1), faces, distance, depth, gap, (0.0, 0.0, 0.0), ClashReason.NONE, "")

    within = replace(row("contact", 2e-5, b="c"), interval=(-6e-5, 2e-5))
    pairs = [row("contact", 1e-15), within, row("clash", 1e-4), row("clash", 3e-3, b="d")]
    lines = table([*pairs, row("clearance", distance=2e-4)], surfaces=True).splitlines()
    assert lines[0] == "2 clash, 2 contact, 1 clearance"
    assert [line.split()[3].rstrip(":") for line in lines[1:4]] == ["d", "b", "c"]
    assert lines[3].endswith("touching within their deflection, from 0.060 mm deep to 0.020 mm apart")
    assert lines[4].endswith("touching") and lines[5].endswith("0.200 mm apart")
    assert "0.000" not in "\n".join(lines)


def heap():
    """A cube that a plate cuts and a post touches; two further plates that only touch."""
    cube, slab = m.box(0.02, 0.02, 0.02), m.box(0.02, 0.02, 0.005)
    poses = {"cube": (cube, AT_HOME), "stack/plate": (slab, at(z=0.019)), "post": (cube, at(x=0.02))}
    return m.scene({**poses, "stack/top": (slab, at(z=0.024)), "lid": (slab, at(z=0.029))})


def test_clashes_are_listed_by_pair_of_parts_and_contacts_counted_at_the_end():
    found = clash(heap())
    lines = table(found).splitlines()
    assert lines[0] == "1 clash, 4 contact (pairs of parts)"
    assert lines[1].split()[:5] == ["clash", "cube", "–", "stack/plate:", "1.000"]
    assert " mm deep at (" in lines[1] and " · plane – face " in lines[1] and "pairs of surfaces" in lines[1]
    rest = [p for p in found if p.parts != ("cube", "stack/plate")]
    assert lines[2].endswith(f"4 pairs of parts only touch ({len(rest)} pairs of surfaces); --contacts lists them")
    assert len(lines) == 3
    asked = table(found, contacts=True).splitlines()
    assert len(asked) == 6 and asked[:2] == lines[:2]
    assert sum(line.startswith("  contact") and "touching" in line for line in asked) == 4
    every = table(found, surfaces=True).splitlines()
    assert len(every) == 1 + len(found)


def test_the_document_nests_the_surfaces_of_a_pair_of_parts():
    found = clash(heap())
    (worst, *rest) = document(found, notes=["a note"])["pairs"]
    assert document(found, notes=["a note"])["notes"] == ["a note"]
    assert worst["parts"] == ["cube", "stack/plate"] and worst["kind"] == "clash" and len(rest) == 4
    assert worst["count"] == len(worst["surface_pairs"])
    deepest = max(worst["surface_pairs"], key=lambda row: row["depth"])
    for name in ("depth", "point", "faces", "surfaces"):
        assert worst[name] == worst["surface_pairs"][0][name]
    assert worst["depth"] == deepest["depth"] == pytest.approx(1e-3, abs=1e-6)
    rows = [row for pair in (worst, *rest) for row in pair["surface_pairs"]]
    assert sorted(rows, key=repr) == sorted((row.document() for row in found), key=repr), (
        "nothing is lost, nothing listed twice"
    )
    x, y, z = worst["point"]
    assert -1e-9 <= x <= 0.02 + 1e-9 and -1e-9 <= y <= 0.02 + 1e-9 and 0.019 - 1e-9 <= z <= 0.02 + 1e-9


def test_a_row_of_a_fit_has_a_place_and_its_faces_names():
    scene = shaft_in_bore(0.01002)
    (pair,) = document(clash(scene))["pairs"]
    bore, shaft = (face.split(" · ")[1] for face in pair["faces"])
    assert (bore, shaft) == ("bore Ø20", "shaft Ø20.04")
    x, y, z = pair["point"]
    assert np.hypot(x, y) <= 0.0101 and 0.0 <= z <= 0.03


def test_one_pair_that_touches_is_listed_as_its_count_takes_a_line_too():
    cube = m.box(0.02, 0.02, 0.02)
    lines = table(clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.02))}))).splitlines()
    assert len(lines) == 2 and "a – b: touching" in lines[1]


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
    assert text.splitlines()[0] == "1 thread (pairs of parts)"
    assert "thread, " in table(found, surfaces=True).splitlines()[0] and "thread M6: Ø6 in Ø5 mm" in text
    # a hole that no thread is cut into is a clash as before
    assert "clash" in kinds(clash(screwed(0.0055, length)))


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


BORED = m.box(0.04, 0.04, 0.01) - m.cylinder(0.01, 0.01).translated(0.02, 0.02, 0.0)
COARSE = {"deflection": 1e-4, "angular": 0.7}


@pytest.mark.parametrize("overlap", [3e-5, 1.2e-5])
@pytest.mark.parametrize(
    ("solid", "pose"),
    [
        (BORED, lambda dz: at(0.001, 0.002, 0.01 - dz)),
        (m.cylinder(0.015, 0.01), lambda dz: at(0.02, 0.02, 0.01 - dz)),
        (
            m.box(0.01, 0.01, 0.01),
            lambda dz: pin.SE3(pin.rpy.rpyToMatrix(np.pi / 4, 0.0, 0.0), np.array([0.002, 0.004, 0.01 - dz])),
        ),
    ],
    ids=["bored plate", "disc", "edge"],
)
def test_planes_are_exact_whatever_bores_are_cut_into_them(solid, pose, overlap):
    """Planes that overlap by less than the facets of a bore in them sag, 48 µm here, clash all the same."""
    deep = clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(overlap))}, **COARSE))
    assert max(deflections(m.shape(BORED, **COARSE))) > 4e-5
    clashes = [p for p in deep if p.kind == "clash"]
    assert clashes and max(p.depth for p in clashes) == pytest.approx(overlap, abs=1e-8)
    assert kinds(clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(0.0))}, **COARSE))) <= {"contact"}
    meant = clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose(overlap))}, **COARSE), authorised=[("a", "b")])
    assert kinds(meant) <= {"contact", "authorised"}


@pytest.mark.parametrize(
    ("solid", "pose"),
    [
        # a square key whose corners lie on the bore's circle: the bore's chords cut them off
        (
            m.box(0.01 * 2**0.5, 0.01 * 2**0.5, 0.03).translated(-0.01 / 2**0.5, -0.01 / 2**0.5, 0.0),
            pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.3), np.array([0.02, 0.02, -0.01])),
        ),
        # a pin that ends 30 µm below the plate's face: chords of bore and pin overlap in a sliver
        (
            m.cylinder(0.01, 0.00997),
            pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.1), np.array([0.02, 0.02, 0.0])),
        ),
    ],
    ids=["key", "pin"],
)
def test_a_curved_border_still_strays_within_its_plane(solid, pose):
    assert kinds(clash(m.scene({"a": (BORED, AT_HOME), "b": (solid, pose)}, **COARSE))) == {"contact"}


# --- the gap of curved faces is that of their surfaces ----------------------------------------------------------------


def worst(parts, clearance=1e-3, **options):
    """The gravest row of the two parts of a scene."""
    (pair,) = by_parts(clash(m.scene(parts, **options), clearance))
    return pair.worst


def curved(case, gap):
    """Two solids with a gap (m; negative: an overlap) between curved faces, as in the models of strangers."""
    turn = pin.exp3(np.array([0.3, -0.4, 0.5]))
    ball = m.sphere(0.01)
    if case == "balls":
        u = turn[:, 0]
        return {"a": ball, "b": (m.sphere(0.008), at(*(u * (0.018 + gap))))}
    if case == "ball on plane":
        return {"a": m.box(0.04, 0.04, 0.01), "b": (ball, at(0.021, 0.019, 0.02 + gap))}
    if case == "taper":
        plug, socket = m.cone(0.008, 0.012, 0.02), m.cone(0.0075, 0.0125, 0.025).translated(z=-0.0025)
        body = m.box(0.04, 0.04, 0.022).translated(-0.02, -0.02, -0.001) - socket
        return {"body": body, "plug": (plug, at(z=gap / np.sin(np.arctan(0.2))))}
    if case == "countersink":
        plate = m.box(0.04, 0.04, 0.012).translated(-0.02, -0.02, -0.012) - m.cylinder(0.0035, 0.03).translated(z=-0.02)
        plate = plate - m.cone(0.0015, 0.007, 0.0055).translated(z=-0.005)
        screw = m.cone(0.003, 0.0065, 0.0035).translated(z=-0.0035) + m.cylinder(0.003, 0.016).translated(z=-0.016)
        return {"plate": plate, "screw": (screw, at(z=gap * 2**0.5))}
    if case == "shaft off its axis":
        hub = m.box(0.07, 0.07, 0.03).translated(-0.035, -0.035, 0.0) - m.cylinder(0.025, 0.03)
        return {"hub": hub, "shaft": (m.cylinder(0.025 - 8e-5, 0.05), at(8e-5 - gap, 0.0, -0.01))}
    if case == "parallel cylinders":
        return {
            "a": m.cylinder(0.01, 0.03),
            "b": (m.cylinder(0.006, 0.03), at(*((0.016 + gap) * turn[:2, 0] / np.linalg.norm(turn[:2, 0])), 0.0)),
        }
    if case == "ring on a plane":
        return {"a": m.box(0.06, 0.06, 0.01), "b": (m.torus(0.015, 0.004), at(0.03, 0.03, 0.014 + gap))}
    if case == "crossed cylinders":
        lying = m.cylinder(0.006, 0.06).translated(0.0, 0.0, -0.03).rotated([1.0, 0.0, 0.0], 1.1)
        return {"a": m.cylinder(0.01, 0.06).translated(0.0, 0.0, -0.03), "b": (lying, at(0.016 + gap))}
    if case == "ball on the rim of a hole":
        plate = m.box(0.04, 0.04, 0.01).translated(-0.02, -0.02, -0.01) - m.cylinder(0.006, 0.02).translated(z=-0.015)
        return {"plate": plate, "ball": (ball, at(z=((0.01 + gap) ** 2 - 0.006**2) ** 0.5))}
    raise AssertionError(case)


CURVED = (
    "balls", "ball on plane", "taper", "countersink", "shaft off its axis", "parallel cylinders", "ring on a plane",
    "crossed cylinders", "ball on the rim of a hole",
)  # fmt: skip


@pytest.mark.parametrize("deflection", [1e-4, 3e-4])
@pytest.mark.parametrize("gap", [-6e-5, -2.5e-5, 2e-5, 6e-5])
@pytest.mark.parametrize("case", CURVED)
def test_curved_faces_are_judged_by_their_surfaces(case, gap, deflection):
    found = worst(curved(case, gap), deflection=deflection)
    assert found.kind == ("clash" if gap < 0.0 else "clearance")
    assert found.distance - found.depth == pytest.approx(gap, abs=2e-8)
    low, high = found.interval
    assert low - 1e-8 <= gap <= high + 1e-8 and high - low < 2e-8
    assert found.distance <= max(gap, 0.0) + 1e-9, "a clearance is never overstated"
    if gap < 0.0:
        assert "mm deep" in table([found]) and ".." not in table([found])


@pytest.mark.parametrize("case", CURVED)
def test_an_overlap_that_facets_do_not_reach_is_found_without_a_clearance(case):
    assert "clash" in kinds(clash(m.scene(curved(case, -3e-5))))
    assert kinds(clash(m.scene(curved(case, 3e-5)))) <= {"contact"}


def test_parts_that_overlap_sideways_only_touch_end_to_end():
    """Two posts of which one stands on the other, 30 µm inside the other's outline: no material is common."""
    post = m.cylinder(0.006, 0.01)
    beside = {"a": post, "b": (post, at(0.012 - 3e-5, 0.0, 0.01))}
    assert kinds(clash(m.scene(beside), 1e-4)) == {"contact"}
    level = {"a": post, "b": (post, at(0.012 - 3e-5))}
    assert worst(level).depth == pytest.approx(3e-5, abs=1e-9)


def freeform(scene):
    """The same parts, their curved faces without an analytic surface."""
    for part in scene.parts:
        faces = tuple(
            s if s.orientation == "flat" else Surface(s.index, s.name, Freeform(), "free", 0.0, s.area)
            for s in part.surfaces
        )
        measured = part.shape.volume, part.shape.center, part.shape.inertia
        part.shape = Shape(part.shape.mesh, faces, (), measured)
    return scene


@pytest.mark.parametrize("gap", [-1.5e-4, -3e-5, 2e-5, 3e-4])
@pytest.mark.parametrize("case", ["balls", "ball on plane", "ring on a plane", "parallel cylinders"])
def test_freeform_faces_have_bounds_and_no_clearance_is_overstated(case, gap):
    found = clash(freeform(m.scene(curved(case, gap))), 1e-3)
    pair = document(found)["pairs"][0]
    low, high = pair["interval"]
    assert low <= gap <= high and 1e-6 < high - low < 6e-4
    assert pair["distance"] <= max(gap, 0.0)
    if pair["kind"] == "clearance":
        assert ".." in table(found) and table(found).splitlines()[1].count("mm apart") == 1
    elif pair["kind"] == "contact":
        assert "touching within their deflection, from" in table(found, contacts=True)
    assert pair["kind"] != "clash" or gap < 0.0
