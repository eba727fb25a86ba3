"""The commands of `vpframe`: each takes the parsed arguments and returns the exit code."""

from __future__ import annotations

import importlib
import os
import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from vpframe import console, files
from vpframe.app import options
from vpframe.app.options import INTERRUPTED, NO, OK, UsageError, document, print_notes, print_written, scene_of
from vpframe.errors import VpframeError
from vpframe.outputs import BCF, PAGE, RULES, SCRIPT, STATUS, URDF, Claims, Output
from vpframe.scene.overlap_rules import file_beside
from vpframe.scene.units import seconds
from vpframe.text import plain

SUITES = ("collision", "constraints", "load", "physics", "planning", "service", "session", "study", "truth")


def demo(arguments: Namespace) -> int:
    """Run the demo task; return the exit code."""
    from vpframe.app import demo

    return demo.run(arguments.out, arguments.view, arguments.force, arguments.wait)


def run(arguments: Namespace) -> int:
    """Run a task script; return the exit code."""
    from vpframe.app.task_runner import RunOptions, run_task

    return run_task(arguments.task, **{name: getattr(arguments, name) for name in RunOptions.__annotations__})


def new(arguments: Namespace) -> int:
    """Write a first task script for a model; say why no part of it is taken out; return the exit code."""
    from vpframe.app.task_runner import new_task

    stops = new_task(arguments.task, arguments.file, arguments.force, arguments.part, arguments.budget)
    print(f"wrote {arguments.task}; run it with: vpframe run {arguments.task} --view")
    if stops:
        what = f"{arguments.part} was not" if arguments.part else "no part was"
        console.say(f"{what} taken out; the script only takes a part in hand, and says what was tried: {stops}")
    return OK


def clash(arguments: Namespace) -> int:
    """Print which surfaces of files clash, and write the files that the options name; return the exit code."""
    from collision import Tolerance
    from vpframe.analysis import clash
    from vpframe.analysis.bodies import overlap_notes

    tolerance = options.press_fit(arguments)
    if arguments.tolerance is not None:
        tolerance = replace(tolerance or Tolerance(), linear=arguments.tolerance)
    with document(arguments.json) as emit, Claims(arguments.force, *arguments.files) as claims:
        status, bcf = claims.file(arguments.status, STATUS), claims.file(arguments.bcf, BCF)
        rules = claims.file(_rules_of(arguments), RULES)
        scene = scene_of(arguments, *arguments.files)
        authorised = clash.authorised_pairs(arguments.authorise, scene)
        with console.progress("looking for clashes") as progress:
            found = clash.clash(
                scene, arguments.clearance, tolerance, authorised, progress, as_drawn=arguments.as_drawn
            )
        if status is not None:
            found = clash.with_status(found, status)
        scene.notes = (*scene.notes, *overlap_notes(scene, tolerance))
        emit(clash.document(found, notes=list(scene.all_notes())))
        if not arguments.json:
            print(clash.table(found, arguments.surfaces, arguments.contacts))
            print_notes(scene)
        if bcf is not None:
            from vpframe.exporters.bcf import write_bcf

            with console.progress("drawing the clashes") as progress:
                left = write_bcf(bcf, scene, found, progress=progress)
            print_written(arguments.bcf, left)
        if arguments.table is not None:
            from vpframe.exporters.tables import clash_rows, write_table

            write_table(arguments.table, clash_rows(found), force=arguments.force)
            print_written(arguments.table)
        if rules is not None:
            from vpframe.analysis.rules_draft import draft

            files.replace(rules.path, draft(found))
            print_written(str(rules.path))
    return NO if any(map(clash.is_open, found)) else OK


def _rules_of(arguments: Namespace) -> str | None:
    """The rules file that `vpframe clash --write-rules` drafts; None if it is not asked to."""
    if not arguments.write_rules:
        return None
    if len(arguments.files) > 1:
        raise VpframeError("--write-rules drafts the rules of one model; give one file")
    return str(file_beside(arguments.files[0]))


def accept(arguments: Namespace) -> int:
    """Accept clashes in a status file or report; return the exit code."""
    from vpframe.analysis import clash_status

    keys = clash_status.accept_named(arguments.file, arguments.names, arguments.remark, arguments.authorise)
    for line in clash_status.accepted_words(keys):
        console.say(f"accepted: {line}")
    print(f"the next run with {arguments.file} counts them as accepted")
    return OK


def mates(arguments: Namespace) -> int:
    """Print the constraints between parts and the joints that they make; return the exit code."""
    from collision import Tolerance
    from vpframe.analysis import fasteners, mates

    tolerance = None if arguments.fit is None else Tolerance(clearance=arguments.fit, clearance_relative=0.0)
    with document(arguments.json) as emit, Claims(arguments.force, arguments.file) as claims:
        urdf = claims.file(arguments.urdf, URDF)
        scene = scene_of(arguments, arguments.file)
        with console.progress("recognising constraints") as progress:
            found = mates.mates(scene, tolerance, progress=progress)
        rows = fasteners.fastener_rows(scene)
        listed = [row.document() for row in rows]
        emit({**found.document(), "fasteners": listed, "notes": list(scene.all_notes())})
        if not arguments.json:
            print(*filter(None, (fasteners.table(rows), mates.table(found))), sep="\n\n")
            print_notes(scene)
        if urdf is not None:
            for note in mates.write_urdf(scene, urdf, tolerance):
                console.warn(f"vpframe: note: {note}")
            print(f"wrote {urdf}", file=sys.stderr)
    return OK


