"""The bounding volume hierarchy of a mesh: its layout, its construction, and the traversal of two of them.

It finds the triangles that may answer a query; each query of `query` is a task given to the traversal.
May use `numeric`; knows no objects, poses of a scene or results.
Start with `layout` (nodes of eight boxes, packets of eight triangles), then `traverse`; `build` is independent of both.
"""
