"""One assembly goes through every format: a pin is drawn, and what became of it is written for each of the others.

Not a task: it prints what each file holds and what its format cannot carry. `python examples/formats.py [FOLDER]`
"""

import sys
import tempfile
from pathlib import Path

from parts import BRASS, STEEL, at

import vpframe as vp
from vpframe.scene import modelling


def scene():
    block = modelling.box(0.06, 0.06, 0.03).translated(-0.03, -0.03, 0.0) - modelling.cylinder(0.01, 0.03)
    pin = modelling.cylinder(0.01, 0.05)
    made = modelling.scene({"base/block": (block, at(), STEEL), "base/pin": (pin, at(), BRASS)})
    made["base/block"].fixed = True
    return made


def main(folder: Path) -> None:
    made, run = scene(), folder / "run.rrd"
    with vp.Session(made, record=run) as session:
        hand = session.hand()
        hand.grab("base/pin")
        hand.move_by((0.0, 0.0, 0.02))
        session.expect_constraint("concentric", "base/pin", "base/block")
        vp.write_table(folder / "events.csv", session.events)
    motion = vp.read_motion(run)
    print(f"{motion.duration:.2f} s of {', '.join(motion.moving)}")
    for name in ("moved.step", "moved.glb", "moved.urdf", "moved.mjcf", "moved.csv"):
        left = made.export(folder / name, motion if name.endswith(("glb", "csv")) else None)
        print(f"{name}: {(folder / name).stat().st_size} bytes; left out: {'; '.join(left) or 'nothing'}")
    back = vp.load(folder / "moved.step")
    assert abs(back["base/pin"].pose.translation - made["base/pin"].pose.translation).max() < 1e-12
    robot = vp.load(folder / "moved.urdf")
    print(f"{robot.source}: {', '.join(f'{s.kind} of {s.a[0]} and {s.b[0]}' for s in robot.statements)}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made_here:
            main(Path(made_here))
