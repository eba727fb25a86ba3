"""The fasteners of whole scenes: what screws clamp and thread into, bearings of rings, and real models."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from constraints.recognition.fastener_names import base_name
from constraints.recognition.fasteners import FastenerKind
from vpframe.analysis.fasteners import fastener_rows, fasteners_of, fastenings, table
from vpframe.scene import modelling as m

MM = 1e-3
TRUTH = json.loads((Path(__file__).parent / "fasteners_truth.json").read_text(encoding="utf-8"))
"""file -> what a person read from its names and pictures"""


def up(z):
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, z * MM]))


def screw(length=16):
    """M5 by ISO 4762, head above z = 0."""
    head = m.cylinder(4.36 * MM, 5 * MM) - m.hexagon(4 * MM, 3 * MM).translated(z=2 * MM)
    return head + m.cylinder(2.5 * MM, (length + 1) * MM).translated(z=-length * MM)


def washer():
    return m.cylinder(5 * MM, 1 * MM) - m.cylinder(2.65 * MM, 1 * MM)


def block(height, bore=0.0, deep=None, x=0.0):
    """From z = 0 to height, with a bore from its top."""
    solid = m.box(40 * MM, 40 * MM, height * MM).translated(-20 * MM, -20 * MM)
    deep = height if deep is None else deep
    hole = m.cylinder(bore / 2 * MM, deep * MM).translated(x * MM, 0.0, (height - deep) * MM) if bore else None
    return solid if hole is None else solid - hole


def nut():
    return m.hexagon(8 * MM, 4.7 * MM) - m.cylinder(2.1 * MM, 4.7 * MM)


def what(parts, turn=None):
    """Names of what each screw clamps and threads into, and the engagement in mm."""
    turn = pin.SE3.Identity() if turn is None else turn
    scene = m.scene({name: (solid, turn * place) for name, (solid, place) in parts.items()})
    names = scene.names
    return {
        names[f.part]: ([names[k] for k in f.clamps], [names[k] for k in f.threads_into], round(f.engagement / MM, 3))
        for f in fastenings(scene)
    }


TURNS = [pin.SE3.Identity(), pin.SE3(pin.exp3(np.array([0.7, -1.1, 0.4])), np.array([0.3, -0.2, 0.1]))]


@pytest.mark.parametrize("turn", TURNS, ids=["upright", "turned"])
def test_a_screw_through_a_plate_into_a_tapped_hole(turn):
    parts = {
        "screw": (screw(), up(1)),
        "washer": (washer(), up(0)),
        "plate": (block(5, 5.5), up(-5)),
        "base": (block(20, 4.2, 15), up(-25)),
        "beside": (block(3), pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.0]))),
    }
    assert what(parts, turn) == {"screw": (["washer", "plate"], ["base"], 10.0)}


def test_a_nut_holds_and_what_is_behind_it_is_not_clamped():
    parts = {
        "screw": (screw(25), up(0)),
        "plate": (block(5, 5.5), up(-5)),
        "second": (block(5, 5.0), up(-10)),
        "nut": (nut(), up(-14.7)),
        "behind": (block(5, 5.5), up(-20)),
    }
    assert what(parts) == {"screw": (["plate", "second"], ["nut"], 4.7)}


def test_a_screw_in_a_slot_clamps_it():
    slot = m.cylinder(2.75 * MM, 5 * MM).translated(x=-3 * MM) + m.cylinder(2.75 * MM, 5 * MM).translated(x=3 * MM)
    slot += m.box(6 * MM, 5.5 * MM, 5 * MM).translated(-3 * MM, -2.75 * MM)
    parts = {"screw": (screw(), up(0)), "plate": (block(5) - slot, up(-5)), "base": (block(20, 4.2), up(-25))}
    assert what(parts) == {"screw": (["plate"], ["base"], 11.0)}


def test_a_screw_between_two_holes_goes_through_neither():
    holes = m.cylinder(2.75 * MM, 5 * MM).translated(x=-8 * MM) + m.cylinder(2.75 * MM, 5 * MM).translated(x=8 * MM)
    frame = block(5) - m.box(6 * MM, 6 * MM, 5 * MM).translated(-3 * MM, -3 * MM) - holes
    assert what({"screw": (screw(), up(0)), "frame": (frame, up(-5))}) == {"screw": ([], [], 0.0)}


def test_a_screw_drawn_into_a_solid_threads_into_it():
    parts = {"screw": (screw(), up(0)), "plate": (block(5, 5.5), up(-5)), "base": (block(20), up(-25))}
    assert what(parts) == {"screw": (["plate"], ["base"], 11.0)}


def test_a_pilot_hole_may_be_off_the_axis():
    parts = {"screw": (screw(), up(0)), "base": (block(20, 4.2, 20, x=0.4), up(-20))}
    assert what(parts) == {"screw": ([], ["base"], 16.0)}


def test_an_insert_holds_and_its_carrier_does_not():
    insert = m.cylinder(3.5 * MM, 6 * MM) - m.cylinder(2.1 * MM, 6 * MM)
    parts = {
        "screw": (screw(), up(0)),
        "plate": (block(5, 5.5), up(-5)),
        "M5 heatset": (insert, up(-11)),
        "carrier": (block(20, 7.0, 6), up(-25)),
    }
    parts["carrier"] = (parts["carrier"][0] - m.cylinder(3 * MM, 20 * MM), up(-25))
    assert what(parts) == {"screw": (["plate"], ["M5 heatset"], 6.0)}


def test_rings_and_balls_are_one_bearing():
    ball = m.sphere(1.5 * MM)
    ring = m.cylinder(10 * MM, 5 * MM) - m.cylinder(8 * MM, 5 * MM)
    inner = m.cylinder(5 * MM, 5 * MM) - m.cylinder(4 * MM, 5 * MM)
    places = [pin.SE3(np.eye(3), MM * np.array([6.5 * math.cos(a), 6.5 * math.sin(a), 2.5])) for a in range(5)]
    parts = {"b/Outer_Ring": (ring, up(0)), "b/InnerRace": (inner, up(0))}
    parts |= {f"b/Ball_{k}": (ball, place) for k, place in enumerate(places)}
    parts |= {"Ball_7": (ball, up(90)), "b/Ball_8": (ball, up(90))}
    found = fasteners_of(m.scene(parts))
    assert sorted(found) == list(range(7)), "balls elsewhere are of no bearing"
    for one in found.values():
        assert (one.kind, one.diameter) == (FastenerKind.BEARING, pytest.approx(8 * MM, rel=0.02))


def test_instances_of_one_pattern_are_one_row():
    solid, plate, base = screw(), block(5), block(20)
    places = [pin.SE3(np.eye(3), MM * np.array([x, y, 0.0])) for x in (-10, 10) for y in (-10, 10)]
    for place in places:
        plate -= m.cylinder(2.75 * MM, 5 * MM).moved(place)
        base -= m.cylinder(2.1 * MM, 20 * MM).moved(place)
    parts = {f"M5x16_{k}": (solid, place) for k, place in enumerate(places)}
    scene = m.scene({**parts, "plate": (plate, up(-5)), "base": (base, up(-25))})
    (row,) = fastener_rows(scene)
    assert str(row) == (
        "4 × M5x16 screw · ISO 4762 · hexagon socket 4 mm · clamps plate · threads into base, 11 mm deep"
    )
    assert table([row]).splitlines()[0] == "4 fasteners"
    document = json.loads(json.dumps(row.document()))
    assert document["count"] == 4 and document["clamps"] == ["plate"] and document["threads_into"] == ["base"]
    assert document["engagement"] == pytest.approx([11 * MM, 11 * MM])


def test_a_scene_without_fasteners_has_no_table():
    assert table(fastener_rows(m.scene({"block": block(5)}))) == ""


@pytest.mark.skipif("VPFRAME_DATA" not in os.environ, reason="VPFRAME_DATA names no folder of real models")
@pytest.mark.parametrize("file", TRUTH)
def test_real_models(file):
    scene = vp.load(Path(os.environ["VPFRAME_DATA"]) / file)
    found = fasteners_of(scene)
    told = Counter((base_name(scene.names[i]), str(one.kind), one.size) for i, one in found.items())
    assert told == {(name, kind, size): n for name, kind, size, n in TRUTH[file]["fasteners"]}
    joined = {
        (base_name(row.parts[0]), *row.clamps, "->", *row.threads_into): len(row.parts)
        for row in fastener_rows(scene)
        if row.fastener.kind in FastenerKind and (row.clamps or row.threads_into)
    }
    for name, clamps, into, n in TRUTH[file].get("joined", ()):
        assert joined.get((name, *clamps, "->", *into)) == n, (name, joined)
