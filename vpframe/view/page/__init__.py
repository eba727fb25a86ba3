"""The page that shows a session: meshcat's viewer in a frame of panels, live or as one file without outside parts.

`page.html` is its frame, `main.js` its beginning; `scene.js` draws, `panels.js`, `hand.js`, `pick.js` and others are
the panels and tools. The messages that it receives are made by `vpframe.view.page_protocol`.
Start with `main.js`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError
from vpframe.text import rendered, script_json

HERE = Path(__file__).parent
SCRIPTS = ("scene", "panels", "pick", "paint", "look", "layout", "measure", "hand", "timeline", "main")
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
    return rendered(
        "view/page/page.html",
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        meshcat=meshcat_script().replace("</script", "<\\/script"),
        embedded=script_json(None if messages is None else list(messages)),
        script="\n".join((HERE / f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS),
    )
