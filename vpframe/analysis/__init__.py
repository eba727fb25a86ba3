"""Analysis of an assembly at its present poses: clashes, mates, clearance, swept volumes."""
