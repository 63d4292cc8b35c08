"""Estimate the error and the order of a run from two more runs with shorter steps, by Richardson extrapolation.

If the error of u is e for the steps of the run, e / q for steps shorter by a ratio r, and e / q^2 for r^2, then the
order is log q / log r. The first run differs by e (1 - 1/q) from the second, and by e (1 - 1/q^2) from the third.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_LEAST = math.sqrt(2)  # q for the order 1/2; a smaller q counts as no convergence
_ROUND_OFF = 1e-12  # smaller differences, relative to the motion, may be round-off
_BELOW = 0.6  # least difference between the order of the method and an observed order that is reported as lower


@dataclass(frozen=True)
class Refinement:
    """The comparison of a run with two runs with shorter steps.

    Attributes
    ----------
    t : ndarray, shape (m,)
        The times of the comparison.
    error : ndarray, shape (m,) or (m, n)
        The estimated error of u in the first run.
    size : float
        The largest |u|.
    factor : float
        The factor by which the differences of the runs decrease when the steps, or the tolerances, decrease by `ratio`.
    ratio : float
    is_round_off : bool
        Whether the differences are so small that round-off may dominate them.
    """

    t: np.ndarray
    error: np.ndarray
    size: float
    factor: float
    ratio: float
    is_round_off: bool

    @classmethod
    def of(cls, t: np.ndarray, u: np.ndarray, fine: np.ndarray, finest: np.ndarray, ratio: float) -> Refinement:
        """Compare u of three runs, whose steps or tolerances are shorter by a ratio each time."""
        size, first, second = float(np.abs(u).max()), u - fine, fine - finest
        least = float(np.linalg.norm(second))
        factor = float(np.linalg.norm(first)) / least if least else math.inf
        error = (u - finest) / (1 - max(_LEAST, factor) ** -2)
        return cls(t, error, size, factor, ratio, bool(np.abs(first).max() < _ROUND_OFF * size))

    @property
    def order(self) -> float:
        """The observed order, if `ratio` is the ratio of the steps."""
        return math.log(self.factor) / math.log(self.ratio) if self.factor > 0 else -math.inf

    @property
    def largest(self) -> str:
        """The largest error in words."""
        errors = np.abs(self.error).reshape(len(self.t), -1).max(axis=1)
        i = int(np.argmax(errors))
        part = f" ({100 * errors[i] / self.size:.2g} % of the largest |u|)" if self.size else ""
        return f"the error of u is about {errors[i]:.2g}, at t = {self.t[i]:.4g}{part}"

    def of_steps(self, label: str, order: int, h: float) -> str:
        """Describe a run with the fixed step h by a method of an order."""
        begin = f"By runs with h = {h / 2:g} and {h / 4:g}, {self.largest}"
        if self.is_round_off:
            return f"{begin}, which may be round-off."
        text = f"{begin}; they show the order {self.order:.1f}, and {label} has the order {order}."
        if self.order >= order - _BELOW:
            return text
        return (
            f"{text} The order is lower if rhs has kinks or jumps, as from contacts, friction, impacts and records "
            "with corners, if h is still long for the motion, or if round-off is near: shorter steps then gain less."
        )

    def of_tolerances(self, rtol: float) -> str:
        """Describe a run with tolerances."""
        begin = f"By runs with tolerances {self.ratio:g} and {self.ratio**2:g} times smaller, {self.largest}"
        if self.is_round_off:
            return f"{begin}, which may be round-off."
        divided = f"a tolerance {self.ratio:g} times smaller divides it by {self.factor:.2g}"
        text = f"{begin}, with rtol = {rtol:g}; {divided}."
        if self.factor > _LEAST:
            return text
        return f"{text} The motion may be chaotic or have many kinks, or round-off is near: the estimate is rough."
