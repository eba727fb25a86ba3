"""The same hinges through other people's solvers: runs in an interpreter that has them, JSON in, JSON out.

A line in: {"solver", "poses": [[16 numbers, row-major] ...], "joints": [[a, b, point_a, axis_a, point_b, axis_b] ...]}
in metres, body 0 fixed. A line out: {"seconds", "residual", "said"}, the seconds of the call that solves alone, or
{"missing": why}.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

MM = 1000.0  # all of them think in millimetres; their tolerances do too


def residual(joints: list[Any], poses: list[np.ndarray]) -> float:
    """Greatest miss of points (m) and axes (rad) over the joints."""
    worst = 0.0
    for a, b, pa, da, pb, db in joints:
        A, B = poses[a], poses[b]
        worst = max(worst, float(np.linalg.norm((A[:3, :3] @ pa + A[:3, 3]) - (B[:3, :3] @ pb + B[:3, 3]))))
        u, v = A[:3, :3] @ da, B[:3, :3] @ db
        worst = max(worst, float(np.arctan2(np.linalg.norm(np.cross(u, v)), abs(u @ v))))
    return worst


def with_cadquery(poses: list[np.ndarray], joints: list[Any]) -> tuple[float, list[np.ndarray], str]:
    """`Assembly.solve` with Point and Axis constraints."""
    import cadquery as cq
    from OCP.gp import gp_Trsf

    assembly = cq.Assembly()
    for i, M in enumerate(poses):
        t = gp_Trsf()
        t.SetValues(*M[0, :3], MM * M[0, 3], *M[1, :3], MM * M[1, 3], *M[2, :3], MM * M[2, 3])
        body = cq.Assembly(cq.Workplane().box(1, 1, 1), name=f"b{i}", loc=cq.Location(t))
        assembly.add(body)
    for a, b, pa, da, pb, db in joints:
        faces = [
            cq.Face.makePlane(1, 1, cq.Vector(*(MM * np.array(p))), cq.Vector(*d)) for p, d in ((pa, da), (pb, db))
        ]
        for kind, parameter in (("Point", 0), ("Axis", 0)):
            assembly.constrain(f"b{a}", faces[0], f"b{b}", faces[1], kind, parameter)
    assembly.constrain("b0", "Fixed")
    begin = time.perf_counter()
    assembly.solve()
    seconds = time.perf_counter() - begin
    out = []
    for child in assembly.children:
        t = child.loc.wrapped.Transformation()
        M = np.array([[t.Value(r, c) for c in range(1, 5)] for r in range(1, 4)])
        M[:, 3] /= MM
        out.append(np.vstack([M, [0, 0, 0, 1]]))
    return seconds, out, str((assembly._solve_result or {}).get("return_status", ""))


def quaternion(R: np.ndarray) -> np.ndarray:
    """(w, x, y, z) of a rotation."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
        ]
    )
    x, y, z, w = np.linalg.eigh(K / 3.0)[1][:, 3]
    return np.array([w, x, y, z])


def rotation(q: np.ndarray) -> np.ndarray:
    """Rotation of a quaternion (w, x, y, z), normalised."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def with_py_slvs(poses: list[np.ndarray], joints: list[Any]) -> tuple[float, list[np.ndarray], str]:
    """SolveSpace by py_slvs: parts of seven parameters, as FreeCAD's Assembly3 has them."""
    from py_slvs import slvs

    s = slvs.System()
    parameters = []
    for i, M in enumerate(poses):
        group = 1 if i == 0 else 2
        values = [*(MM * M[:3, 3]), *quaternion(M[:3, :3])]
        parameters.append([s.addParamV(float(v), group) for v in values])
        s.addNormal3d(*parameters[-1][3:], group)

    def point(body: int, p: np.ndarray) -> int:
        return s.addTransform(s.addPoint3dV(*(float(x) for x in MM * p), 1), *parameters[body], group=2)

    for a, b, pa, da, pb, db in joints:
        origin, tip = point(a, np.array(pa)), point(a, np.array(pa) + 0.01 * np.array(da))
        line = s.addLineSegment(origin, tip, 2)
        other, end = point(b, np.array(pb)), point(b, np.array(pb) + 0.01 * np.array(db))
        s.addPointsCoincident(origin, other, group=2)
        s.addPointOnLine(end, line, group=2)
    begin = time.perf_counter()
    said = s.solve(2)
    seconds = time.perf_counter() - begin
    out = []
    for handles in parameters:
        v = np.array([s.getParam(h).val for h in handles])
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = rotation(v[3:]), v[:3] / MM
        out.append(M)
    return seconds, out, str(said)


