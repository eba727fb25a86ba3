"""`vpframe bench --html PAGE`: results of benchmark suites as one self-contained page."""

from __future__ import annotations

import base64
import contextlib
import datetime
import html
import json
import os
import platform
import re
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from bench_run import finite

from vpframe import __version__
from vpframe.console import duration
from vpframe.text import escape, plain_lines, rendered

PEERS = (
    "numpy", "numba", "pin", "coal", "python-fcl", "mujoco", "drake", "cadquery", "python-solvespace", "py-slvs",
    "slvs", "ompl", "trimesh", "libigl", "distributed", "cadquery-ocp-novtk",
)  # fmt: skip
"""packages whose versions are shown, if installed"""

Result = tuple[ModuleType, Mapping[str, Any], float] | str
"""module of a suite, the result of its `run`, and the time that it took (s); or why there is none"""


def page(results: Mapping[str, Result]) -> str:
    """Return one HTML document for the results of suites by name."""
    links = "".join(f"<a href='#{escape(name)}'>{escape(name)}</a>" for name in results)
    sections = "".join(_section(name, result) for name, result in results.items())
    body = f"<h1>vpframe bench</h1><nav>{links}</nav>{_ratios(results)}{_head()}{sections}"
    return rendered("report/base.html", title="vpframe bench", body=body)


def _ratios(results: Mapping[str, Result]) -> str:
    """Return the ratios of all suites, which the page opens with."""
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(what)}</td>"
        f"<td class='n'>{'–' if value is None else f'{value:.4g}'}</td></tr>"
        for name, found in results.items()
        if not isinstance(found, str)
        for what, value in finite(found[1].get("ratios", {})).items()
    )
    return f"<h2>Ratios</h2><table><tr><th>suite</th><th>ratio</th><th></th></tr>{rows}</table>" if rows else ""


def _head() -> str:
    versions = {name: _version(name) for name in PEERS}
    rows = [
        ("vpframe", f"{__version__}{_commit()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("machine", _processor()),
        ("with", ", ".join(f"{name} {found}" for name, found in versions.items() if found)),
        ("without", ", ".join(name for name, found in versions.items() if not found)),
    ]
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows if value)
    return f"<h2>Machine</h2><table>{cells}</table>"


def _section(name: str, found: Result) -> str:
    title = f"<h2 id='{escape(name)}'>{escape(name)}</h2>"
    if isinstance(found, str):
        return f"{title}<p class='dim'>No result: {escape(found)}</p>"
    module, result, seconds = found
    data = _preformatted(json.dumps(finite(result), indent=1, default=str))
    return (
        f"{title}<p class='dim'>measured in {duration(seconds)} on {escape(_machine(result))}</p>"
        + _preformatted(module.table(result))
        + _plots(module, result)
        + f"<details><summary>data</summary>{data}</details>"
    )


def _preformatted(text: str) -> str:
    return f"<pre>{html.escape(plain_lines(text))}</pre>"


def _machine(result: Mapping[str, Any]) -> str:
    found = result["machine"]
    return ", ".join(f"{name} {value}" for name, value in found.items()) if isinstance(found, Mapping) else str(found)


def _processor() -> str:
    """Return the name and number of the processors of this machine."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
        name = found[1] if found else name
    return f"{platform.platform()}, {os.cpu_count()} × {name}, Python {platform.python_version()}"


def _plots(module: ModuleType, result: Mapping[str, Any]) -> str:
    with tempfile.TemporaryDirectory(prefix="vpframe-bench-") as folder:
        try:
            module.plot(result, folder)
        except ModuleNotFoundError as error:
            return f"<p class='dim'>No plots: {escape(str(error))} (pip install matplotlib)</p>"
        except Exception as error:  # the figures are kept
            return f"<p class='dim'>No plots: {escape(f'{type(error).__name__}: {error}')}</p>"
        pictures = sorted(Path(folder).glob("*.png"))
        data = [(picture.stem, base64.b64encode(picture.read_bytes()).decode()) for picture in pictures]
    return "".join(
        f"<figure><img alt='{escape(name)}' src='data:image/png;base64,{text}'></figure>" for name, text in data
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """Return `, commit 1bad235` in a checkout, with `and changes` if files differ from it; otherwise ""."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    done = [
        subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
        for words in (
            ["rev-parse", "--short", "HEAD"],
            ["status", "--porcelain", "-uno", "--", ".", ":!docs/bench.html"],
        )
    ]
    if any(one.returncode for one in done):
        return ""
    return f", commit {done[0].stdout.strip()}{' and changes' if done[1].stdout.strip() else ''}"
