"""Bodies: mass, inertia, shapes for contact, and their state as arrays."""
