"""Two triangles: whether they intersect, how far they are apart, how long they stay apart while they move.

All is kernels over (3, 3) corners, without objects or trees.
May use `numeric`.
Start with `intersection`; `filter` settles most pairs before it in float64 with an error bound.
"""
