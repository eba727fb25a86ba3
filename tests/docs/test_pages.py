"""The documentation: every block of code runs, every command is one that there is, every name is on a page."""

import html
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import physics as physics_package
import vpframe as vp
from vpframe.app import cli, demo
from vpframe.exporters.export import KINDS
from vpframe.importers.checks import FORMATS
from vpframe.scene import modelling as m

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```", re.S | re.M)
LOOKED_AT = ("view", "replay")
"""commands that open a viewer"""
Names = dict[str, Any]


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Language, what follows it on its line, and text of each block."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def commands(text: str) -> Iterator[list[str]]:
    """The words of each command of a block, without comments."""
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        if words and Path(words[0]).name in ("vpframe", "python"):
            yield words


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the pages' models lie, and what the tutorial writes."""
    folder = tmp_path_factory.mktemp("docs")
    demo.build(folder / "demo.step")
    return folder


def follow(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a page from its first line to its last: files are written, scripts and commands run."""
    monkeypatch.chdir(folder)
    for language, note, text in blocks(page):
        wanted = int(re.findall(r"exit code (\d)|$", note)[0] or 0)
        if language == "python":
            named = re.match(r"# (\S+\.py)\n", text)
            if named:
                Path(named[1]).write_text(text)
            else:
                exec(compile(text, str(page), "exec"), {"__name__": "a block"})
        elif language == "sh":
            for words in commands(text):
                if words[0] == "python":
                    exec(compile(Path(words[1]).read_text(), words[1], "exec"), {"__name__": "__main__"})
                elif words[1] not in LOOKED_AT:
                    assert cli.main(words[1:]) == wanted, words


@pytest.mark.slow
def test_the_tutorial_and_the_answers_run_as_they_stand(folder: Path, monkeypatch, capsys) -> None:
    follow(DOCS / "tutorial.md", folder, monkeypatch)
    out = capsys.readouterr().out
    for _, _, text in (block for block in blocks(DOCS / "tutorial.md") if block[0] == "text"):
        for line in filter(None, text.splitlines()):
            assert line in out, "the page says what is printed"
    follow(DOCS / "howto.md", folder, monkeypatch)


def gearbox() -> vp.Scene:
    """A housing with a shaft in its bore, a cover beside it."""
    housing = m.box(0.04, 0.04, 0.04).translated(-0.02, -0.02, 0.0) - m.cylinder(0.01001, 0.032).translated(0, 0, 0.008)
    cover = m.box(0.04, 0.04, 0.005)
    made = m.scene(
        {
            "housing": (housing, pin.SE3.Identity()),
            "shaft": (m.cylinder(0.010, 0.05), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.008]))),
            "cover": (cover, pin.SE3(np.eye(3), np.array([0.06, 0.0, 0.0]))),
        }
    )
    made["housing"].fixed = True
    return made


def fan() -> Names:
    """A hand, and a cover on four screws over a fan, with a spare one."""
    base = m.box(0.06, 0.06, 0.02).translated(-0.03, -0.03, 0.0) - m.box(0.03, 0.03, 0.015).translated(
        -0.015, -0.015, 0.005
    )
    cover = m.box(0.06, 0.06, 0.004).translated(-0.03, -0.03, 0.0)
    places = [(x, y) for x in (-0.024, 0.024) for y in (-0.024, 0.024)]
    for x, y in places:
        base = base - m.cylinder(0.0015, 0.006).translated(x, y, 0.014)
        cover = cover - m.cylinder(0.0016, 0.004).translated(x, y, 0.0)
    screw = m.cylinder(0.0015, 0.009).translated(0, 0, -0.009) + m.hexagon(0.0055, 0.002)

    def at(x: float, y: float, z: float) -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([x, y, z]))

    rotor = m.box(0.026, 0.026, 0.014).translated(-0.013, -0.013, 0.0)  # farther from its walls than mates reach
    parts = {"base": (base, at(0, 0, 0)), "cover": (cover, at(0, 0, 0.02)), "fan": (rotor, at(0, 0, 0.005))}
    parts["spare fan"] = (rotor, at(0.0, 0.2, 0.0))
    for i, (x, y) in enumerate(places, start=1):
        parts[f"M3_{i}"] = (screw, at(x, y, 0.024))
    scene = m.scene(parts)
    scene["base"].fixed = True
    session = vp.Session(scene)
    for i in range(1, 5):
        session.thread(f"M3_{i}", 0.0005)
    return {"session": session, "hand": session.hand()}


def mesh() -> Any:
    return m.shape(m.box(0.1, 0.1, 0.01)).mesh


def recognition() -> Names:
    scene = gearbox()
    wanted = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01]))
    return {"scene": scene, "held": 1, "wanted": wanted, "movable": {1}}


def physics() -> Names:
    from physics import Behaviour, force

    high = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05]))
    return {
        "floor_mesh": mesh(),
        "floor_pose": pin.SE3.Identity(),
        "part_mesh": mesh(),
        "part_pose": high,
        "Behaviour": Behaviour,
        "force": force,
    }


def readme() -> Names:
    part = mesh()
    return {
        "vertices": part.vertices, "triangles": part.triangles, "surface_of_triangle": part.surface_of_triangle,
        "b": part, "pose_of_b_in_a": pin.SE3.Identity(),
    }  # fmt: skip


def formats() -> Names:
    demo.build(Path("bolt.step"))
    return {"there": pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.0]))}


GIVEN: dict[str, Callable[[], Names]] = {
    "README.md": readme, "formats.md": formats, "recognition.md": recognition, "physics.md": physics, "verbs.md": fan,
}  # fmt: skip
"""what a page's blocks of Python take as given"""
RUN = [page for page in TEXTS if page.name not in ("tutorial.md", "howto.md")]
RUN = [page for page in RUN if any(language == "python" for language, _, _ in blocks(page))]


LONG = ("verbs.md", "physics.md", "sessions.md")
"""pages of which all blocks together take five seconds to half a minute"""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow) if page.name in LONG else page for page in RUN],
    ids=lambda page: page.name,
)
def test_blocks_of_python_run(page: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(vp, "load", lambda path: gearbox())
    names = {"__name__": "a block", **GIVEN.get(page.name, dict)()}
    for language, _, text in blocks(page):
        if language == "python":
            code = text.replace('viewer="meshcat", ', "")
            exec(compile(code, str(page), "exec"), names)
    assert "__builtins__" in names, "there was a block"


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.name)
def test_commands_are_commands(page: Path) -> None:
    for language, _, text in blocks(page):
        for words in commands(text) if language == "sh" else ():
            if Path(words[0]).name == "vpframe":
                given = words[1:]
                if given[:2] == cli.ACCEPT.split():
                    given[:2] = [cli.ACCEPT]
                assert callable(cli._parser().parse_args(given).command)


@pytest.fixture
def site(monkeypatch) -> Iterator[ModuleType]:
    """The hook of the site."""
    import importlib.util

    spec = importlib.util.spec_from_file_location("docs_site", DOCS / "site.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "docs_site", module)
    spec.loader.exec_module(module)
    yield module


def test_every_public_name_and_every_command_has_its_place(site: ModuleType) -> None:
    reference, line = site.reference(), site.commands()
    for name in vp._LAZY:
        assert re.search(rf"^::: \S+\.{name}$", reference, re.M), name
    for name in vp._MODULES.values():
        assert f"::: {name}\n" in reference
    for name in cli._parser()._subparsers._group_actions[0].choices:  # type: ignore[union-attr]
        assert f"## vpframe {name}\n" in line
    assert "--help" in line


def test_every_block_is_a_block_of_the_site() -> None:
    """As MkDocs renders it: a fence that it does not understand becomes text, with all up to the next one."""
    markdown = pytest.importorskip("markdown")
    pytest.importorskip("pymdownx")
    for page in TEXTS:
        text = page.read_text(encoding="utf-8")
        shown = markdown.markdown(
            text, extensions=["tables", "attr_list", "pymdownx.highlight", "pymdownx.superfences"]
        )
        found = re.findall(r'<div class="highlight">.*?<code>(.*?)</code></pre></div>', shown, re.S)
        there = {html.unescape(re.sub(r"<[^>]*>", "", block)).strip() for block in found}
        assert {block.strip() for *_, block in blocks(page)} <= there, page.name
        assert "```" not in shown, page.name


