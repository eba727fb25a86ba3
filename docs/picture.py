"""Draws `docs/demo.png`, the README's picture: the demo's own frames, cut open.

python docs/picture.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import vpframe as vp
from vpframe.app import demo
from vpframe.events import Frames
from vpframe.view import snapshot
from vpframe.view.camera import look_at
from vpframe.view.symbols import frame_symbols


def main() -> None:
    """Run the demo's task and put four of its frames side by side."""
    kept = Frames()
    with tempfile.TemporaryDirectory() as folder:
        scene = vp.load(demo.build(Path(folder) / "demo.step"))
    with vp.Session(scene, observers=[kept]) as session:
        demo.task(session)
    at = {event.text.split()[0] + " " + event.kind: i for i, f in enumerate(kept.frames) for event in f.events}
    chosen = [10, at["concentric accepted"] + 8, at["against accepted"] + 6, at["concentric removed"] + 2]
    # a box that holds the shaft above the housing
    corners = np.array([[x, y, z] for x in (-0.028, 0.028) for y in (-0.028, 0.028) for z in (-0.01, 0.11)])
    strip = []
    for i in chosen:
        frame = kept.frames[i]
        points = corners if i != chosen[0] else corners + np.array([[0.075, 0, 0]]) * (corners[:, :1] > 0)
        picture = snapshot.render(
            scene,
            frame.poses,
            [(scene.names[o], s) for row in frame.colliding.tolist() for o, s in (row[:2], row[2:])],
            size=(300, 400),
            camera=look_at(points),
            symbols=frame_symbols(frame),
            look=snapshot.Look(section=None if i == chosen[0] else ((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)), supersample=3),
        )
        strip.append(picture)
    snapshot.save_png(np.concatenate(strip, axis=1), Path(__file__).parent / "demo.png")


if __name__ == "__main__":
    main()
