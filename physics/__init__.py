"""Rigid-body dynamics: mass, forces, materials, joints, contact with impulses, time stepping.

Knows bodies, contacts and accepted constraints; nothing of files, names of a product tree, or viewers.
May use `collision` and `constraints`. Within it `model` is lowest, then `joints`, `contact`, `solver`, `forces`,
`stepping`; `world` is the one door.
Start with `world`, then `stepping/step`.
"""

from __future__ import annotations

from collision.lazy import attributes, modules

_NAMES = {
    "physics.errors": "BehaviourError BodyError PhysicsError WorldError",
    "physics.forces.behaviours": """
        Behaviour Buoyancy Drag Elastic Friction Gravity Magnet Motor Reaction ScriptedPath Sleeping Solidity Spring
        Touch View Wind force""",
    "physics.forces.hands": "SpringHand",
    "physics.model.body": "Body",
    "physics.model.material": "DENSITY MATERIALS PAIRS Material Pair",
    "physics.world": "Snapshot World",
}
"""by module the names that it defines: imported at first use, because kernels take long to import"""

__all__ = sorted(modules(_NAMES))
__getattr__, __dir__ = attributes(__name__, modules(_NAMES))
