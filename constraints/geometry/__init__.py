"""Analytic surfaces of parts, the features they form, and how two of them lie to each other.

Values without state: planes, cylinders, cones, spheres, tori, threads, and measures of pairs (overlap, gap, fit).
May use `collision` for meshes and tolerances; names types of `recognition`.
Start with `surfaces`, then `features`.
"""
