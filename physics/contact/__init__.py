"""Contact points, contact sets and the contact problem."""
