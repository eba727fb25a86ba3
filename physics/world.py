"""`World`: moves bodies under forces, joints and contacts. The public door of the package; it holds all its state."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import CollisionManager, Tolerance
from collision.poses import unpack_all
from constraints.geometry.surfaces import Geometry
from physics.contact.contact_problem import NO_CONTACTS, Contacts, joined
from physics.contact.depenetration import depenetrate
from physics.contact.neighbour_list import SLACK, NeighbourList
from physics.errors import BehaviourError, WorldError
from physics.forces.behaviours import Behaviour, Gravity, Reaction, Sleeping, Touch, View
from physics.forces.checked_behaviours import CheckedBehaviours
from physics.forces.hands import Grip, SpringHand
from physics.forces.wrenches import Forces, touches, wrenches_by_pair
from physics.joints.articulated_body import ArticulatedBody
from physics.joints.rows import JointConstraint
from physics.model.bodies import ABSENT, FREE, KINEMATIC, STATIC, Bodies, point_speeds
from physics.model.body import Body
from physics.model.free_rotation import METHODS
from physics.model.material import PAIRS, Material, Pair
from physics.model.material import material as material_of
from physics.solver.batch import whole
from physics.solver.islands import components
from physics.stepping.kinematic_bodies import KinematicBodies
from physics.stepping.sleeping import put_to_sleep, wake_neighbours
from physics.stepping.step import Stepper

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of one world at one instant, see `World.snapshot`; opaque. Not for files: see `World.save`."""

    time: float
    residual: float
    last_step: float
    model: _Saved
    motion: tuple[_Saved, Array]
    """and the poses (n, 12) of all objects of the collision manager"""


_Saved = Mapping[str, Mapping[str, Any]]
"""Read-only values of attributes, by the attribute of the world that has them ("": the world itself)."""
_MODEL = {
    "": ("_joints", "_body", "_behaviours", "_may_sleep", "_geometries", "_materials", "_pairs"),
    "_bodies": ("n", *Bodies.CONSTANTS),
    "_contact_set": ("friction", "restitution", "poisson", "material", "pair_table"),
    "_forces": ("gravity", "own", "heavy", "constant", "varying"),
    "_kinematic_bodies": ("path",),
    "_neighbours": ("solid",),
}
"""attributes that change when objects or joints are added or removed"""
_MOTION = {
    "": ("_moving", "_mechanisms", "_grips"),
    "_bodies": Bodies.STATE,
    "_contact_set": ("shape_of",),
    "_forces": ("contacts",),
    "_neighbours": ("pairs", "reach", "center", "rotation", "stale", "placed"),
}
"""attributes that change in a step"""


