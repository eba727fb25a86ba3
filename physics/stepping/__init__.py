"""Time stepping: free flight, forces, impacts at their time of impact, kinematic bodies, sleep.

The highest folder of the package, below `world`: it may use all others.
Start with `step`.
"""
