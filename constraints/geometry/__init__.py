"""Analytic surfaces of parts, their features and how they overlap."""
