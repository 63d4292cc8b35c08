"""The extremes of an invariant or an output over a run."""

from typing import Any, NamedTuple

import numpy as np


class Extremes(NamedTuple):
    """The extremes of an invariant or an output over a run, independent of the saved states, and their times.

    With a fixed step, and in an ensemble, the extremes are taken over the ends of all steps and the states before and
    after events. Between these, the peak A of a sine of angular frequency omega is higher by up to A (omega h)^2 / 8.

    With tolerances, the extremes are found within the steps too: for a smooth value, their error has the size of the
    error of the run. Where the value has a kink, such as abs(u) at u = 0, the extreme is taken over samples: the start,
    the end and some points of the step, whose number depends on the order of the method.

    Attributes
    ----------
    low, high : float or ndarray
        The minimum and the maximum. For an output with k values they have the shape (k,), and for the m members of an
        ensemble (m,) or (m, k). Both are NaN if the function gave NaN.
    t_low, t_high : float or ndarray
        The times at which they first occurred; the time of the first NaN if they are NaN.
    """

    low: Any
    high: Any
    t_low: Any
    t_high: Any

    @property
    def peak(self) -> Any:
        """The maximum of the size, max(-low, high)."""
        return np.maximum(-np.asarray(self.low), self.high)
