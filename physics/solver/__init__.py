"""Islands and the solvers of their velocities."""
