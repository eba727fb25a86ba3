"""The benchmark: what it holds for true, its own cases at coarse steps, its ratios, goals, table and plot."""

import bench_physics as bench
import numpy as np
import physics_cases as pc
import physics_linkages
import physics_peers
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipkinc

from constraints.kinds.against import Against
from constraints.kinds.concentric import Concentric


@pytest.fixture(scope="module")
def truth():
    return pc.truths()


def test_elliptic_functions_are_scipys():
    u = np.linspace(-3.0, 3.0, 41)
    for rest in (0.9, 0.3, 1e-3):
        for mine, theirs in zip(pc.jacobi(u, rest), ellipj(u, 1.0 - rest)[:3], strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-13)
    for phi in (0.1, 0.7, 1.4):
        s, c = np.sin(phi), np.cos(phi)
        mine = s * pc.carlson(c * c, 1.0 - 0.8 * s * s, 1.0)
        assert mine == pytest.approx(ellipkinc(phi, 0.8), rel=1e-13)


def test_free_spin_in_closed_form_is_the_integral_of_eulers_equations(truth, monkeypatch):
    monkeypatch.setitem(pc.SPIN, "time", 12.0)  # three flips; errors grow e-fold in a third of a second
    inertia, start = np.array(pc.SPIN["inertia"]), np.array(pc.SPIN["omega"])

    def rate(_, y):
        rotation, w = y[:9].reshape(3, 3), y[9:]
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.concatenate([(rotation @ cross).ravel(), np.cross(inertia * w, w) / inertia])

    errors = pc.SpinErrors({"spin": pc.spin_truth()})
    times = np.arange(1, errors.LOOKS + 1) * pc.SPIN["time"] / errors.LOOKS
    y = solve_ivp(rate, (0, 12.0), [*np.eye(3).ravel(), *start], method="DOP853", rtol=1e-13, atol=1e-15, t_eval=times)
    for column in y.y.T:
        errors.look(column[:9].reshape(3, 3), column[9:])
    assert errors.energy < 1e-12 and errors.momentum < 1e-12
    assert 0.0 < errors.flips < 1e-9 and errors.attitude < 1e-10
    late = pc.SpinErrors({"spin": pc.spin_truth()})
    for column in np.roll(y.y, 1, axis=1).T:  # each look is one too late
        late.look(column[:9].reshape(3, 3), column[9:])
    assert late.flips == pytest.approx(12.0 / errors.LOOKS, rel=1e-6)


def test_coins_stand_in_balance():
    for coin in pc.COINS.values():
        rotation, center, omega = pc.coin_start(coin)
        r, t, m = coin["radius"], coin["thickness"], coin["mass"]
        contact = rotation @ [r, 0.0, -t / 2] if (rotation @ [r, 0.0, -t / 2])[2] < 0 else rotation @ [r, 0.0, t / 2]
        assert center[2] + contact[2] == pytest.approx(0.0, abs=1e-15)
        assert np.abs(np.cross(omega, contact)).max() < 1e-12  # neither slips nor moves
        inertia = rotation @ (m * np.diag([r * r / 4 + t * t / 12] * 2 + [r * r / 2])) @ rotation.T
        # the whole picture turns about the vertical: so does the angular momentum, by the weight's moment
        momentum, moment = inertia @ omega, np.cross(contact, [0.0, 0.0, m * pc.G])
        turn = np.cross([0.0, 0.0, 1.0], momentum)
        rate = moment @ turn / (turn @ turn)
        np.testing.assert_allclose(rate * turn, moment, atol=1e-12 * np.abs(moment).max())
        spin = omega - rate * np.array([0.0, 0.0, 1.0])  # what is left turns the coin in itself
        assert np.abs(np.cross(spin, rotation[:, 2])).max() < 1e-9 * np.abs(omega).max()


def test_joints_of_the_linkages_are_recognised():
    _, ids, joints = physics_linkages.pendulum()
    pair = (ids["post"], ids["bar"])
    assert len(joints) == 2 and {(type(j), j.bodies) for j in joints} == {(Against, pair), (Concentric, pair)}
    world, ids, joints = physics_linkages.fourbar()
    base, crank, coupler, rocker = (ids[n] for n in ("base", "crank", "coupler", "rocker"))
    pairs = {(base, crank), (crank, coupler), (coupler, rocker), (base, rocker)}
    assert {(type(j), j.bodies) for j in joints} == {(k, p) for k in (Against, Concentric) for p in pairs}
    for j in joints:
        assert np.abs(j.residual(*(world.collision.pose(i) for i in j.bodies))).max() < 1e-15


