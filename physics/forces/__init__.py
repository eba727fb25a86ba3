"""Behaviours of objects, and the forces that they and hands exert.

May use `model` and `contact`, for what a behaviour sees of its body and contacts.
Start with `behaviours`: each is a small class that users can write too (docs/physics.md); `wrenches` sums them.
"""
