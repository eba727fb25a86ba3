"""`clash`, sessions, reports and plans call a pin in its bore the same: clearance, contact, press fit or clash."""

import json
from itertools import cycle

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from constraints.geometry.round_fit import press_fit_words, round_fit
from constraints.recognition.iso286 import greatest_interference
from vpframe.analysis.clash import clash
from vpframe.errors import TaskError
from vpframe.planning.plan import disassembly, removal
from vpframe.scene import modelling as m

LINEAR = vp.Tolerance().linear
DIAMETERS = (2e-3, 5e-3, 10e-3, 17.5e-3, 40e-3, 80e-3, 125e-3, 200e-3)
CLEARANCES = (-5e-4, -2.4e-4, -1e-4, -5e-5, -2.5e-5, -1.5e-5, -1.2e-5, -8e-6, 0.0, 5e-6, 2e-5, 1e-4, 2.5e-4)
OFFSETS = (0.0, 0.0, 4e-6, 2.7e-5)
TURNS = (0.0, 0.123)
NEAR = 1e-7
"""m: cases nearer than this to a limit are moved off it"""


def cases() -> list[tuple[float, float, float, float]]:
    """Diameter, radial clearance, offset of the axes, turn about the axis: 64 of them, some at the limit of s7."""
    offsets, turns = cycle(OFFSETS), cycle(TURNS)
    out = []
    for k, d in enumerate(DIAMETERS):
        most = 0.5 * greatest_interference("s7", d)
        own = [CLEARANCES[(5 * k + 2 * n) % len(CLEARANCES)] for n in range(6)]
        for clearance in (*own, -most + NEAR, -most - NEAR):
            at_limit = abs(clearance) not in map(abs, CLEARANCES)
            out.append((d, clearance, 0.0 if at_limit else next(offsets), next(turns)))
    return out


def scene(d: float, clearance: float, offset: float, turn: float, inside: bool) -> vp.Scene:
    """A pin through the bore of a plate that is fixed; or above it, on its axis."""
    length, width = max(d, 0.01), 2.0 * d + 0.02
    plate = m.box(width, width, length).translated(-0.5 * width, -0.5 * width, 0.0) - m.cylinder(0.5 * d, length)
    pose = pin.SE3(pin.exp3(np.array([0.0, 0.0, turn])), np.array([offset, 0.0, -0.25 * length]))
    if not inside:
        pose = pin.SE3(pose.rotation, np.array([0.0, 0.0, 1.2 * length]))
    out = m.scene({"plate": plate, "pin": (m.cylinder(0.5 * d - clearance, 1.5 * length), pose)})
    out["plate"].fixed = True
    return out


def truth(d: float, clearance: float, offset: float) -> str:
    """Kind by the closed form."""
    gap = clearance - offset
    if gap >= -LINEAR:
        return "contact" if gap <= LINEAR else "clearance"
    most = 0.5 * greatest_interference("s7", d)
    return "press fit" if -clearance <= most and offset <= LINEAR else "clash"


@pytest.mark.parametrize(("d", "clearance", "offset", "turn"), cases())
def test_clash_session_report_and_plan_agree(d, clearance, offset, turn, tmp_path):
    kind = truth(d, clearance, offset)
    words = press_fit_words(-clearance)

    drawn = scene(d, clearance, offset, turn, True)
    rows = clash(drawn, clearance=1e-3)
    gravest = rows[0].kind if len(rows) == 1 else vp_gravest(rows)
    assert gravest == kind, "clash"
    assert any(words in row.why for row in rows) == (kind == "press fit")

    way = removal(drawn, "pin", motion="straight")
    assert (way.verdict == "removable") == (kind != "clash"), "disassemble"
    assert bool(way.overlaps) == (kind == "clash")
    assert [str(fit) for fit in way.press_fits] == [f"plate – pin: {words}"] * (kind == "press fit")

    as_drawn = vp.Session(drawn)
    as_drawn.step()
    assert holds(as_drawn) == (kind != "clash"), "expect_no_clash of the drawn state"
    hand = as_drawn.hand()
    hand.grab("pin")
    assert goes(lambda: hand.slide((0, 0, -1), distance=2.0 * max(d, 0.01))) == (kind != "clash"), "pulled out"
    as_drawn.close()

    if offset == 0.0:
        check_insertion(scene(d, clearance, 0.0, turn, False), kind, words, tmp_path)


