"""The assembly graph: what hangs together, on what base, as JSON and GraphViz."""

import json

import numpy as np
import pinocchio as pin

from constraints import Against, Concentric
from constraints.freedom.graph import AssemblyGraph
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.solve.system import components

Z = [0.0, 0.0, 1.0]


def hole(x, y=0.0):
    return Cylinder([x, y, 0.0], Z, 0.005)


def bolted_plate():
    """Plate 0 carries bracket 1 by two bolts 2 and 3; part 4 lies loose."""
    axis, down, up = Cylinder([0, 0, 0], Z, 0.005), Plane([0, 0, 0], [0, 0, -1]), Plane([0, 0, 0], Z)
    head = Plane([0, 0, 0.01], [0, 0, -1])
    constraints = [
        Against((0, 1), (up, down), ((0,), (1,))),
        *(Concentric((0, b), (hole(x), axis), ((k,), (0,))) for k, (b, x) in enumerate([(2, 0.0), (3, 0.1)], 1)),
        *(Concentric((1, b), (hole(x), axis), ((k + 4,), (0,))) for k, (b, x) in enumerate([(2, 0.0), (3, 0.1)])),
        *(Against((1, b), (Plane([0, 0, 0.01], Z), head), ((3,), (2,))) for b in (2, 3)),
    ]
    poses = [pin.SE3.Identity() for _ in range(5)]
    poses[3] = pin.SE3(np.eye(3), np.array([0.1, 0, 0]))
    poses[4] = pin.SE3(np.eye(3), np.array([0, 1.0, 0]))
    return AssemblyGraph.of(constraints, poses, [0], ["plate", "bracket", "bolt 1", 'bolt "2"', "loose"])


def test_components_against_depth_first_search():
    rng = np.random.default_rng(5)
    for _ in range(50):
        n = int(rng.integers(1, 12))
        edges = [tuple(int(x) for x in rng.integers(0, n, 2)) for _ in range(int(rng.integers(0, 12)))]
        seen, slow = set(), []
        for start in range(n):
            if start in seen:
                continue
            group, todo = set(), [start]
            while todo:
                x = todo.pop()
                if x not in group:
                    group.add(x)
                    todo += [b for e in edges for a, b in (e, e[::-1]) if a == x]
            seen |= group
            slow.append(tuple(sorted(group)))
        assert components(range(n), edges) == tuple(slow)


def test_subassemblies_and_links():
    graph = bolted_plate()
    assert graph.subassemblies == ((0, 1, 2, 3), (4,))
    assert graph.links == ((0, 1), (2,), (3,), (4,))
    assert graph.mobility.parts[1].joint == "rigid" and graph.mobility.parts[2].joint == "revolute"


def test_json_is_plain_and_complete():
    document = json.loads(json.dumps(bolted_plate().to_json()))
    assert [p["joint"] for p in document["parts"]] == ["fixed", "rigid", "revolute", "revolute", "free"]
    assert len(document["constraints"]) == 7
    bore = document["constraints"][1]
    assert bore["kind"] == "concentric" and bore["parts"] == ["plate", "bolt 1"] and bore["residual"] == 0.0
    first = document["features"][bore["features"][0]]
    assert first == {"part": "plate", "surfaces": [1], "type": "cylinder"}
    shared = [c["features"][1] for c in document["constraints"] if c["parts"][1] == "bolt 1" and c["kind"] != "against"]
    assert len(set(shared)) == 1  # the bolt's shank is one feature with two constraints
    assert document["subassemblies"] == [["plate", "bracket", "bolt 1", 'bolt "2"'], ["loose"]]
    assert document["links"][0] == ["plate", "bracket"]


def test_dot_has_a_node_a_part_and_an_edge_a_constraint():
    dot = bolted_plate().to_dot()
    assert dot.count(" -- ") == 7 and dot.count("peripheries=2") == 1
    assert 'p3 [label="bolt \\"2\\"\\nrevolute"];' in dot
    assert dot.startswith("graph assembly {") and dot.endswith("}\n")
