"""Mobility, lower pairs, redundancy and the assembly graph."""