class World:
    """Objects of a `CollisionManager` that move under forces, joints and contacts.

    An island falls asleep when every point of its bodies has stayed below `tolerance.sleep_speed` for
    `tolerance.sleep_time`. It then costs nothing until a moving object comes near, or a call here wakes it.

    Parameters
    ----------
    collision: meshes and poses; object ids are its ids. Objects that were not added here are static and solid.
    tolerance: `touch`, `rest_speed`, `sleep_speed` and `sleep_time` are used; the manager's own if not given.
    integrator: one of `METHODS`, for free rotation.
    gravity: (3,) m/s², acts on every body that is free and has no `Gravity` of its own among its behaviours.
    pairs: friction and restitution of pairs of materials, by their names in either order; they come before the values
        of the materials. None: `PAIRS`, for materials that state no value.

    Raises WorldError: unknown integrator, bad gravity.
    """

    def __init__(
        self,
        collision: CollisionManager,
        tolerance: Tolerance | None = None,
        integrator: str = "gauss6",
        gravity: ArrayLike = (0.0, 0.0, 0.0),
        pairs: Mapping[tuple[str, str], Pair] | None = None,
    ) -> None:
        if not isinstance(integrator, str) or integrator not in METHODS:
            raise WorldError(f"no integrator {integrator!r}; there are: {', '.join(METHODS)}")
        self.collision = collision
        self.tolerance = tolerance if tolerance is not None else collision.tolerance
        self.time = 0.0
        """s since the world began"""
        self.residual = 0.0
        """m/s: largest violation of joints and contact laws that the solver left in the last step"""
        self._bodies = Bodies()
        self._stepper = Stepper(self._bodies, self.tolerance, integrator)
        self._contact_set = self._stepper.contact_set
        self._body: dict[int, Body] = {}
        self._behaviours: dict[int, tuple[Behaviour, ...]] = {}
        self._may_sleep: dict[int, bool] = {}
        self._geometries: dict[int, Mapping[int, Geometry]] = {}
        self._joints: list[JointConstraint] = []
        self._grips: dict[int, Grip] = {}
        self._mechanisms: dict[tuple, tuple[dict[int, pin.SE3], ArticulatedBody | None]] = {}
        self._moving: tuple[int, ...] = ()
        self._model: _Saved | None = None  # copies of the last `snapshot`, None after a change
        self._motion: tuple[_Saved, Array] | None = None
        self._checked = CheckedBehaviours(collision, self._body, self.tolerance)
        self._forces = Forces(self._bodies, self._body, self._grips, self._checked)
        self._kinematic_bodies = KinematicBodies(self._bodies, self._forces, self._grips, self._checked)
        self._neighbours = NeighbourList(collision, self._bodies, self._contact_set, self._geometries)
        self._materials: dict[str, int] = {}  # numbers in the table of pairs, by name
        self._default_pairs = pairs is None
        self._pairs = {frozenset(names): pair for names, pair in (PAIRS if pairs is None else pairs).items()}
        self.gravity = gravity

    # --- objects ------------------------------------------------------------------------------------------------------

    def add(
        self,
        object_id: int,
        body: Body | None = None,
        behaviours: Sequence[Behaviour] = (),
        geometries: Mapping[int, Geometry] | None = None,
        velocity: ArrayLike = (0.0,) * 6,
        material: Material | str | None = None,
    ) -> None:
        """Give an object of the collision manager mass and behaviours; adding it again replaces both.

        body: None makes the object static; its behaviours and material still affect contact.
        geometries: analytic surfaces (mesh frame), by surface; contact on them is exact, not faceted.
        velocity: (6,) of the centre of mass and angular, world axes, m/s and rad/s.
        material: friction and restitution where no behaviour states them; pairs are found by its name.
        Raises WorldError, BehaviourError, BodyError, which name the object; the world is unchanged then.
        """
        i = self._known(object_id)
        twist = _finite(velocity, 6, f"object {i}: velocity", i)
        for behaviour in behaviours:
            if not isinstance(behaviour, Behaviour):
                raise BehaviourError(f"object {i}: {behaviour!r} is no Behaviour", i, type(behaviour).__name__)
        reaction = self._checked.reaction(i, behaviours)
        stuff = material_of(material) if material is not None else None
        pose = self.collision.pose(i)
        constant, varying = np.zeros(6), tuple[Behaviour, ...]()
        if body is not None:
            view = View(i, self.time, body, pose, pose.act(body.center), twist[:3], twist[3:])
            constant, varying = self._forces.sort(behaviours, view)
        path = next((x for x in reversed(behaviours) if type(x).pose is not Behaviour.pose), None)
        if path is not None:
            self._checked.pose(i, path, self.time)
        b = self._reserve(i)
        b.set_constants(i, body, self.collision.mesh(i).vertices)
        b.set_pose(i, pose)
        self._geometries[i] = dict(geometries or {})
        self._behaviours[i] = tuple(behaviours)
        self._set_reaction(i, reaction, stuff)
        self._contact_set.shape_of[i] = -1
        self._neighbours.solid[i] = reaction.solid
        self._kinematic_bodies.path.pop(i, None)
        heavy = 0.0 if body is None or any(isinstance(x, Gravity) for x in behaviours) else body.mass
        self._forces.set(i, constant, varying, heavy)
        b.velocity[i] = 0.0
        if body is None:
            b.kind[i] = STATIC
            self._body.pop(i, None)
        else:
            b.kind[i] = FREE
            self._body[i] = body
            b.velocity[i] = twist
            self._may_sleep[i] = all(x.allowed for x in behaviours if isinstance(x, Sleeping))
        if path is not None:
            self._kinematic_bodies.path[i] = path
            b.kind[i] = KINEMATIC
        self._mechanisms.clear()  # they have its mass in them
        self.wake(i)
        self.refresh()

    def _set_reaction(self, i: int, reaction: Reaction, stuff: Material | None) -> None:
        """Store friction and restitution of an object: of its behaviours where they give them, else of its material."""
        own = (reaction.friction, reaction.restitution)
        number = 0 if stuff is None else self._number_of(stuff.name)
        values = [
            x if x is not None else getattr(stuff, name, None)
            for x, name in zip(own, ("friction", "restitution"), strict=True)
        ]
        t = self._contact_set
        t.friction[i], t.restitution[i] = (np.nan if x is None else x for x in values)
        t.material[i] = [number if x is None else 0 for x in (values if self._default_pairs else own)]
        law = reaction.law if own[1] is not None or stuff is None else stuff.law
        t.poisson[i] = law == "poisson"

    def _number_of(self, name: str) -> int:
        """Number of a material in the table of pairs, which grows by it if it is new."""
        if name not in self._materials:
            self._materials[name] = number = len(self._materials) + 1
            table = np.full((number + 1, number + 1, 2), np.nan)
            table[:number, :number] = self._contact_set.pair_table
            for other, k in self._materials.items():
                pair = self._pairs.get(frozenset((name, other)))
                if pair is not None:
                    values = [np.nan if x is None else x for x in (pair.friction, pair.restitution)]
                    table[number, k] = table[k, number] = values
            self._contact_set.pair_table = table
        return self._materials[name]

    def refresh(self) -> None:
        """Notice objects that were added or moved in the collision manager without going through this world."""
        self._model = self._motion = None
        self._neighbours.stale = self._neighbours.placed = True

    def remove(self, object_id: int) -> None:
        """Remove mass and behaviours of an object; it is static if the manager still holds it."""
        i = self._member(object_id)
        self._wake_near(i)
        self._forces.remove(i)
        self._model = self._motion = None
        for table in (self._body, self._behaviours, self._kinematic_bodies.path, self._geometries, self._grips):
            table.pop(i, None)
        self._bodies.kind[i] = ABSENT
        self._bodies.awake[i] = False
        self._set_reaction(i, Reaction(), None)
        self._neighbours.solid.pop(i, None)
        self._neighbours.stale = True

    def set_joints(self, joints: Iterable[JointConstraint]) -> None:
        """Replace all joints by these accepted constraints; wakes bodies of new and removed ones."""
        new = list(joints)
        self._model = self._motion = None
        for joint in new:
            for i in joint.bodies:
                self._known(i)
                self._reserve(i)
                if self._bodies.kind[i] == ABSENT:
                    self._add_static(i)
        old = {id(joint): joint for joint in self._joints}
        now = {id(joint): joint for joint in new}
        for key in old.keys() ^ now.keys():
            for i in (old.get(key) or now[key]).bodies:
                self.wake(i)
        self._joints = new
        self._mechanisms.clear()
        self._neighbours.stale = True

    @property
    def gravity(self) -> Array:
        """(3,) m/s², acting on every free body that has no `Gravity` of its own. Setting it wakes all bodies."""
        return self._forces.gravity.copy()

    @gravity.setter
    def gravity(self, acceleration: ArrayLike) -> None:
        new = _finite(acceleration, 3, "gravity")
        if (new != self._forces.gravity).any():
            self._forces.set_gravity(new)
            self._model = None
            for i in self._body:
                self.wake(i)

    # --- state --------------------------------------------------------------------------------------------------------

    def pose(self, object_id: int) -> pin.SE3:
        """Pose of an object's mesh frame in the world."""
        return self._bodies.pose(self._member(object_id))

    @property
    def poses(self) -> dict[int, pin.SE3]:
        """Poses of all objects that were added, by id."""
        return {i: self._bodies.pose(i) for i in sorted(self._behaviours)}

    def velocity(self, object_id: int) -> Array:
        """(6,) velocity of the centre of mass (m/s) and angular velocity (rad/s), world axes."""
        return self._bodies.velocity[self._member(object_id)].copy()

    @property
    def velocities(self) -> Array:
        """(n, 6) velocities as `velocity` returns them, by object id; 0 for objects without a body."""
        return self._bodies.velocity[: self._bodies.n].copy()

    def set_velocity(self, object_id: int, velocity: ArrayLike) -> None:
        """Set the velocity (6,) of an object, as `velocity` returns it; wakes the object."""
        i = self._member(object_id)
        twist = _finite(velocity, 6, f"object {i}: velocity", i)
        self._bodies.velocity[i] = twist
        self.wake(i)

    def set_pose(self, object_id: int, pose: pin.SE3) -> None:
        """Move an object and keep its velocity; wakes it and bodies near it. Does nothing if it is there already."""
        i = self._member(object_id)
        if self._bodies.stands_at(i, pose) and self.collision.pose(i) == pose:
            return
        self.collision.set_pose(i, pose)
        self._wake_near(i)
        self._bodies.set_pose(i, pose)
        self.refresh()
        self.wake(i)

    @property
    def awake(self) -> tuple[int, ...]:
        """Ids of the free bodies that are awake, ascending."""
        return tuple(self._free_awake().tolist())

    def wake(self, object_id: int) -> None:
        """Wake an object."""
        i = self._member(object_id)
        self._motion = None
        self._bodies.wake(i)

    def energy(self, object_id: int) -> float:
        """Kinetic energy of an object, J."""
        i = self._member(object_id)
        b = self._bodies
        w = b.rotation[i].T @ b.velocity[i, 3:]
        return 0.5 * float(b.mass[i] * (b.velocity[i, :3] @ b.velocity[i, :3]) + w @ b.inertia[i] @ w)

    def touches(self, object_id: int) -> tuple[Touch, ...]:
        """Loaded contact points of an object in the last step; `impulse` is force times the step's length."""
        return touches(self._member(object_id), self._forces.contacts, self._forces.last_step)

    def contact_wrenches(self) -> tuple[Ints, Array]:
        """Contact forces of the last step, summed by pairs of objects.

        Returns pairs (k, 2) of object ids, i < j, sorted; and wrenches (k, 6) on the first of each by the second: force
        and torque about the world's origin, world axes, N and N·m. The second feels the opposite.
        """
        return wrenches_by_pair(self._forces.contacts)

    def save(self) -> dict[str, Any]:
        """Return all that the future depends on, by value, as plain data and arrays; without state that a user's
        behaviours keep."""
        b = self._bodies
        place = {id(joint): k for k, joint in enumerate(self._joints)}
        data = {name: getattr(b, name)[: b.n] for name in Bodies.ARRAYS}
        data.update(
            n=b.n, time=self.time, contacts=tuple(self._forces.contacts), last_step=self._forces.last_step,
            moving=self._moving, near=self._neighbours.state(),
            grips={i: g.data() for i, g in self._grips.items()}, members=tuple(sorted(self._behaviours)),
            poses=self.collision.packed_poses()[sorted(self._behaviours)],
            joints=[joint.bodies for joint in self._joints],
            mechanisms=[
                (ids, [place[j] for j in joints], {i: pose.homogeneous for i, pose in poses.items()})
                for (ids, joints), (poses, _) in self._mechanisms.items()
            ],
        )  # fmt: skip
        saved: dict[str, Any] = copy.deepcopy(data)
        return saved

    def load(self, saved: Mapping[str, Any]) -> None:
        """Go on from the data that `save` returned, of this world, or of one with the same objects and the same joints
        in the same order; the future is the same, bit for bit.

        Raises WorldError: the data is of other objects or joints.
        """
        data = copy.deepcopy(dict(saved))
        self._take_in()
        if data["members"] != tuple(sorted(self._behaviours)) or data["n"] != self._bodies.n:
            raise WorldError("the saved state is of other objects; add what it had, remove what it had not")
        if data["joints"] != [joint.bodies for joint in self._joints]:
            raise WorldError("the saved state is of other joints; call set_joints with those it had")
        self._model = self._motion = None
        b = self._bodies
        for name in Bodies.ARRAYS:
            getattr(b, name)[: b.n] = data[name]
        self.time = data["time"]
        self._forces.contacts = Contacts(*data["contacts"])
        self._forces.last_step = data["last_step"]
        self._moving = data["moving"]
        self._contact_set.shape_of[: b.n] = -1  # walls are measured when they first matter, as there
        self._neighbours.restore(data["near"])
        self._grips.clear()
        self._grips.update({i: Grip.of(d) for i, d in data["grips"].items()})
        self._mechanisms.clear()
        for ids, places, homogeneous in data["mechanisms"]:
            poses = {i: pin.SE3(m) for i, m in homogeneous.items()}
            joints = [self._joints[k] for k in places]
            self._mechanisms[ids, tuple(map(id, joints))] = (
                poses,
                ArticulatedBody.build(np.array(ids), joints, b, poses),
            )
        self.collision.set_poses(sorted(self._behaviours), unpack_all(data["poses"]))

    @property
    def snapshot(self) -> Snapshot:
        """The state at this instant, which may be assigned again and again: it takes back all changes since, to the
        bit, with the poses that this world set in the collision manager.

        Copies only what has changed since the last snapshot. Not covered are state that a user's behaviours keep, poses
        that others set in the collision manager, and objects added to the manager or removed from it.
        """
        if self._model is None:
            self._model = self._save(_MODEL)
        if self._motion is None:
            self._motion = self._save(_MOTION), self.collision.packed_poses()
        return Snapshot(self.time, self.residual, self._forces.last_step, self._model, self._motion)

    @snapshot.setter
    def snapshot(self, there: Snapshot) -> None:
        b = self._bodies
        self.time, self.residual, self._forces.last_step = there.time, there.residual, there.last_step
        if there.motion is not self._motion:
            saved, poses = there.motion
            was = saved["_bodies"]
            n = min(b.n, len(was["kind"]), len(poses))
            moved = was["kind"][:n] == ABSENT
            moved |= (was["origin"][:n] != b.origin[:n]).any(axis=1)
            moved |= (was["rotation"][:n] != b.rotation[:n]).any(axis=(1, 2))
            ids = np.intersect1d(np.flatnonzero(moved), self.collision.objects)
            self._load(saved)
            if len(ids):
                self.collision.set_poses(ids, unpack_all(poses[ids]))
        if there.model is not self._model:
            self._load(there.model)
        self._model, self._motion = there.model, there.motion

    def _save(self, attributes: Mapping[str, tuple[str, ...]]) -> _Saved:
        holders = {holder: getattr(self, holder) if holder else self for holder in attributes}
        return {k: {name: _copied(getattr(holders[k], name)) for name in names} for k, names in attributes.items()}

    def _load(self, saved: _Saved) -> None:
        for holder, values in saved.items():
            owner = getattr(self, holder) if holder else self
            for name, value in values.items():
                if isinstance(value, dict):  # shared by those who read it
                    own = getattr(owner, name)
                    own.clear()
                    own.update(_copied(value))
                else:
                    setattr(owner, name, _copied(value))

    # --- hands --------------------------------------------------------------------------------------------------------

    def hold(self, object_id: int, grip: pin.SE3 | SpringHand) -> None:
        """Hold an object, or move the hand that holds it.

        grip: a pose, which the object reaches within the next step against any resistance; or a spring hand, which
        feels weight and contact and pulls up to its limit. Raises WorldError for a static object.
        """
        i = self._member(object_id)
        if i not in self._body:
            raise WorldError(f"object {i} is static; a hand can hold what has a body", i)
        spring = isinstance(grip, SpringHand)
        self._checked.rigid(i, grip.target if spring else grip, "hold")
        self._motion = None
        self._bodies.kind[i] = FREE if spring else KINEMATIC
        self._grips[i] = Grip(grip)
        self.wake(i)

    def let_go(self, object_id: int) -> None:
        """End a hold; the object keeps its velocity. Raises WorldError if it is not held."""
        i = self._member(object_id)
        if i not in self._grips:
            raise WorldError(f"object {i} is not held", i)
        self._motion = None
        del self._grips[i]
        self._bodies.kind[i] = KINEMATIC if i in self._kinematic_bodies.path else FREE
        self.wake(i)
        self._neighbours.stale = True

    def wrench(self, object_id: int) -> Array:
        """(6,) force and torque of a hand on the object in the last step, about its centre of mass, world axes.

        Of a spring its own; of a pose the reaction to weight, inertia and contacts. Raises WorldError if not held.
        """
        i = self._member(object_id)
        if i not in self._grips:
            raise WorldError(f"object {i} is not held", i)
        return self._grips[i].wrench.copy()

    # --- the step -----------------------------------------------------------------------------------------------------

    def step(self, dt: float) -> None:
        """Advance the world by `dt` seconds (> 0).

        Raises BehaviourError if a behaviour raises or returns no wrench or pose, WorldError if a motion cannot be
        followed: not finite, faster than light, or in too many sub-steps. The world is unchanged then, and also when
        the step is interrupted.
        """
        if not (np.isfinite(dt) and dt > 0.0):
            raise WorldError(f"dt is {dt!r} s; give a positive number")
        dt = self._forces.dt = float(dt)
        before = self.snapshot
        try:
            self._step(dt)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            self.snapshot = before
            raise self._not_followed(dt, error) from None
        except BaseException:
            self.snapshot = before
            raise

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # what overflows is an error of `_check`
    def _step(self, dt: float) -> None:
        b = self._bodies
        targets, changed = self._kinematic_bodies.targets(self.time + dt)
        ids = self._free_awake()
        if targets or changed or len(ids) or self._grips:
            self._motion = None
        self._neighbours.stale |= changed
        carried = self._kinematic_bodies.begin(targets, dt)
        if len(ids) or carried or self._grips:
            if self._neighbours.placed:
                self._depenetrate(ids)
            kept = self._update_neighbours(ids, carried, dt)
            links = self._links()
            while len(woken := wake_neighbours(b, ids, links)) > len(ids):  # pairs among sleepers were not listed
                ids = woken
                self._neighbours.stale = True
                kept = self._update_neighbours(ids, carried, dt)
                links = self._links()
            label, count = self._islands(ids, links)
            kept = kept and tuple(ids) == self._moving
            self._moving = tuple(ids)
            self._contact_set.residual = 0.0
            moved = np.union1d(ids, np.array(carried, np.int64))
            contacts = self._advance(ids, label, count, kept, dt)
            self._check(moved)
            self._kinematic_bodies.end(targets, contacts, self.time, dt)
            self.residual = self._contact_set.residual
            self._forces.contacts = contacts
            may = np.array([i not in self._grips and self._may_sleep[i] for i in ids.tolist()], bool)
            if put_to_sleep(b, ids, label, links, may, self.tolerance, dt):
                self._neighbours.stale = True  # the list is of those that are awake
            self.collision.set_poses(moved, b.homogeneous(moved))
        self.time += dt
        self._forces.last_step = dt

    @np.errstate(over="ignore")
    def _not_followed(self, dt: float, error: Exception) -> WorldError:
        """The error of a step of dt seconds that failed, after it was undone; names the body that forces or its speed
        would move farthest."""
        b, ids = self._bodies, self._free_awake()
        if len(ids) == 0:
            return WorldError(f"the step of {dt:.3g} s cannot be computed: {error}")
        wrench = self._forces.wrenches(ids, self.time)
        force, torque = (np.hypot.reduce(wrench[:, k : k + 3], axis=1) for k in (0, 3))
        speed, spin = (np.hypot.reduce(b.velocity[ids, k : k + 3], axis=1) for k in (0, 3))
        least = np.array([np.linalg.eigvalsh(b.inertia[i])[0] for i in ids])
        k = int(np.argmax(speed + b.radius[ids] * spin + dt * (force / b.mass[ids] + b.radius[ids] * torque / least)))
        i = int(ids[k])
        why = "the equations have no solution" if isinstance(error, np.linalg.LinAlgError) else error
        return WorldError(
            f"{self._checked.called(i)}: its motion cannot be followed in a step of {dt:.3g} s: {why} "
            f"({speed[k]:.3g} m/s, {spin[k]:.3g} rad/s, {force[k]:.3g} N, {torque[k]:.3g} N·m); "
            "give less force, gravity or speed, or a shorter step",
            i,
        )

    def _free_awake(self) -> Ints:
        b = self._bodies
        return np.flatnonzero(b.awake[: b.n] & (b.kind[: b.n] == FREE))

    def _check(self, moved: Ints) -> None:
        b = self._bodies
        lost = ~(np.isfinite(b.center[moved]).all(axis=1) & np.isfinite(b.velocity[moved]).all(axis=1))
        if lost.any():
            i = int(moved[np.argmax(lost)])
            text = f"{self._checked.called(i)}: its motion is not finite; give less force, gravity or speed"
            raise WorldError(text, i)

    def _depenetrate(self, free: Ints) -> None:
        """Move awake bodies out of overlaps that are too deep for contact search."""
        self._take_in()
        solid = self._neighbours.solid
        near = self.collision.object_pairs(free.tolist()).tolist()
        pairs = [(i, j) for i, j in near if solid.get(i, True) and solid.get(j, True)]
        self._neighbours.use(np.array(pairs, np.int64))
        bound = frozenset(i for joint in self._joints for i in joint.bodies)
        depenetrate(self._bodies, self.collision, self._place, pairs, bound)

    def _place(self, i: int, pose: pin.SE3) -> None:
        self._bodies.set_pose(i, pose)
        self.collision.set_pose(i, pose)

    def _update_neighbours(self, free: Ints, carried: list[int], dt: float) -> bool:
        """Rebuild the list of near surface pairs if it may have become incomplete; returns whether it was kept."""
        b = self._bodies
        movers = np.union1d(free, np.array(carried, np.int64))
        step = dt * point_speeds(b.velocity[movers], b.radius[movers]) + self._gain(movers, dt)
        if self._neighbours.hold_for(movers, step):
            return True
        self._take_in()
        self._neighbours.renew(movers, step)
        return False

    def _gain(self, movers: Ints, dt: float) -> Array:
        """(n,) m: ways that present forces add to free flight in one step."""
        mass = np.where(self._bodies.mass[movers] > 0.0, self._bodies.mass[movers], np.inf)
        force = np.sqrt((self._forces.wrenches(movers, self.time)[:, :3] ** 2).sum(axis=1))
        return dt * dt * force / mass

    def _links(self) -> Ints:
        """(k, 2) pairs of objects that are near to or joined with one another."""
        joined = np.array([joint.bodies for joint in self._joints], np.int64).reshape(-1, 2)
        return np.concatenate([self._neighbours.objects(), joined])

    def _take_in(self) -> None:
        """Add objects of the manager that have no body here as static ones; follow poses of those it moved."""
        for i in self.collision.objects:
            self._reserve(i)
            if i not in self._behaviours:
                self._add_static(i)

    def _add_static(self, i: int) -> None:
        b = self._bodies
        if b.kind[i] == ABSENT:
            b.set_constants(i, None, self.collision.mesh(i).vertices)
            b.kind[i] = STATIC
        pose = self.collision.pose(i)
        if not b.stands_at(i, pose):
            self._model = self._motion = None
            b.set_pose(i, pose)

    def _islands(self, ids: Ints, links: Ints) -> tuple[Ints, int]:
        """Island labels (n,) of the awake bodies `ids`, connected by `links`, and the number of islands."""
        place = np.full(self._bodies.n, -1, np.int64)
        place[ids] = np.arange(len(ids))
        return components(len(ids), place[links])

    def _advance(self, ids: Ints, label: Ints, count: int, kept: bool, dt: float) -> Contacts:
        """Move the awake bodies; returns the contacts at the end.

        Bodies under constant forces without joints are advanced together, other islands one by one.
        """
        b, stepper, before, wrenches = self._bodies, self._stepper, self._forces.contacts, self._forces.wrenches
        bound = np.zeros(b.n, bool)
        bound[self._neighbours.pairs[:, [0, 2]]] = True
        special = np.zeros(b.n, bool)
        special[[*self._forces.varying, *self._grips, *(i for joint in self._joints for i in joint.bodies)]] = True
        alone = ~(bound | special)[ids]
        stepper.near = len(ids) - int(alone.sum())
        own = np.zeros(count, bool)
        own[label[special[ids]]] = True
        ended = []
        plain = ids[~own[label] & ~alone]
        if len(plain):
            pairs = self._neighbours.of(plain)
            moved = self._kinematic(pairs[:, [0, 2]])
            gain = self._gain(plain, dt)
            ended.append(stepper.advance_apart(plain, pairs, moved, before, kept, self.time, dt, (wrenches, gain)))
        for island in np.flatnonzero(own):
            members = ids[label == island]
            pairs = self._neighbours.of(members)
            among = set(members.tolist())
            joints = [j for j in self._joints if among.intersection(j.bodies)]
            moved = self._kinematic([*pairs[:, [0, 2]].ravel(), *(i for j in joints for i in j.bodies)])
            constant = not any(i in self._forces.varying or i in self._grips for i in among)
            batch = whole(members, pairs, moved, b.n, joints, self._mechanism(members, joints), constant)
            ended.append(stepper.advance(batch, before, kept, self.time, dt, wrenches))
        if alone.any():
            stepper.coast(ids[alone], self._forces.constant[ids[alone]], dt)
        return joined(ended) if ended else NO_CONTACTS

    def _kinematic(self, ids: ArrayLike) -> Ints:
        """Ids of the kinematic bodies among `ids` that move in this step, ascending."""
        unique = np.unique(np.asarray(ids, np.int64))
        return unique[(self._bodies.kind[unique] == KINEMATIC) & self._bodies.velocity[unique].any(axis=1)]

    def _mechanism(self, ids: NDArray[np.int64], joints: Sequence[JointConstraint]) -> ArticulatedBody | None:
        """Articulated body of an island, built once for the same bodies and joints; None if it has none."""
        key = (tuple(ids.tolist()), tuple(map(id, joints)))
        if key not in self._mechanisms:
            members = {*key[0], *(i for joint in joints for i in joint.bodies)}
            poses = {i: self._bodies.pose(i) for i in sorted(members)}
            self._mechanisms[key] = (poses, ArticulatedBody.build(ids, joints, self._bodies, poses))
        return self._mechanisms[key][1]

    # --- helpers ------------------------------------------------------------------------------------------------------

    def _known(self, object_id: int) -> int:
        if object_id not in self.collision.objects:
            raise WorldError(f"the collision manager has no object {object_id!r}; add it there first", object_id)
        return int(object_id)

    def _member(self, object_id: int) -> int:
        if object_id not in self._behaviours:
            if object_id in self.collision.objects:
                self._reserve(object_id)
                self._add_static(int(object_id))
                return int(object_id)
            raise WorldError(f"no object {object_id!r} in this world; add it first", object_id)
        return int(object_id)

    def _reserve(self, i: int) -> Bodies:
        b = self._bodies
        if i >= b.n:
            self._model = self._motion = None
        b.reserve(i + 1)
        self._contact_set.reserve(len(b.kind))
        self._forces.reserve(len(b.kind))
        return b

    def _wake_near(self, i: int) -> None:
        """Wake free bodies near object i."""
        b = self._bodies
        d = np.sqrt(((b.center[: b.n] - b.center[i]) ** 2).sum(axis=1))
        near = (d <= b.radius[: b.n] + b.radius[i] + SLACK) & (b.kind[: b.n] == FREE)
        b.awake[: b.n][near] = True
        b.quiet[: b.n][near] = 0.0


def _finite(value: ArrayLike, n: int, what: str, object_id: int | None = None) -> Array:
    """`value` as (n,) finite numbers. Raises WorldError that names it `what`."""
    try:
        out = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        out = np.zeros(0)
    if out.shape != (n,) or not np.isfinite(out).all():
        raise WorldError(f"{what} is {value!r}; give {n} finite numbers", object_id)
    return out


def _copied(value: Any) -> Any:
    """A copy of an array or of a dictionary and its grips; other values as they are."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, dict):
        grips = {key: copy.copy(v) for key, v in value.items() if isinstance(v, Grip)} if len(value) else {}
        return value | grips
    return value
