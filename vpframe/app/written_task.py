"""Statements performed by a user on the page, and the task script that repeats them bit for bit."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
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
    source = f"FILE = {model.as_posix()!r}"
    if options:
        source = f"def scene():\n    return vp.load(Path(__file__).parent / {model.as_posix()!r}{options})"
    lines = [line for statement in statements for line in statement.source.split("\n")]
    return _TEMPLATE.format(
        title=plain(model.name).replace("\\", "\\\\").replace('"', '\\"'),
        path="from pathlib import Path\n\n" if options else "",
        source=source,
        gap="\n\n" if options else "\n",
        snap=repr(snap),
        body="\n".join(f"    {line}" for line in lines),
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


_TEMPLATE = '''"""What a person did at the page of {title}."""

{path}import vpframe as vp

{source}
{gap}OPTIONS = {{"rule": vp.accept_standing}}


def task(session):
    hand = session.hand()
    hand.assist = vp.Assist(snap={snap})
{body}


if __name__ == "__main__":
    vp.main(__file__)
'''
