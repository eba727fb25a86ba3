"""The process that runs variants one after the other: `python -m vpframe.studies.runner SCRIPT`.

It reads variants as lines of JSON from its standard input, and writes nothing but lines of JSON to its standard output:
`{"ready"}` once, `{"compiling": bool}` when compiling of kernels begins and ends, `{"done": outcome}` for each variant,
`{"error"}` if the script cannot be read. What the script prints goes to standard error, as does the Python traceback of
a crash, or on SIGUSR1 the present one. The script itself has an empty standard input.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import random
import resource
import select
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from collision.numeric.kernel import compilation
from vpframe.errors import VpframeError
from vpframe.scene.names import ignored_words
from vpframe.scripts import in_one_line, place
from vpframe.session.session import Session
from vpframe.studies.child import IDLE
from vpframe.studies.distributions import Value, is_number
from vpframe.studies.replay import opened
from vpframe.studies.variants import Variant, bound

Outcome = dict[str, Any]
"""status ("ok", "no", "error"), reason (of "ok": pairs that may pass through each other), clearance (m), measures, time
(s of the task), steps, seconds, memory (B)"""


class Runner:
    """Runs variants of one script; the script is read once."""

    def __init__(self, script: Path) -> None:
        self.script = script
        self._name = Path(script.name)  # a reason must not depend on the worker's folder of the script
        self._module = opened(script)

    def run(self, variant: Variant) -> Outcome:
        """Run one variant; return its outcome, also if the script raises."""
        words = np.random.SeedSequence(variant.seed, spawn_key=(variant.index, 2)).generate_state(2)
        random.seed(int(words[0]))
        np.random.seed(int(words[1]))  # noqa: NPY002  (a script that uses the global generator repeats itself too)
        began = time.perf_counter()
        outcome: Outcome = {"status": "error", "reason": "", "clearance": None, "measures": {}, "time": 0.0, "steps": 0}
        try:
            task = bound(self._module, self.script, variant)
            session = Session(task.scene(), **{"name": self.script.stem, "clearance": True, **task.OPTIONS})
        except BaseException as error:
            outcome["reason"] = f"{place(error, self._name)}{in_one_line(error)}"
        else:
            outcome |= self._performed(session, task.task)
        return outcome | {"seconds": time.perf_counter() - began, "memory": _memory()}

    def _performed(self, session: Session, task: Any) -> Outcome:
        measures: dict[str, Value | None] = {}
        try:
            returned = task(session)
            session.conclude()
            measures = _measures(returned, self._name)
        except BaseException as error:  # `sys.exit` in a script is no success either
            session.conclude(error, self._name)
        finally:
            session.close()
        least = session.log.least
        return {
            "status": "no" if session.failure else "error" if session.undecided else "ok",
            "reason": session.failure or session.undecided or ignored_words(session.ignored, len(session.scene)),
            "clearance": _number(least.clearance) if least is not None else None,
            "measures": measures,
            "time": session.time,
            "steps": session.step_count,
        }


def _memory() -> int:
    """Peak memory of this process, bytes; `getrusage` would count the process that started it, if that was larger."""
    with contextlib.suppress(OSError), open("/proc/self/status", encoding="ascii") as file:
        return next(1024 * int(line.split()[1]) for line in file if line.startswith("VmHWM:"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _measures(returned: Any, script: Path) -> dict[str, Value | None]:
    if returned is None:
        return {}
    if not isinstance(returned, Mapping):
        raise VpframeError(
            f"{script}: task returned a {type(returned).__name__}; return a dict of measures, or nothing"
        )
    measures: dict[str, Value | None] = {}
    for name, value in returned.items():
        value = value.item() if isinstance(value, np.generic) else value
        if not isinstance(name, str) or not isinstance(value, float | int | str):
            kind = type(value).__name__
            raise VpframeError(f"{script}: measure {name!r} is a {kind}; give a number, a text or a truth value")
        measures[name] = value if isinstance(value, str) else _number(value)
    return measures


def _number(value: float | None) -> float | None:
    """Return a number; None if it is NaN, infinite or too large."""
    return value if is_number(value) else None


def main(script: Path) -> None:
    """Read the script, then run incoming variants until none arrives for `IDLE` seconds."""
    requests, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w", encoding="utf-8")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=False)

    def send(**message: Any) -> None:
        answers.write(json.dumps(message, allow_nan=False) + "\n")
        answers.flush()

    compilation.listeners.append(lambda begins: send(compiling=begins))
    try:
        runner = Runner(script)
    except VpframeError as error:
        send(error=str(error))
        return
    send(ready=True)
    while select.select([requests], [], [], IDLE)[0] and (line := requests.readline()):
        outcome = runner.run(Variant(**json.loads(line)))
        sys.stdout.flush()
        send(done=outcome)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
