"""Random numbers that depend on nothing but a seed, a member and a count: for forces that are noise.

A generator with a state gives other numbers if a step is rejected or members run in another order. Philox computes each
number from its place in the sequence: Salmon and others, Parallel random numbers: as easy as 1, 2, 3 (SC11, 2011).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .kernels.compile.jit import element
from .math import _function, log, sincos, sqrt

_ROUNDS = 10
_M_0, _M_1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_W_0, _W_1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_32, _LOW = np.uint64(32), np.uint64(0xFFFFFFFF)
_11, _ONE, _ZERO = np.uint64(11), np.uint64(1), np.uint64(0)
_TWO_PI, _ULP = 2 * np.pi, 2.0**-53


@element
def _high(a: Any, b: Any) -> Any:
    """Return the upper 64 bits of a product of 128 bits."""
    a_0, a_1, b_0, b_1 = a & _LOW, a >> _32, b & _LOW, b >> _32
    middle = a_1 * b_0 + ((a_0 * b_0) >> _32)
    return a_1 * b_1 + (middle >> _32) + ((a_0 * b_1 + (middle & _LOW)) >> _32)


@element
def block(key_0: Any, key_1: Any, count: Any) -> Any:
    """Return the first two numbers, of 64 bits, that NumPy's Philox gives for a key from a count on."""
    x_0, x_1, x_2, x_3 = count + _ONE, _ZERO, _ZERO, _ZERO
    for _ in range(_ROUNDS):
        x_0, x_1, x_2, x_3 = (
            _high(_M_1, x_2) ^ x_1 ^ key_0,
            _M_1 * x_2,
            _high(_M_0, x_0) ^ x_3 ^ key_1,
            _M_0 * x_0,
        )
        key_0, key_1 = key_0 + _W_0, key_1 + _W_1
    return x_0, x_1


@_function
def noise(seed: int, member: int, k: int) -> float:
    """Return a normal random number, of mean 0 and variance 1, that depends on nothing but its three arguments.

    In a right-hand side, ``amplitude * eig3.noise(seed, p.member, int(t / dt))`` is white noise that is constant over
    times of dt. Its spectral density is S, in (m/s^2)^2 s for angular frequencies of both signs, if the amplitude is
    sqrt(2 pi S / dt). The noise jumps at these times: at a given dt, the errors of all methods fall with the step h to
    the first power.

    Parameters
    ----------
    seed, member, k : int
        Whole numbers of at least 0, which may be floats up to 2^53.

    Returns
    -------
    float

    Notes
    -----
    The bits are those of ``np.random.Philox(key=[seed, member], counter=[k, 0, 0, 0])``, and the number is that of Box
    and Muller (1958).
    """
    first, second = block(np.uint64(seed), np.uint64(member), np.uint64(k))
    radius = sqrt(-2.0 * log((float(first >> _11) + 1.0) * _ULP))
    _, cosine = sincos(float(second >> _11) * (_ULP * _TWO_PI))
    return radius * cosine
