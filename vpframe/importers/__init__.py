"""`load`: read files and objects of other libraries into scenes. Few imports, because the reading process uses it.

CAD kernel and mesh readers run in a process of their own, with limits; values come back as arrays (`raw`).
May use `scene`, `codec`, `processes`, `constraints.geometry` and `collision`.
Start here with `load`, then `cad` and `_reader` (the way of a STEP file), `build` (from raw arrays to a scene); one
file for each other format.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vpframe.errors import LoadError
from vpframe.importers.checks import checked_format, far_check
from vpframe.importers.raw import Options
from vpframe.scene.overlap_rules import read_beside
from vpframe.scene.units import METRES, NAMES

if TYPE_CHECKING:
    from vpframe.importers.raw import RawShape
    from vpframe.scene.scene import Scene

READING = 0.9
"""fraction of the time of a load spent on reading and meshing; the rest goes to surfaces and features"""


KERNEL = ("step", "iges", "brep", "mjcf")
"""formats read by the reading process"""


def load(
    source: Any,
    deflection: float = 1e-4,
    angular: float = 0.35,
    unit: str | None = None,
    timeout: float | None = None,
    progress: Callable[[float, str], None] | None = None,
    format: str | None = None,
    bodies: str | None = None,
) -> Scene:
    """Load a CAD assembly, a mesh, a robot model, or shapes of another library, as a scene in metres.

    Names of CAD parts are the paths of their instances from the root ("left-bracket/bolt_1"); a single root is left
    out, and siblings of the same name are numbered. In a file with assemblies a product without children is one rigid
    part, whatever number of bodies it has; elsewhere each solid is a part ("name/1", "name/2"). Instances share one
    shape. Each B-rep face is a surface; faces without a type in the file are recognised or fitted within
    `Tolerance.fit`. Density is read in the first unit of g/mm³, g/cm³ and kg/m³ that makes it plausible (20 to 23,000
    kg/m³), because files often state a wrong unit. OBJ objects, groups and materials that share borders become surfaces
    of one part, closed ones become parts; all other meshes are segmented into surfaces when these are first needed. GLB
    keeps its axes (y is up).

    Results are cached in the user's cache folder (`VPFRAME_CACHE` sets another, empty for none) by file content.

    Parameters
    ----------
    source: a STEP (.step, .stp, .p21), IGES (.iges, .igs), BREP, STL, OBJ, PLY, GLB, URDF or MJCF file (.mjcf, .xml;
        needs mujoco), or the bytes of one; a `trimesh.Trimesh` or `Scene`; a shape of build123d (`Part`, `Compound`
        with its children, labels, colours and connected joints) or of OpenCascade; a Pinocchio `GeometryModel`, or
        `(model, geometry)`, or `(model, geometry, q)`. The joints of a model are `Scene.statements`.
    deflection: maximum distance of triangles from their surface, m (CAD files).
    angular: maximum angle between neighbouring segments of a meshed curve, rad (CAD files). On small round parts it
        determines the number of triangles.
    unit: "m", "cm", "mm", "um", "in" or "ft" for STL, OBJ and PLY, which state none. By default a model whose largest
        extent is above 2 is read in millimetres, any other in metres; `Scene.notes` says which. A trimesh mesh has its
        own `units` as default.
    timeout: limit of processor time for reading, s; default for a CAD file one minute for each megabyte, at least one,
        and more for each shape and face, for a mesh 30 s and more by its size and triangles. The limit of resident
        memory is 1.75 GB plus 200 bytes for each byte of a CAD file, 1.5 GB plus 20 bytes for each byte and 1 kB for
        each triangle of a mesh.
    progress: receives the fraction done and the present task.
    format: of bytes, "step", "obj", …; by default recognised from the content (not possible for OBJ).
    bodies: "split" makes each solid of a CAD file a part, "whole" each product.

    Raises
    ------
    LoadError: one line that names the file, the fault and the remedy. Parts and faces lost from a file that can be read
        otherwise are named in `Scene.notes` and `Shape.notes`.
    """
    for name, value in (("deflection", deflection), ("angular", angular), ("timeout", timeout)):
        if value is not None and not 0.0 < value < float("inf"):
            raise LoadError(f"{_called(source)}: {name} is {value!r}; give a positive number", _called(source))
    if unit is not None and unit not in METRES:
        raise LoadError(f"{_called(source)}: unit is {unit!r}; give one of {NAMES}", _called(source))
    if bodies not in (None, "split", "whole"):
        raise LoadError(f"{_called(source)}: bodies is {bodies!r}; give 'split' or 'whole'", _called(source))
    options = Options(deflection, angular, unit, timeout, progress, format, bodies)
    if not isinstance(source, str | Path):
        from vpframe.importers import objects

        return objects.load(source, options)
    path, file = source, Path(source)
    form = checked_format(file)
    if unit is not None and form not in ("stl", "obj", "ply"):
        raise LoadError(f"{path}: {form.upper()} files name their unit themselves; leave unit= out", str(path))
    from vpframe.importers import build, cache

    rules = read_beside(file)  # first, so that a mistake in them is told at once
    files = _files(file, form)
    chosen = form, deflection, angular, unit, bodies
    key = cache.key_of(files, *chosen) if files else ""
    raw = cache.find(key) if key else None
    if raw is None:
        if form in KERNEL:
            from vpframe.importers import cad

            settle = _bare_and_settled if form == "mjcf" else build.settled
            raw = cad.read(files or [file], form, options.within(0.0, READING), settle)
        elif form == "urdf":
            from vpframe.importers import urdf

            raw = urdf.read(file, options)
        else:
            from vpframe.importers import meshes

            raw = meshes.read(file, form, options.within(0.0, READING))
        for p in raw.parts:
            far_check(file, p.name, raw.shapes[p.shape].vertices, p.translation)
        raw.shapes = [build.settled(shape) for shape in raw.shapes]
        if key and raw.whole and cache.key_of(files, *chosen) == key:  # files unchanged
            cache.keep(key, raw)
    keep = partial(cache.keep, key) if key and raw.whole else lambda raw: None
    scene = build.scene(raw, str(path), options.within(READING, 1.0).progress, keep)
    scene.rules = rules
    if progress is not None:
        progress(1.0, "loaded")
    return scene


def _bare_and_settled(shape: RawShape) -> RawShape:
    from vpframe.importers import build, meshes

    return build.settled(shape if shape.brep else meshes.bare(shape))


def _called(source: Any) -> str:
    return str(source) if isinstance(source, str | Path) else type(source).__name__


def _files(file: Path, form: str) -> list[Path]:
    """Return all files of a scene, `file` first; empty if they are not known."""
    if form in ("urdf", "mjcf"):
        return []
    if form in KERNEL:
        from vpframe.importers import cad

        return cad.files_of(file, form)
    from vpframe.importers import meshes

    return meshes.files_of(file, form)
