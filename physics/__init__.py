"""What is free moves: mass, forces, impulses, per-object behaviours, time stepping."""

from physics.errors import BehaviourError, BodyError, PhysicsError, WorldError
from physics.forces.behaviours import (
    Behaviour,
    Buoyancy,
    Drag,
    Elastic,
    Friction,
    Gravity,
    Magnet,
    Motor,
    Reaction,
    ScriptedPath,
    Sleeping,
    Solidity,
    Spring,
    Touch,
    View,
    Wind,
    force,
)
from physics.model.body import DENSITY, Body
from physics.stepping.hands import SpringHand
from physics.world import Snapshot, World

__all__ = [
    "DENSITY",
    "Behaviour",
    "BehaviourError",
    "Body",
    "BodyError",
    "Buoyancy",
    "Drag",
    "Elastic",
    "Friction",
    "Gravity",
    "Magnet",
    "Motor",
    "PhysicsError",
    "Reaction",
    "ScriptedPath",
    "Sleeping",
    "Snapshot",
    "Solidity",
    "Spring",
    "SpringHand",
    "Touch",
    "View",
    "Wind",
    "World",
    "WorldError",
    "force",
]