def export(arguments: Namespace) -> int:
    """Write a model, or a run, in another format; return the exit code."""
    from vpframe.exporters.export import export, kind_of
    from vpframe.exporters.motion import read_motion

    source, time = _poses(arguments.poses)
    with document(arguments.json) as emit:
        inputs = [*arguments.files, *([source] if source else [])]
        with Output(arguments.to, kind_of(arguments.to), arguments.force, inputs) as output:
            motion = read_motion(source) if source else None
            scene = scene_of(arguments, *arguments.files)
            left = export(scene, output, motion, time)
        emit({"written": arguments.to, "parts": len(scene), "left_out": list(left), "notes": list(scene.all_notes())})
        if not arguments.json:
            print(f"wrote {arguments.to}: {len(scene)} parts")
            print_notes(scene)
            for line in left:
                console.say(f"not carried: {plain(line)}")
    return OK


def _poses(given: str | None) -> tuple[str | None, float | None]:
    """Split the argument of `--poses` into file and time (after the last @)."""
    if given is None:
        return None, None
    path, at, time = given.rpartition("@")
    if not at or os.path.exists(given):
        return given, None
    try:
        return path, seconds(time)
    except ValueError as error:
        raise UsageError(f"--poses {given}: {error}") from None


def disassemble(arguments: Namespace) -> int:
    """Plan how parts come out; return the exit code."""
    from vpframe.app import disassemble

    with document(arguments.json) as emit:
        return disassemble.run(arguments, emit)


def view(arguments: Namespace) -> int:
    """Show a model in the browser; return the exit code."""
    from vpframe.app.workbench import Workbench
    from vpframe.view.meshcat_viewer import write_page
    from vpframe.view.screen import has_screen

    if arguments.html is not None and arguments.save is not None:
        raise UsageError("--save is for the live page; leave out --html")
    with Claims(arguments.force, arguments.file) as claims:
        page, script = claims.file(arguments.html, PAGE), claims.file(arguments.save, SCRIPT)
        scene = scene_of(arguments, arguments.file)
        print_notes(scene)
        if page is not None:
            write_page(scene, (), page.path)
            return OK
        loading = options.loading(arguments)
        bench = Workbench(scene, arguments.file, loading, script, arguments.host, open_browser=has_screen())
        print(f"{bench.viewer.url}  (Ctrl-C ends)", flush=True)
        if bench.viewer.outside:
            print(f"from other machines: {bench.viewer.outside}", flush=True)
        bench.run()
    return OK


def replay(arguments: Namespace) -> int:
    """Show a recording, or print its lines; return the exit code."""
    from vpframe.view.replay import lines, replay

    if arguments.events is not None:
        from vpframe.exporters.tables import write_table

        columns = ("step", "time", "kind", "text")
        rows = ({name: getattr(line, name) for name in columns} for line in lines(arguments.recording))
        write_table(arguments.events, rows, columns, force=arguments.force)
        print_written(arguments.events)
        return OK
    return replay(arguments.recording, script=arguments.script)


def study(arguments: Namespace) -> int:
    """Run the variants of a task script and report how many can be done; return the exit code."""
    from vpframe.studies import report
    from vpframe.studies.job import Machines
    from vpframe.studies.run import SAMPLES, Sampling, run_study

    if arguments.sobol and arguments.grid is not None:
        raise UsageError("--sobol is a way to sample; leave out --grid")
    if arguments.cluster is not None and (arguments.jobs is not None or arguments.dashboard):
        raise UsageError("--jobs and --dashboard are for this machine; leave out --cluster")
    samples = SAMPLES if arguments.samples is None else arguments.samples
    sampling = Sampling(samples, arguments.sobol, arguments.grid, arguments.seed)
    jobs = len(os.sched_getaffinity(0)) if arguments.jobs is None else arguments.jobs
    machines = Machines(jobs, arguments.cluster, arguments.dashboard)
    with document(arguments.json) as emit:
        found, interrupted = run_study(
            arguments.task, arguments.out, sampling, machines, arguments.timeout, arguments.retries, arguments.resume,
            arguments.force,
        )  # fmt: skip
        emit(found)
        if not arguments.json:
            print(report.rate_text(found))
            if rest := report.rest_text(found):
                print(rest)
            for line in report.basis_lines(found):
                print(line)
            print(f"report: {os.path.join(arguments.out, 'index.html')}")
    if found["repeated"]["different"]:
        console.warn(f"variants {found['repeated']['different']} gave another answer when they were run again")
    if found["repeated"]["unanswered"]:
        console.warn(f"variants {found['repeated']['unanswered']} crashed or timed out when they were run again")
    if interrupted:
        console.warn("interrupted; what was finished is kept, --resume runs what is missing")
        return INTERRUPTED
    return OK if found["statuses"]["ok"] == found["variants"] else NO


def bench(arguments: Namespace) -> int:
    """Run benchmark suites, which are in a clone of the project only; return the exit code."""
    folder = Path(__file__).parents[2] / "tests" / "benchmarks"
    if not folder.is_dir():
        raise UsageError("the benchmarks are not installed; clone the project and run `vpframe bench` from the clone")
    if arguments.all and arguments.suite:
        raise UsageError(f"--all is every suite; leave out {arguments.suite}")
    if (arguments.only or arguments.number or arguments.corpus) and not arguments.suite:
        raise UsageError("--only, --number and --corpus choose within one suite; name it")
    if str(folder) not in sys.path:  # a suite imports its neighbours by name
        sys.path.insert(0, str(folder))
    code: int = importlib.import_module("bench_run").run(arguments, SUITES)
    return code
