"""The nearest allowed motion among solid bodies, under constraints and contacts.

Each step linearises constraints and near surfaces and solves a small quadratic program.
May use `solve`, `kinds`, `geometry` and the queries of `collision`.
Start with `motion` (what a hand asks for), then `god_object` (one step of the method of Ortega et al. 2007).
"""
