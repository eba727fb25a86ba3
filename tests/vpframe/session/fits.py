"""Tight fits and covers, taken out and back."""

from vpframe.scene.modelling import Solid, box, cylinder, extrude


def tight_fit(kind: str, c: float) -> tuple[Solid, Solid]:
    """A housing and the part that leaves it along z, with a clearance of `c` m all around."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02, -0.015)
    if kind == "pocket":
        room = box(0.02 + 2 * c, 0.02 + 2 * c, 0.03).translated(-0.01 - c, -0.01 - c, 0.0)
        return block - room, box(0.02, 0.02, 0.02).translated(-0.01, -0.01, 0.0)
    if kind == "bore":
        return block - cylinder(0.008 + c, 0.04).translated(0.0, 0.0, -0.03), cylinder(0.008, 0.03).translated(z=-0.01)
    if kind == "dovetail":
        tail = [(-0.006, -0.008), (0.006, -0.008), (0.010, 0.0), (-0.010, 0.0)]
        groove = [
            (-0.006 - 2 * c, -0.008 - c),
            (0.006 + 2 * c, -0.008 - c),
            (0.012 + 2 * c, 0.004),
            (-0.012 - 2 * c, 0.004),
        ]
        half = box(0.04, 0.02, 0.02).translated(-0.02, -0.02, -0.015)
        return half - extrude(groove, 0.04).translated(0.0, 0.0, -0.03), extrude(tail, 0.02).translated(z=-0.01)
    comb, key = block, box(0.04, 0.04, 0.005).translated(-0.02, -0.02, 0.005 + c)
    for x in (-0.013, 0.0, 0.013):
        comb = comb - box(0.006 + 2 * c, 0.05, 0.02).translated(x - 0.003 - c, -0.025, -0.005)
        key = key + box(0.006, 0.04, 0.011).translated(x - 0.003, -0.02, -0.005 + c)
    return comb, key
