"""STEP in, STEP out, STEP in: the same mates, freedoms and clashes."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import vpframe as vp
from vpframe.analysis import clash, mates
from vpframe.scene import modelling as m


def answers(scene: vp.Scene) -> tuple[Any, Any]:
    """Mates with freedoms, and clashes, with lengths to a nanometre."""

    def rounded(value: Any) -> Any:
        if isinstance(value, float):
            return round(value, 9) + 0.0
        if isinstance(value, dict):
            return {k: rounded(v) for k, v in value.items() if k not in ("point", "why", "reason")}
        return [rounded(v) for v in value] if isinstance(value, list | tuple) else value

    return rounded(mates.mates(scene).document()), rounded([row.document() for row in clash.clash(scene)])


@st.composite
def assemblies(draw) -> dict[str, Any]:
    """A plate with holes, pins in some of them (fitting, loose or too thick, at any depth), a cover; all turned."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-1.0, 1.0, 3))
    holes = draw(st.integers(1, 3))
    plate = m.box(0.04 * holes, 0.04, 0.01)
    for i in range(holes):
        plate -= m.cylinder(0.005, 0.01).translated(0.02 + 0.04 * i, 0.02)
    parts: dict[str, Any] = {"frame/plate": (plate, pose, (0.2, 0.4, 0.6), 7800.0)}
    for i in range(holes):
        radius = draw(st.sampled_from([0.005, 0.0049, 0.0052]))
        depth = draw(st.sampled_from([0.0, 0.004, -0.02]))
        at = pin.SE3(np.eye(3), np.array([0.02 + 0.04 * i, 0.02, depth]))
        parts[f"frame/pins/pin_{i + 1}"] = (m.cylinder(radius, 0.02), pose * at)
    if draw(st.booleans()):
        lid = m.box(0.02, 0.04, 0.005) - m.cylinder(0.007, 0.005).translated(0.02, 0.02)
        parts["Deckel ä"] = (lid, pose * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01])))
    return parts


@pytest.mark.slow
@settings(  # an example starts the CAD kernel three times
    max_examples=3,
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.too_slow],
)
@given(assemblies())
def test_step_export_load_gives_the_same_mates_freedoms_and_clashes(parts):
    with tempfile.TemporaryDirectory() as folder:
        nested: dict[str, Any] = {}
        for path, value in parts.items():
            *above, name = path.split("/")
            at = nested
            for step in above:
                at = at.setdefault(step, {})
            at[name] = value
        first = vp.load(m.write_step(Path(folder, "first.step"), nested))
        assert first.export(Path(folder, "second.step")) == ()
        second = vp.load(Path(folder, "second.step"))
        assert second.names == first.names == tuple(parts)
        for a, b in zip(first.parts, second.parts, strict=True):
            assert np.abs(a.pose.homogeneous - b.pose.homogeneous).max() < 1e-12
            assert b.shape.volume == pytest.approx(a.shape.volume, rel=1e-9)
            assert b.density == (None if a.density is None else pytest.approx(a.density))
        assert answers(second) == answers(first)


def test_a_moved_state_has_the_mates_of_where_it_stands(tmp_path):
    """A pin drawn out of its hole has none, in the file as in the session."""
    plate = m.box(0.04, 0.04, 0.01) - m.cylinder(0.005, 0.01).translated(0.02, 0.02)
    at = pin.SE3(np.eye(3), np.array([0.02, 0.02, -0.005]))
    first = vp.load(m.write_step(tmp_path / "first.step", {"plate": plate, "pin": (m.cylinder(0.005, 0.02), at)}))
    assert [c.kind for c in mates.mates(first).constraints] == ["concentric"]
    first["pin"].pose = pin.SE3(np.eye(3), np.array([0.02, 0.02, 0.1]))
    first.export(tmp_path / "second.step")
    second = vp.load(tmp_path / "second.step")
    assert mates.mates(second).constraints == () and answers(second) == answers(first)
