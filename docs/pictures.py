"""Draws the pictures of the tutorial and of the concepts in `docs/pictures`, and `docs/study.png`.

All show the tutorial's own model, task and study.

python docs/pictures.py
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin

import vpframe as vp
from collision import SurfaceMesh, colliding_surfaces
from vpframe.app import cli
from vpframe.events import Frames
from vpframe.scene import modelling as m
from vpframe.view import snapshot
from vpframe.view.camera import look_at
from vpframe.view.symbols import frame_symbols

HERE = Path(__file__).resolve().parent
PICTURES = HERE / "pictures"
LIFT = 0.012
"""by which the picture of kinds shows the upper part above its place, m"""
CUT = ((0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
COLORS = [
    (0.89, 0.47, 0.20),
    (0.20, 0.50, 0.75),
    (0.30, 0.65, 0.35),
    (0.75, 0.70, 0.25),
    (0.55, 0.40, 0.65),
    (0.2, 0.65, 0.65),
    (0.8, 0.35, 0.5),
]
FINE = snapshot.Look(supersample=3)


def blocks(page: str) -> dict[str, str]:
    """Python blocks of a page whose first line names a file, by that name."""
    found = re.findall(r"```python\n# (\S+\.py)\n(.*?)```", (HERE / page).read_text(encoding="utf-8"), flags=re.S)
    return dict(found)


@contextlib.contextmanager
def inside(folder: str) -> Iterator[None]:
    """With `folder` as the working directory."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def save(name: str, *pictures: np.ndarray) -> None:
    """Pictures side by side as `docs/pictures/NAME.png`."""
    PICTURES.mkdir(exist_ok=True)
    path = snapshot.save_png(np.concatenate(pictures, axis=1), PICTURES / f"{name}.png")
    print(f"{path.name}: {path.stat().st_size / 1000:.1f} kB")


def corners(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """The eight corners (8, 3) of a box."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def moved(part: vp.Part, shift: tuple[float, float, float]) -> dict[str, pin.SE3]:
    """A part's pose, shifted, by its name."""
    return {part.name: pin.SE3(part.pose.rotation, part.pose.translation + np.array(shift))}


def pump(scene: vp.Scene) -> None:
    """The pump, whole and cut open."""
    camera = look_at(corners((-0.03, -0.02, 0.0), (0.03, 0.02, 0.05)))
    options = {"size": (380, 320), "camera": camera}
    looks = FINE, snapshot.Look(section=CUT, supersample=3)
    save("pump", *(snapshot.render(scene, look=look, **options) for look in looks))


def service(scene: vp.Scene, script: str) -> None:
    """Frames of the tutorial's task."""
    kept = Frames()
    task = SimpleNamespace()
    exec(compile(script, "service.py", "exec"), task.__dict__)
    with vp.Session(scene, observers=[kept]) as session:
        task.task(session)
    camera = look_at(corners((-0.04, -0.03, 0.0), (0.14, 0.03, 0.08)))
    strip = []
    for kind, text, after in (
        ("removed", "housing and screw_1", 60),
        ("removed", "housing and cover", 20),
        ("removed", "concentric between housing and valve", 15),
    ):
        at = next(i for i, f in enumerate(kept.frames) if any(e.kind == kind and text in e.text for e in f.events))
        frame = kept.frames[at + after]
        strip.append(
            snapshot.render(
                scene,
                frame.poses,
                size=(300, 260),
                camera=camera,
                symbols=frame_symbols(frame),
                look=FINE,
            )
        )
        if len(strip) > 1:
            strip[-1][:, :1] = 255  # a line between two frames
    save("pump_service", *strip)


def surfaces(scene: vp.Scene) -> None:
    """Each surface of housing and valve in its own colour: the parts are drawn surface by surface."""
    parts = []
    for name, shift in (("housing", (0.0, 0.0, 0.0)), ("valve", (0.0, 0.0, 0.055))):
        part = scene[name]
        mesh = part.mesh
        for i in range(len(part.surfaces)):
            chosen = mesh.triangles[mesh.surface_of_triangle == i]
            used, triangles = np.unique(chosen, return_inverse=True)
            one = SurfaceMesh(mesh.vertices[used], triangles.reshape(-1, 3), np.zeros(len(chosen), np.int32))
            pose = moved(part, shift)[name]
            parts.append(vp.Part(f"{name} {i}", vp.Shape(one, (), ()), pose, COLORS[i % len(COLORS)]))
    camera = look_at(corners((-0.03, -0.02, 0.0), (0.03, 0.02, 0.1)))
    save("surfaces", snapshot.render(vp.Scene(parts), size=(420, 420), camera=camera, look=FINE))


def clash(scene: vp.Scene) -> None:
    """A cover above the housing, on it, and in it: apart, in contact, a clash."""
    pair = vp.Scene([scene["housing"], scene["cover"]])
    camera = look_at(corners((-0.03, -0.02, 0.0), (0.03, 0.02, 0.06)))
    strip = []
    for z in (0.01, 0.0, -0.004):
        poses = moved(scene["cover"], (0.004, 0.0, z))
        red: list[tuple[str, int]] = []
        if z < 0.0:
            a, b = scene["housing"], scene["cover"]
            for i, k in colliding_surfaces(a.mesh, b.mesh, a.pose.actInv(poses["cover"])).tolist():
                red += [("housing", i), ("cover", k)]
        strip.append(snapshot.render(pair, poses, red, size=(300, 260), camera=camera, look=FINE))
    save("clash", *strip)


def facets() -> None:
    """A cut across the fit, so coarse that one sees the facets cross."""
    bore = m.box(0.03, 0.03, 0.02).translated(-0.015, -0.015, 0.0) - m.cylinder(0.01002, 0.02)
    coarse = {"deflection": 8e-4, "angular": 1.0}
    parts = [
        vp.Part("bore", m.shape(bore, name="bore", **coarse), pin.SE3.Identity(), (0.55, 0.60, 0.66)),
        vp.Part(
            "shaft",
            m.shape(m.cylinder(0.010, 0.02), name="shaft", **coarse),
            pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.22])), np.zeros(3)),
            (0.85, 0.65, 0.25),
        ),
    ]
    camera = look_at(corners((-0.012, -0.012, 0.0), (0.012, 0.012, 0.02)), (0.0, -0.05, 1.0), up=(0.0, 1.0, 0.0))
    cut = ((0.0, 0.0, 0.01), (0.0, 0.0, 1.0))
    save(
        "facets",
        snapshot.render(
            vp.Scene(parts), size=(420, 420), camera=camera, look=snapshot.Look(section=cut, supersample=3)
        ),
    )


