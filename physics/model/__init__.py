"""Bodies: mass, materials, contact shapes, their state as arrays, and free rotation."""
