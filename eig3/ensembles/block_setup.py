"""What the blocks of an ensemble have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ..functions.quantities import Quantity
from ..kernels.lanes import Lanes, Layout
from ..methods import Method
from ..result.solution import Solution
from ..stepping.march import Cancel
from .histories import Histories
from .lanewise import Keeping
from .members import Members
from .stops import Stops

_CHUNK_SECONDS = 0.02  # duration of a chunk of steps, after which the members are looked at
_CHUNK_GROWTH = 16  # largest factor from the steps of one chunk to the steps of the next
FIRST_CHUNK = 64  # steps
_MOST_STEPS = 2**40  # a chunk may end early


class SignOf(NamedTuple):
    """The key of the function g of an event among the quantities, whose names are texts.

    Attributes
    ----------
    event : str
    """

    event: str


class Pace:
    """The number of steps of a chunk, which follows from the time of the last one in any block.

    Attributes
    ----------
    steps : int
    seconds : float or None
        The time per step; None before the first chunk.
    """

    def __init__(self) -> None:
        self.steps = FIRST_CHUNK
        self.seconds: float | None = None

    def note(self, steps: int, seconds: float) -> None:
        """Choose the number of steps of the next chunk."""
        self.seconds = seconds / steps
        self.steps = max(1, min(int(steps * min(_CHUNK_GROWTH, _CHUNK_SECONDS / (seconds + 1e-9))), _MOST_STEPS))


@dataclass(frozen=True, eq=False)
class BlockSetup:
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
    keeping : Keeping or None
        What keeps the constraints; None without constraints.
    quantities : dict of str or SignOf to (Quantity, Lanes)
        The invariants, the outputs and the functions of the events.
    stops : Stops or None
        The search for events that do nothing but end members; None if there are other events, or none.
    histories : Histories
    alone, single : callable
        ``alone(member, cancel)`` returns the `Solution` of a member from a run of its own, without events and without
        what it follows; ``single(member, cancel)`` returns the one with all options.
    pace : Pace
    """

    members: Members
    layout: Layout
    method: Method
    kernel: Callable
    rhs: Lanes
    keeping: Keeping | None
    quantities: dict[Any, tuple[Quantity, Lanes]]
    stops: Stops | None
    histories: Histories
    alone: Callable[[int, Cancel], Solution]
    single: Callable[[int, Cancel], Solution]
    pace: Pace = field(default_factory=Pace)
