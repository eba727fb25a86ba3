"""Joints between bodies: rows, friction, articulated motion."""
