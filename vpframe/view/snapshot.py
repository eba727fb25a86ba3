"""Still pictures without a screen: a small software renderer, and PNG files.

Shading is two lights over smooth normals; lines are drawn where neighbouring pixels see different features (Saito and
Takahashi 1990, G-buffers), so silhouettes and feature edges come out alike at any scale. Every pixel is the mean of
`Look.supersample`² samples.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.scene import boxes
from vpframe.scene.scene import Part, Scene, Shape
from vpframe.view import palette
from vpframe.view.camera import Camera, frame_scene
from vpframe.view.display import display_mesh
from vpframe.view.symbols import SceneSymbol

KEY_LIGHT = np.array([0.35, 0.55, 0.76])
FILL_LIGHT = np.array([-0.80, -0.10, 0.59])
"""unit vectors in the camera's frame: right, up, towards the eye"""


@dataclass(frozen=True)
class Look:
    """How a picture shows the parts."""

    opacity: Mapping[str, float] = field(default_factory=dict)
    """of parts by name, 0 (not drawn) … 1 (the default)"""
    section: tuple[ArrayLike, ArrayLike] | None = None
    """a point and a normal (3,), world: what lies on the normal's side is cut away, cut solids are filled"""
    colors: Mapping[str, palette.Color] = field(default_factory=dict)
    """of parts by name, over the palette's"""
    supersample: int = 2
    """samples a pixel along either side"""


AS_IT_IS = Look()


