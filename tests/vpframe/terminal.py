"""A program on a terminal of its own, with Ctrl-C as a person presses it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
CTRL_C = b"\x03"


def _take_terminal() -> None:
    """In the child: Ctrl-C is a signal to all on this terminal, also where the test run ignores it (started by `&`)."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Terminal:
    """Runs `python -m vpframe ARGUMENTS`; standard error, and output unless `stdout` is a file, are the terminal."""

    def __init__(self, *arguments: object, cwd: Path, stdout: Path | None = None, **environment: str) -> None:
        self._master, slave = pty.openpty()
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        out = slave if stdout is None else os.open(stdout, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        fcntl.ioctl(slave, termios.TIOCSWINSZ, b"\x28\x00\x8c\x00\x00\x00\x00\x00")  # 40 lines of 140
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vpframe", *map(str, arguments)],
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
        self.text += data.decode(errors="replace")
        return bool(data)
