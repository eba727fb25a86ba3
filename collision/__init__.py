"""Exact surface collision: from triangles grouped by surface, and poses, to pairs of surfaces.

Knows triangles, surfaces, poses and boxes; nothing of CAD, names, mass or viewers, and imports no other package of the
four. Within it `numeric` is lowest, then `triangle`, `bvh`, `query`; `manager` is the one door.
Start with `mesh`, then `manager`; `collision/README.md` has examples.
"""

from __future__ import annotations

from collision.lazy import attributes, modules

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
    "collision.query.front": "buried",
    "collision.query.signed_distance": "signed_distances",
    "collision.statistics": "Statistics",
    "collision.tolerance": "Tolerance",
}
"""by module the names that it defines: imported at first use, because kernels take long to import"""

__all__ = sorted(modules(_NAMES))
__getattr__, __dir__ = attributes(__name__, modules(_NAMES))
