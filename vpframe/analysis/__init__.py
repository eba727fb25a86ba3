"""Analysis of an assembly at its present poses: clashes, mates, clearance, swept volumes.

Functions from a `Scene` to rows and documents; nothing moves, and no session is needed.
May use `scene` and the three packages below.
Start with `clash` and `mates`, the commands of these names; `static` is the collision world and the recogniser that
they share.
"""
