"""What a person did at the page, statement by statement, and the task script that does the same to the bit."""

from __future__ import annotations

import contextlib
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
class Statement:
    """A call of a verb, of "hand" or of "session": performed, and written into the script, from the same values."""

    of: str
    verb: str
    given: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)
    remark: str = ""

    def perform(self, session: Session, hand: Hand) -> Outcome | None:
        """Do it."""
        result = getattr(hand if self.of == "hand" else session, self.verb)(*self.given, **self.named)
        return result if isinstance(result, Outcome) else None

    @property
    def source(self) -> str:
        """The line of the script; every number in it reads back as it was."""
        return self._line(_written)

    @property
    def short(self) -> str:
        """The same for people: of a list its length."""
        return self._line(_shortened)

    def _line(self, written: Any) -> str:
        words = [written(value) for value in self.given]
        words += [f"{name}={written(value)}" for name, value in self.named.items()]
        remark = f"  # {plain(self.remark)}" if self.remark else ""
        return f"{self.of}.{self.verb}({', '.join(words)}){remark}"


def task_source(
    statements: Sequence[Statement], model: Path, beside: Path, loading: Mapping[str, Any], snap: float
) -> str:
    """The task script that performs the statements.

    Parameters
    ----------
    model, beside: the model's file, and the folder that the script is for.
    loading: what the model was loaded with (`vp.load`), other than by default.
    snap: m, reach of the hand's assist.
    """
    with contextlib.suppress(ValueError):  # another drive
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


def _written(value: Any) -> str:
    if isinstance(value, list):  # of poses, a line each
        return "[\n" + "".join(f"    {_numbers(item)},\n" for item in value) + "]"
    return repr(value)


def _shortened(value: Any) -> str:
    return f"[… {len(value)} poses]" if isinstance(value, list) else repr(value)


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(map(repr, values))})"


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
