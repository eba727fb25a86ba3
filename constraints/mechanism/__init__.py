"""A recognised mechanism as links and joints: as a Pinocchio model, as URDF, as MJCF.

May use `freedom` (which joint a pair of parts has), `kinds` and `solve`; knows no meshes but their file names.
Start with `model`: `Mechanism` has the tree and the loops that `urdf` and `mjcf` write.
"""
