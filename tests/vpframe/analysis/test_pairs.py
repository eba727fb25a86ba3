"""Rows of surface pairs, grouped by pair of parts."""

from dataclasses import replace

import pytest

from constraints.geometry.surfaces import Freeform
from tests.vpframe.fitted import AT_HOME, at, heap
from vpframe.analysis.clash import clash, document, table
from vpframe.analysis.fits import ClashReason
from vpframe.analysis.pairs import ClashRow
from vpframe.scene import modelling as m
from vpframe.scene.scene import Surface


def test_the_table_puts_the_deepest_first_and_tells_no_length_of_zero():
    def row(kind, depth=0.0, distance=0.0, b="b"):
        faces = tuple(Surface(i, "", Freeform(), "free", 0.0, 1.0) for i in (0, 1))
        gap = (distance - depth,) * 2
        return ClashRow(kind, ("a", b), (0, 1), faces, distance, depth, gap, (0.0, 0.0, 0.0), ClashReason.NONE, "")

    within = replace(row("contact", 2e-5, b="c"), interval=(-6e-5, 2e-5))
    pairs = [row("contact", 1e-15), within, row("clash", 1e-4), row("clash", 3e-3, b="d")]
    lines = table([*pairs, row("clearance", distance=2e-4)], surfaces=True).splitlines()
    assert lines[0] == "2 clashes, 2 contacts, 1 clearance"
    assert [line.split()[3].rstrip(":") for line in lines[1:4]] == ["d", "b", "c"]
    assert lines[3].endswith("touching within their deflection, from 0.060 mm deep to 0.020 mm apart")
    assert lines[4].endswith("touching") and lines[5].endswith("0.200 mm apart")
    assert "0.000" not in "\n".join(lines)


def test_clashes_are_listed_by_pair_of_parts_and_contacts_counted_at_the_end():
    found = clash(heap())
    lines = table(found).splitlines()
    assert lines[0] == "1 clash, 4 contacts (pairs of parts)"
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


def test_one_pair_that_touches_is_listed_as_its_count_takes_a_line_too():
    cube = m.box(0.02, 0.02, 0.02)
    lines = table(clash(m.scene({"a": (cube, AT_HOME), "b": (cube, at(x=0.02))}))).splitlines()
    assert len(lines) == 2 and "a – b: touching" in lines[1]
