"""Detection of a screen for windows and browsers."""

from __future__ import annotations

import os
import sys


def has_screen() -> bool:
    """Return whether there is a screen: on Windows and macOS always, else if an X or Wayland display is named."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
