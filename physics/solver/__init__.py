"""Islands of bodies, and the solvers of their velocities under joints and contacts.

May use `model`, and the rows of `joints` and `contact`.
Start with `newton` (small islands, exact cone), then `sweeps` (large islands); `block_elimination` is their linear
algebra, `islands` and `batch` group the bodies.
"""
