"""`Answers`: what behaviours answer, checked before anything moves by it; failures are told with the object's name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from physics.errors import BehaviourError
from physics.forces.behaviours import LAWS, Behaviour, Reaction, View
from physics.model.body import Body

Array = NDArray[np.float64]


class Answers:
    """Asks behaviours. body: by object id; the world's own, which it changes."""

    def __init__(self, collision: CollisionManager, body: Mapping[int, Body], tolerance: Tolerance) -> None:
        self._collision = collision
        self._body = body
        self._tolerance = tolerance

    def called(self, i: int) -> str:
        """How messages name object i."""
        body = self._body.get(i)
        name = body.name if body is not None else self._collision.mesh(i).name
        return f"object {i} ({name})"

    def wrench(self, behaviour: Behaviour, view: View) -> Array:
        """(6,) what a behaviour exerts on the object of the view; BehaviourError if it fails or gives no wrench."""
        i = view.object_id
        given = self._asked(i, behaviour, "wrench", view)
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
        """The pose that `path` gives object i at `time`, s; None if it is free then. BehaviourError as for `wrench`."""
        pose = self._asked(i, path, "pose", time)
        return None if pose is None else self.rigid(i, pose, type(path).__name__)

    def rigid(self, i: int, pose: object, name: str) -> pin.SE3:
        """The pose that `name` gave for object i; BehaviourError if it is none."""
        if (
            not isinstance(pose, pin.SE3)
            or not np.isfinite(pose.homogeneous).all()
            or np.abs(pose.rotation.T @ pose.rotation - np.eye(3)).max() > self._tolerance.rigid
            or np.linalg.det(pose.rotation) < 0.0
        ):
            text = f"{self.called(i)}: {name} gives {_line(pose)}, which is no finite rigid pose"
            raise BehaviourError(text, i, name)
        return pose

    def reaction(self, i: int, behaviours: Sequence[Behaviour]) -> Reaction:
        """How object i meets others, by all its behaviours; BehaviourError if one fails or says what cannot be."""
        reaction = Reaction()
        for behaviour in behaviours:
            reaction = self._asked(i, behaviour, "reaction", reaction)
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

    def _asked(self, i: int, behaviour: Behaviour, question: str, *given: object) -> Any:
        try:
            return getattr(behaviour, question)(*given)
        except Exception as error:
            name = type(behaviour).__name__
            text = f"{self.called(i)}: {name}.{question} raised {type(error).__name__}: {error}"
            raise BehaviourError(text, i, name) from error


def _line(value: object) -> str:
    """What was given, on one line and not too long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."