@pytest.mark.parametrize(
    ("run", "dt", "most"),
    [
        ("bounce e=1", 0.05, 1e-12),
        ("bounce e=0.8", 0.01, 1e-12),
        ("slope slide", 0.1, 1e-14),
        ("slope stick", 0.1, 1e-15),
        ("pendulum", 0.1, 1e-5),
        ("four-bar", 0.05, 1e-4),
        ("roll", 0.1, 1e-13),
        ("coin roll", 0.05, 1e-3),
        ("coin spin", 0.05, 1e-3),
        ("balloon rise", 0.1, 1e-3),
        ("balloon rest", 0.1, 1e-9),
        ("peg 10 um", 0.05, 1e-12),
    ],
)
def test_cases_run_and_are_near_their_truth(run, dt, most, truth):
    (row,) = bench.ours_of(run, dt, truth)
    assert row["error"] <= most and row["steps"] > 0 and row["seconds"] > 0.0


def test_one_run_of_the_spin_gives_its_rows(truth):
    rows = list(bench.ours_of("spin", 0.5, truth))
    assert [r["row"] for r in rows] == [row for row, (case, _) in pc.ROWS.items() if case == "spin"]
    assert rows[0]["error"] < 1e-13 and rows[1]["error"] < 1e-13


def test_peg_stays_out_of_its_wall():
    into, seconds = bench.peg_in_wall("peg 10 um", 0.05)
    assert into <= 1e-9 and seconds > 0.0


def made(case, method, total, error, dt=1e-2):
    return {"case": case, "method": method, "seconds": 1e-3, "error": error, "unit": "m", "n": 9, "dt": dt} | {
        "total": total,
        "note": "" if total else "it does not",
    }


ROWS = [
    made("roll", "vpframe", 1.0, 1e-9),
    made("roll", "vpframe", 2.0, 1e-8),  # slower and worse: not looked at
    made("roll", "vpframe", 3.0, 1e-16),
    made("roll", "mujoco", 0.5, 1e-6),
    made("roll", "mujoco RK4", 1.05, 1e-10),
    made("roll", "mujoco RK4", 9.0, 1e-15),
    made("roll", "drake", 4.0, None),
    made("coin roll", "vpframe", 1.0, 1e-6),
    made("coin roll", "mujoco", 2.0, 1e-3),
    made("peg 10 um", "drake hull", None, None),
]


def test_ratios_are_taken_at_equal_processor_time():
    fronts = bench.fronts_of(ROWS, "mujoco")
    assert [(p["total"], p["peer"]) for p in fronts["roll"]] == [(1.0, 1e-10), (3.0, 1e-10)]
    assert [p["ratio"] for p in fronts["roll"]] == pytest.approx([10.0, 1e-4])  # 1e-16 counts as rounding
    assert fronts["coin roll"][0]["ratio"] == pytest.approx(1e-3)  # it was never as quick: its quickest run
    assert bench.fronts_of(ROWS, "drake")["roll"][-1]["peer"] == np.inf


def test_goals_table_and_plot_come_from_the_rows(tmp_path):
    pytest.importorskip("matplotlib")
    fronts = {engine: bench.fronts_of(ROWS, engine) for engine in ("mujoco", "drake")}
    goals = bench.goals_of(ROWS, fronts["mujoco"], 2e-9, 1e-3)
    met = {g["name"]: g["met"] for g in goals}
    assert list(met.values()) == [False, False, False, False, False, False, False, False, False, True]
    assert goals[0]["value"] == 2
    result = {"rows": ROWS, "missing": {"drake": "not installed"}, "fronts": fronts, "goals": goals}
    table = bench.table(result)
    assert "drake: not installed" in table and "MISSED" in table and "diverged" in table and "it does not" in table
    assert bench.plot(result, tmp_path).stat().st_size > 10_000


def test_every_run_has_settings_and_steps():
    assert set(bench.STEPS) == set(pc.RUNS) and len(pc.CASES) == 9
    for engine in physics_peers.ENGINES.values():
        assert all(len(engine.options(run)) > 0 for run in pc.RUNS)


def test_peers_run_what_fits_in_the_processor_time_and_say_what_fails():
    class Peer:
        def run(self, run, dt, option):
            if option == "broken":
                raise RuntimeError("no such thing\nat all")
            return 1.0 / dt, round(1 / dt), {f"{run} a": dt, f"{run} b": np.inf}

    found = list(physics_peers.all_runs_of(Peer(), "case", [1e-3, 1e-2], 200.0, ["good", "broken"]))
    good = [r for r in found if r["method"] == "good"]
    assert sorted({r["dt"] for r in good}) == pytest.approx([1 / 180.0, 1e-2])  # 1e-3 would take five times as long
    assert {r["row"] for r in good} == {"case a", "case b"} and good[1]["error"] is None
    assert [r["failed"] for r in found if r["method"] == "broken"] == ["no such thing"] * 2


def test_an_engine_that_is_not_installed_says_so(truth, monkeypatch):
    monkeypatch.delenv("VPFRAME_PEERS", raising=False)
    for engine, package in (("mujoco", "mujoco"), ("drake", "pydrake")):
        answer = bench.peers_of(engine, [], truth, 0.0, 1.0)
        try:
            __import__(package)
        except ImportError:
            assert "not installed" in answer["missing"]
        else:
            assert answer["rows"] == []
