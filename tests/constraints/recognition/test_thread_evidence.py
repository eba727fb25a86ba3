"""What tells a screw in its tapped hole from a dowel in a bore that is too small."""

import pytest

from constraints.geometry.metric_threads import PITCHES
from constraints.geometry.surfaces import Cylinder
from constraints.recognition.thread_evidence import drawn_thread
from tests.constraints.shapes import turned
from vpframe.scene import modelling as m
from vpframe.scene.names import thread_words


def place(features, radius, sense):
    """Of the cylinder of a radius among features."""
    found = [
        i for i, f in enumerate(features)
        if isinstance(f.geometry, Cylinder) and f.sense == sense and abs(f.geometry.radius - radius) < 1e-9
    ]  # fmt: skip
    return found[0]


def told(screw, hole, d, bore, words=()):
    """The evidence for a thread between solids of `modelling`, empty without one."""
    one, other = m.shape(screw).features, m.shape(hole).features
    thread = drawn_thread(one, place(one, d / 2, 1), other, place(other, bore / 2, -1), words)
    return "" if thread is None else f"{thread.size.name}: {thread.evidence}"


def plate(bore):
    return m.box(0.06, 0.06, 0.02).translated(-0.03, -0.03) - m.cylinder(bore / 2, 0.02)


def dowel(d):
    return m.cylinder(d / 2, 3.0 * d)


@pytest.mark.parametrize(("d", "pitch"), [(3e-3, 5e-4), (6e-3, 1e-3), (10e-3, 1.5e-3), (16e-3, 2e-3)])
def test_each_evidence_tells_a_coarse_thread(d, pitch):
    bore, name = d - pitch, f"M{1e3 * d:g}"
    shank, flat = dowel(d), plate(bore)
    head = m.hexagon(1.6 * d, 0.65 * d).translated(z=3.0 * d)
    cap = m.cylinder(0.8 * d, d).translated(z=3.0 * d)
    socket = m.hexagon(0.8 * d, 0.6 * d).translated(z=3.4 * d)
    countersunk = m.cone(0.5 * d, d, 0.5 * d).translated(z=3.0 * d)
    assert told(shank, flat, d, bore) == ""
    assert told(shank + head, flat, d, bore) == f"{name}: hexagon head"
    assert told(shank + cap, flat, d, bore) == f"{name}: head Ø{1.6e3 * d:.4g} mm"
    assert told(shank + countersunk, flat, d, bore).startswith(f"{name}: countersunk head")
    assert told(shank - socket.translated(z=-1.0 * d), flat, d, bore) == f"{name}: hexagon socket"
    assert told(shank, m.hexagon(1.7 * d, 0.8 * d) - m.cylinder(bore / 2, 0.8 * d), d, bore) == f"{name}: hexagon nut"
    sunk = flat - m.cone(bore / 2, 0.6 * d, 0.6 * d - bore / 2).translated(z=0.02 - 0.6 * d + bore / 2)
    assert told(shank, sunk, d, bore) == f"{name}: countersink Ø{1.2e3 * d:.4g} mm"
    bored = flat - m.cylinder(0.9 * d, 0.005).translated(z=0.015)
    assert told(shank, bored, d, bore) == f"{name}: counterbore Ø{1.8e3 * d:.4g} mm"
    for words in (("screw",), ("nut",), (name,)):
        assert told(shank, flat, d, bore, words) == f'{name}: name "{words[0]}"'


def test_what_is_no_evidence():
    """A chamfer narrower than the screw, a housing, a long shoulder, a square, another size's name."""
    d, bore = 10e-3, 8.5e-3
    shank, flat = dowel(d), plate(bore)
    chamfer = flat - m.cone(bore / 2, 4.75e-3, 0.5e-3).translated(z=0.0195)
    assert told(shank, chamfer, d, bore) == ""
    assert told(shank + m.cylinder(0.007, 0.04).translated(z=0.03), flat, d, bore) == ""
    assert told(shank + m.box(0.06, 0.06, 0.01).translated(-0.03, -0.03, 0.03), flat, d, bore) == ""
    assert told(shank, m.box(0.016, 0.016, 0.01).translated(-0.008, -0.008) - m.cylinder(bore / 2, 0.01), d, bore) == ""
    assert told(shank, flat, d, bore, ("M8", "screw")) == ""


def test_a_fine_pitch_takes_a_name_that_states_it():
    """Ø10 in Ø9 is M10×1 by its diameters: a dowel, whatever its head, unless it is named."""
    d, bore = 10e-3, 9e-3
    head = m.hexagon(0.016, 0.007).translated(z=0.03)
    assert told(dowel(d) + head, plate(bore), d, bore, ("screw",)) == ""
    assert told(dowel(d), plate(bore), d, bore, ("M10×1",)) == 'M10×1: name "M10×1"'
    assert told(dowel(d), plate(bore), d, bore, ("M10",)) == ""


def test_every_coarse_size_is_told_by_its_nut():
    for nominal, pitches in PITCHES.items():
        d, bore = 1e-3 * nominal, 1e-3 * (nominal - pitches[0])
        shank = turned([(0, 0), (d / 2, 0), (d / 2, d), (0, d)])
        hole = turned([(bore / 2, 0), (2 * d, 0), (2 * d, d), (bore / 2, d)])
        assert drawn_thread(shank.features, 1, hole.features, 3, ()) is None
        assert drawn_thread(shank.features, 1, hole.features, 3, ("nut",)).size.coarse


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("screw_15878", ("screw",)), ("top/M6x20-Screw001_1", ("M6", "screw")), ("HexNut", ("nut",)),
        ("ISO 4762 M8x1", ("M8×1",)), ("M10x1.5 bolts", ("M10", "bolts")), ("bolt/plate", ()), ("screwdriver", ()),
        ("PAM6x", ()), ("minute hand", ()), ("Zylinderschraube M5", ("M5", "zylinderschraube")), ("M3", ("M3",)),
        ("pin", ()), ("MG996R", ()), ("CAP_SCREW", ("screw",)), ("M2.5x10", ("M2.5",)),
    ],
)  # fmt: skip
def test_words_of_names(name, words):
    assert thread_words(name) == words
