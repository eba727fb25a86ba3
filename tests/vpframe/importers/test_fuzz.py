"""Files with bytes changed, missing or doubled: a scene, or one line; never an exception of somebody else."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

import vpframe as vp
from vpframe.scene import modelling as m

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


def change(data: bytes, rng: random.Random) -> bytes:
    """Some bytes get other values."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 2, 4, 16, 100))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def digits(data: bytes, rng: random.Random) -> bytes:
    """Some digits, signs and points become others: what is read is sound, what it says is not."""
    out = bytearray(data)
    places = [i for i, byte in enumerate(data) if byte in b"0123456789.-+E"] or [0]
    for _ in range(rng.choice((1, 2, 8, 32))):
        out[rng.choice(places)] = rng.choice(b"0123456789.-E")
    return bytes(out)


def cut(data: bytes, rng: random.Random) -> bytes:
    """The end is missing."""
    return data[: rng.randrange(len(data))]


def drop(data: bytes, rng: random.Random) -> bytes:
    """Some lines are missing."""
    lines = data.splitlines(keepends=True)
    for _ in range(rng.choice((1, 2, 5))):
        lines.pop(rng.randrange(len(lines)))
        lines = lines or [b"\n"]
    return b"".join(lines)


def mix(data: bytes, rng: random.Random) -> bytes:
    """Some lines change places or are there twice."""
    lines = data.splitlines(keepends=True)
    for _ in range(rng.choice((1, 3))):
        lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return b"".join(lines)


MUTATIONS: tuple[Callable[[bytes, random.Random], bytes], ...] = (change, digits, cut, drop, mix)


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> dict[str, list[tuple[str, bytes]]]:
    """Format -> suffix and bytes of sound files of it."""
    folder = tmp_path_factory.mktemp("models")
    plate = m.box(0.06, 0.04, 0.01) - m.cylinder(0.004, 0.01).translated(0.02, 0.02)
    parts = {
        "plate": (plate, None, (0.5, 0.2, 0.1), 7850.0),
        "pair": ({"pin_1": m.cylinder(0.004, 0.03), "ring": m.torus(0.01, 0.002)}, None),
        "tip": m.cone(0.004, 0.0, 0.01) + m.sphere(0.003),
    }
    step = m.write_step(folder / "a.step", parts).read_bytes()
    mesh = trimesh.Trimesh(m.shape(plate).mesh.vertices, m.shape(plate).mesh.triangles, process=False)
    scene = trimesh.Scene([mesh])
    scene.add_geometry(trimesh.creation.box((0.01, 0.02, 0.03)), transform=np.diag([1.0, 2.0, 1.0, 1.0]))

    def exported(form: str, **options) -> bytes:
        data = trimesh.exchange.export.export_mesh(mesh, None, form, **options)
        return data.encode() if isinstance(data, str) else data

    return {
        "step": [("step", step)],
        "stl": [("stl", exported("stl")), ("stl", exported("stl_ascii"))],
        "obj": [("obj", exported("obj")), ("obj", b"o a\n" + exported("obj").replace(b"\nf", b"\ng b\nf", 1))],
        "ply": [("ply", exported("ply")), ("ply", exported("ply", encoding="ascii"))],
        "glb": [("glb", exported("glb")), ("glb", scene.export(file_type="glb"))],
    }


@pytest.mark.parametrize("form", ["step", "stl", "obj", "ply", "glb"])
def test_damaged_files_are_a_scene_or_one_line(form, models, tmp_path, capfd):
    foreign: list[str] = []
    outcomes = {"read": 0, "refused": 0}
    for seed in range(50 if form == "step" else 200):  # the kernel takes over a second to start
        rng = random.Random(f"{form} {seed}")
        suffix, data = rng.choice(models[form])
        mutation = rng.choice(MUTATIONS)
        path = tmp_path / f"{seed}.{suffix}"
        path.write_bytes(mutation(data, rng))
        try:
            scene = vp.load(path, **({"timeout": 20.0} if form == "step" else {}))
        except vp.LoadError as error:
            outcomes["refused"] += 1
            if "\n" in str(error) or not str(error).startswith(str(path)):
                foreign.append(f"seed {seed} ({mutation.__name__}): {error!r}")
        except Exception as error:
            foreign.append(f"seed {seed} ({mutation.__name__}): {type(error).__name__}: {error}")
        else:
            outcomes["read"] += 1
            for part in scene.parts:
                assert np.isfinite(part.mesh.vertices).all() and np.isfinite(part.shape.volume)
        path.unlink()
    assert foreign == []
    assert min(outcomes.values()) > 5
    assert capfd.readouterr() == ("", "")