def render(
    scene: Scene,
    poses: Mapping[str, pin.SE3] | None = None,
    highlight: Iterable[tuple[str, int]] = (),
    size: tuple[int, int] = (800, 600),
    camera: Camera | None = None,
    symbols: Iterable[SceneSymbol] = (),
    look: Look = AS_IT_IS,
) -> NDArray[np.uint8]:
    """Return a picture (height, width, 3) of a scene.

    Parameters
    ----------
    poses: pose of parts by name; a part not named is drawn at its own pose.
    highlight: (part, surface) pairs drawn in the colour of collision.
    size: width and height in pixels.
    camera: as `camera.look_at` makes it; the whole scene from front right by default.
    symbols: lines drawn on top, faint where hidden.
    """
    poses = poses or {}
    opacity, section, supersample = look.opacity, look.section, look.supersample
    width, height = size[0] * supersample, size[1] * supersample
    camera = camera or frame_scene(scene)
    tints = {**palette.part_colors(scene), **look.colors}
    marked: dict[str, set[int]] = {}
    for name, surface in highlight:
        marked.setdefault(name, set()).add(surface)

    solid = _Buffers(width, height)
    seen = _in_picture(scene, poses, camera, (height, width))
    for name, part in seen:
        if opacity.get(name, 1.0) >= 1.0:
            solid.draw(name, part.shape, poses.get(name, part.pose), camera, section)
    solid.fill()
    image = np.array(_background(width, height), order="C")
    solid.shade(image, tints, marked, 1.0, section is not None)
    depth = solid.depth
    ghosts = [(name, part) for name, part in seen if 0.0 < opacity.get(name, 1.0) < 1.0]
    ghost = _Buffers(width, height) if ghosts else solid
    for name, part in ghosts:
        ghost.clear()
        ghost.draw(name, part.shape, poses.get(name, part.pose), camera, section)
        ghost.fill()
        there = ghost.part()
        ghost.face[there][ghost.depth[there] <= depth[there]] = -1
        ghost.shade(image, tints, marked, opacity[name], section is not None)
    _draw_symbols(image, depth, symbols, camera, supersample)
    total = np.zeros((size[1], size[0], 3), dtype=np.float32)
    for row in range(supersample):
        for column in range(supersample):
            total += image[row::supersample, column::supersample]
    return (np.clip(total * np.float32(1.0 / supersample**2), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def _in_picture(
    scene: Scene, poses: Mapping[str, pin.SE3], camera: Camera, shape: tuple[int, int]
) -> list[tuple[str, Part]]:
    """Return the parts whose boxes reach into the picture; close views of large scenes have few."""
    if not len(scene):
        return []
    corners = {part.shape: boxes.corners(part.mesh) for part in {p.shape: p for p in scene.parts}.values()}
    placed = ((part.shape, poses.get(name, part.pose)) for name, part in scene.items())
    seen = np.array([corners[shape] @ pose.rotation.T + pose.translation for shape, pose in placed])
    at = project(seen, camera, shape)[..., :2]
    low, high = at.min(axis=1), at.max(axis=1)
    inside = (high >= -1.0).all(axis=1) & (low <= np.add(shape[::-1], 1.0)).all(axis=1)
    return [item for item, kept in zip(scene.items(), inside.tolist(), strict=True) if kept]


class _Buffers:
    """Depth, triangle and barycentrics of every pixel, and the table of all triangles drawn."""

    def __init__(self, width: int, height: int) -> None:
        self.depth = np.full((height, width), -np.inf)
        self.wall: NDArray[np.float64] | None = None  # (h, w) depth of what lies under the fill of a cut
        self.face = np.full((height, width), -1, dtype=np.int32)
        self.weight = np.zeros((height, width, 2), dtype=np.float32)
        self.names: list[str] = []
        self.normals: list[NDArray[np.float64]] = []  # (m, 3, 3) in the camera's frame
        self.owner: list[NDArray[np.int64]] = []  # (m, 3): part, surface, feature
        self.back: list[NDArray[np.bool_]] = []  # (m,) whether the eye sees the triangle from within
        self.waiting: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []  # (m, 3, 2) pixels and (m, 3) depths
        self.count = 0
        self.window = np.array([height, 0, width, 0])
        """drawn area: first row, row after the last, first column, column after the last"""

    def clear(self) -> None:
        """Clear the buffers."""
        part = self.part()
        self.depth[part], self.wall, self.face[part] = -np.inf, None, -1
        for rows in (self.names, self.normals, self.owner, self.back):
            rows.clear()
        self.count = 0
        self.window[:] = (*self.face.shape[:1], 0, *self.face.shape[1:], 0)

    def part(self) -> tuple[slice, slice]:
        """Return the rows and columns of `window`."""
        top, bottom, left, right = self.window.tolist()
        return slice(top, bottom), slice(left, right)

    def draw(
        self,
        name: str,
        shape: Shape,
        pose: pin.SE3,
        camera: Camera,
        section: tuple[ArrayLike, ArrayLike] | None,
    ) -> None:
        """Add a part if it is in the picture; parts without a cut are drawn together, by `fill`."""
        mesh = display_mesh(shape)
        world = mesh.positions.astype(np.float64) @ pose.rotation.T + pose.translation
        points = project(world, camera, self.depth.shape)
        flat = points[:, :2]
        a, b, c = (flat[mesh.triangles[:, k]] for k in range(3))
        back = _cross(b - a, c - a) > 0.0  # rows count downwards
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        there = (high >= 0.0).all(axis=1) & (low <= self.depth.shape[::-1]).all(axis=1)
        if section is None and shape.closed and shape.volume > 0.0:
            there &= ~back  # the front of a closed solid hides its back
        seen = np.flatnonzero(there)
        if not len(seen):
            return  # out of the picture
        first = np.floor(low[seen].min(axis=0)).astype(np.int64).clip(0)[::-1]
        last = np.minimum(np.ceil(high[seen].max(axis=0)).astype(np.int64)[::-1] + 1, self.face.shape)
        self.window[::2], self.window[1::2] = np.minimum(self.window[::2], first), np.maximum(self.window[1::2], last)
        triangles, back = mesh.triangles[seen], back[seen]
        xy, z = flat[triangles], points[triangles, 2]
        if section is None:
            self.waiting.append((xy, z))
        else:
            point, normal = (np.asarray(v, dtype=np.float64) for v in section)
            keep = np.ascontiguousarray(((world - point) @ normal)[triangles])
            self._fill_cut(xy, z, keep, back, _plane_depth(section, camera, self.depth.shape))
        self.back.append(back)
        turn = camera.axes() @ pose.rotation
        self.normals.append((mesh.normals.astype(np.float64) @ turn.T)[triangles])
        surface = mesh.surface_of_triangle[seen]
        part = np.full(len(surface), len(self.names))
        self.owner.append(np.stack([part, surface, mesh.feature_of_surface[surface]], axis=1))
        self.names.append(name)
        self.count += len(surface)

    def fill(self) -> None:
        """Draw all added triangles in order: at equal depth the first is seen."""
        from vpframe.view.raster import fill_triangles

        if self.waiting:
            xy, z = (np.concatenate(arrays) for arrays in zip(*self.waiting, strict=True))
            fill_triangles(xy, z, np.full(z.shape, -1.0), self.depth, self.face, self.weight)
            self.waiting = []

    def _fill_cut(
        self,
        xy: NDArray[np.float64],
        z: NDArray[np.float64],
        keep: NDArray[np.float64],
        back: NDArray[np.bool_],
        plane: NDArray[np.float64],
    ) -> None:
        """Draw a cut part: where the eye sees its inside, the cut lies in front, in the section plane."""
        from vpframe.view.raster import fill_triangles

        face = np.full_like(self.face, -1)
        depth, weight = np.full_like(self.depth, -np.inf), np.zeros_like(self.weight)
        fill_triangles(xy, z, keep, depth, face, weight)
        filled = face >= 0
        filled[filled] = back[face[filled]]
        wall = depth.copy()
        if self.wall is None:
            self.wall = np.full_like(self.depth, -np.inf)
        depth[filled] = plane[filled]
        # of two solids cut at one pixel the inner one is drawn: its wall is nearer
        drawn = (face >= 0) & ((depth > self.depth) | ((depth == self.depth) & (wall > self.wall)))
        self.depth[drawn], self.wall[drawn], self.weight[drawn] = depth[drawn], wall[drawn], weight[drawn]
        self.face[drawn] = face[drawn] + self.count

    def shade(
        self,
        image: NDArray[np.float32],
        tints: Mapping[str, palette.Color],
        marked: Mapping[str, set[int]],
        alpha: float,
        cut: bool,
    ) -> None:
        """Blend the drawn triangles over `image`."""
        from vpframe.view.raster import shade_faces

        if not self.count:
            return
        owner, back = np.concatenate(self.owner), np.concatenate(self.back)
        filled = back & cut  # an open mesh seen from within, or the fill of a cut
        plain = np.array([tints[name] for name in self.names], dtype=np.float64)[owner[:, 0]]
        surfaces, features = int(owner[:, 1].max()) + 1, int(owner[:, 2].max()) + 2
        red = np.zeros((len(self.names), surfaces), bool)
        for place, name in enumerate(self.names):
            red[place, [s for s in marked.get(name, ()) if s < surfaces]] = True
        color = plain.copy()
        color[red[owner[:, 0], owner[:, 1]] & ~filled] = palette.COLLIDING
        # one number a feature of a part, and one a cut part
        label = owner[:, 0] * features + np.where(filled, features - 1, owner[:, 2])
        half = KEY_LIGHT + np.array([0.0, 0.0, 1.0])
        lights = np.stack([KEY_LIGHT, half / np.linalg.norm(half), FILL_LIGHT])
        normals = np.concatenate(self.normals)
        shade_faces(self.window, self.face, self.weight, normals, color, label, filled, lights, alpha, image)


def project(points: ArrayLike, camera: Camera, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Project world points (n, 3) to (column, row, depth towards the eye) in a picture of `shape` = (height, width)."""
    height, width = shape
    q = (np.asarray(points, dtype=np.float64) - camera.target) @ camera.axes().T
    scale = 0.5 * min(width, height) / camera.radius
    return np.stack([0.5 * width + scale * q[..., 0], 0.5 * height - scale * q[..., 1], q[..., 2]], axis=-1)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _plane_depth(section: tuple[ArrayLike, ArrayLike], camera: Camera, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the depth (h, w) of the section plane at each pixel; -inf everywhere if it is seen edge on."""
    height, width = shape
    axes = camera.axes()
    point, normal = (np.asarray(v, dtype=np.float64) for v in section)
    n = axes @ normal
    if n[2] == 0.0:
        return np.full(shape, -np.inf)
    offset = axes @ (point - camera.target)
    scale = 0.5 * min(width, height) / camera.radius
    x = (np.arange(width) + 0.5 - 0.5 * width) / scale
    y = (0.5 * height - np.arange(height) - 0.5) / scale
    return (n @ offset - n[0] * x[None, :] - n[1] * y[:, None]) / n[2]


@lru_cache(maxsize=4)
def _background(width: int, height: int) -> NDArray[np.float32]:
    """Return the background, read only."""
    top, bottom = (np.array(c, dtype=np.float32) for c in palette.BACKGROUND)
    fade = np.linspace(0.0, 1.0, height, dtype=np.float32)[:, None, None]
    return np.broadcast_to(top + fade * (bottom - top), (height, width, 3))


def _draw_symbols(
    image: NDArray[np.float32],
    depth: NDArray[np.float64],
    symbols: Iterable[SceneSymbol],
    camera: Camera,
    supersample: int,
) -> None:
    from vpframe.view.raster import draw_segments

    ends, color, width, hidden = [], [], [], []
    for symbol in symbols:
        strips = symbol.world()
        flat = project(np.concatenate(strips), camera, depth.shape)
        for points in np.split(flat, np.cumsum([len(strip) for strip in strips])[:-1]):
            ends.append(np.stack([points[:-1], points[1:]], axis=1))
            color.append(np.tile(symbol.color, (len(points) - 1, 1)))
            width.append(np.full(len(points) - 1, symbol.width * supersample))
            hidden.append(np.full(len(points) - 1, symbol.hidden))
    if not ends:
        return
    segment = np.concatenate(ends)
    draw_segments(
        np.ascontiguousarray(segment[:, :, :2]),
        np.ascontiguousarray(segment[:, :, 2]) + 0.01 * camera.radius,  # a line that lies on a surface is in front
        np.concatenate(color),
        np.concatenate(width),
        np.concatenate(hidden),
        depth,
        image,
    )


def png(image: NDArray[np.uint8]) -> bytes:
    """Return `image` (h, w, 3) uint8 as the bytes of a PNG file."""
    from PIL import Image

    content = io.BytesIO()
    Image.fromarray(image).save(content, "PNG")
    return content.getvalue()


def save_png(image: NDArray[np.uint8], path: str | Path) -> Path:
    """Write `image` (h, w, 3) uint8 to `path`."""
    path = Path(path)
    path.write_bytes(png(image))
    return path
