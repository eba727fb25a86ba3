"""`Dynamics`: the physics of a session, created when the first part is given mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from constraints.geometry.surfaces import Freeform, Geometry
from constraints.kinds import Constraint
from physics import Behaviour, Body, BodyError, Material, Snapshot, SpringHand, World
from physics.forces.behaviours import Touch
from physics.model.bodies import ABSENT, FREE, KINEMATIC, STATIC, Bodies, followed
from vpframe.codec import conforms
from vpframe.scene.poses import RIGID, rigid
from vpframe.scene.scene import Part, Scene
from vpframe.session.state import DynamicsState

Array = NDArray[np.float64]


_Given = tuple[Body, tuple[Behaviour, ...], Mapping[int, Geometry], Material | str | None]
"""mass properties, behaviours, analytic surfaces by index, and material of a part"""


class Dynamics:
    """A `physics.World` over the scene's parts; grips of hands move bodies, constraints in force become joints."""

    def __init__(self, scene: Scene, collision: CollisionManager, tolerance: Tolerance, gravity: Array) -> None:
        self.scene = scene
        self.world = World(collision, tolerance, gravity=gravity)
        self._dt = 1.0
        self.bodies: set[int] = set()
        """objects with mass, which move under forces when no hand holds them"""
        self._given: dict[int, _Given] = {}
        self._held: set[int] = set()
        self._springs: set[int] = set()
        self._joined: tuple[int, ...] = ()
        """ids of the constraints that are joints of the world"""
        self._known: tuple[int, ...] = ()
        """number of bodies and constraint ids from which `_joined` was computed"""

    def add(self, i: int, body: Body, behaviours: Sequence[Behaviour], material: Material | str | None = None) -> None:
        """Give an object mass, behaviours, and a material that sets friction and restitution."""
        part = self.scene.parts[i]
        known = {s.index: s.geometry for s in part.surfaces if not isinstance(s.geometry, Freeform)}
        self._given[i] = (body, tuple(behaviours), known, material)
        self._add(i)
        self.bodies.add(i)

    def _add(self, i: int) -> None:
        body, behaviours, known, material = self._given[i]
        self.world.add(i, body, behaviours, known, material=material)

    def join(self, constraints: Mapping[int, Constraint]) -> None:
        """Set the constraints in force, by id; those on bodies become joints."""
        known = (len(self.bodies), *constraints)
        if known == self._known:
            return
        ids = tuple(i for i in sorted(constraints) if not self.bodies.isdisjoint(constraints[i].bodies))
        if ids != self._joined:
            self.world.set_joints([constraints[i] for i in ids])
            self._joined = ids
        self._known = known

    def hold(self, carried: Mapping[int, pin.SE3], springs: Mapping[int, SpringHand]) -> None:
        """Set the grips of this step: `carried` bodies take their poses exactly; `springs` pull with limited force."""
        for i in sorted(self._held - set(carried) - set(springs)):
            self.world.let_go(i)
        self._held = (set(carried) | set(springs)) & self.bodies
        for i, pose in sorted(carried.items()):
            if i in self.bodies:
                self.world.hold(i, pose)
            else:
                self.world.set_pose(i, pose)
        self._springs = set(springs)
        for i, spring in sorted(springs.items()):
            self.world.hold(i, spring)

    def step(self, dt: float) -> tuple[set[int], set[int]]:
        """Advance by `dt` seconds; return the bodies that are awake or held, and the bodies that fell asleep."""
        self._dt = dt
        before = set(self.world.awake)
        self.world.step(dt)
        after = set(self.world.awake)
        return before | after | self._held, before - after - self._held

    def pull(self) -> dict[int, float]:
        """Force (N) with which each spring pulled on its body in the last step; rigid grips measure no force."""
        return {i: float(np.linalg.norm(self.world.wrench(i)[:3])) for i in sorted(self._springs & self._held)}

    def resting_on(self, i: int) -> tuple[int, ...]:
        """Return the objects in contact with a body."""
        return tuple(sorted({touch.other for touch in self.world.touches(i)}))

    def velocity(self, i: int) -> tuple[Array, Array]:
        """Velocity (6,) of a body in world axes, linear at its centre of mass first; that centre (3,), part frame."""
        return self.world.velocity(i), self._given[i][0].center

    def touches(self, i: int) -> list[tuple[Touch, Array]]:
        """Return the loaded contacts of a body, each with the force (3,) on the body, N."""
        return [(touch, touch.impulse / self._dt) for touch in self.world.touches(i)]

    @property
    def snapshot(self) -> DynamicsState:
        """The state at this instant, for `go_to`."""
        return DynamicsState(self.world.snapshot, frozenset(self._held), frozenset(self._springs), self._joined)

    def saved(self) -> DynamicsState:
        """Return the state as plain data and arrays, for `go_to` in this or another process."""
        return replace(self.snapshot, world=self.world.save())

    def go_to(self, state: DynamicsState, constraints: Mapping[int, Constraint]) -> None:
        """Go to a state; the caller must place the objects of the collision manager afterwards.

        constraints: those in force in that state, by id.

        Raises
        ------
        ValueError, TypeError, LookupError: saved data is damaged or of other parts.
        """
        if isinstance(state.world, Snapshot):
            self.world.snapshot = state.world
        else:
            if state.joined != self._joined:
                self.world.set_joints([constraints[i] for i in state.joined])
            self._require(state.world)
            self.world.load(state.world)
        self._held, self._springs, self._joined = set(state.held), set(state.springs), state.joined
        self._known = ()

    def restart(self, constraints: Mapping[int, Constraint]) -> None:
        """Rebuild the world with the same bodies, at rest at the poses of the collision manager."""
        self.world = World(self.world.collision, self.world.tolerance, gravity=self.world.gravity)
        self._held, self._springs, self._joined, self._known = set(), set(), (), ()
        for i in self._given:
            self._add(i)
        self.join(constraints)

    def _require(self, data: Mapping[str, Any]) -> None:
        """Raise ValueError for arrays that kernels could not index safely, and for values that no body can have."""
        own = self.world.save()
        n, surfaces = own["n"], np.array([part.mesh.n_surfaces for part in self.scene.parts])

        def require(holds: bool, what: str) -> None:
            if not holds:
                raise ValueError(f"{what} of the bodies is not of this scene")

        def fits(value: Any, like: Any) -> bool:
            """Compare types recursively; arrays must have the same dtype and the same shape from the second axis on."""
            if isinstance(like, np.ndarray):
                return (
                    type(value) is np.ndarray
                    and value.dtype == like.dtype
                    and value.ndim == like.ndim
                    and value.shape[1:] == like.shape[1:]
                )
            if isinstance(like, tuple):
                return type(value) is tuple and len(value) == len(like) and all(map(fits, value, like))
            return isinstance(value, type(like))

        ids = list(own["members"])
        require(data.keys() == own.keys() and data["near"].keys() == own["near"].keys(), "the state")
        for name, like in own.items():
            if name in ("grips", "members", "joints", "mechanisms", "moving", "near"):
                continue
            require(fits(data[name], like), name)
            require(not isinstance(like, np.ndarray) or data[name].shape == like.shape, name)
            require(name not in Bodies.CONSTANTS or np.allclose(data[name][ids], like[ids], rtol=1e-9, atol=0.0), name)
        require(followed(data["velocity"], own["radius"]), "velocity")
        require(bool((np.abs((data["attitude"] ** 2).sum(axis=1) - 1.0) < RIGID)[ids].all()), "attitude")
        rotation, origin = data["rotation"][ids], data["origin"][ids]
        placed = np.concatenate([rotation.reshape(-1, 9), origin], axis=1)
        require(bool((np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)) < RIGID).all()), "rotation")
        require(np.allclose(placed, data["poses"], rtol=RIGID, atol=RIGID), "poses")
        middle = (rotation @ own["offset"][ids][:, :, None])[:, :, 0] + origin
        require(np.allclose(middle, data["center"][ids], rtol=RIGID, atol=RIGID), "center")
        require(data["time"] >= 0.0 and data["last_step"] >= 0.0 and bool((data["quiet"] >= 0.0).all()), "time")
        require(bool(np.isin(data["kind"], (ABSENT, STATIC, KINEMATIC, FREE)).all()), "kind")
        near = data["near"]
        require(all(fits(near[name], like) for name, like in own["near"].items() if name != "listed"), "near")
        require(len(near["listed"]) == 2, "near")
        for array, shape in zip((near["reach"], *near["listed"]), ((n,), (n, 3), (n, 3, 3)), strict=True):
            require(type(array) is np.ndarray and array.dtype == np.float64, "near")
            require(near["stale"] or array.shape == shape, "near")
        rows = near["pairs"]
        require(rows.ndim == 2 and rows.shape[1:] == (4,) and rows.dtype == np.int64, "near")
        ints, reals, force = data["contacts"]
        require(len(ints) == len(reals) == len(force), "contacts")
        for objects, faces in (
            (rows[:, 0], rows[:, 1]),
            (rows[:, 2], rows[:, 3]),
            (ints[:, 0], ints[:, 2]),
            (ints[:, 1], ints[:, 3]),
        ):
            require(bool(((objects >= 0) & (objects < n)).all()), "an object's number")
            require(bool(((faces >= 0) & (faces < surfaces[objects])).all()), "a surface's number")
        require(conforms(data["moving"], tuple[int, ...]) and set(data["moving"]) <= set(own["members"]), "moving")
        require(conforms(data["grips"], dict[int, tuple[SpringHand | None, Array, Array]]), "grips")
        for i, (_, target, wrench) in data["grips"].items():
            require(i in own["members"] and target.shape == (4, 4) and wrench.shape == (6,), "grips")
            rigid(pin.SE3(target), "what a hand pulls to")
        require(conforms(data["mechanisms"], list[tuple[tuple[int, ...], list[int], dict[int, Array]]]), "mechanisms")
        for ids, places, poses in data["mechanisms"]:
            require({*ids, *poses} <= set(range(n)), "mechanisms")
            require(set(places) <= set(range(len(own["joints"]))), "mechanisms")
            require(all(pose.shape == (4, 4) and np.isfinite(pose).all() for pose in poses.values()), "mechanisms")


def body_of(part: Part, material: str | float | Material | None, mass: float | None) -> Body:
    """Return the mass properties of a part.

    material: a `physics.Material`, a name from `physics.MATERIALS`, or kg/m³; without a density the part's own inertia
    is used, then its own density, else that of steel.
    mass: kg; scales mass and inertia.
    """
    if isinstance(material, Material) and material.density is None:
        material = None
    density = material if material is not None else part.density if part.density is not None else "steel"
    shape = part.shape
    given = part.inertia
    if given is not None and material is None:
        body = Body(given.mass, np.asarray(given.lever), np.asarray(given.inertia), shape.volume, part.name)
    elif shape.closed and shape.volume > 0.0:
        body = Body.from_volume(shape.volume, shape.center, shape.inertia, density, part.name)
    else:
        body = Body.from_mesh(part.mesh, density, part.name)
    if mass is None:
        return body
    if isinstance(mass, bool) or not isinstance(mass, int | float | np.number):
        raise BodyError(f"{part.name}: mass is {mass!r}; give kg, a positive number", part.name, "mass")
    return replace(body, mass=mass, inertia=body.inertia * (mass / body.mass))
