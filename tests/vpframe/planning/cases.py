"""Generated assemblies whose answers are known."""

from itertools import product

import numpy as np
import pinocchio as pin

from vpframe.scene.modelling import Solid, box, cylinder, extrude, hexagon, revolve, scene, sphere, torus


def order(plan):
    return [step.parts for step in plan.steps]


def at(x=0.0, y=0.0, z=0.0):
    """The pose at a point (m), unturned."""
    return pin.SE3(np.eye(3), np.array([x, y, z], np.float64))


def bolted_plate_solids():
    """A base, a plate on it, a bolt from above through both, an M8 nut below: nut, then bolt, then plate."""
    hole = cylinder(0.0045, 0.01).translated(0.03, 0.03)
    plate = box(0.06, 0.06, 0.01) - hole
    base = box(0.08, 0.06, 0.01) - hole
    bolt = cylinder(0.004, 0.03) + hexagon(0.013, 0.005).translated(z=0.03)
    nut = hexagon(0.013, 0.0065) - cylinder(0.0034, 0.0065)
    places = {"base": at(), "plate": at(z=0.01), "bolt": at(0.03, 0.03, -0.01), "nut": at(0.03, 0.03, -0.0065)}
    solids = {"base": base, "plate": plate, "bolt": bolt, "nut": nut}
    return {name: (solid, places[name]) for name, solid in solids.items()}


def bolted_plate():
    """The scene of `bolted_plate_solids`."""
    return scene(bolted_plate_solids())


def m16(engaged):
    """A fixed M16 stud and a nut that is engaged over a length (m) at its end."""
    stud = cylinder(0.008, 0.06) + cylinder(0.02, 0.01).translated(z=-0.01)
    nut = hexagon(0.024, 0.013) - cylinder(0.007, 0.013)
    out = scene({"stud": stud, "nut": (nut, at(z=0.06 - engaged))})
    out["stud"].fixed = True
    return out


def c_clip():
    """A clip on a flat bar between two flanges: it leaves through its mouth, 6 mm wide, past the bar's 4 mm side."""
    bar = box(0.01, 0.004, 0.03).translated(-0.005, -0.002)
    flange = cylinder(0.02, 0.005)
    frame = bar + flange.translated(z=0.03) + flange.translated(z=-0.005)
    clip = cylinder(0.01, 0.008) - cylinder(0.006, 0.008) - box(0.006, 0.02, 0.008).translated(-0.003)
    return scene({"frame": frame, "clip": (clip, at(z=0.011))})


def clip_angle():
    """rad: by how much the clip has to turn: 10 sin x + 4 cos x <= 6 mm, x between the bar's wide side and the way."""
    return 0.5 * np.pi - (np.arcsin(6.0 / np.hypot(10.0, 4.0)) - np.arctan2(4.0, 10.0))


def sector(inner, outer, low, high, start, stop):
    """A part of a tube: between radii and heights (m), from one angle to another (rad)."""
    profile = [(inner, low), (outer, low), (outer, high), (inner, high)]
    return revolve(profile, stop - start).rotated((0, 0, 1), start)


BAYONET = np.radians(75.0)
"""rad: by which the lug has to turn into its axial slot"""


def bayonet():
    """A plug with a lug in a slot round its socket: turned by 75° at least, then pulled."""
    d = np.radians
    socket = cylinder(0.015, 0.02) - cylinder(0.01, 0.02)
    socket = socket - sector(0.008, 0.013, 0.008, 0.02, d(-20.0), d(20.0))
    socket = socket - sector(0.008, 0.013, 0.008, 0.012, d(-20.0), d(100.0))
    plug = cylinder(0.0097, 0.018).translated(z=0.002) + cylinder(0.014, 0.005).translated(z=0.0203)
    plug = plug + cylinder(0.0097, 0.001).translated(z=0.0195)
    plug = plug + sector(0.008, 0.0127, 0.0083, 0.0117, d(65.0), d(95.0))
    return scene({"socket": socket, "plug": plug})


def l_hook():
    """A hook with a bar across its top and a foot that reaches under a plate, beside the slot that it goes through."""
    plate = box(0.06, 0.04, 0.002).translated(-0.03, -0.02) - box(0.012, 0.008, 0.002).translated(0.0, -0.004)
    hook = box(0.003, 0.006, 0.026).translated(0.001, -0.003, -0.006)
    hook = hook + box(0.015, 0.006, 0.003).translated(0.001, -0.003, -0.006)
    hook = hook + box(0.003, 0.02, 0.003).translated(0.001, -0.01, 0.02)
    return scene({"plate": plate, "hook": hook})


