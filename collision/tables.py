"""Places in the tables of addresses that the kernels of the fast query are given, beside that of a `WideTree`."""

from __future__ import annotations

from typing import Final

# of scratch
POSE, MOTION_AT, MOVED, STAMP, TURNED, PREPARED, STAMP_A, STACK_AT, KEYS, PAIRS, COUNTS_AT, WORK = range(12)
"""addresses of its arrays, in the order of `query.Scratch.fit`"""
LAST: Final = 12
"""address of the triangles that met last, an entry a pair of surfaces; 0: nothing is remembered"""
FRONT: Final = 13
"""address of the table of a front while it is mended, else 0"""
SCRATCH: Final = 14
"""length of the table"""

# of the counts in scratch, after the first four of `Statistics`
QUESTION: Final = 4
"""where the questions are numbered"""
PREPARED_FOR: Final = 5
"""not 0: leaves of a stay prepared for good, since always the same mesh is a"""
COUNTS: Final = 6
"""their number"""

STACK: Final = 64 * 24
"""pairs of nodes on the stack: up to eight at each step down either tree"""
SPREAD: Final = 3
"""a prepared leaf takes up to three times what the leaf takes, and lies at three times its place"""

# of a front
PLANES, PIECES, FREE, FAILED, MET, SEEN, ROOM, BEFORE = range(8)
"""addresses: the planes; their pairs of surfaces and of nodes; places in the list that are free; those that failed;
pairs of surfaces that met; the question in which each pair of surfaces was found to meet; room for
`lanes.clearances`; the pose of the last question"""
CAPACITY, SIZE, N_FREE, N_MET, OVERFLOW, STATE, COOLING, REST = range(8, 16)
"""numbers: of certificates there is room for; places used; free ones among them; pairs that met; 1 if there was no
room; state, see `front`; questions until the next front is begun; how many after the next fails"""
FRONT_TABLE: Final = 16
"""length of the table"""
