"""Bodies: mass, materials, contact shapes, their state as arrays, and free rotation.

The lowest folder of the package: values and arrays without contacts, forces or time steps.
May use `collision` (meshes) and `constraints.geometry`.
Start with `body` and `bodies`.
"""
