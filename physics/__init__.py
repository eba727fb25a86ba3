"""What is free moves: mass, forces, impulses, per-object behaviours, time stepping."""
