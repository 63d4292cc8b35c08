"""The kinds of motions, and the few methods of which one is the fastest or nearly the fastest for each kind.

Each method that runs is compiled first, which takes about a second. So a plan tries only these methods. They were
chosen from the plans of 28 ready problems, for accuracies from 1e-2 to 1e-8, in which all methods took part.
"""

from __future__ import annotations

from typing import NamedTuple

from ..functions.companions import constraints_of
from .step_search import SCOUT, Search

_FEW = 200  # with fewer steps of the guide, the cost of a step decides, more than the order
_UNEVEN = 1.75  # if steps of equal length take this multiple of the steps of equal error, tolerances are faster
_KINKS = 4.5  # the order that the guide shows is below this if the force has kinks
_ROUGH = 1e-3  # at least this accuracy is rough,
_FINE = 1e-5  # and at most this one is fine


class Kind(NamedTuple):
    """A kind of motion, with the names of the methods to try with fixed steps, and with tolerances."""

    name: str
    fixed: tuple[str, ...] = ()
    variable: tuple[str, ...] = ()


def kind_of(first: Search) -> Kind:
    """The kind of the motion that the runs of the first method have shown."""
    pilots, free, aim = first.pilots, not first.pilots.problem.uses_velocity, first.pilots.aim
    is_limited, has_kinks = first.is_limited or first.method == SCOUT, (first.observed or _KINKS) < _KINKS
    if constraints_of(pilots.problem.rhs) and not (is_limited or has_kinks):
        return Kind("constraints hold", ("rk5",))
    if first.steps < _FEW:
        return Kind("the motion takes few steps", ("eig8", "eig5", "eig3") if free else ("eig8", "rk5", "eig5"))
    if is_limited:
        low = "cd" if free and not pilots.needs_reference else "eig3"
        fine = ("bm6", "eig5", "eig4") if free else ("eig5", "eig4", "eig3")
        return Kind("stability limits the step", fine if aim < _FINE else (low, "eig4", "eig5"))
    if has_kinks:
        return Kind("the force has kinks", ("eig5", "eig3"), ("rk5",))
    if pilots.unevenness(pilots.span / first.steps) > _UNEVEN:
        if free:
            return Kind("the speed varies much", ("bm6",), ("rkn12",))
        return Kind("the speed varies much", (), ("rk8", "rk5") if aim > _ROUGH / 2 else ("rk8",))
    if free:
        return Kind("the motion is smooth and even", ("rkn12", "bm6", "eig12" if aim < _ROUGH else "eig10"))
    return Kind("the motion is smooth and even", ("eig8", "eig9" if aim < _FINE else "rk5"))
