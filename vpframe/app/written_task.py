"""Statements performed by a user on the page, and the task script that repeats them bit for bit."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vpframe.hands.hand import Hand
from vpframe.hands.segment import Outcome
from vpframe.session.session import Session
from vpframe.text import plain


@dataclass(frozen=True)
class VerbCall:
    """A call of a verb of "hand" or "session", performed and written into the script with the same values."""

    of: str
    verb: str
    given: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""

    def perform(self, session: Session, hand: Hand) -> Outcome | None:
        """Perform the call."""
        result = getattr(hand if self.of == "hand" else session, self.verb)(*self.given, **self.named)
        return result if isinstance(result, Outcome) else None

    @property
    def source(self) -> str:
        """Line of the script with exact numbers."""
        return self._line(_written)

    @property
    def short(self) -> str:
        """Line for display, with lists replaced by their lengths."""
        return self._line(_shortened)

    def _line(self, written: Any) -> str:
        words = [written(value) for value in self.given]
        words += [f"{name}={written(value)}" for name, value in self.named.items()]
        remark = f"  # {plain(self.remark)}" if self.remark else ""
        return f"{self.of}.{self.verb}({', '.join(words)}){remark}"


def task_source(
    statements: Sequence[VerbCall], model: Path, beside: Path, loading: Mapping[str, Any], snap: float
) -> str:
    """Return the task script that performs the statements.

    Parameters
    ----------
    model, beside: file of the model, and folder of the script.
    loading: options with which the model was loaded (`vp.load`).
    snap: reach of the hand's assist, m.
    """
    with contextlib.suppress(ValueError):  # the model is on another drive
        model = Path(os.path.relpath(model, beside))
    options = "".join(f", {name}={value!r}" for name, value in loading.items())
    source = f"FILE = {model.as_posix()!r}\n\n"
    if options:
        source = f"def scene():\n    return vp.load(Path(__file__).parent / {model.as_posix()!r}{options})\n\n\n"
    lines = [line for statement in statements for line in statement.source.split("\n")]
    return script_of(
        f"What a person did at the page of {model.name}.",
        source + 'OPTIONS = {"rule": vp.accept_standing}',
        [f"hand.assist = vp.Assist(snap={snap!r})", *lines],
        imports="from pathlib import Path\n\n" if options else "",
    )


def script_of(title: str, head: str, body: Iterable[str], imports: str = "") -> str:
    """Return a task script: its title, definitions before the task, and the lines of the task, which has a `hand`."""
    lines = "\n".join(f"    {line}" for line in ("hand = session.hand()", *body))
    title = plain(title).replace("\\", "\\\\").replace('"', '\\"')
    return (
        f'"""{title}"""\n\n{imports}import vpframe as vp\n\n{head}\n\n\n'
        f'def task(session):\n{lines}\n\n\nif __name__ == "__main__":\n    vp.main(__file__)\n'
    )


def quoted(text: str) -> str:
    """Return a Python string literal in double quotes."""
    return plain(json.dumps(text, ensure_ascii=False))


def _written(value: Any) -> str:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return f"[{', '.join(map(quoted, value))}]"
    if isinstance(value, list):  # one line for each pose
        return "[\n" + "".join(f"    ({', '.join(map(repr, item))}),\n" for item in value) + "]"
    return repr(value)


def _shortened(value: Any) -> str:
    return f"[… {len(value)} poses]" if isinstance(value, list) else _written(value)
