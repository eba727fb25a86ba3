"""`World`: bodies with behaviours in, their motion out. The one door of the package, and the one place with state."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import CollisionManager, Tolerance
from constraints.geometry import Geometry
from physics import starts
from physics.batch import whole
from physics.behaviours import LAWS, Behaviour, Reaction, Sleeping, Touch, View
from physics.bodies import FREE, KINEMATIC, STATIC, Bodies, Saved
from physics.body import Body
from physics.errors import BehaviourError, WorldError
from physics.hands import Grip, SpringHand
from physics.integrators import METHODS
from physics.islands import components
from physics.joints import Joint
from physics.mechanism import Mechanism
from physics.near import near_objects, near_surfaces
from physics.pressing import NO_CONTACTS, Contacts
from physics.shapes import Shape, make_shape, pack
from physics.stepping import Stepper
from physics.touching import DEEPEST

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 2e-3
"""m: least slack of the list of near surfaces; more where things are fast, so that it lasts some steps"""
CROWD = 64
"""bodies: among more, a long list costs more than making it anew"""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of a world at one instant, by value; opaque. `World.restore` gives the same future, bit for bit."""

    data: Mapping[str, Any]


class World:
    """Objects of a `CollisionManager` that move under forces, joints and contacts.

    Parameters
    ----------
    collision: holds meshes and poses; ids are its ids. Objects that were not added here stand still and are solid.
    tolerance: `touch`, `rest_speed` and the two for sleeping are used; the manager's own if not given.
    integrator: one of `METHODS`, for free rotation.

    A body falls asleep with its island when every point of it has stayed below `tolerance.sleep_speed` for
    `tolerance.sleep_time`; it then costs nothing until something that moves comes near, or it is touched through here.
    """

    def __init__(
        self, collision: CollisionManager, tolerance: Tolerance | None = None, integrator: str = "gauss6"
    ) -> None:
        if integrator not in METHODS:
            raise WorldError(f"no integrator {integrator!r}; there are: {', '.join(METHODS)}")
        self.collision = collision
        self.tolerance = tolerance if tolerance is not None else collision.tolerance
        self.time = 0.0
        """s since the world began"""
        self.residual = 0.0
        """m/s: largest violation of joints and contact laws that the last step's solver left"""
        self._bodies = Bodies()
        self._stepper = Stepper(self._bodies, self.tolerance, integrator)
        self._touching = self._stepper.touching
        self._body: dict[int, Body] = {}
        self._behaviours: dict[int, tuple[Behaviour, ...]] = {}
        self._varying: dict[int, tuple[Behaviour, ...]] = {}
        self._path: dict[int, Behaviour] = {}
        self._may_sleep: dict[int, bool] = {}
        self._geometries: dict[int, Mapping[int, Geometry]] = {}
        self._constant = np.zeros((0, 6))
        self._joints: list[Joint] = []
        self._grips: dict[int, Grip] = {}
        self._solid: dict[int, bool] = {}
        self._shapes: list[Shape] = []
        self._shape_key: dict[tuple, int] = {}
        self._mechanisms: dict[tuple, tuple[dict[int, pin.SE3], Mechanism | None]] = {}
        self._contacts = NO_CONTACTS
        self._pairs = np.zeros((0, 4), np.int64)
        self._reach = np.zeros(0)
        self._listed_center = np.zeros((0, 3))
        self._listed_rotation = np.zeros((0, 3, 3))
        self._moving: tuple[int, ...] = ()
        self._stale = True
        self._placed = True

    # --- objects ------------------------------------------------------------------------------------------------------

    def add(
        self,
        object_id: int,
        body: Body | None = None,
        behaviours: Sequence[Behaviour] = (),
        geometries: Mapping[int, Geometry] | None = None,
        velocity: ArrayLike = (0.0,) * 6,
    ) -> None:
        """Give an object of the collision manager mass and behaviours; adding it again replaces both.

        body: None makes it static: it never moves, but its behaviours say how it meets others.
        geometries: surfaces known analytically (mesh frame); contacts on them are judged exactly.
        velocity: (6,) of the centre of mass and angular, world axes, m/s and rad/s.
        Raises WorldError, BehaviourError: before anything moves, naming the object.
        """
        i = self._known(object_id)
        twist = np.array(velocity, dtype=np.float64)
        if twist.shape != (6,) or not np.isfinite(twist).all():
            raise WorldError(f"object {i}: velocity is {velocity!r}; give six finite numbers", i)
        for behaviour in behaviours:
            if not isinstance(behaviour, Behaviour):
                raise BehaviourError(f"object {i}: {behaviour!r} is no Behaviour", i, type(behaviour).__name__)
        reaction = self._reaction(i, behaviours)
        pose = self.collision.pose(i)
        constant, varying, path = np.zeros(6), [], None
        if body is not None:
            view = View(i, self.time, body, pose, pose.act(body.center), twist[:3], twist[3:])
            for behaviour in behaviours:
                if type(behaviour).wrench is Behaviour.wrench:
                    continue
                if behaviour.constant:
                    constant += self._wrench(i, behaviour, view)
                else:
                    varying.append(behaviour)
        for behaviour in behaviours:
            if type(behaviour).pose is not Behaviour.pose:
                path = behaviour
                self._target(i, path, self.time)
        b = self._reserve(i)
        mesh = self.collision.mesh(i)
        b.set_constants(i, body, mesh.vertices)
        b.set_pose(i, pose)
        self._geometries[i] = dict(geometries or {})
        self._behaviours[i] = tuple(behaviours)
        self._touching.friction[i] = np.nan if reaction.friction is None else reaction.friction
        self._touching.restitution[i] = np.nan if reaction.restitution is None else reaction.restitution
        self._touching.poisson[i] = reaction.law == "poisson"
        self._solid[i] = reaction.solid
        self._touching.shape_of[i] = -1
        self._path.pop(i, None)
        self._varying.pop(i, None)
        self._constant[i] = constant
        b.velocity[i] = 0.0
        if body is None:
            b.kind[i] = STATIC
            self._body.pop(i, None)
        else:
            b.kind[i] = FREE
            self._body[i] = body
            b.velocity[i] = twist
            self._may_sleep[i] = all(x.allowed for x in behaviours if isinstance(x, Sleeping))
            if varying:
                self._varying[i] = tuple(varying)
        if path is not None:
            self._path[i] = path
            b.kind[i] = KINEMATIC
        self.wake(i)
        self._stale = self._placed = True

    def refresh(self) -> None:
        """Take notice of objects that were added to the manager, or placed by it, while they have no body here."""
        self._stale = self._placed = True

    def remove(self, object_id: int) -> None:
        """Take mass and behaviours from an object: if the manager still holds it, it stands still."""
        i = self._member(object_id)
        self._wake_near(i)
        for table in (self._body, self._behaviours, self._varying, self._path, self._geometries, self._grips):
            table.pop(i, None)
        self._bodies.kind[i] = 0
        self._bodies.awake[i] = False
        self._touching.friction[i] = self._touching.restitution[i] = np.nan
        self._solid.pop(i, None)
        self._stale = True

    def set_joints(self, joints: Iterable[Joint]) -> None:
        """The accepted constraints that hold from now on, all of them; bodies of new or lost ones wake."""
        new = list(joints)
        for joint in new:
            for i in joint.bodies:
                self._known(i)
                self._reserve(i)
                if self._bodies.kind[i] == 0:
                    self._stand(i)
        old = {id(joint): joint for joint in self._joints}
        now = {id(joint): joint for joint in new}
        for key in old.keys() ^ now.keys():
            for i in (old.get(key) or now[key]).bodies:
                self.wake(i)
        self._joints = new
        self._mechanisms.clear()
        self._stale = True

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

    def set_velocity(self, object_id: int, velocity: ArrayLike) -> None:
        """Set what `velocity` returns; wakes the object."""
        i = self._member(object_id)
        twist = np.array(velocity, dtype=np.float64)
        if twist.shape != (6,) or not np.isfinite(twist).all():
            raise WorldError(f"object {i}: velocity is {velocity!r}; give six finite numbers", i)
        self._bodies.velocity[i] = twist
        self.wake(i)

    def set_pose(self, object_id: int, pose: pin.SE3) -> None:
        """Place an object anew (it keeps its velocity); wakes it and what is near."""
        i = self._member(object_id)
        self._wake_near(i)
        self.collision.set_pose(i, pose)
        self._bodies.set_pose(i, pose)
        self._stale = self._placed = True
        self.wake(i)

    @property
    def awake(self) -> tuple[int, ...]:
        """Ids of the free bodies that are moving, or have not been at rest for long enough to sleep."""
        b = self._bodies
        return tuple(int(i) for i in np.flatnonzero(b.awake[: b.n] & (b.kind[: b.n] == FREE)))

    def wake(self, object_id: int) -> None:
        """Wake an object."""
        i = self._member(object_id)
        self._bodies.awake[i] = True
        self._bodies.quiet[i] = 0.0
        self._bodies.steady[i] = False

    def energy(self, object_id: int) -> float:
        """Kinetic energy of an object, J."""
        i = self._member(object_id)
        b = self._bodies
        w = b.rotation[i].T @ b.velocity[i, 3:]
        return 0.5 * float(b.mass[i] * (b.velocity[i, :3] @ b.velocity[i, :3]) + w @ b.inertia[i] @ w)

    def touches(self, object_id: int) -> tuple[Touch, ...]:
        """Contact points of an object that carry force, as of the last step; `impulse` is force times the step."""
        return _touches(self._member(object_id), self._contacts, self._last_step)

    _last_step = 0.0
    _dt = 0.0  # s: of the step that is going on

    def state(self) -> Snapshot:
        """Everything that changes while the world runs (behaviours of a user keep their own state)."""
        b = self._bodies
        place = {id(joint): k for k, joint in enumerate(self._joints)}
        data = {name: getattr(b, name)[: b.n] for name in Bodies._PER_OBJECT}
        data.update(
            n=b.n, time=self.time, contacts=tuple(self._contacts), pairs=self._pairs,
            listed=(self._listed_center, self._listed_rotation),
            reach=self._reach, moving=self._moving, stale=self._stale, placed=self._placed, last_step=self._last_step,
            grips={i: g.data() for i, g in self._grips.items()}, members=tuple(sorted(self._behaviours)),
            joints=[joint.bodies for joint in self._joints],
            mechanisms=[
                (ids, [place[j] for j in joints], {i: pose.homogeneous for i, pose in poses.items()})
                for (ids, joints), (poses, _) in self._mechanisms.items()
            ],
        )  # fmt: skip
        return Snapshot(copy.deepcopy(data))

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this world, or of one like it: same objects, same joints in the same order."""
        data = copy.deepcopy(dict(snapshot.data))
        self._stale = True
        self._refresh()
        if data["members"] != tuple(sorted(self._behaviours)) or data["n"] != self._bodies.n:
            raise WorldError("the snapshot is of other objects; add what it had, remove what it had not")
        if data["joints"] != [joint.bodies for joint in self._joints]:
            raise WorldError("the snapshot is of other joints; call set_joints with those it had")
        b = self._bodies
        for name in Bodies._PER_OBJECT:
            getattr(b, name)[: b.n] = data[name]
        self.time = data["time"]
        self._contacts = Contacts(*data["contacts"])
        self._pairs, self._reach = data["pairs"], data["reach"]
        self._listed_center, self._listed_rotation = data["listed"]
        self._stale, self._placed, self._moving = data["stale"], data["placed"], data["moving"]
        self._last_step = data["last_step"]
        self._grips = {i: Grip.of(d) for i, d in data["grips"].items()}
        self._mechanisms.clear()
        for ids, places, homogeneous in data["mechanisms"]:
            poses = {i: pin.SE3(m) for i, m in homogeneous.items()}
            joints = [self._joints[k] for k in places]
            self._mechanisms[ids, tuple(map(id, joints))] = (poses, Mechanism.build(np.array(ids), joints, b, poses))
        for i in np.unique(self._pairs[:, [0, 2]]):
            self._shape(int(i))
        for i in self._behaviours:
            self.collision.set_pose(i, b.pose(i))

    # --- hands --------------------------------------------------------------------------------------------------------

    def hold(self, object_id: int, grip: pin.SE3 | SpringHand) -> None:
        """Hold an object: at a pose, to which it is carried over the next step and which nothing can hinder, or by a
        spring hand, which feels weight and contact and slips when its limit is reached. Called again, it moves on.
        """
        i = self._member(object_id)
        if i not in self._body:
            raise WorldError(f"object {i} is static; a hand can hold what has a body", i)
        spring = isinstance(grip, SpringHand)
        self._rigid(i, grip.target if spring else grip, "hold")
        self._bodies.kind[i] = FREE if spring else KINEMATIC
        self._grips[i] = Grip(grip)
        self.wake(i)

    def let_go(self, object_id: int) -> None:
        """End a hold; the object keeps its velocity."""
        i = self._member(object_id)
        if self._grips.pop(i, None) is None:
            raise WorldError(f"object {i} is not held", i)
        self._bodies.kind[i] = KINEMATIC if i in self._path else FREE
        self.wake(i)
        self._stale = True

    def wrench(self, object_id: int) -> Array:
        """(6,) force and torque about the centre of mass, world axes, with which a hand held the object in the last
        step: the spring's own, or what it took to carry it (weight, inertia and contacts).
        """
        i = self._member(object_id)
        if i not in self._grips:
            raise WorldError(f"object {i} is not held", i)
        return self._grips[i].wrench.copy()

    # --- the step -----------------------------------------------------------------------------------------------------

    def step(self, dt: float) -> None:
        """Move everything by `dt` seconds (> 0).

        Raises BehaviourError if a behaviour fails, or returns what is no wrench or pose, WorldError if the motion of an
        object is not finite. Nothing has moved then, nor when the step is interrupted.
        """
        if not (np.isfinite(dt) and dt > 0.0):
            raise WorldError(f"dt is {dt!r} s; give a positive number")
        dt = self._dt = float(dt)
        b = self._bodies
        targets = self._targets(dt)
        before = {i: b.velocity[i].copy() for i in targets}
        carried = self._carry(targets, dt)
        free = self._free_awake()
        start: Saved | None = None
        try:
            if len(free) or carried or self._grips:
                if self._placed:
                    self._part_deep(free)
                kept = self._list_near(free, carried, dt)
                while self._rouse(
                    free
                ):  # pairs among sleepers were not listed: a blow must reach the next one in this step
                    self._stale = True
                    kept = self._list_near(free, carried, dt)
                ids = np.array(free, dtype=np.int64)
                label, count = self._near_islands(ids)
                kept = kept and tuple(free) == self._moving
                self._moving = tuple(free)
                self._touching.residual = 0.0
                moved = np.array(sorted({*free, *carried}), dtype=np.int64)
                start, steady, rate = Saved(b, moved), b.steady[moved], b.rate[moved]
                ended = self._advance(ids, label, count, kept, dt)
                self._check(moved)
                contacts = _joined(ended)
                self._finish_carried(targets, contacts, dt)
                self.residual = self._touching.residual
                self._contacts = contacts
                self._settle(ids, label, count, dt)
                self.collision.set_poses(moved, b.homogeneous(moved))
        except BaseException:
            for i, velocity in before.items():
                b.velocity[i] = velocity
            if start is not None:
                start.restore(b)
                b.steady[moved], b.rate[moved] = steady, rate
            raise
        self.time += dt
        self._last_step = dt

    def _free_awake(self) -> list[int]:
        b = self._bodies
        return [int(i) for i in np.flatnonzero(b.awake[: b.n] & (b.kind[: b.n] == FREE))]

    def _targets(self, dt: float) -> dict[int, pin.SE3]:
        """Where kinematic objects are to be at the end of the step, by id; those whose path has ended become free."""
        b = self._bodies
        out = {i: grip.target for i, grip in self._grips.items() if grip.hand is None}
        ways = {i: self._target(i, path, self.time + dt) for i, path in self._path.items() if i not in self._grips}
        for i, target in ways.items():
            kind = KINEMATIC if target is not None else FREE if i in self._body else STATIC
            if b.kind[i] != kind:
                b.kind[i] = kind
                self._stale = True
                self.wake(i)
            if target is not None:
                out[i] = target
        return dict(sorted(out.items()))

    def _carry(self, targets: Mapping[int, pin.SE3], dt: float) -> list[int]:
        """Kinematic objects that move in this step, with the velocity that takes them to their pose."""
        b = self._bodies
        moving = []
        for i, target in targets.items():
            if i in self._grips:
                self._grips[i].before = b.velocity[i].copy()
            turn = pin.log3(target.rotation @ b.rotation[i].T)
            shift = target.rotation @ b.offset[i] + target.translation - b.center[i]
            b.velocity[i, :3] = shift / dt
            b.velocity[i, 3:] = turn / dt
            if b.velocity[i].any():
                moving.append(i)
        return moving

    def _check(self, moved: NDArray[np.int64]) -> None:
        b = self._bodies
        lost = ~(np.isfinite(b.center[moved]).all(axis=1) & np.isfinite(b.velocity[moved]).all(axis=1))
        if lost.any():
            i = int(moved[np.argmax(lost)])
            raise WorldError(f"{self._called(i)}: its motion is not finite; a force or a speed is too great", i)

    def _felt(self, i: int, grip: Grip, contacts: Contacts, dt: float) -> Array:
        """(6,) what it took to carry object i through the step: its inertia, less what contacts and behaviours gave."""
        b = self._bodies
        change = (b.velocity[i] - grip.before) / dt
        r = b.rotation[i]
        w = np.concatenate([b.mass[i] * change[:3], r @ b.inertia[i] @ r.T @ change[3:]])
        omega = b.velocity[i, 3:]
        w[3:] += np.cross(omega, r @ b.inertia[i] @ r.T @ omega)
        w -= self._wrenches(np.array([i]), self.time)[0]
        for touch in _touches(i, contacts, dt):
            w[:3] -= touch.impulse / dt
            w[3:] -= np.cross(touch.point - b.center[i], touch.impulse / dt)
        return w

    def _finish_carried(self, targets: Mapping[int, pin.SE3], contacts: Contacts, dt: float) -> None:
        felt = {i: self._felt(i, self._grips[i], contacts, dt) for i in targets if i in self._grips}
        for i, target in targets.items():
            if self._bodies.velocity[i].any():
                self._bodies.set_pose(i, target)
            if i in felt:
                self._grips[i].wrench = felt[i]

    def _list_near(self, free: list[int], carried: list[int], dt: float) -> bool:
        """Renew the list of near surface pairs when something may leave the slack it was made with; True if not."""
        b = self._bodies
        movers = np.array(sorted({*free, *carried}), dtype=np.int64)
        v = b.velocity[movers]
        speed = np.sqrt((v[:, :3] ** 2).sum(axis=1)) + np.sqrt((v[:, 3:] ** 2).sum(axis=1)) * b.radius[movers]
        step = dt * speed + self._gain(movers, dt)
        if not self._stale:
            turned = np.abs(b.rotation[movers] - self._listed_rotation[movers]).sum(axis=(1, 2)) * b.radius[movers]
            moved = np.sqrt(((b.center[movers] - self._listed_center[movers]) ** 2).sum(axis=1)) + turned
            if (moved + step <= self._reach[movers]).all():
                return True
        self._refresh()
        n = b.n
        self._listed_center = b.center[:n].copy()
        self._listed_rotation = b.rotation[:n].copy()
        self._reach = np.zeros(n)
        self._reach[movers] = SLACK + (4.0 if len(movers) <= CROWD else 1.5) * step
        if self._placed:  # perhaps into one another
            self._reach[movers] += DEEPEST * np.where(np.isfinite(b.thickness[movers]), b.thickness[movers], 0.0)
        others = np.array([i for i in range(n) if b.kind[i] != 0 and self._solid.get(i, True)], dtype=np.int64)
        solid = np.array([i for i in movers if self._solid.get(int(i), True)], dtype=np.int64)
        objects = np.empty((max(64, 8 * len(solid)), 2), np.int64)
        while (found := near_objects(solid, others, b.center, b.radius, self._reach, objects)) > len(objects):
            objects = np.empty((found, 2), np.int64)
        objects = objects[:found]
        objects = objects[np.lexsort((objects[:, 1], objects[:, 0]))]
        objects = np.array([p for p in objects if not self._left_out(int(p[0]), int(p[1]))], np.int64).reshape(-1, 2)
        for i in np.unique(objects):
            self._shape(int(i))
        self._pairs = self._surface_pairs(objects)
        self._stale = self._placed = False
        return False

    def _part_deep(self, free: list[int]) -> None:
        """Bring awake bodies out of what they were put into too deep for contact to see."""
        self._refresh()
        near = self.collision.object_pairs(free).tolist()
        pairs = [(i, j) for i, j in near if self._solid.get(i, True) and self._solid.get(j, True)]
        for i in {i for pair in pairs for i in pair}:
            self._shape(i)
        starts.part(self._bodies, self.collision, pairs, frozenset(i for joint in self._joints for i in joint.bodies))

    def _gain(self, movers: NDArray[np.int64], dt: float) -> Array:
        """m that forces may add to a body's way in one step (as they are now)."""
        mass = np.where(self._bodies.mass[movers] > 0.0, self._bodies.mass[movers], np.inf)
        force = np.sqrt((self._wrenches(movers, self.time)[:, :3] ** 2).sum(axis=1))
        return dt * dt * force / mass

    def _left_out(self, i: int, j: int) -> bool:
        return self.collision.ignored(i, j)

    def _surface_pairs(self, objects: NDArray[np.int64]) -> NDArray[np.int64]:
        b = self._bodies
        shapes = self._touching.shapes
        if shapes is None or len(objects) == 0:
            return np.zeros((0, 4), np.int64)
        out = np.empty((256, 4), np.int64)
        while True:
            found = near_surfaces(
                objects, b.rotation, b.origin, self._touching.shape_of, shapes.boxes, shapes.first_surface,
                self._surface_count, self._whole, self._reach, out,
            )  # fmt: skip
            if found <= len(out):
                break
            out = np.empty((found, 4), np.int64)
        pairs = out[:found]
        keep = np.ones(found, bool)
        for i, j in objects:
            ignored = self.collision.ignored_surfaces(int(i), int(j))
            if ignored:
                mine = np.flatnonzero((pairs[:, 0] == i) & (pairs[:, 2] == j))
                keep[mine] = [(int(pairs[k, 1]), int(pairs[k, 3])) not in ignored for k in mine]
        return np.ascontiguousarray(pairs[keep])

    def _shape(self, i: int) -> None:
        """Make sure object i's shape is packed."""
        if self._touching.shape_of[i] >= 0:
            return
        mesh = self.collision.mesh(i)
        geometries = self._geometries.get(i, {})
        key = (id(mesh), tuple(sorted((s, id(g)) for s, g in geometries.items())))
        if key not in self._shape_key:
            self._shape_key[key] = len(self._shapes)
            self._shapes.append(make_shape(mesh, geometries, self.tolerance.linear))
            self._kept_alive.append((mesh, geometries))
            self._touching.use(pack(self._shapes))
            self._surface_count = np.array([len(s.kinds) for s in self._shapes], np.int64)
            self._whole = np.array([[*s.boxes[:, :3].min(axis=0), *s.boxes[:, 3:].max(axis=0)] for s in self._shapes])
        self._touching.shape_of[i] = self._shape_key[key]
        self._bodies.thickness[i] = min(self._bodies.thickness[i], self._shapes[self._shape_key[key]].wall)

    _surface_count = np.zeros(0, np.int64)
    _whole = np.zeros((0, 6))

    @property
    def _kept_alive(self) -> list:
        """What `_shape_key` names by id must not be freed."""
        return self.__dict__.setdefault("_alive", [])

    def _refresh(self) -> None:
        """Take in objects that were added to the manager or placed anew since; those without a body stand still."""
        for i in self.collision.objects:
            self._reserve(i)
            if i not in self._behaviours:
                self._stand(i)

    def _stand(self, i: int) -> None:
        b = self._bodies
        if b.kind[i] == 0:
            b.set_constants(i, None, self.collision.mesh(i).vertices)
            b.kind[i] = STATIC
        b.set_pose(i, self.collision.pose(i))

    def _rouse(self, free: list[int]) -> bool:
        """Wake what an awake body is near to or joined with, and add it to `free`; whether there was any."""
        b = self._bodies
        is_free = b.kind == FREE
        links = self._near().tolist()
        links += [joint.bodies for joint in self._joints]
        everything = {*free}
        grown = True
        while grown:
            grown = False
            for i, j in links:
                for one, other in ((i, j), (j, i)):
                    active = one in everything or (b.kind[one] == KINEMATIC and b.velocity[one].any())
                    if active and is_free[other] and other not in everything:
                        everything.add(other)
                        b.awake[other] = True
                        b.quiet[other] = 0.0
                        grown = True
        woken = len(everything) > len(free)
        free[:] = sorted(everything)
        return woken

    def _near_islands(self, ids: Ints) -> tuple[Ints, int]:
        """Labels (n,) of the awake bodies by who is near to or joined with whom, and how many there are."""
        place = np.full(self._bodies.n, -1, np.int64)
        place[ids] = np.arange(len(ids))
        joined = np.array([joint.bodies for joint in self._joints], np.int64).reshape(-1, 2)
        links = np.concatenate([self._near(), joined])
        return components(len(ids), place[links])

    def _advance(self, ids: Ints, label: Ints, count: int, kept: bool, dt: float) -> list[Contacts]:
        """Move the awake bodies; contacts at the end. Those under constant forces without joints go all together."""
        b = self._bodies
        bound = np.zeros(b.n, bool)
        bound[self._pairs[:, [0, 2]]] = True
        special = np.zeros(b.n, bool)
        special[[*self._varying, *self._grips, *(i for joint in self._joints for i in joint.bodies)]] = True
        alone = ~(bound | special)[ids]
        own = np.zeros(count, bool)
        own[label[special[ids]]] = True
        ended = []
        plain = ids[~own[label] & ~alone]
        if len(plain):
            pairs = self._pairs_of(plain)
            moved = self._kinematic(pairs[:, [0, 2]])
            gain = self._gain(plain, dt)
            ended.append(
                self._stepper.advance_apart(
                    plain, pairs, moved, self._contacts, kept, self.time, dt, self._wrenches, gain
                )
            )
        for island in np.flatnonzero(own):
            members = ids[label == island]
            pairs = self._pairs_of(members)
            among = set(members.tolist())
            joints = [j for j in self._joints if among.intersection(j.bodies)]
            moved = self._kinematic([*pairs[:, [0, 2]].ravel(), *(i for j in joints for i in j.bodies)])
            constant = not any(i in self._varying or i in self._grips for i in among)
            batch = whole(members, pairs, moved, b.n, joints, self._mechanism(members, joints), constant)
            ended.append(self._stepper.advance(batch, self._contacts, kept, self.time, dt, self._wrenches))
        if alone.any():
            self._stepper.coast(ids[alone], self._constant[ids[alone]], dt)
        return ended

    def _near(self) -> Ints:
        """(k, 2) near objects, each pair once; the list of surface pairs is sorted by them."""
        near = self._pairs[:, [0, 2]]
        return near[np.append(True, (near[1:] != near[:-1]).any(axis=1))] if len(near) else near

    def _pairs_of(self, ids: Ints) -> Ints:
        """Near surface pairs with one of the bodies."""
        mine = np.zeros(self._bodies.n, bool)
        mine[ids] = True
        return self._pairs[mine[self._pairs[:, 0]] | mine[self._pairs[:, 2]]]

    def _kinematic(self, ids: ArrayLike) -> Ints:
        """The kinematic ones of some objects, ascending."""
        unique = np.unique(np.asarray(ids, np.int64))
        return unique[self._bodies.kind[unique] == KINEMATIC]

    def _mechanism(self, ids: NDArray[np.int64], joints: Sequence[Joint]) -> Mechanism | None:
        """The island's model, made once for these bodies and joints."""
        key = (tuple(ids.tolist()), tuple(map(id, joints)))
        if key not in self._mechanisms:
            members = {*key[0], *(i for joint in joints for i in joint.bodies)}
            poses = {i: self._bodies.pose(i) for i in sorted(members)}
            self._mechanisms[key] = (poses, Mechanism.build(ids, joints, self._bodies, poses))
        return self._mechanisms[key][1]

    def _settle(self, ids: Ints, label: Ints, count: int, dt: float) -> None:
        """Put islands to sleep that have been at rest for long enough; bodies that are near to nothing stay awake."""
        b = self._bodies
        v = b.velocity[ids]
        speed = np.sqrt((v[:, :3] ** 2).sum(axis=1)) + np.sqrt((v[:, 3:] ** 2).sum(axis=1)) * b.radius[ids]
        b.quiet[ids] = np.where(speed < self.tolerance.sleep_speed, b.quiet[ids] + dt, 0.0)
        restless = b.quiet[ids] < self.tolerance.sleep_time
        restless |= np.array([i in self._grips or not self._may_sleep[i] for i in ids.tolist()], bool)
        place = np.full(b.n, -1, np.int64)
        place[ids] = label
        near = np.concatenate([self._near(), np.array([j.bodies for j in self._joints], np.int64).reshape(-1, 2)])
        met = np.zeros(count, bool)
        met[place[near[(place[near] >= 0).any(axis=1)]].max(axis=1)] = True
        carried = (b.kind[near] == KINEMATIC) & b.velocity[near].any(axis=2)
        pushed = place[near[carried.any(axis=1)]].max(axis=1)
        awake = ~met
        awake[label[restless]] = True
        awake[pushed[pushed >= 0]] = True
        asleep = ids[~awake[label]]
        b.awake[asleep] = False
        b.velocity[asleep] = 0.0
        self._stale |= len(asleep) > 0  # the list is of those that are awake

    # --- behaviours ---------------------------------------------------------------------------------------------------

    def _wrenches(self, ids: NDArray[np.int64], time: float) -> Array:
        """(n, 6) sums of what behaviours and hands exert, world axes, about the centres of mass."""
        w = self._constant[ids]
        if self._varying or self._grips:
            for k, i in enumerate(ids.tolist()):
                for behaviour in self._varying.get(i, ()):
                    w[k] += self._wrench(i, behaviour, self._view(i, time))
                grip = self._grips.get(i)
                if grip is not None and grip.hand is not None:
                    w[k] += grip.pull(self._view(i, time), self._dt)
        return w

    def _wrench(self, i: int, behaviour: Behaviour, view: View) -> Array:
        given = self._asked(i, behaviour, "wrench", view)
        if given is None:
            return np.zeros(6)
        try:
            w = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            w = np.zeros(0)
        if w.shape != (6,) or not np.isfinite(w).all():
            name = type(behaviour).__name__
            raise BehaviourError(
                f"{self._called(i)}: {name}.wrench returned {_line(given)}; give six finite numbers", i, name
            )
        return w

    def _asked(self, i: int, behaviour: Behaviour, question: str, *given: object) -> Any:
        """What a behaviour answers; if it fails, that is told with the object's name."""
        try:
            return getattr(behaviour, question)(*given)
        except Exception as error:
            name = type(behaviour).__name__
            raise BehaviourError(
                f"{self._called(i)}: {name}.{question} raised {type(error).__name__}: {error}", i, name
            ) from error

    def _called(self, i: int) -> str:
        """How messages name object i."""
        body = self._body.get(i)
        name = body.name if body is not None else self.collision.mesh(i).name
        return f"object {i} ({name})"

    def _target(self, i: int, path: Behaviour, time: float) -> pin.SE3 | None:
        """The pose that `path` gives object i at `time`, s; None if it is free then."""
        pose = self._asked(i, path, "pose", time)
        return None if pose is None else self._rigid(i, pose, type(path).__name__)

    def _rigid(self, i: int, pose: object, name: str) -> pin.SE3:
        if (
            not isinstance(pose, pin.SE3)
            or not np.isfinite(pose.homogeneous).all()
            or np.abs(pose.rotation.T @ pose.rotation - np.eye(3)).max() > self.tolerance.rigid
            or np.linalg.det(pose.rotation) < 0.0
        ):
            raise BehaviourError(
                f"{self._called(i)}: {name} gives {_line(pose)}, which is no finite rigid pose", i, name
            )
        return pose

    def _view(self, i: int, time: float) -> View:
        b = self._bodies
        return View(
            i, time, self._body[i], b.pose(i), b.center[i].copy(), b.velocity[i, :3].copy(), b.velocity[i, 3:].copy(),
            _touches(i, self._contacts, self._last_step),
        )  # fmt: skip

    def _reaction(self, i: int, behaviours: Sequence[Behaviour]) -> Reaction:
        reaction = Reaction()
        for behaviour in behaviours:
            reaction = self._asked(i, behaviour, "reaction", reaction)
            name, called = type(behaviour).__name__, self._called(i)
            if not isinstance(reaction, Reaction):
                raise BehaviourError(f"{called}: {name}.reaction returned {_line(reaction)}, no Reaction", i, name)
            for what, value, most in (
                ("restitution", reaction.restitution, 1.0),
                ("friction", reaction.friction, np.finfo(np.float64).max),
            ):
                if value is not None and not (isinstance(value, int | float | np.number) and 0.0 <= value <= most):
                    limits = "0 … 1" if most == 1.0 else "0 or more"
                    raise BehaviourError(f"{called}: {name} gives {what} {_line(value)}; give {limits}", i, name)
            if reaction.law not in LAWS:
                raise BehaviourError(
                    f"{called}: {name} gives law {_line(reaction.law)}; there are: {', '.join(LAWS)}", i, name
                )
        return reaction

    # --- small things -------------------------------------------------------------------------------------------------

    def _known(self, object_id: int) -> int:
        if object_id not in self.collision.objects:
            raise WorldError(f"the collision manager has no object {object_id!r}; add it there first", object_id)
        return int(object_id)

    def _member(self, object_id: int) -> int:
        if object_id not in self._behaviours:
            if object_id in self.collision.objects:
                self._reserve(object_id)
                self._stand(int(object_id))
                return int(object_id)
            raise WorldError(f"no object {object_id!r} in this world; add it first", object_id)
        return int(object_id)

    def _reserve(self, i: int) -> Bodies:
        b = self._bodies
        b.reserve(i + 1)
        n = len(b.kind)
        s = self._touching
        if len(s.friction) < n:
            old = len(s.friction)
            s.friction = np.concatenate([s.friction, np.full(n - old, np.nan)])
            s.restitution = np.concatenate([s.restitution, np.full(n - old, np.nan)])
            s.poisson = np.concatenate([s.poisson, np.zeros(n - old, bool)])
            s.shape_of = np.concatenate([s.shape_of, np.full(n - old, -1, np.int64)])
            self._constant = np.concatenate([self._constant, np.zeros((n - old, 6))])
        return b

    def _wake_near(self, i: int) -> None:
        """Wake what may rest on object i."""
        b = self._bodies
        d = np.sqrt(((b.center[: b.n] - b.center[i]) ** 2).sum(axis=1))
        near = (d <= b.radius[: b.n] + b.radius[i] + SLACK) & (b.kind[: b.n] == FREE)
        b.awake[: b.n][near] = True
        b.quiet[: b.n][near] = 0.0


