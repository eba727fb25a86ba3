"""A session: its state, its step, and what it tells."""
