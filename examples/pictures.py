"""Draws the pictures of `README.md`: a few of each example's own frames side by side.

    python examples/pictures.py [NAME ...] [--to DIR]

A task is run as it stands, and watched by an observer that keeps its frames; an example of physics alone is run with a
`World` that keeps its poses after each step.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from digger_pin import LEAN
from numpy.typing import ArrayLike, NDArray

import physics
import vpframe as vp
from vpframe.events import Frame, Frames
from vpframe.scene.scene import Part, Scene, Shape
from vpframe.studies.variants import bound, nominal
from vpframe.view import snapshot
from vpframe.view.camera import DIRECTION, Camera, look_at
from vpframe.view.symbols import frame_symbols

FOLDER = Path(__file__).parent / "pictures"
WIDTH, HEIGHT = 600, 220  # pixels, of a strip

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Shot:
    """A frame of a task: so many steps after the first event of a kind, since the shot before, that says `text`."""

    kind: str = ""
    text: str = ""
    after: int = 0


@dataclass(frozen=True)
class Strip:
    """What a picture shows, and from where."""

    shots: Sequence[Shot | float]
    """frames of a task, or times (s) of an example of physics"""
    low: Vector
    high: Vector
    """corners of a box in the world that is in the picture"""
    direction: Vector = DIRECTION
    """from the scene towards the eye"""
    cut: tuple[Vector, Vector] | None = None
    """a point and a normal: what lies beyond is cut away"""
    glass: Sequence[str] = ()
    """parts that are drawn transparent"""
    symbols: bool = False
    """whether constraints and the freedom they leave are drawn"""
    lean: pin.SE3 = field(default_factory=pin.SE3.Identity)
    """of the frame in which box, direction and cut are given"""


class Watched(physics.World):
    """A world that keeps the poses of all its objects after each step."""

    last: Watched

    def __init__(self, *arguments, **options) -> None:
        super().__init__(*arguments, **options)
        self.kept: list[tuple[float, dict[str, pin.SE3]]] = []
        Watched.last = self

    def step(self, dt: float) -> None:
        """A step, kept."""
        super().step(dt)
        self.kept.append((self.time, {str(i): pin.SE3(self.pose(i)) for i in self.collision.objects}))


def run_task(name: str) -> tuple[Scene, list[Frame]]:
    """A task's scene and its frames."""
    module = importlib.import_module(name)
    if hasattr(module, "VARIANTS"):
        module = bound(module, FOLDER.parent / f"{name}.py", nominal(module.VARIANTS))
    scene, kept = module.scene(), Frames()
    with vp.Session(scene, observers=[kept], **getattr(module, "OPTIONS", {})) as session:
        module.task(session)
    return scene, kept.frames


def run_physics(name: str) -> tuple[Scene, list[tuple[float, dict[str, pin.SE3]]]]:
    """The objects of an example of physics as a scene, and their poses by time."""
    module = importlib.import_module(name)
    setattr(module, "World", Watched)  # noqa: B010
    module.main()
    manager = Watched.last.collision
    parts = [Part(str(i), Shape(manager.mesh(i), (), ()), pin.SE3(manager.pose(i))) for i in manager.objects]
    return Scene(parts), Watched.last.kept


def chosen(frames: Sequence[Frame], shots: Sequence[Shot | float]) -> list[Frame]:
    """The frames that the shots name."""
    found, i = [], 0
    for shot in shots:
        assert isinstance(shot, Shot)
        if shot.kind:
            i = next(
                k
                for k in range(i, len(frames))
                if any(e.kind == shot.kind and shot.text in e.text for e in frames[k].events)
            )
        i = min(i + shot.after, len(frames) - 1)
        found.append(frames[i])
    return found