class _Sketch:
    """The module `slvs`, which holds one sketch and names the group in each call, as python-solvespace's system."""

    def __init__(self) -> None:
        import slvs

        self.slvs, self.group = slvs, 1
        slvs.clear_sketch()

    def set_group(self, group: int) -> None:
        """The group of what is made from now on."""
        self.group = group

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return functools.partial(getattr(self.slvs, name), self.group)

    def solve(self) -> int:
        """Solve the group; 0 where that succeeds."""
        return int(self.slvs.solve_sketch(self.group, False)["result"])

    def params(self, point: Any) -> list[float]:
        """Coordinates of a point."""
        return [self.slvs.get_param_value(handle) for handle in point["param"][:3]]


def with_slvs(poses: list[np.ndarray], joints: list[Any]) -> tuple[float, list[np.ndarray], str]:
    """SolveSpace by slvs, the successor of python-solvespace, likewise."""
    sketch = _Sketch()
    return _by_points(sketch, sketch.params, sketch.slvs.E_FREE_IN_3D, poses, joints)


def with_python_solvespace(poses: list[np.ndarray], joints: list[Any]) -> tuple[float, list[np.ndarray], str]:
    """SolveSpace by python-solvespace, which has no parts: four points each, their six distances kept."""
    from python_solvespace import Entity, SolverSystem

    system = SolverSystem()
    return _by_points(system, lambda point: system.params(point.params), Entity.FREE_IN_3D, poses, joints)


def _by_points(
    s: Any, coordinates: Callable[[Any], Any], free: Any, poses: list[np.ndarray], joints: list[Any]
) -> tuple[float, list[np.ndarray], str]:
    """Solve by points alone. coordinates: of a point. free: what stands for no workplane."""
    ends: dict[int, list[np.ndarray]] = {i: [] for i in range(len(poses))}
    for a, b, pa, da, pb, db in joints:
        for body, p, d in ((a, pa, da), (b, pb, db)):
            ends[body] += [np.array(p), np.array(p) + 0.01 * np.array(d)]
    s.set_group(1)
    made: dict[int, list[Any]] = {}
    M = poses[0]
    made[0] = [s.add_point_3d(*(MM * (M[:3, :3] @ p + M[:3, 3]))) for p in ends[0]]
    s.set_group(2)
    for i in range(1, len(poses)):
        M = poses[i]
        middle = np.mean(ends[i], axis=0)
        while len(ends[i]) < 4:
            ends[i].append(middle + 0.02 * np.array([[1.0, 0.3, 0.2], [0.1, 1.0, -0.4]][len(ends[i]) - 2]))
        made[i] = [s.add_point_3d(*(MM * (M[:3, :3] @ p + M[:3, 3]))) for p in ends[i]]
        for x in range(4):
            for y in range(x):
                length = MM * float(np.linalg.norm(ends[i][x] - ends[i][y]))
                s.distance(made[i][x], made[i][y], length, free)
    used = dict.fromkeys(made, 0)
    for a, b, *_ in joints:
        pa, ta = made[a][used[a]], made[a][used[a] + 1]
        pb, tb = made[b][used[b]], made[b][used[b] + 1]
        used[a] += 2
        used[b] += 2
        s.coincident(pa, pb, free)
        s.coincident(tb, s.add_line_3d(pa, ta), free)
    begin = time.perf_counter()
    said = s.solve()
    seconds = time.perf_counter() - begin
    out = [poses[0]]
    for i in range(1, len(poses)):
        now = np.array([coordinates(p) for p in made[i][: len(ends[i])]]) / MM
        local = np.array(ends[i])
        U, _, Vt = np.linalg.svd((now - now.mean(0)).T @ (local - local.mean(0)))
        R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = R, now.mean(0) - R @ local.mean(0)
        out.append(M)
    return seconds, out, str(said)


SOLVERS: dict[str, Callable[..., tuple[float, list[np.ndarray], str]]] = {
    "cadquery": with_cadquery,
    "py_slvs": with_py_slvs,
    "python-solvespace": with_python_solvespace,
    "slvs": with_slvs,
}


def main() -> None:
    """Answer one request a line until there are no more; what the solvers themselves print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        asked = json.loads(line)
        poses = [np.array(p).reshape(4, 4) for p in asked["poses"]]
        joints = [[x if isinstance(x, int) else np.array(x) for x in j] for j in asked["joints"]]
        try:
            seconds, found, said = SOLVERS[asked["solver"]](poses, joints)
            answer = {"seconds": seconds, "residual": residual(joints, found), "said": said}
        except ImportError:
            answer = {"missing": "not installed"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