def latched_box():
    """A box, what is in it, a sliding lid in its grooves, and a latch before the lid: latch, lid, content."""
    shell = box(0.06, 0.04, 0.03) - box(0.05, 0.03, 0.03).translated(0.005, 0.005, 0.005)
    shell = (
        shell
        - box(0.055, 0.034, 0.004).translated(0.005, 0.003, 0.02)
        - box(0.005, 0.03, 0.01).translated(0.055, 0.005, 0.02)
    )
    shell = shell - box(0.002, 0.04, 0.01).translated(0.056, 0.0, 0.02)
    lid = box(0.0498, 0.0338, 0.0038).translated(0.0051, 0.0031, 0.0201)
    latch = box(0.0018, 0.04, 0.0098).translated(0.0561, 0.0, 0.0201)
    content = box(0.02, 0.02, 0.01).translated(0.02, 0.01, 0.005)
    return scene({"box": shell, "lid": lid, "latch": latch, "content": content})


def dovetail():
    """A tongue in a groove along y, touching all along."""
    tongue = [(-0.005, 0.0), (0.005, 0.0), (0.008, -0.006), (-0.008, -0.006)]
    upright = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.array([0.0, 0.04, 0.0]))
    key = extrude(tongue, 0.04).moved(upright)
    rail = box(0.03, 0.04, 0.012).translated(-0.015, 0.0, 0.0)
    body = box(0.03, 0.04, 0.012).translated(-0.015, 0.0, -0.012) - key
    return scene({"body": body, "slide": key + rail})


def headed_pin():
    """A pin with a head at both ends through two plates."""
    plate = box(0.04, 0.04, 0.005).translated(-0.02, -0.02) - cylinder(0.0052, 0.005)
    pin_ = (
        cylinder(0.005, 0.0102)
        + cylinder(0.009, 0.003).translated(z=-0.003)
        + cylinder(0.009, 0.003).translated(z=0.0102)
    )
    return scene({"lower": plate, "upper": (plate, at(z=0.005)), "pin": (pin_, at(z=-0.0001))})


def linked_rings():
    """Two rings of a chain, apart."""
    turned = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.array([0.02, 0.0, 0.0]))
    return scene({"one": torus(0.02, 0.003), "two": (torus(0.02, 0.003), turned)})


def ball_in_shell():
    """A ball in a hollow cube, touching nothing."""
    return scene(
        {
            "shell": box(0.04, 0.04, 0.04) - sphere(0.015).translated(0.02, 0.02, 0.02),
            "ball": (sphere(0.01), at(0.02, 0.02, 0.02)),
        }
    )


def box_in_pocket():
    """A block that fits its closed pocket on all sides, in a housing with a lid that is one piece with it."""
    housing = box(0.03, 0.03, 0.03) - box(0.01, 0.012, 0.014).translated(0.01, 0.009, 0.008)
    housing = housing - cylinder(0.002, 0.03).translated(0.015, 0.015)
    return scene({"housing": housing, "block": box(0.01, 0.012, 0.014).translated(0.01, 0.009, 0.008)})


def interlocked():
    """Two halves in a tray, a tongue of the one in a pocket of the other: up each holds the other back, sideways the
    tray does; both come out as one, and then apart."""
    wall = 0.0002
    tray = box(0.04, 0.04, 0.02).translated(-0.02, -0.02, -0.005)
    tray = tray - box(0.02 + 2 * wall, 0.02 + 2 * wall, 0.02).translated(-0.01 - wall, -0.01 - wall)
    one = box(0.02, 0.01, 0.01).translated(-0.01, -0.01) + box(0.006, 0.004, 0.004).translated(-0.003, 0.0, 0.003)
    two = box(0.02, 0.01, 0.01).translated(-0.01) - box(0.0062, 0.0042, 0.0042).translated(-0.0031, 0.0, 0.0029)
    return scene({"tray": tray, "one": one, "two": two})


def peg(clearance=1e-5):
    """A square peg in its hole with a clearance (m) on all sides."""
    c = clearance
    block = box(0.04, 0.04, 0.03) - box(0.01, 0.01, 0.03).translated(0.015, 0.015, 0.005)
    pin_ = box(0.01 - 2 * c, 0.01 - 2 * c, 0.03).translated(0.015 + c, 0.015 + c, 0.005 + c)
    return scene({"block": block, "peg": pin_})


