"""What parts are as fasteners, from their geometry and their names."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import constraints.recognition.fastener_sizes as table
from constraints.recognition.fastener_names import base_name, name_hint, name_words
from constraints.recognition.fasteners import SCREWS, FastenerKind, fastener
from vpframe.scene import modelling as m

MM = 1e-3
LENGTHS = (6, 8, 10, 12, 16, 20, 25, 30, 40)
"""mm"""


def told(solid, name=""):
    shape = m.shape(solid)
    return fastener(shape.mesh, shape.features, name_words(name))


def of(form, standard):
    return [row for row in table.sizes()[form] if row.standard == standard and row.name.startswith("M")]


def shank(diameter, length):
    """From z = 0 down, with a chamfer at its tip."""
    tip, r, top = 0.1 * diameter, 0.5 * diameter, 0.01 * diameter
    return m.revolve([(0, top), (r, top), (r, tip - length), (r - tip, -length), (0, -length)])


def cap_screw(row, length, drawn=0.0):
    """ISO 4762: head above z = 0."""
    head = m.cylinder(row.a / 2, row.b) - m.hexagon(row.c, 0.5 * row.b).translated(z=0.5 * row.b)
    return head + shank(drawn or row.diameter, length)


def hexagon_screw(row, length, drawn=0.0):
    return m.hexagon(row.a, row.b) + shank(drawn or row.diameter, length)


def button_screw(row, length, drawn=0.0):
    """ISO 7380-1: a dome of chords is enough."""
    steps = np.linspace(0.0, 1.0, 9)
    dome = [(row.a / 2 * math.sqrt(1.0 - (0.85 * t) ** 2), row.b * t) for t in steps]
    head = m.revolve([(0, 0), *dome, (0, row.b)]) - m.hexagon(row.c, row.b).translated(z=0.5 * row.b)
    return head + shank(drawn or row.diameter, length)


def countersunk_screw(row, length, drawn=0.0):
    """ISO 10642: top at z = 0."""
    k = (row.a - row.diameter) / 2
    head = m.revolve([(0, 0), (row.a / 2, 0), (row.diameter / 2, -k), (0, -k)])
    below = m.box(1.0, 1.0, 1.0).translated(-0.5, -0.5, -1.0)
    return (head + (shank(drawn or row.diameter, length) & below)) - m.hexagon(row.c, k).translated(z=-0.6 * k)


def set_screw(row, length, drawn=0.0):
    return shank(drawn or row.diameter, length) - m.hexagon(row.a, 0.4 * length).translated(z=-0.4 * length)


def nut(row):
    return m.hexagon(row.a, row.b) - m.cylinder((row.diameter - 1.0825 * row.pitch) / 2, row.b)


def ring(inner, outer, height):
    return m.cylinder(outer / 2, height) - m.cylinder(inner / 2, height)


CASES = {
    "ISO 4762": (cap_screw, of("cylinder", "ISO 4762"), "hexagon socket"),
    "ISO 4017": (hexagon_screw, of("hexagon", "ISO 4017"), "hexagon"),
    "ISO 7380-1": (button_screw, of("dome", "ISO 7380-1"), "hexagon socket"),
    "ISO 10642": (countersunk_screw, of("countersunk", "ISO 10642"), "hexagon socket"),
}


@pytest.mark.parametrize("standard", CASES)
@given(data=st.data())
@settings(max_examples=8, deadline=None)
def test_screws_of_every_size_length_and_place(standard, data):
    build, rows, drive = CASES[standard]
    row = data.draw(st.sampled_from(rows))
    length = MM * data.draw(st.sampled_from([x for x in LENGTHS if x * MM > 1.2 * row.diameter] or [80]))
    root = data.draw(st.booleans())
    turn = np.array(data.draw(st.tuples(*[st.floats(-3, 3)] * 3)))
    place = pin.SE3(pin.exp3(turn), np.array(data.draw(st.tuples(*[st.floats(-0.2, 0.2)] * 3))))
    one = told(build(row, length, row.diameter - 1.0825 * row.pitch if root else row.diameter).moved(place))
    assert (one.kind, one.thread, one.diameter) == (FastenerKind.SCREW, row.name, row.diameter)
    assert one.size == f"{row.name}x{length / MM:g}" and one.pitch == row.pitch
    assert one.length == pytest.approx(length, abs=1e-6)
    assert one.axis == pytest.approx(place.rotation @ [0, 0, -1], abs=1e-6)
    assert one.origin == pytest.approx(place.translation, abs=1e-5)
    assert one.drive.startswith(drive) and one.confidence >= 0.9


def test_a_socket_head_names_its_standard_and_drive():
    row = next(r for r in of("cylinder", "ISO 4762") if r.name == "M5")
    one = told(cap_screw(row, 16 * MM))
    assert (one.standard, one.drive) == ("ISO 4762", "hexagon socket 4 mm")
    assert "cylinder head" in one.evidence and "ISO 4762" in one.evidence


@pytest.mark.parametrize("row", of("set screw", "ISO 4026"), ids=lambda row: row.name)
def test_set_screws(row):
    one = told(set_screw(row, 2.5 * row.diameter))
    assert (one.kind, one.thread) == (FastenerKind.SET_SCREW, row.name)
    assert one.axis == pytest.approx([0, 0, -1]) and one.outside == pytest.approx(row.diameter / 2)


@pytest.mark.parametrize("row", of("hexagon nut", "ISO 4032"), ids=lambda row: row.name)
def test_nuts(row):
    one = told(nut(row))
    assert (one.kind, one.size, one.standard) == (FastenerKind.NUT, row.name, "ISO 4032")


@pytest.mark.parametrize("row", of("washer", "ISO 7089"), ids=lambda row: row.name)
def test_washers(row):
    one = told(ring(row.a, row.b, row.c))
    assert (one.kind, one.diameter) == (FastenerKind.WASHER, row.diameter)


@pytest.mark.parametrize(
    ("solid", "why"),
    [
        (m.cylinder(3 * MM, 20 * MM), "a plain cylinder may be anything"),
        (m.cylinder(3 * MM, 20 * MM).chamfered(0.5 * MM), "with chamfers, too"),
        (ring(6 * MM, 20 * MM, 5 * MM), "a ring of no standard"),
        (m.box(40 * MM, 30 * MM, 3 * MM) - m.cylinder(3 * MM, 9 * MM).translated(20 * MM, 15 * MM), "a plate"),
        (m.cylinder(10 * MM, 4 * MM) + m.cylinder(4 * MM, 30 * MM), "a flanged pin"),
        (m.cylinder(4 * MM, 5 * MM) + m.cylinder(2.5 * MM, 20 * MM) + m.cylinder(1.5 * MM, 30 * MM), "a stepped shaft"),
        (m.hexagon(10 * MM, 20 * MM), "a hexagonal bar"),
        (m.hexagon(30 * MM, 5 * MM) - m.cylinder(2 * MM, 5 * MM), "a hexagonal plate with a hole"),
        (m.box(10 * MM, 6 * MM, 6 * MM), "a block"),
        (m.sphere(3 * MM), "a ball"),
        (m.cylinder(10 * MM, 20 * MM) - m.hexagon(6 * MM, 10 * MM), "a shaft with a hexagonal hole"),
        (
            m.box(30 * MM, 10 * MM, 5 * MM).translated(-15 * MM, -5 * MM) + m.cylinder(3 * MM, 25 * MM),
            "a lever with a pin",
        ),
    ],
    ids=lambda x: x.replace(" ", "_") if isinstance(x, str) else "",
)
def test_other_parts_are_none(solid, why):
    assert told(solid) is None, why


NAMED = [
    (m.cylinder(3 * MM, 20 * MM), "Pin 6x20", FastenerKind.DOWEL, "Ø6x20"),
    (m.cylinder(3 * MM, 20 * MM), "Zylinderstift ISO 2338 6x20", FastenerKind.DOWEL, "Ø6x20"),
    (m.cylinder(3 * MM, 3 * MM), "Magnet 6x3:2", FastenerKind.MAGNET, "Ø6"),
    (m.box(10 * MM, 5 * MM, 2 * MM), "magnet_10x5x2", FastenerKind.MAGNET, ""),
    (ring(5 * MM, 7 * MM, 8 * MM), "5x7x8 Sleeve Bearing (1):2", FastenerKind.BUSHING, "Ø5"),
    (ring(5 * MM, 8 * MM, 0.5 * MM), "Shim 0.5mm:10", FastenerKind.WASHER, "Ø5"),
    (ring(8 * MM, 22 * MM, 7 * MM), "608ZZ", FastenerKind.BEARING, "Ø8"),
    (ring(2.9 * MM, 5 * MM, 4 * MM), "M3x5x4 heatset", FastenerKind.INSERT, "M3"),
    (ring(2.5 * MM, 5 * MM, 30 * MM), "M3xD5x30 threaded round standoff:2", FastenerKind.NUT, "M3"),
    (ring(7.8 * MM, 16 * MM, 6 * MM), "shaft seal", FastenerKind.SEAL, "Ø7.8"),
    (m.cylinder(3 * MM, 100 * MM), "Gewindestange M6", FastenerKind.THREADED_ROD, "M6x100"),
    (m.box(6 * MM, 20 * MM, 6 * MM), "Passfeder 6x6x20", FastenerKind.KEY, "Ø6"),
    (m.box(50 * MM, 6 * MM, 1.5 * MM), "GT2 belt", FastenerKind.BELT, ""),
    (m.box(50 * MM, 3 * MM, 1 * MM), "zip tie 100mm", FastenerKind.TIE, ""),
]


@pytest.mark.parametrize(("solid", "name", "kind", "size"), NAMED, ids=[row[1] for row in NAMED])
def test_names_decide_where_geometry_does_not(solid, name, kind, size):
    one = told(solid, name)
    assert (one.kind, one.size) == (kind, size)
    assert name_hint(name_words(name)).text in one.evidence


@pytest.mark.parametrize(
    "name", ["Bearing Holder", "DX124_SCREW-COVER", "magnet_mount", "belt clamp", "bolt plate", "GT2 20T pulley"]
)
def test_parts_made_for_fasteners_are_none(name):
    assert told(m.box(20 * MM, 15 * MM, 8 * MM) - m.cylinder(3 * MM, 8 * MM).translated(10 * MM, 7 * MM), name) is None


def test_a_name_does_not_make_a_screw_of_a_plate():
    assert told(m.box(40 * MM, 30 * MM, 3 * MM), "M3x8 screw") is None


def test_a_name_decides_between_sizes():
    row = next(r for r in of("cylinder", "ISO 4762") if r.name == "M3")
    solid = m.cylinder(2.9 * MM, 2.8 * MM) + shank(2.75 * MM, 8 * MM)  # drawn as nothing in particular
    assert told(solid) is None
    assert told(solid, "M3x8 SHCS v2:18").size == "M3x8" and told(cap_screw(row, 8 * MM)).size == "M3x8"


def test_an_o_ring_is_a_whole_torus_of_a_standard_size():
    row = table.sizes()["seal"][10]
    one = told(m.torus((row.diameter + row.a) / 2, row.a / 2))
    assert (one.kind, one.standard) == (FastenerKind.SEAL, "ISO 3601")
    assert one.diameter == pytest.approx(row.diameter)
    assert told(m.torus(20 * MM, 7 * MM)) is None, "a thick ring"


def test_a_toothed_wheel_is_no_nut():
    wheel = m.cylinder(8 * MM, 6 * MM)
    for k in range(12):
        gap = m.box(2 * MM, 2 * MM, 6 * MM).translated(7 * MM, -1 * MM).rotated((0, 0, 1), k * math.pi / 6)
        wheel -= gap
    assert told(wheel - m.cylinder(5 * MM, 6 * MM)) is None


def test_a_parallel_key_has_round_ends():
    ends = m.cylinder(3 * MM, 6 * MM) + m.cylinder(3 * MM, 6 * MM).translated(x=14 * MM)
    one = told(ends + m.box(14 * MM, 6 * MM, 6 * MM).translated(y=-3 * MM))
    assert (one.kind, one.diameter, one.standard) == (FastenerKind.KEY, pytest.approx(6 * MM), "DIN 6885")
    assert one.length == pytest.approx(20 * MM)


@pytest.mark.parametrize(
    ("sunk", "words"),
    [
        (m.hexagon(2.5 * MM, 1.5 * MM), "hexagon socket 2.5 mm"),
        (m.box(8 * MM, 0.8 * MM, 1.5 * MM).translated(-4 * MM, -0.4 * MM), "slot"),
        (m.box(2 * MM, 2 * MM, 1.5 * MM).translated(-1 * MM, -1 * MM), "square socket"),
        (
            m.box(4 * MM, 0.8 * MM, 1.5 * MM).translated(-2 * MM, -0.4 * MM)
            + m.box(0.8 * MM, 4 * MM, 1.5 * MM).translated(-0.4 * MM, -2 * MM),
            "cross",
        ),
    ],
    ids=["hexagon", "slot", "square", "cross"],
)
def test_drives(sunk, words):
    solid = m.cylinder(2.75 * MM, 3 * MM) + shank(3 * MM, 10 * MM)
    assert told(solid - sunk.translated(z=1.5 * MM)).drive == words


def test_a_hexalobular_socket_names_its_size():
    star = m.cylinder(1.1 * MM, 1.2 * MM)
    for k in range(6):
        angle = k * math.pi / 3
        star += m.cylinder(0.35 * MM, 1.2 * MM).translated(1.05 * MM * math.cos(angle), 1.05 * MM * math.sin(angle))
    solid = m.cylinder(2.8 * MM, 2.4 * MM) + shank(3 * MM, 10 * MM)
    assert told(solid - star.translated(z=1.2 * MM)).drive == "Torx T10"


NAMES = [
    ("M3x8 BHCS v2:18", "screw", 3, (3, 8), "dome"),
    ("M2x10 self tapping:3", "self-tapping screw", 2, (2, 10), ""),
    ("SHCS", "screw", 0, (), "cylinder"),
    ("FHS_M2_5X10:4", "screw", 2.5, (2.5, 10), "countersunk"),
    ("BTS2_M2_6X8", "self-tapping screw", 2.6, (2.6, 8), "dome"),
    ("PHS_1_7X20_5_DC10", "screw", 0, (1.7, 20.5), "dome"),
    ("5x20 sex-bolt", "nut", 0, (5, 20), ""),
    ("M3x5x4 heatset", "threaded insert", 3, (3, 5, 4), ""),
    ("DIN 912 M5x16", "screw", 5, (5, 16), "cylinder"),
    ("ISO 7380-1 - M3 x 8", "screw", 3, (3, 8), "dome"),
    ("Linsenschraube", "screw", 0, (), "dome"),
    ("Sechskantmutter M6", "nut", 6, (), ""),
    ("Magnet 6x3", "magnet", 0, (6, 3), ""),
    ("F695 flanged bearing:5", "bearing", 0, (), ""),
    ("608-2RS", "bearing", 0, (), ""),
    ("GT2 belt", "belt", 0, (), ""),
    ("o-ring", "seal", 0, (), ""),
    ("spring washer M3", "washer", 3, (), ""),
    ("Di=5mm L0=5mm compression spring:2", "spring", 0, (), ""),
    ("D5x40 smooth pin:1", "dowel", 0, (5, 40), ""),
    ("M4x2.5 set screw:3", "set screw", 4, (4, 2.5), ""),
    ("M6x20-Screw001_1", "screw", 6, (6, 20), ""),
    ("hardware/bolts/SocketHeadCapScrew", "screw", 0, (), "cylinder"),
    ("91292A113_18-8", "", 0, (), ""),
    ("rod-assembly_1/plate_1", "", 0, (), ""),
    ("DX124_SCREW-COVER:1", "", 0, (), ""),
    ("magnet mount", "", 0, (), ""),
]


@pytest.mark.parametrize(("name", "kind", "diameter", "sizes", "head"), NAMES, ids=[row[0] for row in NAMES])
def test_what_names_say(name, kind, diameter, sizes, head):
    hint = name_hint(name_words(name))
    assert (hint.kind, hint.head) == (kind, head)
    assert hint.diameter == pytest.approx(diameter * MM)
    assert hint.sizes == pytest.approx(tuple(x * MM for x in sizes))


def test_base_names_have_no_instances():
    assert [base_name(x) for x in ("a/M3x8 BHCS v2:18", "_M3x8 SHCS:9", "pin (1) (1):2", ":3")] == [
        "M3x8 BHCS", "M3x8 SHCS", "pin", ":3",
    ]  # fmt: skip


def test_kinds_with_an_outside_thread():
    assert FastenerKind.SCREW in SCREWS and FastenerKind.NUT not in SCREWS


def numbers(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8-sig") as file:
        return [{key.strip(): value for key, value in row.items() if key} for row in csv.DictReader(file)]


@pytest.mark.parametrize(
    ("file", "column", "form", "standard", "keys"),
    [
        ("socket_head_cap_parameters.csv", "iso4762", "cylinder", "ISO 4762", ("dk", "k", "s")),
        ("button_head_parameters.csv", "iso7380_1", "dome", "ISO 7380-1", ("dk", "k", "s")),
        ("hex_head_parameters.csv", "iso4017", "hexagon", "ISO 4017", ("s", "k")),
        ("countersunk_head_parameters.csv", "iso10642", "countersunk", "ISO 10642", ("dk", "k", "s")),
        ("hex_nut_parameters.csv", "iso4032", "hexagon nut", "ISO 4032", ("s", "m")),
        ("plain_washer_parameters.csv", "iso7089", "washer", "ISO 7089", ("d1", "d2", "h")),
    ],
)
def test_the_table_agrees_with_bd_warehouse(file, column, form, standard, keys):
    package = pytest.importorskip("bd_warehouse")
    ours = {row.name: (row.a, row.b, row.c) for row in table.sizes()[form] if row.standard == standard}
    checked = 0
    for row in numbers(Path(package.__file__).parent / "data" / file):
        size = next(iter(row.values()))
        if row.get(f"{column}:{keys[0]}"):
            given = [float(row[f"{column}:{key}"]) * MM for key in keys]
            assert ours[size.split("-")[0]][: len(keys)] == pytest.approx(given, abs=1e-6), size
            checked += 1
    assert checked == len(ours)


def subclasses(kind):
    for one in kind.__subclasses__():
        yield one
        yield from subclasses(one)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_all_metric_fasteners_of_bd_warehouse():
    fasteners = pytest.importorskip("bd_warehouse.fastener")
    wrong, count = [], 0
    for kind in (*subclasses(fasteners.Screw), *subclasses(fasteners.Nut), *subclasses(fasteners.Washer)):
        for series in sorted(kind.types()):
            for size in (size for size in kind.sizes(series) if size.startswith("M")):
                given = {"size": size, "fastener_type": series}
                if issubclass(kind, fasteners.Screw):
                    data = fasteners.isolate_fastener_type(series, kind.fastener_data)[size]
                    given["length"] = round(float(data["short"]) + 0.1 * (float(data["long"]) - float(data["short"])))
                one = told(m.Solid(kind(**given).wrapped))
                count += 1
                right = one is not None and one.diameter == pytest.approx(float(size[1:].split("-")[0]) * MM)
                if not right or one.length != pytest.approx(given.get("length", one.length / MM) * MM, abs=2e-5):
                    wrong.append((kind.__name__, series, size, one and one.size))
    assert count > 500 and len(wrong) <= 0.01 * count, wrong
