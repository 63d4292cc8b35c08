"""The control of the step by the error of the last two steps, the PI controller of Gustafsson.

    h_{n+1} = 0.9 h_n error_n^(-0.7/k) error_{n-1}^(0.4/k)

k is the order of the estimate of the error plus 1. The logarithm and the power of 2 are approximate, to 1 %: this is
enough for a step, and the next step of a small system would have to wait for those of the C library.
"""

import numpy as np

from ..compile.jit import element

_ONE_BITS, _FRACTION_BITS = 1023 << 52, (1 << 52) - 1
_SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
_LEAST_SQUARE = 1e-20  # a smaller square of the error counts as this


@element
def log2(x):
    """Return the logarithm to the base 2 of a positive, normal number."""
    bits = np.float64(x).view(np.int64)
    m = np.int64((bits & _FRACTION_BITS) | _ONE_BITS).view(np.float64)
    return (bits >> 52) - 1023 + (m - 1) * (1.3465553856 - 0.3465553856 * (m - 1))


@element
def exp2(x):
    """Return 2^x, for -1000 < x < 1000."""
    whole = np.floor(x)
    s = x - whole
    return np.int64((np.int64(whole) + 1023) << 52).view(np.float64) * (1 + s * (0.6565 + 0.3435 * s))


@element
def exponent(square):
    """Return the logarithm of the error from its square."""
    return 0.5 * log2(max(square, _LEAST_SQUARE))


@element
def growth(now, before, order):
    """Return the factor of the step from the logarithms of the error of this step and of the step before."""
    return min(MOST, max(LEAST, _SAFETY * exp2((0.4 * before - 0.7 * now) / order)))


@element
def shrinkage(square, order):
    """Return the factor of a step whose error is beyond the tolerance."""
    return max(LEAST, _SAFETY * exp2(-exponent(square) / order)) if square < 1e300 else LEAST / 2  # also for NaN
