"""Scenes: names of their parts."""

import pytest

import vpframe as vp
from tests.vpframe.fitted import AT_HOME
from vpframe.analysis.clash import clash, merged
from vpframe.scene import modelling as m
from vpframe.scene.scene import Scene


def test_two_parts_of_one_name_are_refused():
    scene = m.scene({"plate": (m.box(0.01, 0.01, 0.01), AT_HOME)})
    with pytest.raises(vp.VpframeError, match=r"two parts are called 'plate'"):
        scene.add(scene["plate"])


def test_scenes_of_several_files_keep_their_parts_apart():
    one = m.scene({"cube": (m.box(0.01, 0.01, 0.01), AT_HOME)})
    one.source = "folder/a.step"
    both = merged([one, one])
    assert both.names == ("a/cube", "a_2/cube")
    assert merged([one]) is one
    assert clash(Scene()) == ()
