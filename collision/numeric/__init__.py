"""Numerics: vectors, rigid transforms, exact predicates, SIMD, and the compilation of kernels.

The lowest folder of all: it knows numbers and arrays only, and every package may import it.
May use numpy and numba.
Start with `kernel` (how compiled functions are declared) and `vectors`; `predicates` holds all exact decisions.
"""
