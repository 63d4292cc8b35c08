"""Supports that move according to a sampled record of their displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..kernels.table import interval
from ..scene.effect import Motion


class Sampled(Motion):
    """A motion with a record: the fields times and values."""

    def __post_init__(self) -> None:
        super().__post_init__()
        times, values = self._reals("times"), self._reals("values")
        self.require(times.ndim == 1 and times.size >= 2, "times must hold at least two samples")
        self.require(values.shape == times.shape, f"values must have as many samples as times, {times.size}")
        self.require(np.diff(times) > 0, "times must increase from sample to sample")


@dataclass(frozen=True, eq=False)
class SampledMotion(Sampled):
    """Fixed points that move along a direction by a record of the displacement.

    Formula: the displacement is linear between the samples and constant before and after the record; the velocity is
    constant between samples.

    The velocity jumps at the samples: no method keeps an order above 1 across a jump where a damper is attached to the
    support. The work that ``work=True`` adds has the order 1 with every method. Tolerances do not control its error,
    which ``drift["energy"]`` shows: a smaller h or ``h_max`` reduces it. With tolerances, steps are at most half as
    long as the shortest bump, a part of the record that differs from its first value; a run whose fixed step skips much
    of the record has a note.

    Parameters
    ----------
    times : array_like, shape (samples,)
        Times of the samples, s; they must increase.
    values : array_like, shape (samples,)
        Displacements, m.
    direction : array_like, shape (dimension,)
        The vector that multiplies the displacement.

    Raises
    ------
    ValueError
        If there are fewer than two samples, the lengths differ, or times do not increase.

    Notes
    -----
    Other codes: OpenSees ``pattern MultipleSupport`` with ``groundMotion Plain -disp``.

    Not included: interpolation with a continuous velocity: for that take `SampledAcceleration` or `SupportMotion`.
    """

    times: ArrayLike
    values: ArrayLike
    direction: ArrayLike = (1.0,)

    vectors = ("direction",)
    arrays = ("times", "values")
    _record = arrays
    source = "linear interpolation"

    @staticmethod
    @element
    def motion(t, times, values):
        last = times.size - 1
        if t < times[0]:
            return values[0], 0.0
        if t >= times[last]:
            return values[last], 0.0
        i = interval(t, times)
        slope = (values[i + 1] - values[i]) / (times[i + 1] - times[i])
        return values[i] + slope * (t - times[i]), slope
