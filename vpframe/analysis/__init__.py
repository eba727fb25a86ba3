"""What an assembly is as it stands: clashes, mates, clearance, swept volumes."""
