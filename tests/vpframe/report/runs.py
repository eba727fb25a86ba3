"""Runs of which reports are written."""

import itertools
import json
from html.parser import HTMLParser

import numpy as np

from collision import colliding_surfaces
from tests.vpframe.watching import box, fake_session, place
from vpframe import __version__
from vpframe.events import ConstraintView, Frame
from vpframe.report import SessionLog
from vpframe.scene.scene import Part, Scene


def by_origin(folder):
    return {(pair["origin"], *pair["parts"]): pair for pair in document(folder)["clashes"]}


def log_of(frames, scene=None):
    log = SessionLog()
    log.begin(fake_session(scene).scene)
    for frame in frames:
        log.frame(frame)
    log.end()
    return log


def document(folder):
    document = json.loads((folder / "report.json").read_text())
    assert document["version"] == __version__
    return document


class Page(HTMLParser):
    """Tags of a page with their attributes, and whether each that was opened is closed."""

    VOID = ("meta", "link", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.text = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def stacked(heights, aside=0.0):
    """A block that stands 1 mm deep in a floor, a lid flush on the block, and a cube that goes to those heights.

    Yields the scene and its frames, with all that collides.
    """
    scene = Scene(
        [
            Part("floor", box((1, 1, 0.1)), place(z=-0.05), fixed=True),
            Part("block", box((0.1, 0.1, 0.1)), place(z=0.049)),
            Part("lid", box((0.1, 0.1, 0.02)), place(z=0.109)),
            Part("cube", box((0.1, 0.1, 0.1)), place(x=0.3, z=0.051)),
        ]
    )
    frames = []
    for step, height in enumerate(heights, 1):
        poses = {p.name: p.pose.copy() for p in scene.parts}
        poses["cube"] = place(x=0.3 + aside * step, z=height)
        rows = []
        for a, b in itertools.combinations(range(4), 2):
            at = [poses[name] for name in (scene.names[a], scene.names[b])]
            met = colliding_surfaces(scene.parts[a].mesh, scene.parts[b].mesh, at[0].actInv(at[1]))
            rows += [(a, i, b, j) for i, j in met.tolist()]
        colliding = np.array(rows, np.int32).reshape(-1, 4)
        frames.append(Frame(step, step / 60, poses, colliding, (), {"cube": 6}, {}, None, {}, ("cube",)))
    return scene, frames


def lasting(id, parts):
    """A constraint in force, seen in each frame."""
    return ConstraintView(
        id=id,
        kind="against",
        parts=parts,
        surfaces=((0,), (1,)),
        residual=0.0,
        state="active",
        origin=np.zeros(3),
        direction=np.array([0.0, 0.0, 1.0]),
        size=0.01,
        why="told",
    )
