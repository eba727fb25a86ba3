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

from vpframe import __version__
from vpframe.app.bench import finite
from vpframe.console import duration
from vpframe.text import escape, plain_lines

PEERS = (
    "numpy", "numba", "pin", "coal", "mujoco", "drake", "cadquery", "python-solvespace", "py-slvs", "ompl", "trimesh",
    "libigl", "distributed", "cadquery-ocp-novtk",
)  # fmt: skip
"""packages whose versions are shown, if installed"""
STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}"
    "pre{overflow-x:auto;background:#f4f6f8;padding:.8em;font-size:12.5px}.plot{overflow-x:auto}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:left}"
    "nav a{margin-right:1em}.dim{color:#666}"
)


Result = tuple[ModuleType, Mapping[str, Any], float] | str
"""module of a suite, the result of its `run`, and the time that it took (s); or why there is none"""


def page(results: Mapping[str, Result]) -> str:
    """Return one HTML document for the results of suites by name."""
    links = "".join(f"<a href='#{escape(name)}'>{escape(name)}</a>" for name in results)
    sections = "".join(_section(name, result) for name, result in results.items())
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="generator" content="vpframe">'
        "<title>vpframe bench</title>"
        f"<style>{STYLE}</style></head><body><h1>vpframe bench</h1>{_head()}<nav>{links}</nav>{sections}"
        "</body></html>"
    )


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
    return f"<table>{cells}</table>"


def _section(name: str, found: Result) -> str:
    title = f"<h2 id='{escape(name)}'>{escape(name)}</h2>"
    if isinstance(found, str):
        return f"{title}<p class='dim'>No result: {escape(found)}</p>"
    module, result, seconds = found
    ratios = "".join(
        f"<tr><td>{escape(what)}</td><td>{value:.4g}</td></tr>" for what, value in result.get("ratios", {}).items()
    )
    data = _preformatted(json.dumps(finite(result), indent=1, default=str))
    return (
        f"{title}<p class='dim'>measured in {duration(seconds)} on {escape(_machine(result))}</p>"
        + _preformatted(module.table(result))
        + (f"<table><tr><th>ratio</th><th></th></tr>{ratios}</table>" if ratios else "")
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
        f"<p class='plot'><img alt='{escape(name)}' src='data:image/png;base64,{text}'></p>" for name, text in data
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