def _touches(i: int, c: Contacts, dt: float) -> tuple[Touch, ...]:
    """Contact points at which object i is pressed, after a step of `dt` seconds."""
    out = []
    for k in np.flatnonzero(((c.ints[:, 0] == i) | (c.ints[:, 1] == i)) & (c.force[:, 0] > 0.0)):
        sign = 1.0 if c.ints[k, 0] == i else -1.0
        n = c.reals[k, 3:6]
        t1 = _tangent(n)
        f = c.force[k, 0] * n + c.force[k, 1] * t1 + c.force[k, 2] * np.cross(n, t1)
        other = int(c.ints[k, 1] if sign > 0 else c.ints[k, 0])
        out.append(Touch(other, c.reals[k, :3].copy(), sign * n, sign * dt * f))
    return tuple(out)


def _line(value: object) -> str:
    """What was given, on one line and not too long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


def _tangent(n: Array) -> Array:
    """The first tangent that `solver.rows_of_contacts` gives the normal n."""
    k = 0
    for i in (1, 2):
        if abs(n[i]) < abs(n[k]) - 1e-6:
            k = i
    e = np.zeros(3)
    e[k] = 1.0
    t = np.cross(n, e)
    return t / np.sqrt(t @ t)


def _joined(contacts: list[Contacts]) -> Contacts:
    if not contacts:
        return NO_CONTACTS
    return Contacts(*(np.concatenate(columns) for columns in zip(*contacts, strict=True)))
