"""The arguments of a run with tolerances: their checks, and the choice of a method."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count, check_h, check_method, reals, shown
from ..functions.companions import Cutoffs
from ..methods import METHODS, RK5, RK8, RKN12, Method

LEAST_RTOL = 100 * float(np.finfo(np.float64).eps)  # below it, round-off controls the steps
_OF_CUTOFF = 1 / 8  # the longest way of a point in a step: two points approach by a quarter of their cutoff
NO_POINTS = 0, math.inf  # what `longest_way` returns without points that have a cutoff
_RK8_FROM = 1e-4  # RK8 takes less time than RK5 if rtol is smaller than this
_RK5, _RK8, _RKN12 = RK5(), RK8(), RKN12()
_RKN12_FROM = 1e-6  # up to this error, RKN12 takes less time than RK8; for the same rtol it may take more


class Tolerances(NamedTuple):
    """The tolerances and limits that determine the steps of a run.

    Attributes
    ----------
    rtol : float
        The tolerance relative to the size of u and of v.
    atol : ndarray, shape (2, n)
        The absolute tolerances of u and of v. Before `of`, they have the shape given by the user.
    is_relative : bool
        Whether `rtol` is relative to the largest value so far of each degree of freedom, and not to the current value.
    h_first : float
        The first step; 0.0 for an automatic first step.
    h_max : float
        The longest step.
    max_steps : int
        The largest number of steps.
    is_bounded : bool
        Whether the user has given `h_max`: then points may move further in a step than `longest_way`.
    """

    rtol: float
    atol: np.ndarray
    is_relative: bool
    h_first: float
    h_max: float
    max_steps: int
    is_bounded: bool = False

    def of(self, n: int, n_first_order: int = 0, *, are_read: bool = False) -> Tolerances:
        """Return the tolerances of a run with n degrees of freedom and some first-order unknowns after them.

        If rhs reads these unknowns, `atol` has their tolerances last. Otherwise they do not control the steps. The
        integrals of unknowns never do.
        """
        if self.is_relative and not n_first_order:
            return self._replace(atol=np.zeros((2, n)))
        atol = np.full((2, n + n_first_order), np.inf)
        n_own = n + n_first_order * are_read
        atol[:, :n_own] = _absolute(self.atol, n_own)
        atol[0, n:] = np.inf
        return self._replace(atol=atol)


def check_tolerances(
    rtol: float | None, atol: ArrayLike | None, h_max: float | None, first_step: float | None, max_steps: int | None
) -> Tolerances:
    """Check the arguments of a run with tolerances."""
    if rtol is None:
        raise ValueError("atol needs rtol too: the relative tolerance, such as 1e-6.")
    relative = rtol if type(rtol) is float else reals(rtol, "rtol")
    if np.ndim(relative) or not LEAST_RTOL <= relative < 1:
        raise ValueError(
            f"rtol must be a number from {LEAST_RTOL:.3g}, below which round-off decides, to 1, not {shown(rtol)}."
        )
    return Tolerances(
        float(relative),
        np.zeros(()) if atol is None else reals(atol, "atol"),
        atol is None,
        0.0 if first_step is None else check_h(first_step, "first_step"),
        math.inf if h_max is None else check_h(h_max, "h_max"),
        2**62 if max_steps is None else check_count(max_steps, "max_steps"),
        h_max is not None,
    )


def longest_way(cutoffs: Cutoffs | None, tolerances: Tolerances, params: np.ndarray) -> tuple[int, float]:
    """Return the number of coordinates of points, and the longest way along one of them in a step.

    Two points that act on each other within a cutoff would otherwise pass through each other in one step, while nothing
    bends their paths. Without such points, or with `h_max`, these are 0 and infinity.
    """
    least = math.inf if cutoffs is None or tolerances.is_bounded else cutoffs.least(params)
    return (cutoffs.degrees, _OF_CUTOFF * least) if cutoffs and least < math.inf else NO_POINTS


def _absolute(atol: np.ndarray, n: int) -> np.ndarray:
    """Return the absolute tolerances of u and v, an array of shape (2, n)."""
    if not (np.isfinite(atol).all() and (atol >= 0).all()):
        raise ValueError(f"atol must be finite and not negative, not {shown(atol)}.")
    try:
        return np.broadcast_to(atol, (2, n))
    except ValueError:
        each = f"{n} numbers for the degrees of freedom and the first-order unknowns, " if n > 1 else ""
        raise ValueError(
            f"atol must be a number, {each}or an array of shape (2, {n}) with a row for u and a row for v, not of the "
            f"shape {atol.shape}."
        ) from None


def usual_method(rtol: float, reads_velocity: bool) -> Method:
    """Return the default method for a tolerance, and for a right-hand side that reads the velocity or not."""
    if rtol <= _RKN12_FROM and not reads_velocity:
        return _RKN12
    return _RK8 if rtol < _RK8_FROM else _RK5


def check_variable(method: str | Method) -> Method:
    """Return a method with steps of variable length."""
    record = check_method(method, has_tolerances=True)
    if record.variable:
        return record
    if record.name == "eig3":
        raise ValueError("method must be EIG3() with tolerances: alpha and beta depend on the steps.")
    known = ", ".join(repr(name) for name, other in METHODS.items() if getattr(other(), "variable", ""))
    raise ValueError(f"method must be one of {known} with tolerances, not {record!r}; the others need h.")
