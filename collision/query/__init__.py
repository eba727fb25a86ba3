"""The queries about two meshes or two objects, a file for each: intersection, distance, penetration, time of impact, …

Each gives a task to the traversal of `bvh` and decides single pairs of triangles by `triangle`.
May use `bvh`, `triangle`, `numeric`; others reach it through `collision.manager`.
Start with `intersection`, the shortest, then `distance`, which the queries of depth and motion build on.
"""
