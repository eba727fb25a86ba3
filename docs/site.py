"""Hook of MkDocs: pages that are made of something else, and links to files that are no pages.

README.md, CHANGELOG.md and other texts of the repository are pages as they stand. The reference is made of the names of
`vpframe`, the page of commands of the command line's own parser.
"""

from __future__ import annotations

import argparse
import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TEXTS = {
    "index.md": "README.md",
    "examples.md": "examples/README.md",
    "collision.md": "collision/README.md",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
}
"""page: file of the repository"""
BENCH = Path(__file__).with_name("bench.html")
"""the page that `vpframe bench --all --html docs/bench.html` wrote last"""
LAST_RUN = "<!-- last run -->"
_PAGES = {text: page for page, text in TEXTS.items()}
_LINK = re.compile(r"(\]\()([^)#\s]+)(#[^)\s]*)?(\))")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made, and the pictures that texts from outside of `docs` show."""
    from mkdocs.structure.files import File

    for page, text in TEXTS.items():
        files.append(File.generated(config, page, content=(ROOT / text).read_text(encoding="utf-8")))
    files.append(File.generated(config, "reference.md", content=reference()))
    files.append(File.generated(config, "commands.md", content=commands()))
    for picture in sorted((ROOT / "examples" / "pictures").glob("*.png")):
        files.append(File.generated(config, f"pictures/examples/{picture.name}", abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links to files of the repository at their pages; a link to a file without one becomes its path."""
    if LAST_RUN in markdown:
        markdown = markdown.replace(LAST_RUN, last_run())
    source = TEXTS.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    folder = posixpath.dirname(source)

    def replaced(match: re.Match[str]) -> str:
        target, anchor = match[2], match[3] or ""
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        path = posixpath.normpath(posixpath.join(folder, target))
        if path in _PAGES:
            return f"{match[1]}{_PAGES[path]}{anchor}{match[4]}"
        if path.startswith("docs/"):
            return f"{match[1]}{path.removeprefix('docs/')}{anchor}{match[4]}"
        if path.startswith("examples/pictures/"):
            return f"{match[1]}pictures/examples/{posixpath.basename(path)}{match[4]}"
        if not (ROOT / path).exists():
            return match[0]  # MkDocs says that it leads nowhere
        return f"]: `{path}`"

    return re.sub(r"\[([^\[\]]*)\]: (`[^`]*`)", r"\1 (\2)", _LINK.sub(replaced, markdown))


def reference() -> str:
    """Every public name of `vpframe`, by the module that it comes from."""
    import vpframe

    lines = ["# Names of `vp`", "", "All that a task script needs: `import vpframe as vp`, then `vp.NAME`.", ""]
    for module, names in vpframe._NAMES.items():
        for name in sorted(names):
            options = ["    options: {inherited_members: true}"] if name == "Hand" else []  # its verbs, by subject
            lines += [f"::: {module}.{name}", *options, ""]
    for name, module in vpframe._MODULES.items():
        lines += [f"::: {module}", "    options:", f"      heading: vp.{name}", ""]
    return "\n".join(lines)


def last_run() -> str:
    """When, where and of which commit the benchmarks were run last, the ratios they found, and a link to their page."""
    if not BENCH.exists():
        return "None is kept here yet: `vpframe bench --all --html docs/bench.html` keeps one."
    text = BENCH.read_text(encoding="utf-8")
    head = re.findall(r"<tr><th>(\w+)</th><td>(.*?)</td></tr>", text.partition("<nav>")[0])
    lines = ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in head), ""]
    lines += ["[The whole page, with tables and plots](bench.html)", "", "| suite | ratio | |", "| --- | --- | --- |"]
    for suite, section in re.findall(r"<h2 id='(\w+)'>(.*?)(?=<h2 |</body>)", text, re.S):
        if missing := re.search(r"<p class='dim'>(No result: [^<]*)</p>", section):
            lines.append(f"| {suite} | {missing[1]} | |")
        for name, value in re.findall(r"<tr><td>([^<]*)</td><td>([^<]*)</td></tr>", section):
            lines.append(f"| {suite} | {name.replace('|', '&#124;')} | {value} |")
    return "\n".join(lines)


def commands() -> str:
    """Every command with its options, as `--help` prints them."""
    from vpframe.app.cli import _parser

    parser = _parser()
    parser.formatter_class = _Wide
    lines = ["# Command line", "", "```text", parser.format_help().rstrip(), "```", ""]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                command.formatter_class = _Wide
                lines += [f"## vpframe {name}", "", "```text", command.format_help().rstrip(), "```", ""]
    lines += [
        "Every command exits with 0 when it is done, with 1 when the answer is no (a clash, a task that failed, no way",
        "out), with 2 on bad usage or bad input (one line on standard error), with 130 after Ctrl-C. With `--json` one",
        "JSON document and nothing else goes to standard output.",
    ]
    return "\n".join(lines)


class _Wide(argparse.HelpFormatter):
    """Help of one width, whatever the terminal."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=110, max_help_position=32)
