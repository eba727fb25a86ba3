"""The bounding volume hierarchy of a mesh: its layout, how it is built, and the traversal of two of them."""
