"""Every page that vpframe writes, of parts whose names are markup, scripts, marks of templates and control codes."""

import functools
import html.parser
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.benchmarks import bench_page
from tests.vpframe.browser import PROGRAM
from tests.vpframe.watching import fake_session, hostile_frames, hostile_scene
from vpframe import planning
from vpframe.report import SessionLog, plan_page, write
from vpframe.scene.scene import Part, Scene
from vpframe.studies import report as study_report
from vpframe.studies.distributions import Uniform
from vpframe.studies.summary import summary
from vpframe.text import plain, script_json
from vpframe.view import notebook
from vpframe.view import page as session_page
from vpframe.view.meshcat_viewer import MeshcatViewer, write_page

HOSTILE = [
    "<!--<script>",
    "</script><script>window.harm=1</script>",
    "*PAGE*",
    "/*PAGE*/ null/*EMBEDDED*/ /*MESHCAT*/ /*STYLE*/",
    "$title $body ${body} $embedded $$ {title} %s",
    "]]>--></style></title><svg/onload=window.harm=1>",
    "' onerror=window.harm=1 x='\"><img src=x onerror=window.harm=1>",
    "a\u2028b\u2029c\x1b[2J\x00\r\n\ud800",
    "__proto__",
    "<\\/script>\\u003c&lt;&amp;",
]


def saved(name: str, folder: Path) -> Path:
    return write_page(hostile_scene(name), [(f, f.events) for f in hostile_frames(name)], folder / "saved.html")


def reported(name: str, folder: Path) -> Path:
    log = SessionLog()
    log.begin(fake_session(hostile_scene(name)).scene)
    for frame in hostile_frames(name):
        log.frame(frame)
    return Path(write(folder / "report", log, task=name, failure=f"{name} is in the way")) / "index.html"


def played(name: str, folder: Path) -> Path:
    return reported(name, folder).with_name("scene.html")


def in_a_notebook(name: str, folder: Path) -> Path:
    path = folder / "notebook.html"
    frames = [(frame, frame.events) for frame in hostile_frames(name)]
    path.write_text(f"<!DOCTYPE html><body>{notebook.shown(hostile_scene(name), frames)}</body>", encoding="utf-8")
    return path


@functools.cache
def planned(name: str) -> tuple[Scene, planning.Disassembly]:
    scene = hostile_scene(name)
    return scene, planning.disassembly(scene, budget=20.0)


def plan(name: str, folder: Path) -> Path:
    path = folder / "plan.html"
    path.write_text(plan_page.html(planned(name)[1], planned(name)[0], name), encoding="utf-8")
    return path


def study(name: str, folder: Path) -> Path:
    variables = {name: Uniform(0.0, 1.0), "x": Uniform(0.0, 1.0)}
    rows = [
        {
            "key": str(k), "index": k, "status": "no" if k % 4 == 0 else "ok", "reason": f"{name} is" * (k % 4 == 0),
            "parameters": {name: k / 40, "x": (7 * k % 40) / 40}, "measures": {name: float(k), f"{name} text": name},
            "clearance": 1e-5 * k, "time": 1.0, "steps": 60, "seconds": 0.1, "memory": 1, "attempts": 1, "worker": "",
        }
        for k in range(40)
    ]  # fmt: skip
    document = summary(variables, {"method": "random", "samples": 40, "seed": 0}, rows, [], 40)
    path = folder / "study.html"
    script = Path(f"{name.replace('/', '|')}.py")
    path.write_text(study_report.page(script, variables, document, rows), encoding="utf-8")
    return path


def benchmark(name: str, folder: Path) -> Path:
    result = {"machine": {name: name}, "rows": [{"case": name}], "ratios": {name: 2.0}}
    module = SimpleNamespace(table=lambda result: f"{name}\n{name}", plot=lambda result, folder: None)
    path = folder / "bench.html"
    path.write_text(bench_page.page({name: (module, result, 1.0), "other": f"no {name}"}), encoding="utf-8")  # type: ignore[dict-item]
    return path


WRITERS: list[Callable[[str, Path], Path]] = [saved, reported, played, in_a_notebook, plan, study, benchmark]


