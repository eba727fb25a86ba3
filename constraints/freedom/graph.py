"""The assembly graph: parts and features as nodes, constraints as edges; its subassemblies and rigid links.

After Lee and Gossard's hierarchical mating graphs (CAD 17, 1985): two parts not connected by constraints belong to
different subassemblies; parts that cannot move relative to each other form one rigid link of the mechanism.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from collision import Tolerance
from constraints.freedom.mobility import Mobility, mobility
from constraints.kinds import Constraint
from constraints.solve.system import Poses, components


@dataclass(frozen=True, eq=False)
class AssemblyGraph:
    """Parts, and the constraints between them, at poses where the constraints hold.

    Parameters
    ----------
    constraints: the edges.
    poses: of every part, by body id.
    base: ids of the fixed parts.
    labels: names of the parts, by body id; ids if missing.
    """

    constraints: tuple[Constraint, ...]
    poses: Poses
    base: tuple[int, ...]
    labels: Mapping[int, str]
    tolerance: Tolerance

    @classmethod
    def of(
        cls,
        constraints: Sequence[Constraint],
        poses: Poses,
        base: Iterable[int],
        labels: Mapping[int, str] | Sequence[str] = (),
        tolerance: Tolerance | None = None,
    ) -> AssemblyGraph:
        """Return the graph of an assembly; `labels` also as a sequence in the order of the ids."""
        names = dict(labels) if isinstance(labels, Mapping) else dict(enumerate(labels))
        return cls(tuple(constraints), poses, tuple(sorted(set(base))), names, tolerance or Tolerance())

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """All part ids, ascending."""
        return tuple(sorted(self.poses)) if isinstance(self.poses, Mapping) else tuple(range(len(self.poses)))

    def label(self, body: int) -> str:
        """Return the name of a part."""
        return self.labels.get(body, str(body))

    @cached_property
    def mobility(self) -> Mobility:
        """Freedom of each part and each constrained pair."""
        return mobility(self.constraints, self.poses, self.base, self.tolerance)

    @cached_property
    def subassemblies(self) -> tuple[tuple[int, ...], ...]:
        """Parts connected by constraints, single parts included; the base's parts count as connected."""
        edges = [c.bodies for c in self.constraints]
        return components(self.bodies, edges + [(self.base[0], b) for b in self.base[1:]])

    @cached_property
    def links(self) -> tuple[tuple[int, ...], ...]:
        """Groups of parts that cannot move relative to each other; the base's group first, and in it the base."""
        rigid = [pair for pair, freedom in self.mobility.pairs.items() if freedom.freedom == 0]
        still = [b for b, freedom in self.mobility.parts.items() if freedom.freedom == 0]
        if self.base:
            rigid += [(self.base[0], b) for b in (*self.base[1:], *still)]
        groups = components(self.bodies, rigid)
        ranked = [tuple(sorted(g, key=lambda b: (b not in self.base, b))) for g in groups]
        return tuple(sorted(ranked, key=lambda g: (g[0] not in self.base, g)))

    def to_json(self) -> dict[str, Any]:
        """Return parts, features, constraints and subassemblies as one JSON document; lengths in metres."""
        parts = self.mobility.parts
        features = {
            (b, s): {"part": self.label(b), "surfaces": list(s), "type": f.kind}
            for c in self.constraints
            for b, s, f in zip(c.bodies, c.surfaces, c.features, strict=True)
        }
        places = {key: i for i, key in enumerate(sorted(features))}
        return {
            "parts": [
                {
                    "name": self.label(b),
                    "base": b in self.base,
                    "joint": "fixed" if b in self.base else parts[b].joint,
                    "freedom": 0 if b in self.base else parts[b].freedom,
                }
                for b in self.bodies
            ],
            "features": [features[key] for key in sorted(features)],
            "constraints": [
                {
                    "kind": c.kind,
                    "parts": [self.label(b) for b in c.bodies],
                    "features": [places[b, s] for b, s in zip(c.bodies, c.surfaces, strict=True)],
                    "residual": self._residual(c),
                }
                for c in self.constraints
            ],
            "subassemblies": [[self.label(b) for b in group] for group in self.subassemblies],
            "links": [[self.label(b) for b in group] for group in self.links],
        }

    def _residual(self, c: Constraint) -> float:
        rows = c.residual(self.poses[c.bodies[0]], self.poses[c.bodies[1]])
        return float(np.abs(rows[~c.angular]).max(initial=0.0))

    def to_dot(self) -> str:
        """Return the graph in GraphViz' language: boxes for parts (double for the base), edges for constraints."""
        lines = ["graph assembly {", "  node [shape=box, fontname=Helvetica];", "  edge [fontname=Helvetica];"]
        for b in self.bodies:
            joint = "base" if b in self.base else self.mobility.parts[b].joint
            rim = ", peripheries=2" if b in self.base else ""
            lines.append(f'  p{b} [label="{_escaped(self.label(b))}\\n{joint}"{rim}];')
        for c in self.constraints:
            a, b = c.bodies
            ends = " – ".join(",".join(map(str, s)) for s in c.surfaces)
            lines.append(f'  p{a} -- p{b} [label="{c.kind}\\n{ends}"];')
        return "\n".join([*lines, "}"]) + "\n"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')
