"""Files in, scenes out: `load`. The module stays light, because the reading process imports it too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vpframe.errors import LoadError
from vpframe.importers.checks import checked_format, far_check
from vpframe.scene.units import METRES, NAMES

if TYPE_CHECKING:
    from vpframe.importers.raw import RawShape
    from vpframe.scene.scene import Scene

READING = 0.9
"""share of the time of a load that reading and meshing take; the rest goes into surfaces and features"""


KERNEL = ("step", "iges", "brep", "mjcf")
"""formats that the reading process reads"""


def load(
    source: Any,
    deflection: float = 1e-4,
    angular: float = 0.35,
    unit: str | None = None,
    timeout: float | None = None,
    progress: Callable[[float, str], None] | None = None,
    format: str | None = None,
) -> Scene:
    """Load a CAD assembly, a mesh, a robot model, or shapes of another library, as a scene in metres.

    Parts of CAD files carry the names of the instances from the root down ("left-bracket/bolt_1"); a single root, with
    which all would begin, is left out, siblings of one name are numbered, and solids of one compound are "name/1",
    "name/2". Instances of one shape share it. Each B-rep face is a surface. What the file does not type is recognised
    or fitted within `Tolerance.fit`. A density is taken in the first of g/mm³, g/cm³ and kg/m³ that makes it plausible
    (20 to 23,000 kg/m³), as files get its unit wrong. OBJ objects, groups and materials that share borders are the
    surfaces of one part, closed ones are parts; all other meshes are cut into surfaces. GLB keeps its axes (y is up).

    What was read is kept in the user's cache folder (`VPFRAME_CACHE` names another, or none if empty) under the content
    of the files, so that the same file is there at once the next time.

    Parameters
    ----------
    source: a STEP (.step, .stp, .p21), IGES (.iges, .igs), BREP, STL, OBJ, PLY, GLB, URDF or MJCF file (.mjcf, .xml;
        needs mujoco), or the bytes of one; a `trimesh.Trimesh` or `Scene`; a shape of build123d (`Part`, `Compound`
        with its children, labels, colours and connected joints) or of OpenCascade; a Pinocchio `GeometryModel`, or
        `(model, geometry)`, or `(model, geometry, q)`. The joints of a model are `Scene.statements`.
    deflection: m; no triangle is farther than this from its surface (CAD files).
    angular: rad; no two neighbouring segments of a meshed curve turn by more than this. On small round parts it is
        this, not `deflection`, that sets the number of triangles (CAD files).
    unit: "m", "cm", "mm", "um", "in" or "ft" for STL, OBJ and PLY, which name none. Left out, a model whose largest
        extent is above 2 is taken to be in millimetres and any other in metres; a note in `Scene.notes` says which.
        Of a mesh of trimesh, left out, its own `units` count first.
    timeout: s; a CAD file that takes longer is given up. Left out, a minute, and one more for each megabyte beyond the
        first. Reading may take 4 GiB of memory, and 200 bytes more for each byte of the file.
    progress: called with the fraction done and what is being done.
    format: of bytes, "step", "obj", …; left out, their content tells (OBJ has no mark to know it by).

    Raises
    ------
    LoadError: one line that says what is wrong with which file, and how to mend it. Parts and faces that were lost
        from a file that could be read otherwise are named in `Scene.notes` and `Shape.notes`.
    """
    for name, value in (("deflection", deflection), ("angular", angular), ("timeout", timeout)):
        if value is not None and not 0.0 < value < float("inf"):
            raise LoadError(f"{_called(source)}: {name} is {value!r}; give a positive number", _called(source))
    if unit is not None and unit not in METRES:
        raise LoadError(f"{_called(source)}: unit is {unit!r}; give one of {NAMES}", _called(source))
    if not isinstance(source, str | Path):
        from vpframe.importers import objects

        return objects.load(source, deflection, angular, unit, timeout, progress, format)
    path, file = source, Path(source)
    form = checked_format(file)
    if unit is not None and form not in ("stl", "obj", "ply"):
        raise LoadError(f"{path}: {form.upper()} files name their unit themselves; leave unit= out", str(path))
    from vpframe.importers import build, cache

    def part(begin: float, end: float) -> Callable[[float, str], None] | None:
        if progress is None:
            return None
        return lambda fraction, text: progress(begin + (end - begin) * fraction, text)

    files = _files(file, form)
    key = cache.key_of(files, form, deflection, angular, unit) if files else ""
    raw = cache.find(key) if key else None
    if raw is None:
        if form in KERNEL:
            from vpframe.importers import cad

            settle = _surfaced_and_settled if form == "mjcf" else build.settled
            raw = cad.read(files or [file], form, deflection, angular, timeout, part(0.0, READING), settle)
            for p in raw.parts:
                far_check(file, p.name, raw.shapes[p.shape].vertices, p.translation)
        elif form == "urdf":
            from vpframe.importers import urdf

            raw = urdf.read(file, deflection, angular)
            for p in raw.parts:
                far_check(file, p.name, raw.shapes[p.shape].vertices, p.translation)
            raw.shapes = [build.settled(shape) for shape in raw.shapes]
        else:
            from collision import Tolerance
            from vpframe.importers import meshes

            raw = meshes.read(file, form, unit, Tolerance(), part(0.0, READING))
            raw.shapes = [build.settled(shape) for shape in raw.shapes]
        if key and raw.whole and cache.key_of(files, form, deflection, angular, unit) == key:  # not changed meanwhile
            cache.keep(key, raw)
    scene = build.scene(raw, str(path), part(READING, 1.0))
    if progress is not None:
        progress(1.0, "loaded")
    return scene


def _surfaced_and_settled(shape: RawShape) -> RawShape:
    from vpframe.importers import build, meshes

    return build.settled(shape if shape.brep else meshes.surfaced(shape))


def _called(source: Any) -> str:
    return str(source) if isinstance(source, str | Path) else type(source).__name__


def _files(file: Path, form: str) -> list[Path]:
    """All files that the scene is made of, `file` first; empty where that is not known."""
    if form in ("urdf", "mjcf"):
        return []
    if form in KERNEL:
        from vpframe.importers import cad

        return cad.files_of(file, form)
    from vpframe.importers import meshes

    return meshes.files_of(file, form)
