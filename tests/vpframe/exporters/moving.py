"""A scene of many kinds of parts, and a motion of one of them."""

import numpy as np
import pinocchio as pin

import vpframe as vp
from vpframe.scene import modelling as m
from vpframe.scene.motion import Motion

RED = (1.0, 0.0, 0.0, 0.5)


def placed(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))


def model() -> vp.Scene:
    """Parts of three levels, two of one shape, with colours, a coloured face, densities and names of every kind."""
    plate = m.box(0.1, 0.08, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.04)
    pin_ = m.cylinder(0.004, 0.03).chamfered(0.0005)
    scene = m.scene(
        {
            "base/plate": (plate, placed(0), RED, 7850.0),
            "base/Bolzen Ø8 (größer)_1": (pin_, placed(1), (0.1, 0.2, 0.3), 20.0),
            "base/sub/Bolzen_2": (pin_, placed(2), (0.4, 0.2, 0.3), 20.0),
            "base/sub/1": (pin_, placed(3)),
            "base/sub/2": (pin_, placed(4)),
            "ball": (m.sphere(0.01), placed(5), None, 23000.0),
        }
    )
    return scene


def moving(scene: vp.Scene, part: str = "ball") -> Motion:
    """A part that rests half a second, goes 0.3 m along x in one, and rests again; all else stands still."""

    def poses(t: float) -> dict[str, pin.SE3]:
        out = {p.name: p.pose for p in scene.parts}
        shift = np.array([0.3 * np.clip(t - 0.5, 0.0, 1.0), 0.0, 0.0])
        out[part] = pin.SE3(out[part].rotation, out[part].translation + shift)
        return out

    return Motion.of((t, poses(t)) for t in np.arange(0.0, 2.01, 0.1).tolist())
