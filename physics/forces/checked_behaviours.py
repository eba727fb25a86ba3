"""`CheckedBehaviours`: calls behaviours and checks their results; errors name object and behaviour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, PoseError, Tolerance
from collision.poses import pack
from physics.errors import BehaviourError
from physics.forces.behaviours import Behaviour, Reaction, View
from physics.model.body import Body
from physics.model.material import LAWS

Array = NDArray[np.float64]


class CheckedBehaviours:
    """Calls behaviours. body: mass properties by object id, shared with the world."""

    def __init__(self, collision: CollisionManager, body: Mapping[int, Body], tolerance: Tolerance) -> None:
        self._collision = collision
        self._body = body
        self._tolerance = tolerance

    def called(self, i: int) -> str:
        """Name of object i in messages."""
        body = self._body.get(i)
        name = body.name if body is not None else self._collision.mesh(i).name
        return f"object {i} ({name})"

    def wrench(self, behaviour: Behaviour, view: View) -> Array:
        """(6,) wrench of a behaviour on the object of the view. BehaviourError if it raises or returns no wrench."""
        i = view.object_id
        given = self._called(i, behaviour, "wrench", view)
        if given is None:
            return np.zeros(6)
        try:
            w = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            w = np.zeros(0)
        if w.shape != (6,) or not np.isfinite(w).all():
            name = type(behaviour).__name__
            text = f"{self.called(i)}: {name}.wrench returned {_line(given)}; give six finite numbers"
            raise BehaviourError(text, i, name)
        return w

    def pose(self, i: int, path: Behaviour, time: float) -> pin.SE3 | None:
        """Pose that `path` gives object i at `time`, s; None: the object is free. BehaviourError as for `wrench`."""
        pose = self._called(i, path, "pose", time)
        return None if pose is None else self.rigid(i, pose, type(path).__name__)

    def rigid(self, i: int, pose: object, name: str) -> pin.SE3:
        """`pose`, if it is a finite rigid one; else BehaviourError. name: who returned it."""
        try:
            if isinstance(pose, pin.SE3):
                pack(pose, name, i, self._tolerance.rigid)
                return pose
        except PoseError:
            pass
        text = f"{self.called(i)}: {name} gives {_line(pose)}, which is no finite rigid pose"
        raise BehaviourError(text, i, name)

    def reaction(self, i: int, behaviours: Sequence[Behaviour]) -> Reaction:
        """Reaction of object i after all its behaviours. BehaviourError if one raises or returns an impossible one."""
        reaction = Reaction()
        for behaviour in behaviours:
            reaction = self._called(i, behaviour, "reaction", reaction)
            name, called = type(behaviour).__name__, self.called(i)
            if not isinstance(reaction, Reaction):
                raise BehaviourError(f"{called}: {name}.reaction returned {_line(reaction)}, no Reaction", i, name)
            for what, value, most in (
                ("restitution", reaction.restitution, 1.0),
                ("friction", reaction.friction, np.finfo(np.float64).max),
            ):
                if value is not None and not (isinstance(value, int | float | np.number) and 0.0 <= value <= most):
                    limits = "0 … 1" if most == 1.0 else "0 or more"
                    raise BehaviourError(f"{called}: {name} gives {what} {_line(value)}; give {limits}", i, name)
            if reaction.law not in LAWS:
                text = f"{called}: {name} gives law {_line(reaction.law)}; there are: {', '.join(LAWS)}"
                raise BehaviourError(text, i, name)
        return reaction

    def _called(self, i: int, behaviour: Behaviour, question: str, *given: object) -> Any:
        try:
            return getattr(behaviour, question)(*given)
        except Exception as error:
            name = type(behaviour).__name__
            text = f"{self.called(i)}: {name}.{question} raised {type(error).__name__}: {error}"
            raise BehaviourError(text, i, name) from error


def _line(value: object) -> str:
    """`repr` on one line, at most 80 characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."
