"""Kernels and inner kernels: their signatures, and what they may return."""

import numpy as np
import pytest

from collision.numeric.kernel import inner_kernel, kernel


def test_integers_of_all_kinds_share_one_kernel() -> None:
    @kernel
    def inner(n, m):
        return n + m

    @kernel
    def outer(n):
        return inner(n, 1) + inner(2, n)

    assert outer(3) == 9 and outer(np.int32(4)) == 11
    assert inner(np.int32(1), np.int16(2)) == 3
    assert len(inner.signatures) == len(outer.signatures) == 1


def test_an_inner_kernel_is_not_called_from_python() -> None:
    @inner_kernel
    def half(x):
        return 0.5 * x

    @kernel
    def quarter(x):
        return half(half(x))

    assert quarter(8.0) == 2.0
    with pytest.raises(TypeError, match="half is an inner kernel: only kernels can call it"):
        half(8.0)


def test_an_uncounted_array_is_not_passed_on() -> None:
    @kernel
    def given(a):
        return a

    @inner_kernel(allocates=True)
    def copied(a):
        return a.copy()

    @kernel
    def first(a):
        return copied(a)[0]

    @kernel
    def zeros(n):
        return np.zeros(n).sum()

    @kernel
    def doubled(a):
        return (a + a).sum()

    with pytest.raises(TypeError, match="zeros makes an array: declare it with allocates=True"):
        zeros(2)
    with pytest.raises(TypeError, match="doubled makes an array: declare it with allocates=True"):
        doubled(np.zeros(2))
    with pytest.raises(TypeError, match="given returns an array: declare it with allocates=True"):
        given(np.zeros(2))
    with pytest.raises(TypeError, match="first calls a kernel that returns an array"):
        first(np.zeros(2))
