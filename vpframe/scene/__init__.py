"""The model: a scene of parts with their shapes and surfaces, their names, units, boxes and motions.

The lowest folder of vpframe: values, and functions of them.
May use `constraints.geometry` and `collision` for surfaces and meshes.
Start with `scene`; `modelling` builds B-rep parts for demo, examples and tests.
"""
