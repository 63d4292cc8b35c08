"""Random numbers that depend on nothing but counts: for forces that are noise, and for methods that add noise.

A generator with a state gives other numbers if a step is rejected or members run in another order. Philox computes each
number from its place in the sequence: Salmon and others, Parallel random numbers: as easy as 1, 2, 3 (SC11, 2011).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .compile.jit import element
from .elementary import log, sincos, sqrt

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
def block(key_0: Any, key_1: Any, count: Any, place: Any, kind: Any) -> Any:
    """Return the first two numbers, of 64 bits, that NumPy's Philox gives for a key from a counter on.

    The counter is [count, place, kind, 0].
    """
    x_0, x_1, x_2, x_3 = count + _ONE, place, kind, _ZERO
    for _ in range(_ROUNDS):
        x_0, x_1, x_2, x_3 = (
            _high(_M_1, x_2) ^ x_1 ^ key_0,
            _M_1 * x_2,
            _high(_M_0, x_0) ^ x_3 ^ key_1,
            _M_0 * x_0,
        )
        key_0, key_1 = key_0 + _W_0, key_1 + _W_1
    return x_0, x_1


@element
def normal(key_0: Any, key_1: Any, count: Any, place: Any, kind: Any) -> Any:
    """Return a normal random number, of mean 0 and variance 1, from a `block`, as Box and Muller (1958) do."""
    first, second = block(key_0, key_1, count, place, kind)
    radius = sqrt(-2.0 * log((float(first >> _11) + 1.0) * _ULP))
    _, cosine = sincos(float(second >> _11) * (_ULP * _TWO_PI))
    return radius * cosine