def kinds() -> None:
    """A pair of parts a kind, the upper one lifted to show the symbol of the constraint that is recognised."""
    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0)
    groove = m.cylinder(0.010, 0.04).rotated((0.0, 1.0, 0.0), np.pi / 2).translated(-0.02, 0.0, 0.02)
    pairs = {
        "against": (block, m.box(0.02, 0.02, 0.015).translated(-0.01, -0.01, 0.02)),
        "concentric": (block - m.cylinder(0.008, 0.02), m.cylinder(0.008, 0.05).translated(0.0, 0.0, -0.01)),
        "conical": (block - m.cone(0.004, 0.014, 0.02), m.cone(0.004, 0.014, 0.02)),
        "spherical": (block - m.sphere(0.012).translated(0.0, 0.0, 0.02), m.sphere(0.012).translated(0.0, 0.0, 0.02)),
        "groove": (block - groove, m.sphere(0.010).translated(0.0, 0.0, 0.02)),
    }
    strip, camera = [], look_at(corners((-0.022, -0.022, -0.01), (0.022, 0.022, 0.045)))
    for kind, (fixed, moving) in pairs.items():
        parts = [
            vp.Part("base", m.shape(fixed, name="base"), pin.SE3.Identity(), (0.70, 0.73, 0.77)),
            vp.Part("part", m.shape(moving, name="part"), pin.SE3.Identity(), (0.89, 0.60, 0.30)),
        ]
        scene, kept = vp.Scene(parts), Frames()
        with vp.Session(scene, observers=[kept], rule=vp.accept_standing) as session:
            session.scene["base"].fixed = True
            session.step()
            assert [constraint.kind for constraint in session.constraints] == [kind]
        frame = kept.frames[-1]
        poses = {**frame.poses, "part": pin.SE3(np.eye(3), np.array([0.0, 0.0, LIFT])) * frame.poses["part"]}
        options = {"symbols": frame_symbols(frame), "size": (220, 240), "camera": camera, "look": FINE}
        strip.append(snapshot.render(scene, poses, **options))
    save("kinds", *strip)


def assembly(model: Path) -> None:
    """AS1, the test assembly of the CAx Implementor Forum: as it stands, its mates, a bolt that the rod stops."""
    one = "l-bracket-assembly_1/nut-bolt-assembly_1"
    kept, scene = Frames(), vp.load(model)
    with vp.Session(scene, observers=[kept]) as session:
        session.scene["plate_1"].fixed = True
        session.thread(f"{one}/nut_3", 0.0015)
        hand = session.hand()
        hand.remove([f"{one}/nut_3"])
        with contextlib.suppress(vp.TaskError):  # the rod is in the way
            hand.remove([f"{one}/bolt_1"])
    first, last = kept.frames[0], kept.frames[-1]
    options = {"size": (400, 320), "look": FINE}
    strip = [snapshot.render(scene, first.poses, **options)]
    strip += [snapshot.render(scene, f.poses, symbols=frame_symbols(f), **options) for f in (first, last)]
    save("as1", *strip)


def study(script: str, samples: int = 120) -> None:
    """The page of a study of the tutorial, as Chromium shows it."""
    Path("fits.py").write_text(script)
    cli.main(["study", "fits.py", "--samples", str(samples), "--out", "runs"])
    page, picture = Path("runs/index.html").resolve().as_uri(), HERE / "study.png"
    options = ["--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1000,1500"]
    subprocess.run(["chromium", *options, f"--screenshot={picture}", page], check=True, capture_output=True)


def main() -> None:
    """Draw them all; that of a study only where there is a Chromium, that of AS1 only where VPFRAME_DATA has it."""
    if data := os.environ.get("VPFRAME_DATA"):
        assembly(Path(data) / "step" / "as1-oc-214.stp")
    code = blocks("tutorial.md")
    with tempfile.TemporaryDirectory() as folder, inside(folder):
        exec(compile(code["pump.py"], "pump.py", "exec"), {})
        scene = vp.load("pump.step")
        pump(scene)
        surfaces(scene)
        clash(scene)
        facets()
        kinds()
        service(scene, code["service.py"])
        if shutil.which("chromium"):
            study(code["fits.py"])


if __name__ == "__main__":
    main()
