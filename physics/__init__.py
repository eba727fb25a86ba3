"""Rigid-body dynamics: mass, forces, materials, joints, contact with impulses, time stepping."""

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
from physics.forces.hands import SpringHand
from physics.model.body import Body
from physics.model.material import DENSITY, MATERIALS, PAIRS, Material, Pair
from physics.world import Snapshot, World

__all__ = [
    "DENSITY",
    "MATERIALS",
    "PAIRS",
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
    "Material",
    "Motor",
    "Pair",
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
