"""Damaged files by seed: each is read as a scene or refused in one line, in bounded time and memory.

    python -m tests.reliability.mutants --count 10000 --jobs 2 --results FILE [FORMAT ...]

Mutants are read in shards, each by a child process. If it dies, the mutant that it had counts as a death, and another
child goes on with the next one. A shard is a line of the results file; shards that the file has are not run again.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import random
import re
import resource
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from tests.reliability import results
from tests.vpframe.readers import forked

ROOT = Path(__file__).parents[2]
FORMATS = ("step", "iges", "stl", "obj", "ply", "glb")
KERNEL = ("step", "iges")
"""of them, those that the CAD kernel reads"""
SHARD = 250
"""mutants that one child reads, at most"""
SILENCE = 600.0
"""s after which a child that says nothing is killed"""
IN_MEMORY = "/dev/shm" if os.path.isdir("/dev/shm") else None
LIMIT = 20.0
"""s that reading one file may take, as `vpframe.load(…, timeout=)`; twice that where one shape took all of it, and the
others are read again"""
MEMORY = 2 * 2**30
"""bytes that reading may take"""
Mutation = Callable[[bytes, random.Random], bytes]


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


MUTATIONS: tuple[Mutation, ...] = (change, digits, cut, drop, mix)

ENTITY = re.compile(rb"^#(\d+)\s*=\s*([A-Z0-9_]*)(.*?);\s*$", re.S | re.M)
REFERENCE = re.compile(rb"#(\d+)")


class _Step:
    """A STEP file as a head, entities by number, and a tail."""

    def __init__(self, data: bytes) -> None:
        found = list(ENTITY.finditer(data))
        self.head, self.tail = data[: found[0].start()], data[found[-1].end() :]
        self.entities = {int(m[1]): (m[2], m[3]) for m in found}

    def of(self, *kinds: bytes) -> list[int]:
        return [number for number, (kind, _) in self.entities.items() if kind in kinds]

    def numbers(self) -> list[int]:
        return [number for number, (_, text) in self.entities.items() if REFERENCE.search(text)]

    def point(self, number: int, rng: random.Random, to: int) -> None:
        """One reference of an entity, chosen at random, leads elsewhere."""
        kind, text = self.entities[number]
        chosen = rng.choice(list(REFERENCE.finditer(text)))
        self.entities[number] = kind, text[: chosen.start()] + b"#%d" % to + text[chosen.end() :]

    def bytes(self) -> bytes:
        lines = (b"#%d=%s%s;\n" % (number, kind, text) for number, (kind, text) in self.entities.items())
        return self.head + b"".join(lines) + self.tail


def step_reference(data: bytes, rng: random.Random) -> bytes:
    """Some references lead to entities of another kind, or to none."""
    step = _Step(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        step.point(rng.choice(step.numbers()), rng, rng.choice([*step.entities, 10**9]))
    return step.bytes()


def step_exchange(data: bytes, rng: random.Random) -> bytes:
    """A reference leads to another entity of the same kind: the file stays well-formed."""
    step = _Step(data)
    number = rng.choice(step.numbers())
    kind, text = step.entities[number]
    chosen = rng.choice(list(REFERENCE.finditer(text)))
    same = step.of(step.entities.get(int(chosen[1]), (b"", b""))[0]) or [number]
    step.entities[number] = kind, text[: chosen.start()] + b"#%d" % rng.choice(same) + text[chosen.end() :]
    return step.bytes()


def step_cycle(data: bytes, rng: random.Random) -> bytes:
    """An entity refers to itself, or to one that refers to it."""
    step = _Step(data)
    number = rng.choice(step.numbers())
    users = [n for n, (_, text) in step.entities.items() if b"#%d," % number in text or b"#%d)" % number in text]
    step.point(number, rng, rng.choice([number, *users]))
    return step.bytes()


def step_unit(data: bytes, rng: random.Random) -> bytes:
    """Another unit, none, or one that is no length."""
    units = [b".MILLI.", b"$", b".CENTI.", b".MICRO.", b".KILO.", b".PICO.", b".EXA.", b"*", b""]
    names = [b".METRE.", b".METRE.", b".RADIAN.", b".GRAM.", b".SECOND.", b"$"]
    return re.sub(rb"SI_UNIT\(\.MILLI\.,\.METRE\.\)", b"SI_UNIT(%s,%s)" % (rng.choice(units), rng.choice(names)), data)


def step_face(data: bytes, rng: random.Random) -> bytes:
    """A shell has lost some of its faces."""
    step = _Step(data)
    shell = rng.choice(step.of(b"CLOSED_SHELL", b"OPEN_SHELL"))
    kind, text = step.entities[shell]
    faces = list(REFERENCE.finditer(text))
    gone = set(rng.sample(range(len(faces)), rng.randint(1, len(faces))))
    kept = b",".join(m[0] for i, m in enumerate(faces) if i not in gone)
    step.entities[shell] = kind, re.sub(rb"\([^()]*\)\)\s*$", b"(%s))" % kept, text)
    return step.bytes()


def step_delete(data: bytes, rng: random.Random) -> bytes:
    """Some entities are gone; references to them lead nowhere."""
    step = _Step(data)
    for _ in range(rng.choice((1, 2, 10))):
        step.entities.pop(rng.choice(list(step.entities)))
    return step.bytes()


def step_number(data: bytes, rng: random.Random) -> bytes:
    """A coordinate or a size is nought, negative, huge, or no number."""
    step = _Step(data)
    kinds = (b"CARTESIAN_POINT", b"DIRECTION", b"CYLINDRICAL_SURFACE", b"CIRCLE", b"VECTOR", b"TOROIDAL_SURFACE")
    for _ in range(rng.choice((1, 2, 8))):
        number = rng.choice(step.of(*kinds))
        kind, text = step.entities[number]
        numbers = list(re.finditer(rb"-?\d+\.\d*(?:E[+-]?\d+)?", text))
        if numbers:
            chosen = rng.choice(numbers)
            other = rng.choice([b"0.", b"-1.", b"1.E+30", b"1.E+308", b"1.E-300", b"NAN", b"INF", b"1.E+999"])
            step.entities[number] = kind, text[: chosen.start()] + other + text[chosen.end() :]
    return step.bytes()


def step_sense(data: bytes, rng: random.Random) -> bytes:
    """Some orientations are turned round."""
    return re.sub(rb"\.[TF]\.", lambda m: rng.choice((m[0], m[0], m[0], b".T.", b".F.")), data)


STEP_MUTATIONS: tuple[Mutation, ...] = (
    step_reference, step_exchange, step_cycle, step_unit, step_face, step_delete, step_number, step_sense,
)  # fmt: skip


def _ring(n: int, radius: float, height: float) -> list[bytes]:
    turns = (2.0 * math.pi * i / n for i in range(n))
    return [b"v %.6f %.6f %.6f\n" % (radius * math.cos(a), radius * math.sin(a), height) for a in turns]


def obj_prism(data: bytes, rng: random.Random) -> bytes:
    """A prism, frustum or chamfered disc of many sides, whose ends are polygons."""
    n = rng.choice((3, 100, 2000, 8000))
    faces = [b"f %d %d %d %d\n" % (i + 1, (i + 1) % n + 1, n + (i + 1) % n + 1, n + i + 1) for i in range(n)]
    ends = [b"f " + b" ".join(b"%d" % i for i in order) + b"\n" for order in (range(n, 0, -1), range(n + 1, 2 * n + 1))]
    radius = rng.choice((50.0, 49.9, 20.0, 0.0))
    return b"".join([*_ring(n, 50.0, 0.0), *_ring(n, radius, rng.choice((0.1, 20.0))), *faces, *ends])


def obj_polygon(data: bytes, rng: random.Random) -> bytes:
    """A face of many corners: convex, a star, on a line, or the same few corners again and again."""
    n = rng.choice((5, 500, 5000, 20000))
    turns = [2.0 * math.pi * i / n for i in range(n)]
    corners = {
        "convex": [(50.0 * math.cos(a), 50.0 * math.sin(a)) for a in turns],
        "star": [
            ((50.0 - 20.0 * (i % 2)) * math.cos(a), (50.0 - 20.0 * (i % 2)) * math.sin(a)) for i, a in enumerate(turns)
        ],
        "line": [(float(i), 5.0 * (i == n - 1)) for i in range(n)],
    }[rng.choice(("convex", "star", "line"))]
    face = [i + 1 for i in range(n)] if rng.random() < 0.7 else [1 + rng.randrange(n) for _ in range(n)]
    vertices = b"".join(b"v %.6f %.6f %.6f\n" % (x, y, rng.choice((0.0, 1e-4))) for x, y in corners)
    return vertices + b"f " + b" ".join(b"%d" % i for i in face) + b"\n"


def obj_repeated(data: bytes, rng: random.Random) -> bytes:
    """Faces again and again, of the same or of almost the same corners, wound either way."""
    lines = data.splitlines(keepends=True)
    faces = [line for line in lines if line.startswith(b"f ")]
    times = rng.choice((1, 3, 10000 // len(faces) + 1))
    back = [b"f " + b" ".join(reversed(face.split()[1:])) + b"\n" for face in faces]
    return data + b"\n" + b"".join(rng.choice((faces, faces, back))[i] for _ in range(times) for i in range(len(faces)))


def obj_text(data: bytes, rng: random.Random) -> bytes:
    """Materials that are none, objects of one name, names that no terminal shows."""
    word = rng.choice(
        (b"mtllib " + b"x" * 5000, b"mtllib /dev/zero", b"mtllib .", b"o a", b"o", b"g \xed\xa0\x80", b"o \x1b[2J")
    )
    lines = data.splitlines(keepends=True)
    for _ in range(rng.choice((1, 3, 50))):
        lines.insert(rng.randrange(len(lines)), word + b"\n")
    return b"".join(lines)


def stl_repeated(data: bytes, rng: random.Random) -> bytes:
    """A binary file whose triangles come again, turned over or moved by less than can be told apart."""
    if data.startswith(b"solid"):
        body = data[data.index(b"facet") : data.rindex(b"endfacet") + 8] + b"\n"
        return data.replace(b"endsolid", body * rng.choice((1, 20)) + b"endsolid", 1)
    rows = [data[at : at + 50] for at in range(84, len(data) - 49, 50)]
    for row in [rng.choice(rows) for _ in range(rng.choice((1, 50, 9600)))]:
        turned = row[:12] + row[24:36] + row[12:24] + row[36:]
        rows.append(rng.choice((row, turned, row[:12] + bytes([row[12] ^ 1]) + row[13:])))
    return data[:80] + struct.pack("<I", len(rows)) + b"".join(rows)


def glb_tree(data: bytes, rng: random.Random) -> bytes:
    """The JSON has a value of another kind, or a name that no encoding has."""
    length = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + length])
    values = ["x", None, -1, 10**9, 0.5, True, [], {}, [0], "\ud800", "\x1b[2J", 1e308, [1e30] * 16]

    def places(at: Any) -> Iterator[tuple[Any, Any]]:
        for key in list(at) if isinstance(at, dict) else range(len(at)) if isinstance(at, list) else ():
            yield at, key
            yield from places(at[key])

    for _ in range(rng.choice((1, 1, 3))):
        at, key = rng.choice(list(places(tree)))
        at[key] = rng.choice(values)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    return data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + data[16:20] + text + rest


OWN: dict[str, tuple[Mutation, ...]] = {
    "step": STEP_MUTATIONS,
    "stl": (stl_repeated,),
    "obj": (obj_prism, obj_polygon, obj_repeated, obj_text),
    "glb": (glb_tree,),
}
"""mutations by format that keep to its grammar"""


def models(folder: Path) -> dict[str, list[tuple[str, bytes]]]:
    """Format -> suffix and bytes of sound files of it."""
    import numpy as np
    import trimesh
    from OCP.IGESControl import IGESControl_Writer

    from vpframe.scene import modelling as m

    plate = m.box(0.06, 0.04, 0.01) - m.cylinder(0.004, 0.01).translated(0.02, 0.02)
    parts = {
        "plate": (plate, None, (0.5, 0.2, 0.1), 7850.0),
        "pair": ({"pin_1": m.cylinder(0.004, 0.03), "ring": m.torus(0.01, 0.002)}, None),
        "tip": m.cone(0.004, 0.0, 0.01) + m.sphere(0.003),
    }
    step = m.write_step(folder / "a.step", parts).read_bytes()
    writer = IGESControl_Writer("MM", 0)
    writer.AddShape(plate.occ)
    writer.ComputeModel()
    assert writer.Write(str(folder / "a.igs"))
    mesh = trimesh.Trimesh(m.shape(plate).mesh.vertices, m.shape(plate).mesh.triangles, process=False)
    scene = trimesh.Scene([mesh])
    scene.add_geometry(trimesh.creation.box((0.01, 0.02, 0.03)), transform=np.diag([1.0, 2.0, 1.0, 1.0]))

    def exported(form: str, **options: Any) -> bytes:
        data = trimesh.exchange.export.export_mesh(mesh, None, form, **options)
        return data.encode() if isinstance(data, str) else data

    return {
        "step": [("step", step)],
        "iges": [("igs", (folder / "a.igs").read_bytes())],
        "stl": [("stl", exported("stl")), ("stl", exported("stl_ascii"))],
        "obj": [("obj", exported("obj")), ("obj", b"o a\n" + exported("obj").replace(b"\nf", b"\ng b\nf", 1))],
        "ply": [("ply", exported("ply")), ("ply", exported("ply", encoding="ascii"))],
        "glb": [("glb", exported("glb")), ("glb", scene.export(file_type="glb"))],
    }


def mutant(form: str, seed: int, sound: list[tuple[str, bytes]]) -> tuple[str, str, bytes]:
    """Name of the mutation, suffix and bytes of one mutant; half of them keep to the grammar of the format."""
    rng = random.Random(f"{form} {seed}")
    suffix, data = rng.choice(sound)
    mutation = rng.choice(OWN[form] if form in OWN and seed % 2 else MUTATIONS)
    return mutation.__name__, suffix, mutation(data, rng)


def clocks() -> tuple[float, float]:
    """Processor time of this process and of those that it has waited for, and the clock's, s.

    Of a file the shorter counts: a busy machine lengthens the clock's, threads of the kernel the processor's.
    """
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used), time.monotonic()


def digest(scene: Any) -> str:
    """Of all that a reader takes from a file: names, places, triangles."""
    sha = hashlib.sha256()
    for part in scene.parts:
        sha.update(repr(part.name).encode() + part.pose.homogeneous.tobytes())
        sha.update(part.mesh.vertices.tobytes() + part.mesh.triangles.tobytes())
    return sha.hexdigest()


def read(form: str, first: int, end: int, folder: Path, fork: bool) -> None:
    """Read mutants `first` … `end` - 1 and print what came of each. Reading processes are forked if `fork`."""
    import numpy as np

    import vpframe as vp

    sound = models(folder)[form]
    with forked() if fork else contextlib.nullcontext():
        originals: dict[str, tuple[str, ...]] = {}
        for suffix, data in sound:
            path = folder / f"model.{suffix}"  # of one name, as parts may be named by it
            path.write_bytes(data)
            scene = vp.load(path)
            originals[digest(scene)] = scene.all_notes()
        known = {note for notes in originals.values() for note in notes}
        for seed in range(first, end):
            name, suffix, data = mutant(form, seed, sound)
            path = folder / f"model.{suffix}"
            path.write_bytes(data)
            found: dict[str, Any] = {"seed": seed, "mutation": name}
            print(json.dumps({"begins": seed}), flush=True)
            began = clocks()
            try:
                scene = vp.load(path, timeout=LIMIT)
            except vp.LoadError as error:
                told = "\n" not in str(error) and str(error).startswith(str(path))
                found |= {"outcome": "refused" if told else "foreign", "why": str(error)[-200:]}
            except Exception as error:
                found |= {"outcome": "foreign", "why": f"{type(error).__name__}: {error}"[:200]}
            else:
                finite = all(np.isfinite(p.mesh.vertices).all() and np.isfinite(p.shape.volume) for p in scene.parts)
                changed = digest(scene) not in originals
                silent = changed and known.issuperset(scene.all_notes())
                found |= {"outcome": "read" if finite else "foreign", "silent": silent, "changed": changed}
            used = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
            found |= {"seconds": min(b - a for a, b in zip(began, clocks(), strict=True)), "memory": 1024 * used}
            print(json.dumps(found), flush=True)
            path.unlink()


def outcomes(form: str, count: int, first: int = 0, fork: bool = True) -> Iterator[dict[str, Any]]:
    """What came of each of `count` mutants from seed `first` on."""
    seed, end = first, first + count
    with tempfile.TemporaryDirectory(prefix="vpframe-mutants-", dir=IN_MEMORY) as folder:
        environment = {**os.environ, "TMPDIR": folder, "VPFRAME_CACHE": str(Path(folder, "cache"))}
        while seed < end:
            words = ["--child", form, str(seed), str(end), folder, str(int(fork))]
            child = subprocess.Popen(
                [sys.executable, "-m", "tests.reliability.mutants", *words], stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, text=True, cwd=ROOT, env=environment,
            )  # fmt: skip
            assert child.stdout is not None
            begun = None
            watch = _watch(child)
            for line in child.stdout:
                watch.cancel()
                watch = _watch(child)
                try:
                    found = json.loads(line)
                except ValueError:
                    if not line.startswith("compiling "):
                        yield {"seed": begun, "mutation": "", "outcome": "foreign", "why": f"prints {line[:100]!r}"}
                    continue
                if "begins" in found:
                    begun = found["begins"]
                    continue
                yield found
                seed, begun = found["seed"] + 1, None
            code = child.wait()
            watch.cancel()
            if begun is not None:
                yield {"seed": begun, "mutation": "", "outcome": "death", "why": f"exit code {code}", "memory": 0}
                seed = begun + 1
            elif seed < end:
                raise RuntimeError(f"the process that reads {form} ended with exit code {code}")


def _watch(child: subprocess.Popen[str]) -> threading.Timer:
    """A timer that kills a child for not ending with one file."""
    timer = threading.Timer(SILENCE, child.kill)
    timer.daemon = True
    timer.start()
    return timer


def row(form: str, count: int, first: int = 0, fork: bool = True) -> dict[str, Any]:
    """The line of the table of one format, and the mutants that should not have come out so."""
    counted: Counter[str] = Counter()
    slowest, memory = 0.0, 0
    faults, silent = [], Counter[str]()
    for one in outcomes(form, count, first, fork):
        counted[one["outcome"]] += 1
        over = memory <= MEMORY < one.get("memory", 0)
        slowest, memory = max(slowest, one.get("seconds", 0.0)), max(memory, one.get("memory", 0))
        if one.get("silent"):
            silent[one["mutation"]] += 1
        if one["outcome"] in ("death", "foreign") or one.get("seconds", 0.0) > 2.0 * LIMIT + 5.0 or over:
            faults.append(one)
    return {
        "what": form, "first": first, "count": count,
        **{name: counted[name] for name in ("read", "refused", "foreign", "death")},
        "slowest": slowest, "memory": memory, "silent": dict(silent), "faults": faults,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("formats", nargs="*", choices=[*FORMATS, []], default=FORMATS)
    parser.add_argument("--count", type=int, default=1000, help="mutants of each format")
    results.arguments(parser)
    given = parser.parse_args()
    results.run(row, given.formats, given.count, SHARD, given)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        read(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]), sys.argv[6] == "1")
    else:
        main()
