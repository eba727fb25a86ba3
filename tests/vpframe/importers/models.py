"""CAD files of several shapes, and scenes that are the same to the bit."""

from pathlib import Path

import vpframe as vp
from vpframe.scene import modelling as m


def model(path: Path, size: float = 0.06) -> Path:
    solid = m.box(size, 0.04, 0.02).filleted(0.003) - m.cylinder(0.005, 0.02).translated(0.015, 0.02)
    pin = m.cylinder(0.005, 0.03) + m.sphere(0.007)
    return m.write_step(
        path, {"block": (solid, None, (0.5, 0.2, 0.1), 7850.0), "pin": pin, "pair": ({"pin": pin}, None)}
    )


def same(a: vp.Scene, b: vp.Scene) -> bool:
    """Whether two scenes are the same to the last bit."""
    if a.names != b.names or a.all_notes() != b.all_notes():
        return False
    for p, q in zip(a.parts, b.parts, strict=True):
        assert p.pose.homogeneous.tobytes() == q.pose.homogeneous.tobytes()
        assert (p.color, p.density) == (q.color, q.density)
        one, other = p.shape, q.shape
        for array in ("vertices", "triangles", "surface_of_triangle"):
            assert getattr(one.mesh, array).tobytes() == getattr(other.mesh, array).tobytes()
        assert repr(one.surfaces) == repr(other.surfaces) and repr(one.features) == repr(other.features)
        assert [e.surfaces for e in one.edges] == [e.surfaces for e in other.edges]
        assert [e.points.tobytes() for e in one.edges] == [e.points.tobytes() for e in other.edges]
        assert repr([e.circle for e in one.edges]) == repr([e.circle for e in other.edges])
        assert (one.volume, one.closed) == (other.volume, other.closed)
        assert one.center.tobytes() == other.center.tobytes() and one.inertia.tobytes() == other.inertia.tobytes()
    shared = [[p.shape is q.shape for q in s.parts for p in s.parts] for s in (a, b)]
    return shared[0] == shared[1]
