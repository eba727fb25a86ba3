"""Which surfaces collide, exactly: triangles grouped by surface and poses in, surface pairs out.

Knows triangles, surfaces, poses and boxes; nothing of CAD, names, mass or viewers. See `collision/README.md`.
"""

from collision.classify import PairClass, classify
from collision.contact import CONTACT_DTYPE, PENETRATION_DTYPE, TimeOfImpact
from collision.errors import CollisionError, MeshError, PoseError, UnknownObjectError
from collision.manager import CollisionManager
from collision.mesh import SurfaceMesh
from collision.methods import colliding_surfaces
from collision.statistics import Statistics
from collision.tolerance import Tolerance

__all__ = [
    "CONTACT_DTYPE",
    "PENETRATION_DTYPE",
    "CollisionError",
    "CollisionManager",
    "MeshError",
    "PairClass",
    "PoseError",
    "Statistics",
    "SurfaceMesh",
    "TimeOfImpact",
    "Tolerance",
    "UnknownObjectError",
    "classify",
    "colliding_surfaces",
]