def framed(strip: Strip, size: tuple[int, int]) -> Camera:
    """The camera from which the strip's box fills a picture of `size` pixels."""
    box = np.array([[x, y, z] for x, y, z in np.ndindex(2, 2, 2)])
    points = np.array([strip.low, strip.high])[box, np.arange(3)]
    points = points @ strip.lean.rotation.T + strip.lean.translation
    turn = strip.lean.rotation
    camera = look_at(points, turn @ np.array(strip.direction), up=turn[:, 2])
    width, height = size
    off = np.abs(snapshot.project(points, camera, (height, width))[:, :2] - 0.5 * np.array(size)) / (
        0.5 * np.array(size)
    )
    return replace(camera, radius=1.03 * camera.radius * float(off.max()))


def draw(name: str, strip: Strip, folder: Path = FOLDER) -> Path:
    """Run one example and save its picture in `folder`."""
    views: list[tuple[Mapping[str, pin.SE3], list[tuple[str, int]], tuple]] = []
    if name.startswith("physics_"):
        scene, kept = run_physics(name)
        for time in strip.shots:
            assert isinstance(time, float)
            views.append((min(kept, key=lambda k: abs(k[0] - time))[1], [], ()))
    else:
        scene, frames = run_task(name)
        for frame in chosen(frames, strip.shots):
            red = [(scene.names[o], s) for row in frame.colliding.tolist() for o, s in (row[:2], row[2:])]
            views.append((frame.poses, red, frame_symbols(frame) if strip.symbols else ()))
    size = (WIDTH // len(views), HEIGHT)
    camera = framed(strip, size)
    cut: tuple[ArrayLike, ArrayLike] | None = None
    if strip.cut is not None:
        cut = strip.lean.act(np.array(strip.cut[0])), strip.lean.rotation @ np.array(strip.cut[1])
    pictures: list[NDArray[np.uint8]] = []
    for poses, red, symbols in views:
        opacity = dict.fromkeys(strip.glass, 0.35)
        look = snapshot.Look(opacity, cut, supersample=3)
        picture = snapshot.render(scene, poses, red, size, camera, symbols, look)
        if pictures:
            picture[:, :1] = 255  # a line between two frames
        pictures.append(picture)
    folder.mkdir(parents=True, exist_ok=True)
    return snapshot.save_png(np.concatenate(pictures, axis=1), folder / f"{name}.png")


STRIPS: dict[str, Strip] = {
    "shaft_and_housing": Strip(
        [Shot("grabbed", "shaft", 25), Shot("accepted", "concentric", 12), Shot("accepted", "against", 1)],
        (-0.05, -0.045, -0.005),
        (0.145, 0.03, 0.125),
        (0.45, -0.8, 0.4),
        cut=((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        symbols=True,
    ),
    "digger_pin": Strip(
        [
            Shot("note", "boxes would offer"),
            Shot("accepted", "concentric between arm", 20),
            Shot("accepted", "against"),
        ],
        (-0.10, -0.05, -0.11),
        (0.22, 0.05, 0.17),
        (0.3, -1.0, 0.25),
        cut=((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        symbols=True,
        lean=LEAN,
    ),
    "bolted_plate": Strip(
        [
            Shot("removed", "concentric between bolt_1 and nut_1", 12),
            Shot("removed", "concentric between upper and bolt_1", 12),
            Shot("accepted", "against between lower and nut_1"),
        ],
        (-0.055, -0.045, -0.045),
        (0.175, 0.04, 0.05),
        (0.35, -1.0, 0.22),
    ),
    "bolted_bracket": Strip(
        [
            Shot(after=10),
            Shot("removed", "concentric between bracket and bolt_1", 18),
            Shot("grabbed", "holds bracket", 20),
        ],
        (-0.09, -0.05, -0.03),
        (0.09, 0.05, 0.15),
        (0.55, -0.8, 0.4),
    ),
    "bolted_cover": Strip(
        [Shot("removed", "of housing and old_seal", 22), Shot("accepted", "against between housing and new_seal")],
        (-0.05, -0.08, 0.0),
        (0.34, 0.08, 0.08),
        (0.25, -0.7, 0.6),
    ),
    "fan_exchange": Strip(
        [Shot("grabbed", "guard", 40), Shot("grabbed", "fan", 60), Shot("grabbed", "spare", 120)],
        (-0.04, -0.05, 0.0),
        (0.17, 0.05, 0.03),
        (0.25, -0.7, 0.6),
    ),
    "tolerance_study": Strip(
        [Shot("grabbed", "shaft", 5), Shot("accepted", "concentric", 6), Shot("accepted", "against")],
        (-0.03, -0.03, -0.003),
        (0.03, 0.03, 0.085),
        (0.45, -0.8, 0.4),
        cut=((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        symbols=True,
    ),
    "position_study": Strip(
        [Shot("grabbed", "bolt_1", 8), Shot("released", "bolt_2", 8), Shot("released", "bolt_4")],
        (-0.05, -0.05, -0.02),
        (0.05, 0.05, 0.068),
        (0.45, -0.8, 0.5),
    ),
    "hinge_and_door": Strip(
        [Shot("accepted", "concentric", 75), Shot("grabbed", "door", 90), Shot("released", "door", 170)],
        (-0.07, -0.18, 0.0),
        (0.23, 0.03, 0.36),
        (0.35, -0.9, 0.7),
    ),
    "gear_pair": Strip(
        [Shot("blocked", "driven", 0), Shot("satisfied", "gear between driver and driven"), Shot(after=50)],
        (-0.022, -0.033, -0.012),
        (0.084, 0.033, 0.03),
        (0.35, -0.6, 0.8),
        symbols=True,
    ),
    "battery_module": Strip(
        [Shot("grabbed", "holds old"), Shot("removed", "tray and old", 130), Shot("accepted", "tray and spare")],
        (-0.12, -0.2, 0.0),
        (0.5, 0.15, 0.2),
        (0.3, -0.8, 0.6),
    ),
    "balloon_room": Strip(
        [Shot(after=20), Shot("released", "box", 20), Shot(after=400)],
        (-0.9, -0.5, -0.1),
        (0.9, 0.5, 2.5),
        (0.15, -1.0, 0.0),
    ),
    "physics_tray": Strip([0.1, 0.25, 1.5], (-0.15, -0.15, 0.0), (0.15, 0.15, 0.2), (0.3, -0.7, 0.6)),
    "physics_balloon": Strip([0.1, 1.0, 5.0], (-0.6, -0.3, 0.1), (0.6, 0.3, 2.7), (0.1, -1.0, 0.0)),
    "physics_hinge": Strip([0.1, 0.35, 2.15], (-0.2, -0.03, -0.21), (0.21, 0.03, 0.15), (0.3, -1.0, 0.3)),
    "physics_newtons_cradle": Strip([0.05, 0.29, 0.57], (-0.23, -0.03, -0.33), (0.23, 0.03, 0.07), (0.2, -1.0, 0.25)),
    "physics_nut": Strip([0.05, 12.4, 13.4], (-0.04, -0.04, 0.11), (0.04, 0.04, 0.19), (0.3, -1.0, 0.35)),
}
"""a frame whose event is not named is so many steps after the one before it, or the last"""


def main(argv: Sequence[str] | None = None) -> None:
    """Draw the pictures of the examples named, or of all."""
    parser = argparse.ArgumentParser(description="draw the pictures of README.md")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"examples, of {', '.join(STRIPS)}; all by default")
    parser.add_argument("--to", type=Path, default=FOLDER, metavar="DIR", help="where the pictures go")
    given = parser.parse_args(argv)
    unknown = sorted(set(given.names) - set(STRIPS))
    if unknown:
        parser.error(f"no example is called {', '.join(unknown)}; there are {', '.join(STRIPS)}")
    for name in given.names or STRIPS:
        path = draw(name, STRIPS[name], given.to)
        print(f"{path.name}: {path.stat().st_size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
