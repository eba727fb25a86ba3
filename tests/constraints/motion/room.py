"""A room of bodies, of which a hand moves one."""

from collision import CollisionManager
from constraints import ConstraintManager, Motion
from tests.constraints.shapes import Body, at, flanged_shaft, housing


def bored(clearance=2e-5, z=0.03):
    return Room([housing(0.01 + clearance), flanged_shaft(phase=0.05)], [at(), at(z=z)]).mate()


class Room:
    """Bodies, of which number 0 stands still, and a hand on number 1."""

    def __init__(self, bodies: list[Body], poses, accept=True, **options):
        self.world = CollisionManager()
        for k, (body, pose) in enumerate(zip(bodies, poses, strict=True)):
            self.world.add(body.mesh, pose, movable=k > 0)
        rules = [lambda c: True] if accept else []
        self.manager = ConstraintManager([b.features for b in bodies], rules=rules, fixed=[0], **options)
        self.motion = Motion(self.world, self.manager)
        self.poses = list(poses)
        self.movable = range(1, len(bodies))

    def move(self, pose, held=1, movable=None, carried=()):
        movable = self.movable if movable is None else movable
        result = self.motion.step({held: pose}, self.poses, movable, {held: carried})
        for i, p in result.poses.items():
            self.poses[i] = p
        return result

    def update(self, wanted=None):
        changes = self.manager.update(self.poses, self.world.contacts(self.manager.within), wanted)
        self.motion.sync()
        return [(c.kind, c.candidate.kind) for c in changes]

    def mate(self):
        """Accept what is there, and let it snap."""
        self.update()
        self.move(self.poses[1])
        return self
