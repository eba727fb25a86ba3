"""Checkpoint and resume: a journal of what every step came to, with the whole state saved now and then.

A task script holds its own place, so a run is resumed by running the script again from the start: up to the last
save, each step's result is read from the journal instead of computed (and must have been asked for in the same way:
same wishes of the hands, same requests); at the save the state is restored, and from there on steps are computed
as if nothing had happened. One file, appended to; a run killed in the middle of a write loses what follows its
last save, nothing else.

A journal is read with `pickle`: open only journals that you (or this program on your behalf) wrote.
"""

from __future__ import annotations

import hashlib
import pickle
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from vpframe.errors import VpframeError

if TYPE_CHECKING:
    from vpframe.engine import Engine, Request, Result, Wish
    from vpframe.scene import Scene

_MAGIC = b"vpframe journal 1\n"
_HEADER = struct.Struct("<4sII")  # tag, length, crc32 of the payload
_HEAD, _STEP, _SAVE = b"HEAD", b"STEP", b"SAVE"


class CheckpointError(VpframeError):
    """A journal that cannot be resumed from. `path` is the file, `step` where it no longer fits (or None)."""

    def __init__(self, message: str, path: str, step: int | None = None) -> None:
        super().__init__(message)
        self.path = path
        self.step = step


@dataclass(frozen=True, eq=False)
class Entry:
    """One step in the journal."""

    digest: bytes
    """of what was asked of the step"""
    result: Any
    """what it came to"""


class Journal:
    """The journal of one run.

    Parameters
    ----------
    path: the file.
    run: what the run depends on (script, model, time step) by name; a journal made with other values is not resumed.
    resume: whether to go on from what the file holds; otherwise it is begun anew.
    every: steps from one save to the next.
    """

    def __init__(self, path: str | Path, run: Mapping[str, str], resume: bool = False, every: int = 60) -> None:
        self.path = Path(path)
        self.every = every
        self.past: deque[Entry] = deque()
        """steps yet to be replayed, in order"""
        self.saved: bytes | None = None
        """the state after the last of them"""
        self._step = 0
        end = self._read(dict(run)) if resume and self.path.exists() else 0
        try:
            self._file: BinaryIO = open(self.path, "r+b" if end else "wb")  # noqa: SIM115 - open for the whole run
        except OSError as error:
            raise CheckpointError(f"{self.path}: cannot be written: {error.strerror}", str(self.path)) from None
        if end:
            self._file.truncate(end)
            self._file.seek(end)
        else:
            self._file.write(_MAGIC)
            self._write(_HEAD, pickle.dumps(dict(run)))

    @property
    def replaying(self) -> bool:
        """Whether steps still come from the file."""
        return bool(self.past)

    def replay(self, digest: bytes) -> Any:
        """The next step's result, if it was asked for by the same `digest`.

        Raises
        ------
        CheckpointError: the run asks for something else than it did when the journal was written.
        """
        entry = self.past.popleft()
        self._step += 1
        if entry.digest != digest:
            raise CheckpointError(
                f"{self.path}: at step {self._step} the run asks for something else than when this checkpoint was "
                "written (the script may read a clock or random numbers); run it without --resume",
                str(self.path),
                self._step,
            )
        return entry.result

    def append(self, digest: bytes, result: Any) -> bool:
        """Keep one computed step; whether a save is due."""
        self._write(_STEP, pickle.dumps(Entry(digest, result), protocol=pickle.HIGHEST_PROTOCOL))
        self._step += 1
        return self._step % self.every == 0

    def save(self, state: Any) -> None:
        """Keep the whole state after the last step."""
        self._write(_SAVE, pickle.dumps(state, protocol=pickle.HIGHEST_PROTOCOL))

    def restore(self) -> Any:
        """The state at the last save; None if there was none."""
        return None if self.saved is None else pickle.loads(self.saved)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, tag: bytes, payload: bytes) -> None:
        self._file.write(_HEADER.pack(tag, len(payload), zlib.crc32(payload)))
        self._file.write(payload)
        self._file.flush()

    def _read(self, run: dict[str, str]) -> int:
        """Take in the file up to its last save; the length of that part (0: nothing to go on from)."""
        data = self.path.read_bytes()
        if not data.startswith(_MAGIC):
            raise CheckpointError(
                f"{self.path}: not a vpframe checkpoint; name the file that --checkpoint wrote", str(self.path)
            )
        at, end, steps, complete = len(_MAGIC), 0, [], 0
        while at + _HEADER.size <= len(data):
            tag, length, crc = _HEADER.unpack_from(data, at)
            payload = data[at + _HEADER.size : at + _HEADER.size + length]
            if len(payload) < length or zlib.crc32(payload) != crc:
                break  # cut off in the middle of a write
            at += _HEADER.size + length
            if tag == _HEAD:
                self._same_run(pickle.loads(payload), run)
            elif tag == _STEP:
                steps.append(payload)
            elif tag == _SAVE:
                self.saved, complete, end = payload, len(steps), at
        self.past = deque(pickle.loads(payload) for payload in steps[:complete])
        return end

    def _same_run(self, was: dict[str, str], run: dict[str, str]) -> None:
        changed = [name for name in run if was.get(name) != run[name]]
        if changed:
            raise CheckpointError(
                f"{self.path}: written by another run ({', '.join(changed)} differ); run it without --resume",
                str(self.path),
            )


def journal_of(path: str | Path, scene: Scene, run: Mapping[str, str], resume: bool) -> Journal:
    """The journal of a run on a scene, which it depends on as on what `run` names."""
    model = hashlib.sha256()
    for part in scene.parts:
        model.update(part.name.encode())
        for array in (part.mesh.vertices, part.mesh.triangles, part.pose.homogeneous):
            model.update(np.ascontiguousarray(array).tobytes())
    return Journal(path, {**run, "model": model.hexdigest()}, resume)


def digest_of(wishes: Iterable[Wish], requests: Iterable[Request]) -> bytes:
    """What is asked of a step, in 16 bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for wish in wishes:
        digest.update(wish.key())
    for request in requests:
        digest.update(repr(request).encode())
    return digest.digest()


def advance(
    engine: Engine,
    journal: Journal | None,
    wishes: list[Wish],
    requests: list[Request],
    asked: Callable[[], list[Request]],
) -> Result:
    """A step of the engine: computed, and kept in the journal; or read from the journal, while that has more steps.

    asked: what people at viewers ask for besides. That is theirs, not the script's: only the result holds what came of
    it, and while steps are replayed nobody is heard.
    """
    if journal is None:
        return engine.advance(wishes, [*requests, *asked()])
    digest = digest_of(wishes, requests)
    if journal.replaying:
        result = journal.replay(digest)
        engine.follow(result)
        if not journal.replaying:
            engine.restore(journal.restore())
        return result
    result = engine.advance(wishes, [*requests, *asked()])
    if journal.append(digest, result):
        journal.save(engine.state())
    return result