def voxels(cells, unit=0.01):
    """The solid that unit cubes at whole numbers make together."""
    out: Solid | None = None
    for x, y, z in sorted(cells):
        cube = box(unit, unit, unit).translated(x * unit, y * unit, z * unit)
        out = cube if out is None else out + cube
    assert out is not None
    return out


def lattice_blocked(mine, theirs, direction):
    """Whether cells run into others on their straight way along a lattice direction until they are apart."""
    d = np.array(direction)
    others = {tuple(c) for c in theirs}
    far = 2 + max(abs(int(v)) for c in (*mine, *theirs) for v in c) * 2
    return any(tuple(np.array(c) + k * d) in others for c in mine for k in range(1, far))


LATTICE = [d for d in product((-1, 0, 1), repeat=3) if sum(map(abs, d)) == 1]
"""the six directions"""


BARS = {
    "front": {(x, y, z) for x in range(-3, 3) for y in (-2, -1) for z in (-1, 0)},
    "back": {(x, y, z) for x in range(-3, 3) for y in (0, 1) for z in (-1, 0)},
    "left": {(x, y, z) for x in (-2, -1) for y in (-1, 0) for z in range(-3, 3)},
    "right": {(x, y, z) for x in (0, 1) for y in (-1, 0) for z in range(-3, 3)},
    "lower": {(x, y, z) for x in (-1, 0) for y in range(-3, 3) for z in (-2, -1)},
    "upper": {(x, y, z) for x in (-1, 0) for y in range(-3, 3) for z in (0, 1)},
}
"""the six bars of a burr, 2 x 2 x 6, where they stand: what two of them share one has to give up"""


def burr(seed):
    """The cells of each piece of a six-piece burr: each cell that bars share goes to one of them, by chance."""
    random = np.random.default_rng(seed)
    owner = {}
    for cell in sorted(set().union(*BARS.values())):
        names = [name for name in BARS if cell in BARS[name]]
        owner[cell] = names[random.integers(len(names))]
    pieces = {name: {cell for cell in owner if owner[cell] == name} for name in BARS}
    return {name: _largest_piece(cells) for name, cells in pieces.items()}


def _largest_piece(cells):
    """The cells that hang together by faces, of those the most."""
    left, pieces = set(cells), []
    while left:
        piece, queue = set(), [left.pop()]
        while queue:
            cell = queue.pop()
            piece.add(cell)
            near = {tuple(np.array(cell) + d) for d in LATTICE} & left
            left -= near
            queue += sorted(near)
        pieces.append(piece)
    return max(pieces, key=lambda piece: (len(piece), sorted(piece)))


def lattice_peel(cells, base):
    """Names of the pieces that come out one at a time, straight along the lattice, by brute force; the base stays."""
    present = set(cells)
    while True:
        free = [
            name
            for name in sorted(present - {base})
            if any(
                not any(lattice_blocked(cells[name], cells[other], d) for other in present - {name}) for d in LATTICE
            )
        ]
        if not free:
            return set(cells) - present
        present -= set(free)


def seal_on_shaft():
    """A seal, 0.1 mm too narrow all round, on a shaft between two collars: only through the shaft it comes off."""
    collar = cylinder(0.008, 0.002)
    shaft = cylinder(0.004, 0.03) + collar + collar.translated(z=0.028)
    return {"shaft": shaft, "seal": (cylinder(0.007, 0.005) - cylinder(0.0039, 0.005), at(z=0.012))}


def clip_on_rail():
    """A square tube, 0.1 mm too narrow all round, on a bar between two heads."""
    head = box(0.016, 0.016, 0.002).translated(-0.008, -0.008)
    rail = box(0.008, 0.008, 0.03).translated(-0.004, -0.004) + head + head.translated(z=0.028)
    tube = box(0.014, 0.014, 0.005).translated(-0.007, -0.007) - box(0.0078, 0.0078, 0.005).translated(-0.0039, -0.0039)
    return {"rail": rail, "clip": (tube, at(z=0.012))}


def hose_in_bracket():
    """A hose with an end piece on either side of the bracket that it is squeezed into."""
    hose = cylinder(0.005, 0.06) + cylinder(0.008, 0.005) + cylinder(0.008, 0.005).translated(z=0.055)
    bracket = box(0.03, 0.03, 0.004).translated(-0.015, -0.015) - cylinder(0.0047, 0.004)
    return {"bracket": bracket, "hose": (hose, at(z=-0.03))}


CAPTIVE = [(seal_on_shaft, "seal", "shaft"), (clip_on_rail, "clip", "rail"), (hose_in_bracket, "hose", "bracket")]
