"""Files in, scenes out: `load`. The module stays light, because the reading process imports it too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vpframe.errors import LoadError

if TYPE_CHECKING:
    from vpframe.scene import Scene

_CAD = {".stp": "step", ".step": "step", ".p21": "step", ".igs": "iges", ".iges": "iges"}


def load(
    path: str | Path,
    deflection: float = 1e-4,
    angular: float = 0.35,
    timeout: float = 600.0,
    progress: Callable[[float, str], None] | None = None,
) -> Scene:
    """Load a CAD assembly or a mesh as a scene, in metres whatever the file says.

    Parameters
    ----------
    path: a STEP (.step, .stp, .p21) or IGES (.iges, .igs) file.
    deflection: m; no triangle is farther than this from its surface (CAD files).
    angular: rad; no two neighbouring segments of a meshed curve turn by more than this. On small round parts it is
        this, not `deflection`, that sets the number of triangles (CAD files).
    timeout: s; a CAD file that takes longer is given up.
    progress: called with the fraction done and what is being done.

    Raises
    ------
    LoadError: one line that says what is wrong with which file, and how to mend it. Parts and faces that were lost
        from a file that could be read otherwise are named in `Scene.notes` and `Shape.notes`.
    """
    file = Path(path)
    if not file.exists():
        raise LoadError(f"{path}: no such file; check the path", str(path))
    form = _CAD.get(file.suffix.lower())
    if form is None:
        known = ", ".join(sorted(_CAD))
        raise LoadError(f"{path}: files of type {file.suffix or '(none)'} are not read; known are {known}", str(path))
    from vpframe.importers import build, cad

    return build.scene(cad.read(file, form, deflection, angular, timeout, progress), str(path))