def check_insertion(above: vp.Scene, kind: str, words: str, folder) -> None:
    session = vp.Session(above)
    hand = session.hand()
    hand.grab("pin")
    went = goes(lambda: hand.insert("plate"))
    assert went == (kind != "clash"), "inserted"
    if went:
        assert holds(session)
        assert (words in session.events[-1].text) == (kind == "press fit")
        session.close()
    report = json.loads((session.report(folder / "report") / "report.json").read_text(encoding="utf-8"))
    assert report["verdict"] == ("can be done" if went else "not decided" if not session.failure else "cannot be done")
    assert [fit["text"] for fit in report["press_fits"]] == [f"plate – pin: {words}"] * (kind == "press fit")
    page = (folder / "report" / "index.html").read_text(encoding="utf-8")
    assert (words in page) == (kind == "press fit")


def vp_gravest(rows) -> str:
    """The gravest kind of rows; "clearance" where there are none, as of facets that do not meet."""
    from vpframe.analysis.clash import KINDS

    return min((row.kind for row in rows), key=KINDS.index, default="clearance")


def holds(session: vp.Session) -> bool:
    """Whether the session expects no clash and is right."""
    return goes(session.expect_no_clash)


def goes(act) -> bool:
    """Whether an act does not end in a TaskError."""
    try:
        act()
    except TaskError:
        return False
    return True


def test_a_pin_of_the_issue_is_refused_and_blocks():
    """Ø10.48 into Ø10: no way in by hand, by `insert`, by planning; the words say why and what would do."""
    session = vp.Session(scene(0.01, -2.4e-4, 0.0, 0.0, False))
    hand = session.hand()
    hand.grab("pin")
    with pytest.raises(TaskError, match=r"Ø10\.48 in Ø10 mm is 0\.24 mm too large, a press fit s7 may be 19 µm"):
        hand.insert("plate")
    assert not goes(lambda: hand.move_by((0.0, 0.0, -0.012)))
    assert session.scene["pin"].pose.translation[2] > 0.0099
    session.close()


def test_a_tolerance_lets_more_be_pressed():
    tight, wide = vp.Tolerance(press_fit="p6"), vp.Tolerance(press_fit="u8")
    for tolerance, clearance, fits in ((tight, -1.5e-5, False), (wide, -2.4e-5, True), (wide, -2.6e-5, False)):
        session = vp.Session(scene(0.01, clearance, 0.0, 0.0, False), tolerance=tolerance)
        hand = session.hand()
        hand.grab("pin")
        assert goes(lambda hand=hand: hand.insert("plate")) == fits
        session.close()


def test_an_authorised_clash_comes_out():
    drawn = scene(0.01, -2.4e-4, 0.0, 0.0, True)
    assert removal(drawn, "pin", authorise=[("pin", "plate")])
    session = vp.Session(drawn)
    session.authorise("pin", "plate")
    hand = session.hand()
    hand.grab("pin")
    hand.slide((0, 0, -1), distance=0.02)
    session.close()


def test_a_press_fit_keeps_to_its_axis():
    """A pressed pin comes out along its axis and no other way; what it meets there stops it."""
    drawn = scene(0.01, -1.2e-5, 0.0, 0.0, True)
    free = removal(drawn, "pin", motion="straight")
    assert abs(free.way.direction[2]) == 1.0
    stop = m.box(0.03, 0.03, 0.002).translated(-0.015, -0.015, 0.0)
    for z in (-0.006, 0.02):
        drawn.add(m.scene({f"wall {z}": (stop, pin.SE3(np.eye(3), np.array([0.0, 0.0, z])))}).parts[0])
    assert removal(drawn, "pin", motion="straight").verdict != "removable"


def test_a_plan_names_its_press_fits():
    from vpframe.planning.document import document, table

    made = disassembly(scene(0.01, -1.2e-5, 0.0, 0.0, True))
    line = "plate – pin: press fit, 12 µm radial interference, force not checked"
    assert line in table(made) and document(made, 0, 0.0)["press_fits"][0]["text"] == line


@pytest.mark.parametrize(
    ("clearance", "offset", "kind"),
    [(1e-4, 0.0, "clearance"), (1e-4, 9.5e-5, "contact"), (0.0, 1e-5, "contact"), (-1.6e-5, 0.0, "press fit"),
     (-1.6e-5, 1e-5, "press fit"), (-1.6e-5, 1.1e-5, "clash"), (-2e-5, 0.0, "clash"), (1e-4, 1.2e-4, "clash")],
)  # fmt: skip
def test_the_kinds(clearance, offset, kind):
    found = round_fit(clearance, offset, 1.9e-5, 1e-5)
    assert found.kind == kind and found.gap == pytest.approx(clearance - offset)
    assert (found.press > 0.0) == (kind == "press fit")


