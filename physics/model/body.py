"""`Body`: volume, mass, centre and inertia, from a closed mesh or from given figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision import SurfaceMesh
from collision.mesh import welded
from physics.errors import BodyError
from physics.model.material import Material, material

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """Mass properties of one rigid body, in the frame of its mesh.

    Raises
    ------
    BodyError: mass, volume or inertia that no solid has (not finite, not positive, an inertia that is not symmetric
        or whose principal moments violate the triangle inequality).
    """

    mass: float
    """kg"""
    center: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) centre of mass, m"""
    inertia: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) about the centre of mass, kg·m²"""
    volume: float = 0.0
    """m³ of fluid it displaces; 0: none"""
    name: str = "body"
    notes: tuple[str, ...] = ()
    """defects of the mesh, and the values used instead"""

    def __post_init__(self) -> None:
        center = np.array(self.center, dtype=np.float64)
        inertia = np.array(self.inertia, dtype=np.float64)
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise BodyError(f"{self.name}: mass is {self.mass!r} kg; give a positive number", self.name, "mass")
        if not (np.isfinite(self.volume) and self.volume >= 0.0):
            raise BodyError(f"{self.name}: volume is {self.volume!r} m³; give zero or more", self.name, "volume")
        if center.shape != (3,) or not np.isfinite(center).all():
            raise BodyError(f"{self.name}: center is {self.center!r}; give three finite numbers", self.name, "center")
        if inertia.shape != (3, 3) or not np.isfinite(inertia).all():
            raise BodyError(f"{self.name}: inertia must be a finite 3x3 matrix", self.name, "inertia")
        scale = float(np.abs(inertia).max())
        if np.abs(inertia - inertia.T).max() > 1e-9 * scale:
            raise BodyError(f"{self.name}: inertia is not symmetric", self.name, "inertia")
        inertia = 0.5 * (inertia + inertia.T)
        moments = np.linalg.eigvalsh(inertia)
        if moments[0] <= 0.0:
            raise BodyError(
                f"{self.name}: principal moments {moments.tolist()} kg·m² are not all positive", self.name, "inertia"
            )
        if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
            raise BodyError(
                f"{self.name}: principal moments {moments.tolist()} kg·m² violate the triangle inequality "
                "(the largest may not exceed the sum of the others); no solid has them",
                self.name,
                "inertia",
            )
        for array in (center, inertia):
            array.setflags(write=False)
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "inertia", inertia)

    @classmethod
    def from_mesh(cls, mesh: SurfaceMesh, density: float | str | Material = "steel", name: str | None = None) -> Body:
        """Mass properties of the solid a closed mesh bounds, at one density (kg/m³, or a material or its name).

        The polyhedron is integrated exactly (Eberly, "Polyhedral Mass Properties (Revisited)", 2002), so the only
        error against the true solid is the tessellation's. An inverted mesh is turned round, an open one replaced by
        its convex hull; `notes` says so.
        """
        name = mesh.name if name is None else name
        rho = _density(density, name)
        triangles = mesh.vertices[mesh.triangles]
        notes: list[str] = []
        loose = open_edges(mesh)
        if loose:
            triangles = _hull(mesh.vertices, name)
        volume, center, inertia = polyhedron(triangles)
        if loose:
            notes.append(
                f"{name}: the mesh is open ({loose} edges without a partner); its convex hull is used instead, "
                f"{volume:.6g} m³"
            )
        if volume < 0.0:
            volume, center, inertia = polyhedron(triangles[:, ::-1])
            notes.append(
                f"{name}: the mesh is inverted (normals point into the material); it is used turned round, "
                f"{volume:.6g} m³"
            )
        if not volume > 0.0:
            raise BodyError(f"{name}: the mesh bounds no volume; give mass properties by hand", name, "volume")
        return cls(rho * volume, center, rho * inertia, volume, name, tuple(notes))

    @classmethod
    def from_volume(
        cls,
        volume: float,
        center: ArrayLike,
        inertia: ArrayLike,
        density: float | str | Material = "steel",
        name: str = "body",
    ) -> Body:
        """From a solid's volume (m³), centre (3,) and inertia (3, 3) about it at density 1, as a CAD kernel gives."""
        rho = _density(density, name)
        return cls(rho * volume, np.asarray(center), rho * np.asarray(inertia), float(volume), name)

    @classmethod
    def sphere(cls, radius: float, mass: float, name: str = "sphere") -> Body:
        """A solid ball about the origin."""
        return cls(mass, np.zeros(3), 0.4 * mass * radius**2 * np.eye(3), 4.0 / 3.0 * np.pi * radius**3, name)

    @classmethod
    def box(cls, size: ArrayLike, mass: float, name: str = "box") -> Body:
        """A solid box of edge lengths `size` (3,) about the origin."""
        x, y, z = (float(s) for s in np.asarray(size))
        inertia = mass / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
        return cls(mass, np.zeros(3), inertia, x * y * z, name)