class Page(html.parser.HTMLParser):
    """Tags with their attributes, scripts, and text of a page and the documents of its frames."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        inner = Page(given.pop("srcdoc") or "") if "srcdoc" in given else None
        self.tags.append((tag, given))
        if inner is not None:
            self.tags += inner.tags
            self.scripts += inner.scripts

    def handle_data(self, data: str) -> None:
        (self.scripts if self.tags and self.tags[-1][0] == "script" else self.text).append(data)


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("made", WRITERS, ids=lambda f: f.__name__)
def test_a_name_adds_no_element_and_no_attribute(made: Callable[[str, Path], Path], name: str, tmp_path: Path) -> None:
    """The page of a part of that name has the elements of the page of a part with a name of letters, as long."""
    pages = []
    for each, folder in ((name, tmp_path / "a"), (re.sub("[^/ ]", "x", plain(name)), tmp_path / "b")):
        folder.mkdir()
        pages.append(Page(made(each, folder).read_text(encoding="utf-8")))
    bad, good = pages
    assert [(tag, sorted(given)) for tag, given in bad.tags] == [(tag, sorted(given)) for tag, given in good.tags]
    assert len("".join(bad.scripts).split("</")) == len("".join(good.scripts).split("</"))
    shown = plain(name)
    assert any(shown in text for text in (*bad.text, *(str(v) for _, given in bad.tags for v in given.values()))) or (
        script_json(shown)[1:-1] in "".join(bad.scripts)
    )


@pytest.mark.parametrize("name", HOSTILE)
def test_embedded_data_is_what_was_given_and_ends_no_script(name: str) -> None:
    message = {"type": name, name: [name, 1.5, None, {"__proto__": [name]}]}
    page = session_page.html([message])
    data = page.split(' id="embedded">', 1)[1].split("</script", 1)[0]
    assert json.loads(data) == [message]
    assert not set("<>&\u2028\u2029") & set(data)
    assert page.count("<script") == session_page.html([]).count("<script")
    assert page.replace(data, "[]") == session_page.html([])  # nothing else depends on it


@pytest.mark.browser
@pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH")
@pytest.mark.parametrize("name", HOSTILE)
def test_pages_are_seen_with_such_names(chromium: Any, name: str, tmp_path: Path) -> None:
    shown = json.dumps(plain(name))
    viewer = MeshcatViewer()
    viewer.begin(fake_session(hostile_scene(name)).scene)
    for frame in hostile_frames(name):
        viewer.frame(frame)
    pages = {}
    for made in WRITERS:
        if made is not in_a_notebook:  # looked at below, from within its frame
            (folder := tmp_path / made.__name__).mkdir()
            pages[made.__name__] = f"file://{made(name, folder)}"
    try:
        for kind, address in ({"live": viewer.url} | pages).items():
            chromium.open(address)
            chromium.wait(f"document.body.textContent.includes({shown})")
            if kind in ("live", "saved", "played"):
                part = f"world.parts.some((part) => part.name === {shown})"
                chromium.wait(part)
                chromium.wait(f"document.querySelector('#tree').textContent.length > 0 && {part}")
            assert chromium.run("'harm' in window") is False, kind
            assert chromium.run("document.querySelectorAll('[onerror], [onload]').length") == 0, kind
            assert chromium.errors == [], kind
    finally:
        viewer.end()
    page = (
        in_a_notebook(name, tmp_path)
        .read_text(encoding="utf-8")
        .replace('sandbox="allow-scripts', 'sandbox="allow-same-origin allow-scripts')
    )
    (tmp_path / "frame.html").write_text(page, encoding="utf-8")
    chromium.open(f"file://{tmp_path}/frame.html")
    inner = "document.querySelector('iframe').contentWindow"
    chromium.wait(f"{inner}.document.body.textContent.includes({shown})")
    assert chromium.run(f"'harm' in window || 'harm' in {inner}") is False
    assert chromium.errors == []
    shutil.rmtree(tmp_path, ignore_errors=True)


def test_a_scene_of_parts_alone_is_seen_too(tmp_path: Path) -> None:
    """Paths of subassemblies, made of the marks that templates had."""
    parts = [Part(f"a/{mark}/{k}", part.shape, part.pose) for k, (mark, part) in enumerate(
        zip(("/*PAGE*/", "<!--<script>"), hostile_scene("x").parts, strict=True))]  # fmt: skip
    page = write_page(Scene(parts), [], tmp_path / "page.html").read_text(encoding="utf-8")
    assert [tag for tag, _ in Page(page).tags] == [tag for tag, _ in Page(session_page.html([])).tags]
