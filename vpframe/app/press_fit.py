"""`--press-fit CLASS` of `vpframe clash` and `vpframe disassemble`: one limit for both."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collision import Tolerance


def add_argument(sub: argparse.ArgumentParser) -> None:
    """Add the option."""
    sub.add_argument(
        "--press-fit", metavar="CLASS",
        help="ISO 286 class of the tightest shaft that may be pressed into a hole H, such as u8 (default: s7)",
    )  # fmt: skip


def tolerance(given: str | None) -> Tolerance | None:
    """Return the tolerance of a class; None if none is given.

    Raises
    ------
    FitClassError: the class is not known.
    """
    if given is None:
        return None
    from collision import Tolerance
    from constraints.recognition.iso286 import greatest_interference

    greatest_interference(given, 0.01)  # a class that is not known is refused before models are read
    return Tolerance(press_fit=given)
