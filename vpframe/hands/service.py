"""Lists of parts that a hand removes, refits or exchanges: their order, where they go, and how errors name them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.errors import TaskError
from vpframe.hands import paths
from vpframe.hands.gripper import Gripper
from vpframe.hands.reach import spans
from vpframe.scene.scene import Part
from vpframe.scene.subassembly import listed

Vector = NDArray[np.float64]
Names = str | Sequence[str]

ROOM = 0.01
"""distance between a removed part and all others, m"""
PASSING = 2e-3
"""distance at which a removed part passes others on its way aside, m"""
HOME = 1e-6
"""deviation (m and rad) within which a part is at its initial pose"""


def items_of(hand: Gripper, parts: Names, verb: str) -> tuple[str, ...]:
    """Check a list of parts and subassemblies; raise TaskError if it is empty, or names a part twice or a fixed one."""
    if not isinstance(parts, str) and not (isinstance(parts, Sequence) and all(isinstance(n, str) for n in parts)):
        raise TaskError(f"{hand.name}.{verb}({parts!r}): give the name of a part, or a list of names")
    items = (parts,) if isinstance(parts, str) else tuple(parts)
    if not items:
        raise TaskError(f"{hand.name}.{verb}: the list of parts is empty; name at least one")
    seen: set[str] = set()
    for name in items:
        group = hand.session.group(name)
        if not seen.isdisjoint(group):
            raise TaskError(f"{hand.name}.{verb}: {name} is named twice; name each part once")
        for fixed in (n for n in group if hand.scene[n].fixed):
            raise TaskError(f"{hand.name}.{verb}: {fixed} is fixed in the scene; set part.fixed = False before")
        seen.update(group)
    return items


def units(hand: Gripper, name: str, pitch: float | None = None) -> tuple[str, ...]:
    """Return what is removed or refitted as one: a part, a subassembly, or the parts of one that is but fasteners, or
    whose parts are no longer to each other as they were at first."""
    scene, group = hand.scene, hand.session.group(name)
    if len(group) == 1:
        return (name,)
    first = [_trail(hand, part)[0][1] for part in group]
    apart = max(
        paths.apart(first[0].actInv(begun), scene[group[0]].pose.actInv(scene[part].pose))
        for begun, part in zip(first, group, strict=True)
    )
    fasteners = all(pitch is not None or hand.session.pitch_of(part) is not None for part in group)
    return group if fasteners or apart > HOME else (name,)


def check_threads(hand: Gripper, items: Sequence[str], pitch: float | None, verb: str) -> None:
    """Raise TaskError for a part of unknown pitch."""
    for name in items:
        if pitch is None and hand.session.pitch_of(name) is None:
            raise TaskError(
                f"{hand.name}.{verb}: no recognised thread holds {name}; declare it with "
                f"session.thread({name!r}, pitch), or use {'remove' if verb == 'unscrew' else 'refit'}"
            )


def away(hand: Gripper, parts: Names, verb: str) -> tuple[str, ...]:
    """Return the units of a list, without those parts of a unit that are at their initial poses."""
    items: tuple[str, ...] = ()
    for name in items_of(hand, parts, verb):
        found = units(hand, name)
        items += tuple(unit for unit in found if not _is_home(hand, hand.session.group(unit)[0])) or found
    return items


def last_removed_first(hand: Gripper, items: Sequence[str], verb: str) -> list[str]:
    """Return the items by the step of their last motion, latest first; TaskError for one at its initial pose."""
    leads = {name: hand.session.group(name)[0] for name in items}
    for name, lead in leads.items():
        if len(_trail(hand, lead)) < 2 or _is_home(hand, lead):
            raise TaskError(f"{hand.name}.{verb}: {name} is at its initial pose; remove it first")
    return sorted(items, key=lambda name: -_trail(hand, leads[name])[-1][0])


def side(hand: Gripper, way: Vector) -> Vector:
    """Return a direction (3,), unit, world, across `way`: the first axis along which little extra travel is needed."""
    first = int(np.argmin(np.abs(way)))
    axes = [sign * np.eye(3)[(first + k) % 3] for sign in (1.0, -1.0) for k in range(3)]
    sides = [aside - (aside @ way) * way for aside in axes if abs(aside @ way) < 0.8]
    sides = [aside / np.linalg.norm(aside) for aside in sides]
    out = [clear(hand, way, aside) for aside in sides]
    return next(aside for aside, far in zip(sides, out, strict=True) if far <= 2.0 * min(out) + ROOM)


def clear(hand: Gripper, way: Vector, aside: Vector | None = None) -> float:
    """Travel (m) along `way` (3,) until the held parts are clear of all others; 0 if they are.

    aside: (3,) unit, across `way`: consider only parts that would be hit on a later motion along `aside`.
    """
    held = [hand.scene[name] for name in hand.parts]
    others: list[Part] = [part for part in hand.scene.parts if part.name not in hand.parts]
    if aside is not None:
        across = np.cross(way, aside)
        low, high = spans(held, across)
        behind = spans(held, aside)[0]

        def met(part: Part) -> bool:
            least, most = spans([part], across)
            return least < high + PASSING and most > low - PASSING and spans([part], aside)[1] > behind - PASSING

        others = [part for part in others if met(part)]
    if not others:
        return 0.0
    return max(spans(others, way)[1] + ROOM - spans(held, way)[0], 0.0)


def since_home(hand: Gripper, part: str) -> list[pin.SE3]:
    """Return the poses of a part since it was last at its initial pose."""
    poses = [pose for _, pose in _trail(hand, part)]
    last = max(k for k, pose in enumerate(poses) if paths.apart(poses[0], pose) < HOME)
    return [poses[0], *poses[last + 1 :]]


def track(hand: Gripper, poses: Sequence[pin.SE3]) -> paths.Track:
    """Return a track with one pose a step."""
    return paths.Track(hand.session.dt * np.arange(len(poses), dtype=np.float64), poses)


def by_kind(hand: Gripper, items: Sequence[str]) -> str:
    """List names, grouped by shape: "cover, 4 like M3_1"."""
    kinds: dict[int, list[str]] = {}
    for name in items:
        group = hand.session.group(name)
        kinds.setdefault(id(hand.scene[group[0]].shape) if len(group) == 1 else id(group), []).append(name)
    return listed([f"{len(n)} like {n[0]}" if len(n) > 1 else n[0] for n in kinds.values()])


def failed_at(hand: Gripper, verb: str, items: Sequence[str], done: int, error: TaskError) -> TaskError:
    """Return the error of a list that stopped at an item after `done` others."""
    so_far = f", after {by_kind(hand, items[:done])}" if done else ""
    return TaskError(f"{hand.name}.{verb}: {items[done]}, {done + 1} of {len(items)}{so_far}: {error}")


def _is_home(hand: Gripper, part: str) -> bool:
    return paths.apart(_trail(hand, part)[0][1], hand.scene[part].pose) < HOME


def _trail(hand: Gripper, part: str) -> Sequence[tuple[int, pin.SE3]]:
    found: Sequence[tuple[int, pin.SE3]] = hand.session.trail(part)
    return found
