"""What the blocks of an ensemble have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..kernels.lanes import Lanes, Layout
from ..methods import Method
from ..solution import Solution
from ..stepper import Cancel
from .histories import Histories
from .members import Members


@dataclass(frozen=True, eq=False)
class Shared:
    """What the blocks of an ensemble have in common.

    Attributes
    ----------
    members : Members
    layout : Layout
    method : Method
        The record that takes the steps.
    kernel : callable
        The kernel of the method.
    rhs : Lanes
    invariants : dict of str to Lanes
    histories : Histories
    alone : callable
        ``alone(member, cancel)`` returns the `Solution` of a member from a run of its own.
    """

    members: Members
    layout: Layout
    method: Method
    kernel: Callable
    rhs: Lanes
    invariants: dict[str, Lanes]
    histories: Histories
    alone: Callable[[int, Cancel], Solution]
