"""What several questions about a scene need is computed once, and anew where the scene has changed."""

import gc
import weakref

import numpy as np
import pinocchio as pin

from collision import Tolerance
from vpframe.analysis import static
from vpframe.analysis.clash import clash
from vpframe.analysis.mates import mates
from vpframe.analysis.static import analysis_of, world_of
from vpframe.scene import modelling as m


def pin_in_plate():
    plate = m.box(0.03, 0.03, 0.01).translated(-0.015, -0.015) - m.cylinder(0.005, 0.01)
    return m.scene({"plate": plate, "pin": (m.cylinder(0.00499, 0.02), pin.SE3.Identity())})


def test_clash_and_mates_share_one_analysis_until_the_scene_changes():
    scene = pin_in_plate()
    clash(scene)
    first = analysis_of(scene)
    mates(scene)
    assert analysis_of(scene) is first
    assert analysis_of(scene, Tolerance(clearance=1e-3)) is not first
    again = analysis_of(scene)
    scene["pin"].pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1]))
    assert analysis_of(scene) is not again
    assert mates(scene).constraints == () and clash(scene) == ()


def test_the_contacts_of_a_nearer_question_are_those_of_the_world():
    scene = pin_in_plate()
    analysis = analysis_of(scene)
    for within in (3e-3, 1e-5, 1e-3, 5e-3):
        wanted = world_of(scene).contacts(within=within)
        assert analysis.contacts(within).tobytes() == wanted.tobytes()


def test_an_analysis_goes_with_its_scene():
    scene = pin_in_plate()
    kept = weakref.ref(analysis_of(scene))
    key = id(scene)
    assert key in static._KNOWN
    del scene
    gc.collect()
    assert key not in static._KNOWN and kept() is None