def test_docstrings_are_read_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    """By the reader of the reference, whose warnings end a strict build."""
    griffe = pytest.importorskip("griffe")
    packages = ("collision", "constraints", "physics", "vpframe")
    read = griffe.GriffeLoader(search_paths=[str(ROOT)])
    objects = [read.load(package) for package in packages]
    count = 0
    while objects:
        one = objects.pop()
        if one.is_alias:
            continue
        objects += one.members.values()
        if one.docstring is not None:
            one.docstring.parse("numpy", warn_unknown_params=False, warn_missing_types=False)
            count += 1
    assert count > 1000
    assert [record.getMessage() for record in caplog.records] == []


def test_what_the_site_is_built_with_is_bounded() -> None:
    """A new release may bring a warning, and a warning ends the build."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    docs = project["optional-dependencies"]["docs"]
    assert all(re.search(r">=[\d.]+,<[\d.]+$", requirement) for requirement in docs)
    assert {re.match(r"[\w-]+", requirement)[0] for requirement in docs} >= {"mkdocs", "griffelib", "ruff"}  # type: ignore[index]


def rows(text: str) -> list[str]:
    """First cells of the tables of a text."""
    return re.findall(r"^\| (.*?) \|", text, re.M)


def test_the_table_of_verbs_is_that_of_the_code() -> None:
    named = set(re.findall(r"`(\w+)\(", "".join(rows((DOCS / "verbs.md").read_text(encoding="utf-8")))))
    verbs = {name for name in dir(vp.Hand) if hasattr(getattr(vp.Hand, name), "__wrapped__")}
    assert len(verbs) > 15 and verbs - named == set()


def test_the_endings_of_files_are_those_of_the_code() -> None:
    page = (DOCS / "formats.md").read_text(encoding="utf-8")
    into, out = page.split("\n## In\n")[1].split("\n## Out\n")
    endings = set(re.findall(r"\.\w+", " ".join(re.findall(r"`([^`]*)`", " ".join(rows(into))))))
    assert set(FORMATS) <= endings, "each is in the first column"
    head = next(line for line in out.splitlines() if line.startswith("| |"))
    assert set(re.findall(r"\.\w+", head)) == set(KINDS) == set(cli.EXPORTS)


def test_the_behaviours_of_the_page_are_those_of_the_code() -> None:
    named = set(re.findall(r"\w+", "".join(rows((DOCS / "physics.md").read_text(encoding="utf-8")))))
    kinds = [getattr(physics_package, name) for name in physics_package.__all__]
    behaviours = {k.__name__ for k in kinds if isinstance(k, type) and issubclass(k, physics_package.Behaviour)}
    assert behaviours - {"Behaviour", "SpringHand"} <= named


def test_every_page_is_in_the_navigation() -> None:
    listed = re.findall(r"([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
    assert {page.name for page in DOCS.glob("*.md")} <= set(listed)
    assert len(listed) == len(set(listed))


def test_every_picture_of_a_page_is_there_and_is_drawn_by_a_script() -> None:
    drawn = "".join(path.read_text() for path in [*DOCS.glob("*.py"), ROOT / "examples/pictures.py"])
    for page in [*DOCS.glob("*.md"), ROOT / "README.md", ROOT / "examples" / "README.md"]:
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).is_file(), f"{page.name}: {link}"
            assert f'"{Path(link).stem}' in drawn or Path(link).name in drawn, f"{link} is drawn by no script"
