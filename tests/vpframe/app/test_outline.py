"""The outline of a scene."""

import pytest

from vpframe.app import task_runner as study
from vpframe.errors import VpframeError


def test_a_new_task_for_a_named_part_outlines_the_scene(tmp_path) -> None:
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.005, 0.02)
    peg = m.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.02), (0.008, 0.02), (0.008, 0.025), (0.0, 0.025)])
    knob = m.cylinder(0.004, 0.01).translated(0.015, 0.015, 0.0205)
    m.write_step(
        tmp_path / "pegged.step", {"block": block, "peg": peg, "kit": {"knob": knob, "cap": knob.translated(0.1)}}
    )
    path = tmp_path / "first.py"
    assert study.new_task(path, tmp_path / "pegged.step", part="peg") == ""
    text = path.read_text()
    assert 'hand.grab("peg")' in text
    assert '"block": 7 surfaces, 40 x 40 x 20 mm around (0, 0, 10) mm; ' in text
    (line,) = (line for line in text.splitlines() if line.startswith('#   "peg"'))
    assert "16 x 16 x 25 mm around (0, 0, 12.5) mm; " in line
    assert "concentric" in line and "against" in line and line.endswith(" to block")
    (line,) = (line for line in text.splitlines() if line.startswith('#   "kit/knob"'))
    assert line.endswith("; beside block")
    assert study.run_task(path) == 0
    for name, words in (("pegg", "peg"), ("kit", "kit has 2 parts"), ("", "no part")):
        with pytest.raises(VpframeError, match=words):
            study.new_task(tmp_path / "other.py", tmp_path / "pegged.step", part=name)
    assert not (tmp_path / "other.py").exists()
