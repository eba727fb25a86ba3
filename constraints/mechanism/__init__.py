"""A recognised mechanism as a Pinocchio model and as URDF."""
