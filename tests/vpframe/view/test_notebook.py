"""Scenes, sessions and reports in a notebook: run in a real kernel, looked at in a browser."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.vpframe.browser import PROGRAM, Browser

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")

ROOT = Path(__file__).parents[3]
CELLS = [
    f"import sys; sys.path.insert(0, {str(ROOT)!r})\nimport vpframe as vp\n"
    "from tests.vpframe.bench_scene import scene as bench\nscene = bench()",
    "scene",
    "session = vp.Session(scene)\nhand = session.hand(at=(0.06, 0.0, 0.08))\nhand.grab('peg')\n"
    "hand.move_by((0.0, 0.0, 0.03))\nsession",
    "session.close()\nsession.report('report')",
]


@pytest.fixture(scope="module")
def displayed(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What the last three cells show, as HTML."""
    folder = tmp_path_factory.mktemp("notebook")
    kernels = folder / "kernels" / "here"
    kernels.mkdir(parents=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    text = f'{{"argv": {command!r}, "display_name": "here", "language": "python"}}'.replace("'", '"')
    (kernels / "kernel.json").write_text(text)
    from jupyter_client.kernelspec import KernelSpecManager
    from jupyter_client.manager import AsyncKernelManager

    class Specs(KernelSpecManager):
        kernel_dirs = [str(folder / "kernels")]  # noqa: RUF012 - a trait of its base

    manager = AsyncKernelManager(kernel_name="here", kernel_spec_manager=Specs())
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in CELLS])
    client = nbclient.NotebookClient(notebook, km=manager, timeout=240, resources={"metadata": {"path": str(folder)}})
    client.execute()
    shown = []
    for cell in notebook.cells[1:]:
        results = [output for output in cell.outputs if output.output_type == "execute_result"]
        assert len(results) == 1
        shown.append(results[0].data["text/html"])
    return shown


def test_each_is_shown_as_a_frame_that_needs_nothing_from_outside(displayed: list[str]) -> None:
    scene, session, report = displayed
    assert scene.count("<iframe") == session.count("<iframe") == 1
    assert report.count("<iframe") == 2  # the page, and what plays
    for text in displayed:
        head = text.split("&lt;script", 1)[0]
        assert text.startswith("<iframe srcdoc=") and "src=&quot;http" not in head
        assert "allow-same-origin" not in text


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if PROGRAM is None:
        pytest.skip("no Chromium on the PATH")
    with Browser(1000, 700) as made:
        yield made


@pytest.mark.slow
@pytest.mark.browser
def test_they_are_seen_in_a_browser_and_the_session_plays(
    displayed: list[str], browser: Browser, tmp_path: Path
) -> None:
    for number, text in enumerate(displayed):
        page = tmp_path / f"{number}.html"
        page.write_text(f"<!DOCTYPE html><body style='margin: 0'>{text}</body>", encoding="utf-8")
        browser.open(f"file://{page}")
        browser.run("new Promise((done) => setTimeout(done, 2500))")
        seen = browser.picture()
        assert len(np.unique(seen[:500].reshape(-1, 3), axis=0)) > 300  # a picture, not an empty frame
        assert browser.errors == []
        if number == 1:
            before = seen[:, 320:680].astype(int)
            moved = 0.0
            for _ in range(20):  # a busy machine may look when all is back where it began
                browser.press(50, 154)  # Play, or Pause
                browser.run("new Promise((done) => setTimeout(done, 150))")
                moving = browser.picture()[:, 320:680].astype(int)
                moved = max(moved, (np.abs(moving - before).max(axis=2) > 30).mean())
                if moved > 0.0005:
                    break
            assert moved > 0.0005
