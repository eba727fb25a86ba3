"""A session: its state, its step, its events and observers."""
