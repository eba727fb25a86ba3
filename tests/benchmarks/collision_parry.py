"""Parry (Rust) asked the questions that `collision_peers` asks coal, by the program in `peers/parry`.

The program times the queries itself, so a time holds no call from Python.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path

import pinocchio as pin

from collision import SurfaceMesh

FOLDER = Path(__file__).parent / "peers" / "parry"
PROGRAM = FOLDER / "target" / "release" / "parry_peer"
MISSING = (
    ""
    if PROGRAM.is_file()
    else "Parry is left out: cargo build --release --manifest-path "
    + str((FOLDER / "Cargo.toml").relative_to(Path(__file__).parents[2]))
)


def ask(
    question: str, a: SurfaceMesh, b: SurfaceMesh, poses: Sequence[pin.SE3], passes: int,
    near: Sequence[list[tuple[int, int]]] = (),
) -> tuple[float, list[list[float]]]:  # fmt: skip
    """Return seconds a query, and the numbers that Parry answers for each pose.

    Parameters
    ----------
    question: "pairs": those of `near` in collision, two numbers a pair; "collide": 1 or 0; "distance": m.
    near: surface pairs to test at each pose, for "pairs".
    """
    words: list[object] = [question, passes, *_words(a), *_words(b), len(poses)]
    for k, pose in enumerate(poses):
        words += [*pose.rotation.reshape(-1).tolist(), *pose.translation.tolist()]
        if near:
            words += [len(near[k]), *(i for pair in near[k] for i in pair)]
    text = " ".join(map(str, words))
    done = subprocess.run([PROGRAM], input=text, capture_output=True, text=True, check=True)
    seconds, *answers = done.stdout.split("\n")
    return float(seconds), [[float(word) for word in line.split()] for line in answers[: len(poses)]]


def pairs(answers: Iterable[list[float]]) -> list[set[tuple[int, int]]]:
    """Return the surface pairs in each answer to "pairs"."""
    return [{(int(s), int(t)) for s, t in zip(line[::2], line[1::2], strict=True)} for line in answers]


def _words(mesh: SurfaceMesh) -> list[object]:
    rows = zip(mesh.surface_of_triangle.tolist(), mesh.triangles.tolist(), strict=True)
    return [
        len(mesh.vertices), mesh.n_triangles, mesh.n_surfaces, *mesh.vertices.reshape(-1).tolist(),
        *(i for surface, corners in rows for i in (surface, *corners)),
    ]  # fmt: skip
