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
from constraints.geometry.surfaces import Geometry
from physics.contact import depenetration as starts
from physics.contact.contact_problem import NO_CONTACTS, Contacts
from physics.contact.neighbours import SLACK, Neighbours
from physics.errors import BehaviourError, WorldError
from physics.forces.answers import Answers
from physics.forces.behaviours import Behaviour, Sleeping, Touch, View
from physics.forces.total import Forces, touches
from physics.joints.mechanism import Mechanism
from physics.joints.rows import Joint
from physics.model.bodies import FREE, KINEMATIC, STATIC, Bodies, Saved, point_speeds
from physics.model.body import Body
from physics.solver.batch import whole
from physics.solver.islands import components
from physics.stepping.hands import Grip, SpringHand
from physics.stepping.integrators import METHODS
from physics.stepping.kinematic_bodies import Carrying
from physics.stepping.sleeping import rouse, settle
from physics.stepping.step import Stepper

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        if not isinstance(integrator, str) or integrator not in METHODS:
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
        self._may_sleep: dict[int, bool] = {}
        self._geometries: dict[int, Mapping[int, Geometry]] = {}
        self._joints: list[Joint] = []
        self._grips: dict[int, Grip] = {}
        self._mechanisms: dict[tuple, tuple[dict[int, pin.SE3], Mechanism | None]] = {}
        self._moving: tuple[int, ...] = ()
        self._answers = Answers(collision, self._body, self.tolerance)
        self._forces = Forces(self._bodies, self._body, self._grips, self._answers)
        self._carrying = Carrying(self._bodies, self._forces, self._grips, self._answers)
        self._neighbours = Neighbours(collision, self._bodies, self._touching, self._geometries)

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
        reaction = self._answers.reaction(i, behaviours)
        pose = self.collision.pose(i)
        constant, varying = np.zeros(6), tuple[Behaviour, ...]()
        if body is not None:
            view = View(i, self.time, body, pose, pose.act(body.center), twist[:3], twist[3:])
            constant, varying = self._forces.sort(behaviours, view)
        path = next((x for x in reversed(behaviours) if type(x).pose is not Behaviour.pose), None)
        if path is not None:
            self._answers.pose(i, path, self.time)
        b = self._reserve(i)
        b.set_constants(i, body, self.collision.mesh(i).vertices)
        b.set_pose(i, pose)
        self._geometries[i] = dict(geometries or {})
        self._behaviours[i] = tuple(behaviours)
        self._touching.friction[i] = np.nan if reaction.friction is None else reaction.friction
        self._touching.restitution[i] = np.nan if reaction.restitution is None else reaction.restitution
        self._touching.poisson[i] = reaction.law == "poisson"
        self._touching.shape_of[i] = -1
        self._neighbours.solid[i] = reaction.solid
        self._carrying.path.pop(i, None)
        self._forces.set(i, constant, varying)
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
            self._carrying.path[i] = path
            b.kind[i] = KINEMATIC
        self._mechanisms.clear()  # they have its mass in them
        self.wake(i)
        self.refresh()

    def refresh(self) -> None:
        """Take notice of objects that were added to the manager, or placed by it, while they have no body here."""
        self._neighbours.stale = self._neighbours.placed = True

    def remove(self, object_id: int) -> None:
        """Take mass and behaviours from an object: if the manager still holds it, it stands still."""
        i = self._member(object_id)
        self._wake_near(i)
        self._forces.remove(i)
        for table in (self._body, self._behaviours, self._carrying.path, self._geometries, self._grips):
            table.pop(i, None)
        self._bodies.kind[i] = 0
        self._bodies.awake[i] = False
        self._touching.friction[i] = self._touching.restitution[i] = np.nan
        self._neighbours.solid.pop(i, None)
        self._neighbours.stale = True

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
        self._neighbours.stale = True

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
        self.refresh()
        self.wake(i)

    @property
    def awake(self) -> tuple[int, ...]:
        """Ids of the free bodies that are moving, or have not been at rest for long enough to sleep."""
        return tuple(self._free_awake().tolist())

    def wake(self, object_id: int) -> None:
        """Wake an object."""
        i = self._member(object_id)
        self._bodies.wake(i)

    def energy(self, object_id: int) -> float:
        """Kinetic energy of an object, J."""
        i = self._member(object_id)
        b = self._bodies
        w = b.rotation[i].T @ b.velocity[i, 3:]
        return 0.5 * float(b.mass[i] * (b.velocity[i, :3] @ b.velocity[i, :3]) + w @ b.inertia[i] @ w)

    def touches(self, object_id: int) -> tuple[Touch, ...]:
        """Contact points of an object that carry force, as of the last step; `impulse` is force times the step."""
        return touches(self._member(object_id), self._forces.contacts, self._forces.last_step)

    def state(self) -> Snapshot:
        """Everything that changes while the world runs (behaviours of a user keep their own state)."""
        b = self._bodies
        place = {id(joint): k for k, joint in enumerate(self._joints)}
        data = {name: getattr(b, name)[: b.n] for name in Bodies._PER_OBJECT}
        data.update(
            n=b.n, time=self.time, contacts=tuple(self._forces.contacts), last_step=self._forces.last_step,
            moving=self._moving, near=self._neighbours.state(),
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
        self._take_in()
        if data["members"] != tuple(sorted(self._behaviours)) or data["n"] != self._bodies.n:
            raise WorldError("the snapshot is of other objects; add what it had, remove what it had not")
        if data["joints"] != [joint.bodies for joint in self._joints]:
            raise WorldError("the snapshot is of other joints; call set_joints with those it had")
        b = self._bodies
        for name in Bodies._PER_OBJECT:
            getattr(b, name)[: b.n] = data[name]
        self.time = data["time"]
        self._forces.contacts = Contacts(*data["contacts"])
        self._forces.last_step = data["last_step"]
        self._moving = data["moving"]
        self._neighbours.restore(data["near"])
        self._grips.clear()
        self._grips.update({i: Grip.of(d) for i, d in data["grips"].items()})
        self._mechanisms.clear()
        for ids, places, homogeneous in data["mechanisms"]:
            poses = {i: pin.SE3(m) for i, m in homogeneous.items()}
            joints = [self._joints[k] for k in places]
            self._mechanisms[ids, tuple(map(id, joints))] = (poses, Mechanism.build(np.array(ids), joints, b, poses))
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
        self._answers.rigid(i, grip.target if spring else grip, "hold")
        self._bodies.kind[i] = FREE if spring else KINEMATIC
        self._grips[i] = Grip(grip)
        self.wake(i)

    def let_go(self, object_id: int) -> None:
        """End a hold; the object keeps its velocity."""
        i = self._member(object_id)
        if self._grips.pop(i, None) is None:
            raise WorldError(f"object {i} is not held", i)
        self._bodies.kind[i] = KINEMATIC if i in self._carrying.path else FREE
        self.wake(i)
        self._neighbours.stale = True

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
        dt = self._forces.dt = float(dt)
        b = self._bodies
        targets, changed = self._carrying.targets(self.time + dt)
        self._neighbours.stale |= changed
        before = {i: b.velocity[i].copy() for i in targets}
        carried = self._carrying.begin(targets, dt)
        ids = self._free_awake()
        start: Saved | None = None
        try:
            if len(ids) or carried or self._grips:
                if self._neighbours.placed:
                    self._part_deep(ids)
                kept = self._list_near(ids, carried, dt)
                links = self._links()
                while len(woken := rouse(b, ids, links)) > len(ids):  # pairs among sleepers were not listed
                    ids = woken
                    self._neighbours.stale = True
                    kept = self._list_near(ids, carried, dt)
                    links = self._links()
                label, count = self._islands(ids, links)
                kept = kept and tuple(ids) == self._moving
                self._moving = tuple(ids)
                self._touching.residual = 0.0
                moved = np.union1d(ids, np.array(carried, np.int64))
                start, steady, rate = Saved(b, moved), b.steady[moved], b.rate[moved]
                contacts = self._advance(ids, label, count, kept, dt)
                self._check(moved)
                self._carrying.end(targets, contacts, self.time, dt)
                self.residual = self._touching.residual
                self._forces.contacts = contacts
                may = np.array([i not in self._grips and self._may_sleep[i] for i in ids.tolist()], bool)
                if settle(b, ids, label, links, may, self.tolerance, dt):
                    self._neighbours.stale = True  # the list is of those that are awake
                self.collision.set_poses(moved, b.homogeneous(moved))
        except BaseException:
            for i, velocity in before.items():
                b.velocity[i] = velocity
            if start is not None:
                start.restore(b)
                b.steady[moved], b.rate[moved] = steady, rate
            raise
        self.time += dt
        self._forces.last_step = dt

    def _free_awake(self) -> Ints:
        b = self._bodies
        return np.flatnonzero(b.awake[: b.n] & (b.kind[: b.n] == FREE))

    def _check(self, moved: Ints) -> None:
        b = self._bodies
        lost = ~(np.isfinite(b.center[moved]).all(axis=1) & np.isfinite(b.velocity[moved]).all(axis=1))
        if lost.any():
            i = int(moved[np.argmax(lost)])
            raise WorldError(f"{self._answers.called(i)}: its motion is not finite; a force or a speed is too great", i)

    def _part_deep(self, free: Ints) -> None:
        """Bring awake bodies out of what they were put into too deep for contact to see."""
        self._take_in()
        solid = self._neighbours.solid
        near = self.collision.object_pairs(free.tolist()).tolist()
        pairs = [(i, j) for i, j in near if solid.get(i, True) and solid.get(j, True)]
        self._neighbours.use(np.array(pairs, np.int64))
        starts.part(self._bodies, self.collision, pairs, frozenset(i for joint in self._joints for i in joint.bodies))

    def _list_near(self, free: Ints, carried: list[int], dt: float) -> bool:
        """Renew the list of near surface pairs if it must be; True if not."""
        b = self._bodies
        movers = np.union1d(free, np.array(carried, np.int64))
        step = dt * point_speeds(b.velocity[movers], b.radius[movers]) + self._gain(movers, dt)
        if self._neighbours.hold_for(movers, step):
            return True
        self._take_in()
        self._neighbours.renew(movers, step)
        return False

    def _gain(self, movers: Ints, dt: float) -> Array:
        """m that forces may add to a body's way in one step (as they are now)."""
        mass = np.where(self._bodies.mass[movers] > 0.0, self._bodies.mass[movers], np.inf)
        force = np.sqrt((self._forces.wrenches(movers, self.time)[:, :3] ** 2).sum(axis=1))
        return dt * dt * force / mass

    def _links(self) -> Ints:
        """(k, 2) objects that are near to or joined with one another."""
        joined = np.array([joint.bodies for joint in self._joints], np.int64).reshape(-1, 2)
        return np.concatenate([self._neighbours.objects(), joined])

    def _take_in(self) -> None:
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

    def _islands(self, ids: Ints, links: Ints) -> tuple[Ints, int]:
        """Labels (n,) of the awake bodies by who is near to or joined with whom, and how many there are."""
        place = np.full(self._bodies.n, -1, np.int64)
        place[ids] = np.arange(len(ids))
        return components(len(ids), place[links])

    def _advance(self, ids: Ints, label: Ints, count: int, kept: bool, dt: float) -> Contacts:
        """Move the awake bodies; contacts at the end. Those under constant forces without joints go all together."""
        b, stepper, before, wrenches = self._bodies, self._stepper, self._forces.contacts, self._forces.wrenches
        bound = np.zeros(b.n, bool)
        bound[self._neighbours.pairs[:, [0, 2]]] = True
        special = np.zeros(b.n, bool)
        special[[*self._forces.varying, *self._grips, *(i for joint in self._joints for i in joint.bodies)]] = True
        alone = ~(bound | special)[ids]
        own = np.zeros(count, bool)
        own[label[special[ids]]] = True
        ended = []
        plain = ids[~own[label] & ~alone]
        if len(plain):
            pairs = self._neighbours.of(plain)
            moved = self._kinematic(pairs[:, [0, 2]])
            gain = self._gain(plain, dt)
            ended.append(stepper.advance_apart(plain, pairs, moved, before, kept, self.time, dt, wrenches, gain))
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
        return _joined(ended)

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
        self._touching.reserve(len(b.kind))
        self._forces.reserve(len(b.kind))
        return b

    def _wake_near(self, i: int) -> None:
        """Wake what may rest on object i."""
        b = self._bodies
        d = np.sqrt(((b.center[: b.n] - b.center[i]) ** 2).sum(axis=1))
        near = (d <= b.radius[: b.n] + b.radius[i] + SLACK) & (b.kind[: b.n] == FREE)
        b.awake[: b.n][near] = True
        b.quiet[: b.n][near] = 0.0


def _joined(contacts: list[Contacts]) -> Contacts:
    if not contacts:
        return NO_CONTACTS
    return Contacts(*(np.concatenate(columns) for columns in zip(*contacts, strict=True)))
