"""Checkpoint and resume: a journal of the changes of every step, with the whole state saved now and then.

A task script holds its own place, so a run is resumed by running the script again from the start: up to the last
save, each step's result is read from the journal instead of computed (and must have been asked for in the same way:
same targets of the hands, same decisions); at the save the state is restored, and from there on steps are computed
as if nothing had happened. One file, appended to; a run killed in the middle of a write loses what follows its
last save, nothing else.

The file is a line that names the format, then records: a tag of four letters, the length and the CRC-32 of the
content (uint32, little-endian), and the content, a value in the encoding of `vpframe.codec`. Nothing in it is
run, and what does not fit the scene is refused.
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

from vpframe.app.outputs import CHECKPOINT, append, claimed
from vpframe.codec import WRONG, CodecError
from vpframe.errors import CheckpointError, OutputError
from vpframe.scene.scene import Scene
from vpframe.session.readings import Readings
from vpframe.session.state import CODEC, Changes, Decision, State, StateError
from vpframe.session.step import HandTarget, Inputs, advance

_MAGIC = b"vpframe journal 2\n"
_OLD = b"vpframe journal 1\n"
_HEADER = struct.Struct("<4sII")  # tag, length, crc32 of the payload
_HEAD, _STEP, _SAVE = b"HEAD", b"STEP", b"SAVE"


class Journal:
    """The journal of one run.

    Parameters
    ----------
    path: the file, or the `Output` of one.
    run: what the run depends on (script, model, time step) by name; a journal made with other values is not resumed.
    resume: whether to go on from what the file holds; otherwise it is begun anew.
    every: steps from one save to the next.
    """

    def __init__(
        self, path: str | os.PathLike[str], run: Mapping[str, str], resume: bool = False, every: int = 60
    ) -> None:
        self.path = Path(path)
        self.every = every
        self._past: list[bytes] = []
        self._at = 0  # in `_past`
        self.saved: bytes | None = None
        """the state after the last of them, encoded"""
        self._step = 0
        end = self._read(dict(run)) if resume and self.path.exists() and self.path.stat().st_size else 0
        try:
            self._output = claimed(path, CHECKPOINT)
            self._file = self._output.open(end)
        except OutputError as error:
            raise CheckpointError(str(error), error.path) from None
        if not end:
            self._put(_MAGIC)
            self._write(_HEAD, {"schema": CODEC.schema, "run": dict(run)})

    @property
    def past(self) -> list[bytes]:
        """Steps yet to be replayed, in order, encoded."""
        return self._past[self._at :]

    @property
    def left(self) -> int:
        """How many they are."""
        return len(self._past) - self._at

    @property
    def replaying(self) -> bool:
        """Whether steps still come from the file."""
        return self.left > 0

    def mark(self) -> tuple[int, int, int]:
        """Where the journal is, to `undo` what follows."""
        return self._at, self._step, self._file.tell() if self._file.seekable() else -1

    def undo(self, mark: tuple[int, int, int]) -> None:
        """Go back to a mark: what was kept since is not in the file any more."""
        self._at, self._step, end = mark
        if end >= 0 and self._file.tell() != end:
            self._file.truncate(end)
            self._file.seek(end)

    def replay(self, digest: bytes) -> Any:
        """The next step's result, if it was asked for by the same `digest`.

        Raises
        ------
        CheckpointError: the run asks for something else than it did when the journal was written, or it is damaged.
        """
        payload = self._past[self._at]
        self._at += 1
        self._step += 1
        with self.undamaged():
            asked, result = CODEC.decode(payload)
        if asked != digest:
            raise CheckpointError(
                f"{self.path}: at step {self._step} the run asks for something else than when this checkpoint was "
                "written (the script may read a clock or random numbers); run it without --resume",
                str(self.path),
                self._step,
            )
        return result

    def append(self, digest: bytes, result: Any) -> bool:
        """Keep one computed step; whether a save is due."""
        self._write(_STEP, (digest, result))
        self._step += 1
        return self._step % self.every == 0

    def save(self, state: Any) -> None:
        """Keep the whole state after the last step: `State.data`, in the bytes that `State.save` returns."""
        self._write(_SAVE, state)

    def restore(self) -> Any:
        """The state at the last save; None if there was none. CheckpointError: it is damaged."""
        with self.undamaged():
            return None if self.saved is None else CODEC.decode(self.saved)

    @contextlib.contextmanager
    def undamaged(self) -> Iterator[None]:
        """CheckpointError, in one line, for whatever is wrong with something that was read."""
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

    def _write(self, tag: bytes, value: Any) -> None:
        payload = CODEC.encode(value)
        self._put(_HEADER.pack(tag, len(payload), zlib.crc32(payload)) + payload)

    def _put(self, data: bytes) -> None:
        try:
            append(self._file, data)
        except OSError as error:
            raise CheckpointError(f"{self.path}: cannot be written: {error.strerror}", str(self.path)) from None

    def _read(self, run: dict[str, str]) -> int:
        """Take in the file up to its last save; the length of that part (0: nothing to go on from)."""
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
                if at == len(_MAGIC):  # where it is said what the run depends on
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


def journal_of(path: str | os.PathLike[str], scene: Scene, run: Mapping[str, str], resume: bool) -> Journal:
    """The journal of a run on a scene, which it depends on as on what `run` names."""
    model = hashlib.sha256()
    for part in scene.parts:
        model.update(part.name.encode())
        for array in (part.mesh.vertices, part.mesh.triangles, part.pose.homogeneous):
            model.update(np.ascontiguousarray(array).tobytes())
    return Journal(path, {**run, "model": model.hexdigest()}, resume)


def digest_of(targets: Iterable[HandTarget], decisions: Iterable[Decision]) -> bytes:
    """A digest of the inputs of a step, 16 bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for target in targets:
        digest.update(target.key())
    for decision in decisions:
        digest.update(repr(decision).encode())
    return digest.digest()


def advance_or_replay(
    state: State, readings: Readings, journal: Journal | None, given: Inputs, asked: Callable[[], list[Decision]]
) -> Changes:
    """One step: computed, and kept in the journal; or read from the journal, while that has more steps.

    asked: what people at viewers ask for besides. That is theirs, not the script's: only the changes hold what came of
    it, and while steps are replayed nobody is heard.
    """
    if journal is None:
        changes = advance(state, readings, replace(given, decisions=[*given.decisions, *asked()]))
        state.step += 1
        return changes
    digest = digest_of(given.targets, given.decisions)
    if journal.replaying:
        changes = journal.replay(digest)
        with journal.undamaged():
            state.follow(changes)
            state.step += 1
            if not journal.replaying and journal.saved is not None:
                state.restore_data(journal.restore())
        return changes
    changes = advance(state, readings, replace(given, decisions=[*given.decisions, *asked()]))
    state.step += 1
    if journal.append(digest, replace(changes, constraints=tuple(changes.constraints))):
        journal.save(state.data())
    return changes
