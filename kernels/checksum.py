"""A checksum of numbers that takes as long as to read them from a cache: zlib.crc32 takes 20 times as long."""

import functools
from typing import Any

import numpy as np
from numba.types import Array, uint64

from .compile.jit import compile_kernel


def weighted(bits, first, before):
    """Return before + the sum over i of m(x_i) (2 (first + i) + 1) modulo 2^64, where m(x) = x xor x / 2^32.

    A weight is odd, so that each change of one number changes the sum; weights differ, so that each exchange does.
    Without m, the sum would have few bits of round numbers, whose last bits are zero.
    """
    total, weight = before, uint64(2) * first + uint64(1)
    for x in bits:
        total += (x ^ (x >> uint64(32))) * weight
        weight += uint64(2)
    return total


@functools.cache
def _kernel() -> Any:
    return compile_kernel(weighted, {}, uint64(Array(uint64, 1, "C"), uint64, uint64), "checksum")


def checksum(values: np.ndarray, first: int = 0, before: int = 0) -> int:
    """Return the checksum of an array of float64, as a whole number below 2^64.

    With the number `first` of the values before these ones, and their checksum `before`, it is the checksum of all.
    """
    return int(_kernel()(values.reshape(-1).view(np.uint64), first, before))
