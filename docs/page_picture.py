"""Draws `docs/page.png`: the live page with a part in hand, and a mate offered beside the cursor.

python docs/page_picture.py        (needs Chromium on the PATH)
"""

from __future__ import annotations

import sys
import tempfile
import threading
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import vpframe as vp
from tests.vpframe.bench_model import write_bench
from tests.vpframe.browser import Browser
from vpframe.app.workbench import Workbench

HEAD = """(() => { const at = world.parts[1].solid.localToWorld(new THREE.Vector3(0, 0, 0.005)).project(viewer.camera);
    return onScreen(at); })()"""


def main() -> None:
    """Take the peg, bring it to its bore until the mate is offered, and keep what is seen."""
    with tempfile.TemporaryDirectory() as folder, Browser(1200, 720) as browser:
        model = write_bench(Path(folder) / "bench.step")
        bench = Workbench(vp.load(model), model, {})
        runner = threading.Thread(target=bench.run)
        runner.start()
        try:
            browser.open(bench.viewer.url)
            browser.wait("world.last !== null && world.found && world.found.done", 120)
            browser.press(*browser.run(HEAD))
            browser.wait("selection.parts.length === 1")
            browser.click("#grab")
            browser.wait("holding()")
            x, y = browser.run(HEAD)
            browser.drag((x, y), (x, y + 1), (x, y + 2))
            browser.wait("!document.querySelector('#offer').hidden")
            Image.fromarray(browser.picture()).save(Path(__file__).with_name("page.png"), optimize=True)
        finally:
            bench.stop()
            runner.join()


if __name__ == "__main__":
    main()
