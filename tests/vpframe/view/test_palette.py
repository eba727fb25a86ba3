"""Colours of parts."""

import re

import pytest

import vpframe as vp
from vpframe.scene import modelling as m
from vpframe.view import palette


def test_colours_are_the_same_numbers_in_script_file_and_scene(tmp_path):
    """STEP holds sRGB, as scripts and viewers do; what the kernel keeps in between is linear."""
    color = (0.5, 0.25, 0.1, 0.4)
    path = m.write_step(tmp_path / "a.step", {"box": (m.box(0.1, 0.1, 0.1), None, color)})
    written = re.search(r"COLOUR_RGB\(\s*'',([^)]*)\)", path.read_text())
    assert [float(x) for x in written[1].split(",")] == pytest.approx(color[:3], abs=1e-6)
    assert vp.load(path)["box"].color == pytest.approx(color, abs=1e-6)
    palest = palette.part_colors(vp.load(path))["box"]
    assert palest == pytest.approx(palette.part_colors(m.scene({"box": (m.box(0.1, 0.1, 0.1), None, color)}))["box"])
