"""Checkpoint and resume: a journal with the changes of every step and, at intervals, the whole state.

A task script keeps its own position, so a resumed run executes the script again from the start. Up to the last saved
state, the result of each step is read from the journal instead of computed; the step must have the same inputs (hand
targets, decisions). At the saved state the state is restored and later steps are computed as usual. The file is
append-only; a run killed during a write loses only the steps after its last saved state.

File format: a line that names the format, then records. A record is a tag of four letters, the length and CRC-32 of the
payload (uint32, little-endian), and the payload, a value encoded by `vpframe.codec`. Nothing in the file is executed;
data that does not fit the scene is rejected.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.codec import WRONG, CodecError
from vpframe.errors import CheckpointError, OutputError
from vpframe.outputs import CHECKPOINT, append, claimed
from vpframe.scene.scene import Scene
from vpframe.session.engine import Engine
from vpframe.session.readings import Readings
from vpframe.session.state import CODEC, Changes, Decision, StateError
from vpframe.session.step import HandTarget, Inputs, advance

_MAGIC = b"vpframe journal 2\n"
_OLD = b"vpframe journal 1\n"
_HEADER = struct.Struct("<4sII")  # tag, length, crc32 of the payload
_HEAD, _STEP, _SAVE = b"HEAD", b"STEP", b"SAVE"


class Journal:
    """The journal of one run.

    Parameters
    ----------
    path: the file, or its `Output`.
    run: inputs of the run (script, model, time step) by name; a journal with other values is not resumed.
    resume: whether to continue from the existing file; otherwise it is overwritten.
    every: number of steps between saved states.
    """

    def __init__(
        self, path: str | os.PathLike[str], run: Mapping[str, str], resume: bool = False, every: int = 60
    ) -> None:
        self.path = Path(path)
        self.every = every
        self._past: list[bytes] = []
        self._at = 0  # index of the next step in `_past`
        self.saved: bytes | None = None
        """encoded state after the last step of `_past`"""
        self._step = 0
        end = self._read(dict(run)) if resume and self.path.exists() and self.path.stat().st_size else 0
        try:
            self._output = claimed(path, CHECKPOINT)
            self._file = self._output.open(end)
        except OutputError as error:
            raise CheckpointError(str(error), error.path) from None
        if not end:
            self._put(_MAGIC)
            self._put(_record(_HEAD, CODEC.encode({"schema": CODEC.schema, "run": dict(run)})))

    @property
    def past(self) -> list[bytes]:
        """Encoded steps not yet replayed, in order."""
        return self._past[self._at :]

    @property
    def left(self) -> int:
        """Number of recorded steps not yet replayed."""
        return len(self._past) - self._at

    @property
    def replaying(self) -> bool:
        """Whether recorded steps remain to be replayed."""
        return self.left > 0

    def recorded(self, digest: bytes) -> Any:
        """Return the recorded result of the next step, whose inputs must have this `digest`.

        Raises
        ------
        CheckpointError: the inputs differ from those recorded, or the record is damaged.
        """
        with self.undamaged():
            recorded, result = CODEC.decode(self._past[self._at])
        if recorded != digest:
            raise CheckpointError(
                f"{self.path}: at step {self._step + 1} the run has other inputs than those in this checkpoint "
                "(the script may read a clock or random numbers); run it without --resume",
                str(self.path),
                self._step + 1,
            )
        return result

    def advance(self, digest: bytes, result: Any, save: Callable[[], bytes]) -> None:
        """Go on to the next step: write it with its inputs' digest, and at intervals the state that `save` returns,
        unless it was read from the file. The file keeps all of it or nothing.

        Raises CheckpointError if the file cannot be written.
        """
        if self.replaying:
            self._at += 1
        else:
            data = _record(_STEP, CODEC.encode((digest, result)))
            if (self._step + 1) % self.every == 0:
                data += _record(_SAVE, save())
            self._put(data)
        self._step += 1

    @contextlib.contextmanager
    def undamaged(self) -> Iterator[None]:
        """Convert any error about damaged data raised inside to a one-line CheckpointError."""
        try:
            yield
        except CheckpointError:
            raise
        except WRONG as error:
            what = " ".join(str(error).split()) or type(error).__name__
            what = what if isinstance(error, CodecError | StateError) else f"damaged: {what}"
            raise CheckpointError(f"{self.path}: {what}; run it without --resume", str(self.path), self._step) from None

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._output.close()

    def _put(self, data: bytes) -> None:
        """Append all of the data or nothing."""
        end = self._file.tell() if self._file.seekable() else -1
        try:
            append(self._file, data)
        except BaseException as error:
            if end >= 0 and self._file.tell() != end:
                self._file.truncate(end)
                self._file.seek(end)
            if isinstance(error, OSError):
                text = f"{self.path}: cannot be written: {error.strerror}"
                raise CheckpointError(text, str(self.path)) from None
            raise

    def _read(self, run: dict[str, str]) -> int:
        """Read the file up to its last saved state; return the length of that section (0: no saved state)."""
        data = self.path.read_bytes()
        if data.startswith(_OLD):
            raise CheckpointError(
                f"{self.path}: a checkpoint of an older version of vpframe, which is not read any more; "
                "run it without --resume",
                str(self.path),
            )
        if not data.startswith(_MAGIC):
            raise CheckpointError(
                f"{self.path}: not a vpframe checkpoint; name the file that --checkpoint wrote", str(self.path)
            )
        at, end, steps, complete = len(_MAGIC), 0, [], 0
        while at + _HEADER.size <= len(data):
            tag, length, crc = _HEADER.unpack_from(data, at)
            payload = data[at + _HEADER.size : at + _HEADER.size + length]
            if len(payload) < length:
                break  # cut off in the middle of a write
            if zlib.crc32(payload) != crc or (tag == _HEAD) != (at == len(_MAGIC)):
                if at == len(_MAGIC):  # the header, which names the inputs of the run
                    raise CheckpointError(
                        f"{self.path}: damaged at its beginning; run it without --resume", str(self.path)
                    )
                break
            at += _HEADER.size + length
            if tag == _HEAD:
                with self.undamaged():
                    self._same_run(CODEC.decode(payload), run)
            elif tag == _STEP:
                steps.append(payload)
            elif tag == _SAVE:
                self.saved, complete, end = payload, len(steps), at
        self._past = steps[:complete]
        return end

    def _same_run(self, head: Any, run: dict[str, str]) -> None:
        if head["schema"] != CODEC.schema:
            raise CheckpointError(
                f"{self.path}: a checkpoint of another version of vpframe; run it without --resume", str(self.path)
            )
        was = dict(head["run"])
        changed = [name for name in run if was.get(name) != run[name]]
        if changed:
            raise CheckpointError(
                f"{self.path}: written by another run ({', '.join(changed)} differ); run it without --resume",
                str(self.path),
            )


def _record(tag: bytes, payload: bytes) -> bytes:
    return _HEADER.pack(tag, len(payload), zlib.crc32(payload)) + payload


def journal_of(path: str | os.PathLike[str], scene: Scene, run: Mapping[str, str], resume: bool) -> Journal:
    """Open the journal of a run; it depends on the scene and on the inputs `run`."""
    model = hashlib.sha256()
    for part in scene.parts:
        model.update(part.name.encode())
        for array in (part.mesh.vertices, part.mesh.triangles, part.pose.homogeneous):
            model.update(np.ascontiguousarray(array).tobytes())
    return Journal(path, {**run, "model": model.hexdigest()}, resume)


def digest_of(targets: Iterable[HandTarget], decisions: Iterable[Decision]) -> bytes:
    """Return a 16-byte digest of the inputs of a step."""
    digest = hashlib.blake2b(digest_size=16)
    for target in targets:
        digest.update(target.key())
    for decision in decisions:
        digest.update(repr(decision).encode())
    return digest.digest()


def advance_or_replay(
    engine: Engine, readings: Readings, journal: Journal | None, given: Inputs, requested: Callable[[], list[Decision]]
) -> tuple[Changes, Callable[[], None]]:
    """Compute one step, or replay it from the journal while recorded steps remain.

    requested: returns decisions of people at viewers. They are not inputs of the script: the journal records only the
    resulting changes, and `requested` is not called during replay.

    Returns the changes, and what writes them to the journal; it raises CheckpointError if the file cannot be written.
    """
    if journal is None:
        return advance(engine, readings, _with(given, requested())), lambda: None
    digest = digest_of(given.targets, given.decisions)
    if journal.replaying:
        changes = journal.recorded(digest)
        with journal.undamaged():
            engine.follow(changes)
            if journal.left == 1 and journal.saved is not None:
                engine.restore(journal.saved)
    else:
        changes = advance(engine, readings, _with(given, requested()))
    whole = replace(changes, constraints=tuple(changes.constraints))  # with all views read
    return changes, lambda: journal.advance(digest, whole, engine.save)


def _with(given: Inputs, decisions: list[Decision]) -> Inputs:
    """Return the inputs with further decisions."""
    return given._replace(decisions=[*given.decisions, *decisions]) if decisions else given
