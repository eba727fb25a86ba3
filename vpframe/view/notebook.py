"""Scenes, sessions and reports in a notebook: the page that plays them, in an isolated frame."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from pathlib import Path

import pinocchio as pin

from vpframe.events import Event, Frame
from vpframe.scene.scene import Scene
from vpframe.view.meshcat_viewer import page_of

HEIGHT = 560
"""pixels"""


def framed(page: str, height: int = HEIGHT) -> str:
    """Return a document as an isolated frame: its scripts cannot reach the notebook."""
    return (
        f'<iframe srcdoc="{html.escape(page)}" sandbox="allow-scripts allow-downloads" '
        f'style="width: 100%; height: {height}px; border: 1px solid #d5dae2"></iframe>'
    )


def shown(
    scene: Scene,
    frames: Iterable[tuple[Frame, tuple[Event, ...]]] = (),
    start: Mapping[str, pin.SE3] | None = None,
) -> str:
    """Return the page of a scene and its frames, see `vpframe.view.meshcat_viewer.page_of`."""
    return framed(page_of(scene, frames, start))


class ReportFolder(type(Path())):  # type: ignore[misc]  # a path of this machine
    """The folder of a report; a notebook shows its page and plays its scene."""

    def _repr_html_(self) -> str:
        pages = [self / name for name in ("index.html", "scene.html")]
        return "\n".join(framed(page.read_text(encoding="utf-8")) for page in pages if page.is_file())
