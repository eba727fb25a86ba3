"""STEP and IGES through OpenCascade in a separate process, so that a crash of the kernel cannot end this one.

See `guarded`.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.errors import LoadError
from vpframe.importers import archive, guarded, limits
from vpframe.importers.checks import FORMATS, iges_damage
from vpframe.importers.raw import Options, Progress, RawScene, RawShape
from vpframe.importers.step_text import StepText, circular_uses, scan, without

PACKAGES = ("OCP", "manifold3d", "numpy")
"""needed in the reading process"""
_EXTERNAL = re.compile(rb"DOCUMENT_FILE\s*\(\s*'((?:[^']|'')+)'")


def files_of(path: Path, form: str) -> list[Path]:
    """Return the file and all existing files that a STEP assembly refers to, directly or indirectly."""
    found = [path]
    for file in found:
        if form == "step":
            names = (name.replace(b"''", b"'").decode("utf-8", "replace") for name in _EXTERNAL.findall(_bytes(file)))
            beside = (file.parent / name for name in dict.fromkeys(names))
            found.extend(other for other in beside if other not in found and other.is_file())
    return found


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise LoadError(f"{file}: cannot be read ({error.strerror}); check its permissions", str(file)) from None


def read(
    files: Sequence[Path],
    form: str,
    options: Options,
    settle: Callable[[RawShape], RawShape],
    given: Sequence[Any] = (),
) -> RawScene:
    """Return the raw scene of a file; `form` is "step", "iges", "brep" or "mjcf"; `files`: it and those it refers to.

    "given" is a tree of B-reps in `files`: `given` are its roots in the form of `_reader`. `settle` is called with each
    shape while the kernel process continues.

    A shape that crashes the kernel's mesher, or on which that does not end, is meshed without it; one that exceeds
    time or memory is left out, and named in the notes. Raises LoadError if the file cannot be read within its limits
    (`limits.of_cad`), or its unit of length is unknown.
    """
    path = files[0]
    with ThreadPoolExecutor(1) as pool:  # reads the text while the kernel starts
        texts = pool.submit(lambda: [scan(_bytes(file)) for file in files] if form == "step" else [])
        faults = _Faults(files, texts)
        with _acyclic(path, form, len(files)) as source:
            raw = _read_guarded(source, form, options, settle, faults, given)
    if form == "iges" and (damage := iges_damage(_bytes(path))):
        raw.notes.append(f"{damage}: faces or parts may be missing")
    if form == "step":
        text = texts.result()[0]
        if text.damage:
            raw.notes.append(f"damaged: {text.damage_summary()}: faces or parts may be missing")
        raw.notes.extend(f"{name} is used in itself: that use is left out" for name in text.circular.values())
        if any(t.no_unit for t in texts.result()):
            raw.notes.append("names no length unit for some of its shapes: millimetres are taken")
        for file, own in zip(files, texts.result(), strict=True):
            raw.notes.extend(_missing_files(file, own))
        raw.notes.extend(text.lost(raw.instances, raw.faces))
    return raw


@contextlib.contextmanager
def _acyclic(path: Path, form: str, count: int) -> Iterator[Path]:
    """Give a copy of a STEP file (of `count` files) without assemblies that contain themselves; else the file."""
    data = _bytes(path) if form == "step" and count == 1 else b""
    uses = circular_uses(data)
    if not uses:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        copy = Path(folder, path.name)
        copy.write_bytes(without(data, uses))
        try:
            yield copy
        except LoadError as error:
            raise LoadError(str(error).replace(str(copy), str(path)), str(path)) from None


class _Faults:
    """The files of a model, and the faults that their text reveals."""

    def __init__(self, files: Sequence[Path], texts: Future[list[StepText]]) -> None:
        self.files = files
        self.size = sum(file.stat().st_size for file in files)
        self._texts = texts

    def check_units(self) -> None:
        """Raise LoadError for a unit of length that the kernel would misread."""
        for file, text in zip(self.files, self._texts.result(), strict=False):
            if text.unit_fault:
                raise LoadError(f"{file}: {text.unit_fault}; export it again, in millimetres", str(self.files[0]))

    def end_if_refused(self, process: subprocess.Popen[str]) -> None:
        """Kill the reading process as soon as the text shows a refused unit of length, since it may take long."""

        def look(texts: Future[list[StepText]]) -> None:
            if not texts.cancelled() and texts.exception() is None and any(t.unit_fault for t in texts.result()):
                process.kill()

        self._texts.add_done_callback(look)

    def damage(self) -> str:
        """Describe damaged or missing data in one line; empty if there is none."""
        if not self._texts.result():
            return ""
        text = self._texts.result()[0]
        missing = (
            line
            for file, own in zip(self.files, self._texts.result(), strict=True)
            for line in _missing_files(file, own)
        )
        return "; ".join(filter(None, [text.damage_summary(), *missing]))


def _missing_files(path: Path, text: StepText) -> list[str]:
    """Return a line for each referenced file that is missing or no STEP file."""
    lines = []
    for name in dict.fromkeys(text.external):
        if not (path.parent / name).exists():
            lines.append(f"{name}, which {path.name} refers to, does not lie beside it: put it there")
        elif FORMATS.get(Path(name).suffix.lower()) != "step":
            lines.append(f"{name}, which {path.name} refers to, is no STEP file: what it holds is left out")
    return lines


def _read_guarded(
    path: Path,
    form: str,
    options: Options,
    settle: Callable[[RawShape], RawShape],
    faults: _Faults,
    given: Sequence[Any],
) -> RawScene:
    within = limits.of_cad(faults.size, options.timeout)
    request = {
        "path": str(path.resolve()),
        "format": form,
        "deflection": options.deflection,
        "angular": options.angular,
        "bodies": options.bodies,
        "folders": guarded.package_folders(path.resolve().parent, PACKAGES),
        "given": given,
    }
    outcome, raw = _read_once(request, within, options.progress, settle, faults)
    if raw is not None:
        return raw
    where = faults.damage()
    if outcome.error is not None:
        raise LoadError(f"{path}: {outcome.error}{f' ({where})' if where else ''}", str(path))
    damage = f"it is damaged: {where}" if where else "it is probably damaged"
    mend = "open it in a CAD program and export it again"
    how = outcome.how_it_ended()
    if outcome.late and options.timeout is None:
        how += f", the limit for {faults.size / limits.MEGABYTE:.1f} MB,"
    if (outcome.late or outcome.memory) and not where:
        damage = f"it is damaged, or takes a coarser deflection{' or a longer timeout' if outcome.late else ''}"
    raise LoadError(f"{path}: {how} {outcome.where_it_ended()}; {damage}; {mend}", str(path))


def _read_once(
    request: dict[str, Any],
    within: limits.ReadingLimits,
    progress: Progress | None,
    settle: Callable[[RawShape], RawShape],
    faults: _Faults,
) -> tuple[guarded.Reading, RawScene | None]:
    """Run the process once; return its outcome, and on success the raw scene. Shapes are settled meanwhile."""
    worker = ThreadPoolExecutor(1)
    shapes: dict[int, Future[RawShape]] = {}
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:

        def ready(number: int) -> None:
            archived = os.path.join(folder, f"{number}.archive")
            shapes[number] = worker.submit(lambda: settle(archive.read(archived).shapes[0]))

        try:
            begun = guarded.Reading(within)
            outcome = guarded.run({**request, "out": folder}, folder, begun, progress, ready, faults.end_if_refused)
            faults.check_units()
            if not outcome.done:
                return outcome, None
            raw = archive.read(os.path.join(folder, "scene.archive"))
            raw.shapes = [shapes[number].result() for number in sorted(shapes)]
            return outcome, _without_empty(raw, faults.files[0])
        finally:
            worker.shutdown(cancel_futures=True)


def _without_empty(raw: RawScene, path: Path) -> RawScene:
    """Return the scene without parts that lost all faces (triangles of zero area); its notes name them."""
    empty = [not shape.faces for shape in raw.shapes]
    if not any(empty):
        return raw
    lost = [part.name for part in raw.parts if empty[part.shape]]
    raw.notes.extend(f"part {name} is lost: it has no triangle of positive area" for name in lost)
    raw.parts = [part for part in raw.parts if not empty[part.shape]]
    if not raw.parts:
        raise LoadError(f"{path}: holds no triangle of positive area; check it in a CAD program", str(path))
    place = np.cumsum([not each for each in empty]) - 1
    for part in raw.parts:
        part.shape = int(place[part.shape])
    raw.shapes = [shape for shape in raw.shapes if shape.faces]
    return raw


def in_kernel(request: dict[str, Any], folder: str, limit: float, size: int) -> str:
    """Run a request other than reading in the process; return the reason of a failure, "" on success.

    folder: temporary folder for its output. limit: s of processor time. size: of its input, bytes.
    """
    whole = {**request, "folders": guarded.package_folders(Path(folder), PACKAGES)}
    outcome = guarded.run(whole, folder, guarded.Reading(limits.of_cad(size, limit)))
    return "" if outcome.done else outcome.error or f"{outcome.how_it_ended()} {outcome.where_it_ended()}"


def measure(shapes: Sequence[RawShape]) -> None:
    """Set volume, centre and inertia of shapes to those of the exact solids in `brep`.

    A shape without plausible ones, or on which the kernel fails, keeps None and has a note.
    """
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        source = os.path.join(folder, "breps.archive")
        empty = np.empty((0, 3)), np.empty((0, 3), np.int32), np.empty(0, np.int32)
        breps = [RawShape(*empty, each.faces, brep=each.brep, bounds=each.bounds) for each in shapes]
        archive.write(RawScene(breps), source)
        folders = guarded.package_folders(Path(folder), PACKAGES)
        request = {"format": "measure", "path": source, "out": folder, "folders": folders}
        done: list[int] = []
        begun = guarded.Reading(limits.of_cad(sum(len(each.brep) for each in shapes)))
        outcome = guarded.run(request, folder, begun, None, done.append)
        why = "" if outcome.done else f" ({outcome.how_it_ended()} {outcome.where_it_ended()})"
        for number in done:
            found, own = archive.read(os.path.join(folder, f"{number}.archive")).shapes[0], shapes[number]
            own.volume, own.center, own.inertia = found.volume, found.center, found.inertia
            own.notes.extend(found.notes)
        for number in set(range(len(shapes))).difference(done):
            shapes[number].notes.append(f"its exact volume cannot be computed{why}: that of its triangles is taken")