@pytest.mark.parametrize(
    ("clearance", "options", "code"), [(-1.2e-5, (), 0), (-2.4e-5, (), 1), (-2.4e-5, ("--press-fit", "u8"), 0)]
)
def test_the_command_exits_with_0_for_a_press_fit(clearance, options, code, tmp_path, capsys):
    from vpframe.app.cli import main

    file = str(tmp_path / "pin.step")
    plate = m.box(0.03, 0.03, 0.01).translated(-0.015, -0.015) - m.cylinder(0.005, 0.01)
    m.write_step(file, {"plate": plate, "pin": m.cylinder(0.005 - clearance, 0.02)})
    assert main(["clash", file, "--json", *options]) == code
    kinds = [pair["kind"] for pair in json.loads(capsys.readouterr().out)["pairs"]]
    assert kinds == [["press fit"], ["clash"]][code]


@pytest.mark.parametrize(("d", "angle"), [(0.02, 9e-4), (0.05, 7e-4), (0.1, 9.5e-4), (0.2, 5e-4)])
def test_the_clearance_of_a_tilted_shaft_is_never_overstated(d, angle):
    radius, length, fit = 0.5 * d, 0.01, 1.5e-4
    plate = m.box(3 * d, 3 * d, length).translated(-1.5 * d, -1.5 * d, 0.0) - m.cylinder(radius + fit, length)
    turn = pin.exp3(np.array([angle, 0.0, 0.0]))
    pose = pin.SE3(turn, turn @ np.array([0.0, 0.0, -0.5 * length]) + np.array([0.0, 5e-6, -0.5e-2]))
    drawn = m.scene({"plate": plate, "pin": (m.cylinder(radius, 3.0 * length), pose)})
    distances = {row.distance for row in clash(drawn, clearance=1e-3) if row.fit is not None}
    angles = np.linspace(-np.pi, np.pi, 3601)
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros_like(angles)], axis=1)
    least = np.inf
    for height in (0.0, length):  # the ends of the bore: the gap is least there
        start = pose.act(np.zeros(3))
        on_axis = ring @ turn.T + start
        along = (height - on_axis[:, 2]) / turn[2, 2]
        cut = on_axis + along[:, None] * turn[:, 2]
        least = min(least, radius + fit - float(np.hypot(cut[:, 0], cut[:, 1]).max()))
    (distance,) = distances
    assert least - 1e-9 < distance <= least + 1e-12


@pytest.mark.parametrize(
    ("gap", "tolerance", "kind"),
    [(5e-6, None, "contact"), (5e-6, "1um", None), (-5e-6, None, "contact"), (-5e-6, "1um", "clash"),
     (5e-7, "1um", "contact"), (2e-5, "0.05mm", "contact"), (-2e-5, "0.05mm", "contact"), (-2e-5, None, "clash")],
)  # fmt: skip
def test_the_tolerance_of_the_command_decides_what_touches(gap, tolerance, kind, tmp_path, capsys):
    from vpframe.app.cli import main

    file = str(tmp_path / "two.step")
    block = m.box(0.01, 0.01, 0.01)
    m.write_step(file, {"lower": block, "upper": (block, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01 + gap])))})
    options = () if tolerance is None else ("--tolerance", tolerance)
    assert main(["clash", file, "--json", *options]) == (kind == "clash")
    kinds = {pair["kind"] for pair in json.loads(capsys.readouterr().out)["pairs"]}
    assert kinds == ({kind} if kind else set())


@pytest.mark.parametrize("tolerance", ["0mm", "-1um", "3", "nan mm"])
def test_a_tolerance_that_is_no_length_above_0_is_refused(tolerance, capsys):
    from vpframe.app.cli import main

    assert main(["clash", "two.step", f"--tolerance={tolerance}"]) == 2
    assert "--tolerance" in capsys.readouterr().err


def test_a_run_names_its_press_fits(tmp_path, capsys):
    from vpframe.app.cli import main

    script = tmp_path / "press.py"
    script.write_text(
        "from tests.vpframe.test_round_fit import scene as make\n\n\n"
        "def scene():\n    return make(0.01, -1.2e-5, 0.0, 0.0, False)\n\n\n"
        "def task(session):\n    hand = session.hand()\n    hand.grab('pin')\n    hand.insert('plate')\n"
        "    hand.release()\n    session.expect_no_clash()\n",
        encoding="utf-8",
    )
    assert main(["run", str(script)]) == 0
    told = capsys.readouterr()
    assert "plate – pin: press fit, 12 µm radial interference, force not checked" in told.out + told.err
