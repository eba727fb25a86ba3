"""The end of a command: its exit code, and errors in one line."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable

from vpframe import console
from vpframe.app.options import BAD, INTERRUPTED, OK, UsageError
from vpframe.app.progress import Terminal
from vpframe.session.interrupts import handled

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""error codes of a full disk"""
_ERRORS = (
    ("collision.errors", "CollisionError"), ("constraints.errors", "ConstraintsError"),
    ("physics.errors", "PhysicsError"), ("vpframe.errors", "VpframeError"),
)  # fmt: skip
"""roots of the errors printed in one line, by module; a module that is not loaded has raised none"""
_LIBRARY = re.compile(r"(lib\S+\.so\S*): cannot open shared object file")


def exit_code(command: Callable[[], int], title: str = "") -> int:
    """Run a command; return its exit code, and print an error in one line after a title."""
    try:
        with handled(), console.installed(Terminal()):
            code = command()
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _complain(f"{title}interrupted", INTERRUPTED)
    except BrokenPipeError:
        # the reader of standard output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL and error.filename is None:
            # the rest of the output buffer would fail again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return _complain(f"{title}what was found cannot be printed: {error.strerror}", BAD)
        if os.environ.get("VPFRAME_TRACEBACK"):
            raise
        return _complain(title + _one_line(error), BAD)


def _complain(text: str, code: int) -> int:
    Terminal().warn(text)
    return code


def _one_line(error: Exception) -> str:
    known = (UsageError, *(getattr(sys.modules[module], name) for module, name in _ERRORS if module in sys.modules))
    text = " ".join(str(error).split())
    if isinstance(error, known):
        return text
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, ImportError) and (library := _LIBRARY.match(text)):
        return f"{library[1]} is missing, a library of the system: install it (Debian: apt install libgl1 libgomp1)"
    return f"internal error: {type(error).__name__}: {text} (set VPFRAME_TRACEBACK=1 to see where)"
