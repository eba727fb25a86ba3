"""Reading processes forked off one that has imported the CAD kernel and trimesh, without the time that this takes.

`forked()` has `vpframe.importers.guarded` fork reading processes from a zygote. All else is as without it: a process
for each file, its limits of time and memory, its end with ours, its exit code, its memory as the system tells it. A
zygote has only imported: a kernel that has run once cannot be forked.

    python -I readers.py READER PARENT SOCKET FOLDER …       is the zygote; `forked()` starts it
"""

import contextlib
import ctypes
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import IO, Any
from unittest import mock

_PR_SET_CHILD_SUBREAPER = 36  # <linux/prctl.h>
_REQUEST = 1 << 16
"""bytes of a request, at most"""


@contextlib.contextmanager
def forked() -> Iterator[None]:
    """Have `vpframe.load` fork its reading processes from a zygote, which the first starts; this process alone, Linux.

    A stand-in for the reader that a test sets is a process of its own.
    """
    from vpframe.importers import guarded

    reader, lock = guarded.READER, threading.Lock()
    with contextlib.ExitStack() as ends:
        channel: list[socket.socket] = []

        def popen(command: list[str], **options: Any) -> Any:
            if reader != guarded.READER:
                return subprocess.Popen(command, **options)
            with lock:
                if not channel:
                    channel.append(ends.enter_context(_zygote(options["env"])))
                return _Reader(channel[0], command, **options)

        module = SimpleNamespace(Popen=popen, PIPE=subprocess.PIPE)
        ends.enter_context(mock.patch.object(guarded, "subprocess", module))
        yield


@contextlib.contextmanager
def _zygote(environment: dict[str, str]) -> Iterator[socket.socket]:
    """A process that has imported what readers import; the socket for requests."""
    from vpframe.importers import cad, guarded, meshes

    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    words = [
        str(guarded.READER),
        str(os.getpid()),
        str(theirs.fileno()),
        *guarded.package_folders(guarded.READER.parent, (*cad.PACKAGES, *meshes.PACKAGES)),
    ]
    process = subprocess.Popen([sys.executable, "-I", __file__, *words], pass_fds=[theirs.fileno()], env=environment)
    theirs.close()
    try:
        assert ours.recv(_REQUEST) == b"ready", "the zygote imports what readers do"
        yield ours
    finally:
        ours.close()
        process.wait()


@contextlib.contextmanager
def _adopting() -> Iterator[None]:
    """Become the parent of children whose own parent ends."""
    prctl = ctypes.CDLL(None).prctl
    assert prctl(_PR_SET_CHILD_SUBREAPER, 1) == 0, "forked readers become children of this process"
    try:
        yield
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, 0)


class _Reader:
    """A forked reading process, as far as `guarded` uses a `subprocess.Popen`."""

    def __init__(self, zygote: socket.socket, command: list[str], stderr: IO[str], cwd: str, **_: Any) -> None:
        inner_in, outer_in = os.pipe()
        outer_out, inner_out = os.pipe()
        inner = [inner_in, inner_out, stderr.fileno()]
        with _adopting():
            socket.send_fds(zygote, [json.dumps([command[-1], cwd]).encode()], inner)
            self.pid = int(zygote.recv(_REQUEST))
        for each in inner[:2]:
            os.close(each)
        self.stdin, self.stdout = os.fdopen(outer_in, "w"), os.fdopen(outer_out, encoding="utf-8")
        self.returncode: int | None = None

    def wait(self) -> None:
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])

    def kill(self) -> None:
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)

    def communicate(self) -> None:
        self.stdin.close()
        self.stdout.close()
        self.wait()


def main(reader: str, parent: int, channel: socket.socket, folders: list[str]) -> None:
    """Fork a reader for each request, a grandchild that the process `parent` inherits."""
    spec = importlib.util.spec_from_file_location("reader", reader)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.path.extend(folders)
    module._import_vpframe()
    for name in ("vpframe.importers.document", "vpframe.importers.archive", "vpframe.importers.mesh_files"):
        importlib.import_module(name)
    assert len(os.listdir("/proc/self/task")) == 1, "a process with threads must not fork"
    channel.send(b"ready")
    while True:
        words, descriptors, _, _ = socket.recv_fds(channel, _REQUEST, 3)
        if not words:
            return
        between = os.fork()
        if between == 0:
            if os.fork():
                os._exit(0)
            break
        os.waitpid(between, 0)
        for each in descriptors:
            os.close(each)
    while os.getppid() != parent:
        os.sched_yield()
    channel.send(str(os.getpid()).encode())
    channel.close()
    for to, each in enumerate(descriptors):
        os.dup2(each, to)
        os.close(each)
    request, cwd = json.loads(words)
    os.chdir(cwd)
    sys.argv = [reader, request]
    module.main()
    os._exit(0)  # as the reader does


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), socket.socket(fileno=int(sys.argv[3])), sys.argv[4:])
