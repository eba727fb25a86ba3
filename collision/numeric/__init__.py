"""Numerics: vectors, rigid transforms, exact predicates, SIMD, and the compilation of kernels."""
