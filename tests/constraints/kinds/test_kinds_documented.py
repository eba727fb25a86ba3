"""docs/constraints.md says of each kind what the code does."""

import re
from pathlib import Path

import pytest

import constraints.kinds as kinds
from constraints.kinds import Constraint
from constraints.recognition.pairings import PAIRINGS

PAGE = (Path(__file__).parents[3] / "docs" / "constraints.md").read_text(encoding="utf-8")
CLASSES = [
    c
    for name in kinds.__all__
    if isinstance(c := getattr(kinds, name), type) and issubclass(c, Constraint) and c is not Constraint
]


def rows(heading: str) -> list[list[str]]:
    """Cells of the first table below a heading."""
    table = PAGE.split(heading, 1)[1].split("\n| ---", 1)[1].split("\n\n", 1)[0]
    return [[cell.strip() for cell in line.strip("|").split(" |")] for line in table.splitlines()[1:]]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda c: c.__name__)
def test_each_kind_has_its_row(kind: type[Constraint]) -> None:
    (row,) = [r for r in rows("## Kinds") if r[1] == f"`{kind.__name__}`"]
    assert row[0] == kind.kind
    assert row[5] == kind.symbol


def test_each_pairing_that_recognition_has_is_in_the_table() -> None:
    table = rows("## Which surfaces make which kind")
    for pairing in PAIRINGS:
        names = {pairing.first.__name__.lower(), pairing.second.__name__.lower()}
        found = [r for r in table if r[1].startswith(pairing.kind) and names <= set(re.findall(r"[a-z]+", r[0]))]
        assert found, f"{pairing.kind} of {names}"
        assert any(r[3] in ("to a hand", "as it stands") for r in found)
