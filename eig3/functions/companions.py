"""What belongs to a right-hand side besides its accelerations: a history, and constraints."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..kernels.constraint_lanes import Straight


class History(NamedTuple):
    """Two compiled functions of (t, u, v, p), which return a number and change what a run remembers, in its p.

    A trial state, such as a stage of a method or the end of a step that is rejected, changes nothing.

    Attributes
    ----------
    begin : jitted function
        It forgets all. It is called at the start of a run, before the right-hand side.
    advance : jitted function
        It goes on to a state. It is called at the end of each step, and at events.
    """

    begin: Any
    advance: Any


class Constraints(NamedTuple):
    """Compiled functions that keep the constraints of a right-hand side, whose accelerations know them.

    Attributes
    ----------
    project : jitted function
        A function of (t, u, v, p), which returns a number and moves u and v to the nearest state that keeps them.
    leap : jitted function
        A step of EIG-3 by accelerations that do not know them: see `eig3.kernels.constraints.hold`.
    place : int
        The place of their table in p.
    straight : Straight or None
        What keeps them in the lanes of an ensemble; None if there are many.
    """

    project: Any
    leap: Any
    place: int
    straight: Straight | None = None


def constraints_of(rhs: Any) -> Constraints | None:
    """Return the constraints of a right-hand side, or None. They travel as its history does."""
    return getattr(getattr(rhs, "py_func", None), "constraints", None)


def history_of(rhs: Any) -> History | None:
    """Return the history of a right-hand side, or None. It travels with the Python function to other processes."""
    return getattr(getattr(rhs, "py_func", None), "history", None)
