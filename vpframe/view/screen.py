"""Whether there is a screen to open windows and browsers on."""

from __future__ import annotations

import os
import sys


def has_screen() -> bool:
    """True on Windows and macOS, and where an X or Wayland display is named."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