def _density(given: float | str | Material, name: str) -> float:
    density: float | None = material(given).density if isinstance(given, str | Material) else given
    if density is None or not (np.isfinite(density) and density > 0.0):
        raise BodyError(f"{name}: density is {density!r} kg/m³; give a positive number", name, "density")
    return float(density)


def weld(mesh: SurfaceMesh) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) with those that coincide made one, and (m, 3) triangles on them (in the mesh's order).

    Faces of a tessellated B-rep often have vertices of their own along a shared edge; they agree to rounding, so
    what counts as coincident is 1e-9 of the mesh's size.
    """
    v = mesh.vertices
    points, point = welded(v, 1e-9 * max(float(np.ptp(v, axis=0).max()), 1e-300))
    return points, point[mesh.triangles]


def open_edges(mesh: SurfaceMesh) -> int:
    """Number of edges that triangles do not run along as often one way as the other.

    Collinear edges that overlap in part (a vertex on a neighbour's edge, as mesh tools leave) are compared piece
    by piece: there is no gap between them.
    """
    vertices, t = weld(mesh)
    t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]
    edges = _unmatched(np.stack([t, t[:, [1, 2, 0]]], axis=2).reshape(-1, 2))
    return len(edges) and len(_unmatched(_split(vertices, edges)))


def _unmatched(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of directed edges (k, 2) those that are left when each pair that runs both ways is taken away."""
    either, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    way = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    net = np.bincount(which.reshape(-1), way, len(either)).astype(np.int64)
    left = either[net != 0]
    net = net[net != 0]
    return np.repeat(np.where(net[:, None] > 0, left, left[:, ::-1]), np.abs(net), axis=0)


def _split(vertices: Array, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """The directed edges (k, 2), cut at each vertex of another of them that lies on them (to 1e-9 of their extent)."""
    ends = np.unique(edges)
    points = vertices[ends]
    near = 1e-9 * max(float(np.ptp(points, axis=0).max()), 1e-300)
    out = []
    for a, b in edges.tolist():
        way = vertices[b] - vertices[a]
        length = float(np.linalg.norm(way))
        along = (points - vertices[a]) @ way / length
        off = np.linalg.norm(points - vertices[a] - along[:, None] * (way / length), axis=1)
        on = np.flatnonzero((off <= near) & (along > near) & (along < length - near))
        stops = [a, *ends[on[np.argsort(along[on])]].tolist(), b]
        out += list(pairwise(stops))
    return np.array(out, np.int64).reshape(-1, 2)


def polyhedron(triangles: Array, apex: Array | None = None) -> tuple[float, Array, Array]:
    """Signed volume (m³), centre (3,) and inertia (3, 3) about it at density 1, of outward triangles (m, 3, 3).

    Sums over the tetrahedra to one point of the exact integrals of 1, x and x xᵀ (Eberly 2002; Tonon 2004).

    apex: (3,) that point, by default the mean vertex (near the solid, so that nothing cancels far from the origin). Of
    closed triangles it does not matter; of open ones each edge without a neighbour is joined to it.
    """
    origin = triangles.reshape(-1, 3).mean(axis=0) if apex is None else apex
    p = triangles - origin
    six = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2]))
    volume = float(six.sum()) / 6.0
    if volume == 0.0:
        return 0.0, origin, np.zeros((3, 3))
    total = p.sum(axis=1)
    center = (six @ total) / 24.0 / volume
    second = (np.einsum("i,ij,ik->jk", six, total, total) + np.einsum("i,inj,ink->jk", six, p, p)) / 120.0
    second -= volume * np.outer(center, center)
    second = 0.5 * (second + second.T)
    return volume, origin + center, np.trace(second) * np.eye(3) - second


def _hull(points: Array, name: str) -> Array:
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        raise BodyError(
            f"{name}: the mesh is open and flat, so it has no volume; give mass properties by hand", name, "volume"
        ) from None
    triangles: Array = points[hull.simplices]
    inside = points[hull.vertices].mean(axis=0)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normal, triangles[:, 0] - inside) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles
