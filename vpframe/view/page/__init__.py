"""The page that shows a session: meshcat's viewer in a frame of panels, live or as one file without outside parts."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError
from vpframe.text import filled, script_json

HERE = Path(__file__).parent
SCRIPTS = ("scene", "panels", "pick", "paint", "look", "measure", "hand", "timeline", "main")
"""the page's own, in the order in which they are put together"""


def meshcat_script() -> str:
    """The JavaScript bundle of the meshcat package, which is found without importing it (that would import IPython).

    Raises VpframeError if meshcat is not installed.
    """
    spec = importlib.util.find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise VpframeError("the viewer needs the package meshcat; install it with: pip install meshcat")
    return (Path(spec.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")


def html(messages: Iterable[dict[str, Any]] | None = None) -> str:
    """The page. With `messages` (scene, strips, frames) it shows them; without, it asks the server it came from."""
    return filled(
        HERE / "page.html",
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        meshcat=meshcat_script().replace("</script", "<\\/script"),
        embedded=script_json(None if messages is None else list(messages)),
        script="\n".join((HERE / f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS),
    )
