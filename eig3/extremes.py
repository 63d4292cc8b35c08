"""The extremes of an invariant or an output over a run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Extremes(NamedTuple):
    """The extremes of an invariant or an output over every step, saved or not, and when they occurred.

    Attributes
    ----------
    low, high : float or ndarray
        The minimum and the maximum. For an output with k values they have the shape (k,), and for the m members of an
        ensemble (m,) or (m, k). Both are NaN if the function gave NaN in any step.
    t_low, t_high : float or ndarray
        The times of the steps at which they first occurred; the time of the first NaN if they are NaN.
    """

    low: Any
    high: Any
    t_low: Any
    t_high: Any

    def of_member(self, i: int) -> Extremes:
        """Return the extremes of one member of an ensemble."""
        return Extremes(*(x[i].item() if np.ndim(x) == 1 else x[i] for x in self))
