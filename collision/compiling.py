"""Says once, on standard error, that kernels are being compiled: the first question waits for it, later ones do not."""

from __future__ import annotations

import sys

from numba.core import event


class _Announcer(event.Listener):
    def __init__(self) -> None:
        self.said = False

    def on_start(self, event: event.Event) -> None:
        kernel = event.data["dispatcher"].py_func
        if not self.said and kernel.__module__.startswith("collision."):
            self.said = True
            print("compiling collision kernels (once; kept in numba's cache) ...", file=sys.stderr, flush=True)

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""


announcer = _Announcer()
"""set its `said` where something else tells of it"""
event.register("numba:compile", announcer)
