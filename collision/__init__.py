"""Which surfaces collide, exactly: triangles grouped by surface and poses in, surface pairs out.

Knows triangles, surfaces, poses and boxes; nothing of CAD, names, mass or viewers. See `collision/README.md`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from collision.lazy import attributes

if TYPE_CHECKING:
    from collision.classify import PairClass, classify
    from collision.contact import CONTACT_DTYPE, PENETRATION_DTYPE, TimeOfImpact
    from collision.errors import CollisionError, MeshError, PoseError, UnknownObjectError
    from collision.manager import CollisionManager
    from collision.mesh import SurfaceMesh
    from collision.mesh_pair import MeshPair, intersect_at, last_surfaces, prepare_pair
    from collision.methods import colliding_surfaces
    from collision.objects import ObjectsState
    from collision.query.blocking import Stop, SurfacePairs, Sweeps
    from collision.query.containment import inside
    from collision.statistics import Statistics
    from collision.tolerance import Tolerance

__all__ = [
    "CONTACT_DTYPE",
    "PENETRATION_DTYPE",
    "CollisionError",
    "CollisionManager",
    "MeshError",
    "MeshPair",
    "ObjectsState",
    "PairClass",
    "PoseError",
    "Statistics",
    "Stop",
    "SurfaceMesh",
    "SurfacePairs",
    "Sweeps",
    "TimeOfImpact",
    "Tolerance",
    "UnknownObjectError",
    "classify",
    "colliding_surfaces",
    "inside",
    "intersect_at",
    "last_surfaces",
    "prepare_pair",
]

_NAMES = {
    "collision.classify": "PairClass classify",
    "collision.contact": "CONTACT_DTYPE PENETRATION_DTYPE TimeOfImpact",
    "collision.errors": "CollisionError MeshError PoseError UnknownObjectError",
    "collision.manager": "CollisionManager",
    "collision.mesh": "SurfaceMesh",
    "collision.mesh_pair": "MeshPair intersect_at last_surfaces prepare_pair",
    "collision.methods": "colliding_surfaces",
    "collision.objects": "ObjectsState",
    "collision.query.blocking": "Stop SurfacePairs Sweeps",
    "collision.query.containment": "inside",
    "collision.statistics": "Statistics",
    "collision.tolerance": "Tolerance",
}
_MODULE = {name: module for module, names in _NAMES.items() for name in names.split()}
"""where each name is defined: imported at its first use, because kernels take long to import"""

__getattr__, __dir__ = attributes(__name__, _MODULE)
