"""The system of constraint equations and its solution."""
