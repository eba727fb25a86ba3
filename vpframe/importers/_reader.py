"""The reading process: reads one CAD file, or meshes, and writes archives of shapes and tree. Run by `python -I`.

It is a separate process because the CAD kernel can crash on a damaged file and writes to standard output. Its
standard output carries lines of JSON only: `{"fraction", "text", "shape"}` for progress, `{"ready"}` with the number of
each finished shape archive, `{"found"}` with numbers of shapes, faces or triangles that raise limits, `{"error"}` for
an unusable file, `{"memory"}` at the memory limit. Nothing is imported from the working directory, the file's folder or
this folder: vpframe is imported from its own location, all else from the folders of Python or the parent.
"""

from __future__ import annotations

import contextlib
import gc
import importlib.util
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vpframe.importers.crew import Make


def main() -> None:
    """Process the request in the arguments (JSON); report on the original standard output."""
    request = json.loads(sys.argv[1])
    gc.disable()
    _limit_memory(request["memory"])
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.path.extend(request["folders"])
    _import_vpframe()
    from vpframe.importers.raw import UnreadableError
    from vpframe.processes import end_with

    end_with(request["parent"])

    try:
        _read(request, channel)
    except UnreadableError as error:
        _say(channel, error=str(error))
    except Exception as error:
        if not isinstance(error, MemoryError) and "OutOfMemory" not in type(error).__name__:
            raise
        _say(channel, memory=True)
    else:
        _say(channel, fraction=1.0, text="read", done=True)


def _limit_memory(limit: int) -> None:
    """Limit memory that can be written to `limit` bytes, and disable core dumps."""
    if sys.platform == "win32":
        return
    import resource

    for what, value in ((resource.RLIMIT_DATA, limit), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(OSError, ValueError):  # the hard limit may be lower
            resource.setrlimit(what, (value, resource.getrlimit(what)[1]))


def _import_vpframe() -> None:
    """Import the package that contains this file, without adding its folder to the path."""
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    init = os.path.join(folder, "__init__.py")
    spec = importlib.util.spec_from_file_location("vpframe", init, submodule_search_locations=[folder])
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["vpframe"] = module
    spec.loader.exec_module(module)


def _say(channel: TextIO, **message: Any) -> None:
    channel.write(json.dumps(message) + "\n")
    channel.flush()


def _read(request: dict[str, Any], channel: TextIO) -> None:
    if request["format"] == "meshes":
        from vpframe.importers.mesh_files import read_files

        read_files(request["files"], request["out"], lambda **message: _say(channel, **message))
        return
    _say(channel, fraction=0.0, text="starting the CAD kernel")
    if request["format"] == "write":
        from vpframe.importers.step_writer import write_step

        write_step(request["content"], request["out"])
        return
    from vpframe.importers.archive import write
    from vpframe.importers.crew import Crew, crew_size, resident
    from vpframe.importers.document import Given, read_document, read_given
    from vpframe.importers.raw import Options, RawScene, RawShape

    def progress(fraction: float, text: str) -> None:
        _say(channel, fraction=fraction, text=text)

    def hire(make: Make, costs: Sequence[float], texts: Sequence[str]) -> dict[int, str]:
        """Make shapes in forked processes; report what is done, and each archive that is ready."""
        _say(channel, found={"shapes": len(costs), "faces": int(sum(costs)), "forked": crew_size(costs) * resident()})
        done, total = [0.0] * len(costs), max(sum(costs), 1.0)

        def tell(number: int, fraction: float) -> None:
            done[number] = fraction * costs[number]
            progress(0.35 + 0.65 * sum(done) / total, texts[number])

        def keep(number: int, shape: RawShape) -> None:
            write(RawScene([shape]), os.path.join(request["out"], f"{number}.archive"))

        crew = Crew(make, keep, tell, lambda number: _say(channel, ready=number), request["memory"])
        crew.run(costs)
        return crew.lost

    if request["format"] == "measure":
        from vpframe.importers.archive import read
        from vpframe.importers.brep import measure

        shapes = read(request["path"]).shapes

        def measured(number: int, first: bool, tell: object) -> RawShape:
            """Measure a shape; after a crash, in the second attempt, give it up."""
            if first:
                measure(shapes[number])
            else:
                shapes[number].faces = []
            return shapes[number]

        hire(measured, [len(each.faces) for each in shapes], ["measuring"] * len(shapes))
        return
    options = Options(request["deflection"], request["angular"], progress=progress, bodies=request["bodies"])
    if request["format"] == "mjcf":
        from vpframe.importers.mjcf import read_model

        raw = read_model(request["path"], options, hire)
    elif request["format"] in ("brep", "given"):

        def given(node: list[Any]) -> Given:
            name, file, matrix, color, children = node
            return Given(name, file, matrix, color, [given(child) for child in children])

        named = [[Path(request["path"]).stem, request["path"], [], None, []]]
        raw = read_given([given(node) for node in request["given"] or named], options, hire)
    else:
        raw = read_document(request["path"], request["format"], options, hire)
    write(raw, os.path.join(request["out"], "scene.archive"))


if __name__ == "__main__":
    main()
    os._exit(0)  # at once, because unloading the kernel takes longer than reading a small file
