"""Behaviours of objects, and the forces that they exert."""
