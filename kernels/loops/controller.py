"""The control of the step by the error of the last two steps, after Gustafsson: the smaller step of two controllers.

    PI:          h_{n+1} / h_n = 0.9 error_n^(-0.7/k) error_{n-1}^(0.4/k)
    predictive:  h_{n+1} / h_n = 0.9 (h_n / h_{n-1}) (error_{n-1} / error_n^2)^(1/k)

k is the order of the estimate of the error plus 1. The first keeps the steps of a vibration even. The second assumes
that error / h^k continues to grow as in the last step: few steps before a close passage are then rejected. Where the
error falls, steps as long as the second allows would often be rejected.

K. Gustafsson, Control-theoretic techniques for stepsize selection in implicit Runge-Kutta methods, ACM Transactions on
Mathematical Software 20 (1994), 496-517.

The logarithm and the power of 2 are approximate, to 1 %: this is
enough for a step, and the next step of a small system would have to wait for the functions of the C library.
"""

import numpy as np

from ..compile.jit import element

_ONE_BITS, _FRACTION_BITS = 1023 << 52, (1 << 52) - 1
_SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
_LEAST_SQUARE = 1e-20  # a smaller square of the error counts as this
LEAST_ERROR = -13.0  # the logarithm of the last error counts as at least this in the next step


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
def next_step(step, before, now, last, was_rejected, h_max, order):
    """Return the next step, from the logarithms `now` and `last` of the errors of the last step and the step before.

    The predictive controller needs errors above round-off. An estimate of order 3, as for EIG-3, is zero wherever the
    force has an extreme: two of them show no trend. After a rejected step, the next one is not longer.
    """
    power = 0.4 * last - 0.7 * now
    if order > 3 and now > LEAST_ERROR:
        power = min(power, order * log2(step / before) + last - 2 * now)
    grown = min(MOST, max(LEAST, _SAFETY * exp2(power / order)))
    return min(step * (min(grown, 1.0) if was_rejected else grown), h_max)


@element
def shrinkage(square, order):
    """Return the factor of a step whose error is beyond the tolerance."""
    return max(LEAST, _SAFETY * exp2(-exponent(square) / order)) if square < 1e300 else LEAST / 2  # also for NaN
