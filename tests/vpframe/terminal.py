"""A program on a terminal of its own, with Ctrl-C as a person presses it."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
import unicodedata
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
CTRL_C = b"\x03"


def _take_terminal() -> None:
    """In the child: Ctrl-C is a signal to all on this terminal, also where the test run ignores it (started by `&`)."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Terminal:
    """Runs `python -m vpframe ARGUMENTS`; standard error, and output unless `stdout` is a file, are the terminal.

    program: what runs in place of `-m vpframe`.
    """

    def __init__(
        self,
        *arguments: object,
        cwd: Path,
        stdout: Path | None = None,
        columns: int = 140,
        program: Sequence[str] = ("-m", "vpframe"),
        **environment: str,
    ) -> None:
        self._columns = columns
        self._master, slave = pty.openpty()
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        out = slave if stdout is None else os.open(stdout, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, *program, *map(str, arguments)],
            stdin=slave,
            stdout=out,
            stderr=slave,
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": path, "DISPLAY": "", **environment},
            start_new_session=True,
            preexec_fn=_take_terminal,
        )
        for descriptor in {slave, out}:
            os.close(descriptor)
        self.text = ""
        self._decoder = codecs.getincrementaldecoder("utf-8")(errors="replace")

    def wait_for(self, pattern: str, seconds: float = 120.0) -> re.Match[str]:
        """Read on until a pattern is there."""
        until = time.monotonic() + seconds
        while (found := re.search(pattern, self.text)) is None:
            assert time.monotonic() < until, f"no {pattern!r} in {seconds} s: {self.text[-2000:]!r}"
            assert self._read(0.2) or self.process.poll() is None, f"ended without {pattern!r}: {self.text[-2000:]!r}"
        return found

    def press(self, keys: bytes) -> None:
        """Type."""
        os.write(self._master, keys)

    def end(self, seconds: float = 120.0) -> int:
        """Read to the end of the program; its exit code."""
        until = time.monotonic() + seconds
        while self.process.poll() is None:
            assert time.monotonic() < until, f"still running: {self.text[-2000:]!r}"
            self._read(0.2)
        while self._read(0.1):
            pass
        return self.process.returncode

    def relatives(self) -> list[str]:
        """Command lines of the processes of this terminal's session that live, but for the first."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != self.process.pid:
                try:
                    session = int((entry / "stat").read_text().rpartition(")")[2].split()[3])
                    words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                except (OSError, ValueError):
                    continue
                if session == self.process.pid and words:
                    found.append(words)
        return found

    def lines(self) -> list[str]:
        """What is to be read on the terminal in the end: lines that were wiped are gone."""
        shown = []
        for line in self.text.replace("\r\n", "\n").split("\n"):
            kept = re.split(r"\r\x1b\[K", line)[-1]
            if kept.strip():
                shown.append(kept)
        return shown

    def screen(self) -> list[str]:
        """The lines as a terminal shows them that wraps at its last column, and scrolls for ever."""
        rows, column = [""], 0
        for piece in re.findall(r"\r|\n|\x1b\[K|[^\r\n\x1b]", self.text):
            if piece == "\r":
                column = 0
            elif piece == "\n":
                rows.append("")
            elif piece == "\x1b[K":
                rows[-1] = rows[-1][:column]
            else:
                cells = piece + "\0" * (unicodedata.east_asian_width(piece) in "WF")
                if column + len(cells) > self._columns:
                    rows.append("")
                    column = 0
                row = rows[-1].ljust(column)
                rows[-1] = row[:column] + cells + row[column + len(cells) :]
                column += len(cells)
        return [row.replace("\0", "").rstrip() for row in rows]

    def close(self) -> None:
        """End it, whatever it does."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self._master)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _read(self, seconds: float) -> bool:
        if not select.select([self._master], [], [], seconds)[0]:
            return False
        try:
            data = os.read(self._master, 65536)
        except OSError:  # the other side is closed
            return False
        self.text += self._decoder.decode(data)
        return bool(data)
