"""Supports that move according to a sampled record of their acceleration."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..kernels.table import interval
from .sampled_motion import Sampled


@dataclass(frozen=True, eq=False)
class SampledAcceleration(Sampled):
    """Fixed points that move along a direction by a record of the acceleration, such as an accelerogram.

    Formula: the acceleration is linear between the samples; velocity and displacement are its exact integrals, a
    quadratic and a cubic polynomial between samples. The points rest before the record and keep the last velocity after
    it.

    Parameters
    ----------
    times : array_like, shape (samples,)
        Times of the samples, s; they must increase.
    values : array_like, shape (samples,)
        Accelerations, m/s^2.
    direction : array_like, shape (dimension,)
        The vector that multiplies the acceleration.

    Raises
    ------
    ValueError
        If there are fewer than two samples, the lengths differ, or times do not increase.

    Notes
    -----
    Other codes: OpenSees ``pattern MultipleSupport`` with ``groundMotion Plain -accel``: displacements are absolute.
    ``pattern UniformExcitation`` has relative displacements, as `eig3.linear` with ``ground=``.

    Not included: baseline correction: a record whose acceleration does not integrate to 0 ends in a drift.
    """

    times: ArrayLike
    values: ArrayLike
    direction: ArrayLike = (1.0,)
    velocities: np.ndarray = field(init=False, repr=False)  # at the samples, m/s
    displacements: np.ndarray = field(init=False, repr=False)  # at the samples, m

    vectors = ("direction",)
    arrays = ("times", "values", "velocities", "displacements")
    source = "linear interpolation of the acceleration"

    def __post_init__(self) -> None:
        super().__post_init__()
        times, a = self._reals("times"), self._reals("values")
        length = np.diff(times)
        v = np.append(0.0, np.cumsum(length * (a[:-1] + a[1:]) / 2))
        x = np.append(0.0, np.cumsum(length * (v[:-1] + length * (2 * a[:-1] + a[1:]) / 6)))
        object.__setattr__(self, "velocities", v)  # because the dataclass is frozen
        object.__setattr__(self, "displacements", x)

    @staticmethod
    @element
    def motion(t, times, values, velocities, displacements):
        last = times.size - 1
        if t < times[0]:
            return 0.0, 0.0
        if t >= times[last]:
            return displacements[last] + velocities[last] * (t - times[last]), velocities[last]
        i = interval(t, times)
        s = t - times[i]
        slope = (values[i + 1] - values[i]) / (times[i + 1] - times[i])
        v = velocities[i] + s * (values[i] + s * slope / 2)
        return displacements[i] + s * (velocities[i] + s * (values[i] / 2 + s * slope / 6)), v
