"""`vpframe bench --html PAGE`: results of benchmark suites as one self-contained page."""

from __future__ import annotations

import base64
import datetime
import json
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

from vpframe import __version__
from vpframe.text import escape

PEERS = (
    "numpy", "numba", "pin", "coal", "mujoco", "drake", "python-solvespace", "py-slvs", "trimesh", "libigl",
    "distributed", "cadquery-ocp-novtk",
)  # fmt: skip
"""packages whose versions are shown, if installed"""
STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}"
    "pre{overflow-x:auto;background:#f4f6f8;padding:.8em;font-size:12.5px}img{max-width:100%}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:left}"
    "nav a{margin-right:1em}.dim{color:#666}"
)


def page(results: Mapping[str, tuple[ModuleType, Mapping[str, Any]]]) -> str:
    """Return one HTML document for suites by name: the module and the result of its `run`."""
    names = list(results)
    links = "".join(f"<a href='#{escape(name)}'>{escape(name)}</a>" for name in names)
    sections = "".join(_section(name, module, result) for name, (module, result) in results.items())
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="generator" content="vpframe">'
        "<title>vpframe bench</title>"
        f"<style>{STYLE}</style></head><body><h1>vpframe bench</h1>{_head(results)}<nav>{links}</nav>{sections}"
        "</body></html>"
    )


def _head(results: Mapping[str, tuple[ModuleType, Mapping[str, Any]]]) -> str:
    machines = sorted({str(result["machine"]) for _, result in results.values()})
    rows = [
        ("vpframe", f"{__version__}{_commit()}"),
        ("date", datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("machine", "; ".join(machines)),
        ("with", ", ".join(f"{name} {found}" for name in PEERS if (found := _version(name)))),
    ]
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{cells}</table>"


def _section(name: str, module: ModuleType, result: Mapping[str, Any]) -> str:
    ratios = "".join(
        f"<tr><td>{escape(what)}</td><td>{value:.4g}</td></tr>" for what, value in result.get("ratios", {}).items()
    )
    data = escape(json.dumps(result, indent=1, default=str))
    return (
        f"<h2 id='{escape(name)}'>{escape(name)}</h2><pre>{escape(module.table(result))}</pre>"
        + (f"<table><tr><th>ratio</th><th></th></tr>{ratios}</table>" if ratios else "")
        + _plots(module, result)
        + f"<details><summary>data</summary><pre>{data}</pre></details>"
    )


def _plots(module: ModuleType, result: Mapping[str, Any]) -> str:
    with tempfile.TemporaryDirectory(prefix="vpframe-bench-") as folder:
        try:
            module.plot(result, folder)
        except ModuleNotFoundError as error:
            return f"<p class='dim'>No plots: {escape(str(error))} (pip install matplotlib)</p>"
        pictures = sorted(Path(folder).glob("*.png"))
        data = [(picture.stem, base64.b64encode(picture.read_bytes()).decode()) for picture in pictures]
    return "".join(f"<p><img alt='{escape(name)}' src='data:image/png;base64,{text}'></p>" for name, text in data)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """Return `, commit 1bad235` in a checkout, otherwise ""."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    command = ["git", "-C", str(root), "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return f", commit {done.stdout.strip()}" if done.returncode == 0 else ""
