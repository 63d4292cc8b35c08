"""Linear interpolation in tables, such as records of earthquakes and measured roads."""

from __future__ import annotations

import math

from .compile.jit import element
from .elementary import inlined, number


@element
def interval(t, times):
    """Return the i with times[i] <= t < times[i + 1]; for evenly spaced samples the first guess is right."""
    last = times.size - 1
    i = int((t - times[0]) / (times[last] - times[0]) * last)
    i = min(max(i, 0), last - 1)
    low = i if times[i] <= t else 0
    high = i + 1 if t < times[i + 1] else last
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@inlined
def interp(x, xp, fp):
    """Interpolate linearly in a table, as ``numpy.interp``, which takes up to fifty times as long for one number.

    Parameters
    ----------
    x : float
    xp, fp : ndarray, shape (samples,)
        The table, with at least two samples; xp must increase. If its samples are evenly spaced, the time does not
        depend on their number.

    Returns
    -------
    float
        The first or last value of fp beyond the ends of the table; NaN for NaN, and if the lengths of xp and fp differ.
    """
    x = number(x)
    if xp.size != fp.size:  # fp[i] would be another parameter; an exception would prevent vector instructions
        return math.nan
    i, last = interval(x, xp), xp.size - 1
    y = fp[i] + (x - xp[i]) / (xp[i + 1] - xp[i]) * (fp[i + 1] - fp[i])
    return fp[0] if x < xp[0] else (fp[last] if x >= xp[last] else y)
