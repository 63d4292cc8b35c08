"""What belongs to a function: the history and the constraints of a right-hand side, and what runs remember of it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..kernels.constraint_lanes import UnrolledConstraints


class HistoryVariables(NamedTuple):
    """The history variables of a run in p, and two compiled functions of (t, u, v, p) that update them.

    History variables, such as the tangential springs of grains, advance only at the end of accepted steps. Trial
    states, such as the stages of a method or a rejected step, do not change them.

    Attributes
    ----------
    begin : jitted function
        Initialises the history variables. It is called at the start of a run, before the right-hand side.
    advance : jitted function
        Advances the history variables to a state. It is called at the end of each step, and at events.
    places : tuple of slice
        The places of the history variables in p.
    """

    begin: Any
    advance: Any
    places: tuple[slice, ...]


class Constraints(NamedTuple):
    """Compiled functions that enforce the constraints of a right-hand side, whose accelerations include the reactions.

    Attributes
    ----------
    project : jitted function
        A function of (t, u, v, p) that projects u and v onto the constraints, and returns a number.
    constrained_step : jitted function
        A step of EIG-3 by accelerations without reactions: see `eig3.kernels.constraints.hold`.
    place : int
        The place of their table in p.
    unrolled : UnrolledConstraints or None
        The constraints for the lanes of an ensemble; None if there are many.
    """

    project: Any
    constrained_step: Any
    place: int
    unrolled: UnrolledConstraints | None = None


class Cutoffs(NamedTuple):
    """The cutoffs of the forces, and the distances of the impacts, between points in p.

    `degrees` is the number of coordinates of points, which are the first degrees of freedom. `places` are the begin and
    the end of values in p, and the factor from the least of them to a distance. `acting` are the coordinates of the
    points on which these forces and impacts act.
    """

    degrees: int
    places: tuple[tuple[int, int, float], ...]
    acting: np.ndarray

    def least(self, params: np.ndarray) -> float:
        """Return the shortest cutoff, of one or more rows of parameters; at 0, points never touch."""
        each = ((factor, params[..., begin:end]) for begin, end, factor in self.places)
        return min(factor * float(values.min(where=values > 0, initial=math.inf)) for factor, values in each)

    def speeds(self, *v: np.ndarray) -> np.ndarray:
        """Return the largest speed of these points along an axis, of each member: v has the shape (m, n) or (n,)."""
        return np.max([np.abs(np.atleast_2d(each)[:, self.acting]).max(axis=1, initial=0.0) for each in v], axis=0)


class Angles(NamedTuple):
    """The angles of a right-hand side from -pi to pi, at whose ends a torque may jump.

    Attributes
    ----------
    degrees : ndarray of int
        The degrees of freedom of unit vectors, which change if a body turns.
    names : tuple of str
        The name of the law of each angle.
    function : jitted function
        A function of (t, u, v, p, a) that writes each angle into a: 0 if the torque does not jump.
    """

    degrees: np.ndarray
    names: tuple[str, ...]
    function: Any


def remembered(function: Any, name: str) -> dict[Any, Any]:
    """Return the dictionary in which runs remember something of a function, under a name.

    The function holds it: both are freed together. An object that is no function gets a dictionary that is not kept.
    """
    own = getattr(function, "__dict__", None)
    return own.setdefault(f"_eig3_{name}", {}) if isinstance(own, dict) else {}


def mark(rhs: Any, name: str) -> Any:
    """Return an attribute of the Python function that others bind to named parameters or unknowns, or None."""
    function: Any = getattr(rhs, "py_func", None)
    while hasattr(function, "inner"):
        function = function.inner.py_func
    return getattr(function, name, None)


def constraints_of(rhs: Any) -> Constraints | None:
    """Return the constraints of a right-hand side, or None. They are pickled with the Python function."""
    return getattr(getattr(rhs, "py_func", None), "constraints", None)


def history_of(rhs: Any) -> HistoryVariables | None:
    """Return the history of a right-hand side, or None. It is pickled with the Python function."""
    return getattr(getattr(rhs, "py_func", None), "history", None)
