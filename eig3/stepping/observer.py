"""What a run looks at in each step: events, wanted times, and the quantities that it follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..kernels.protocol import PART_END, LookWithin
from ..kernels.protocol import Look as Arguments
from .system import System
from .watching import Watching


class Observer:
    """The look of one run.

    Parameters
    ----------
    system : System
    times : ndarray or None
        The times at which the state is wanted.
    n : int
        The number of degrees of freedom.
    work_rows : int
        The number of rows of scratch that the kernel needs for events and wanted times.

    Attributes
    ----------
    watching : Watching
    follower : Follower
    arguments : Look or LookWithin of `eig3.kernels.protocol`
        What the kernel gets.
    """

    def __init__(self, system: System, times: np.ndarray | None, n: int, work_rows: int) -> None:
        self.watching = Watching(system, times, n, work_rows)
        self.follower = system.followed.follower(n)

    @property
    def arguments(self) -> Any:
        watch, follow, within = self.watching.watch, self.follower.record(), self.follower.within
        return Arguments(watch, follow) if within is None else LookWithin(watch, follow, within)

    def begin(self, tally: np.ndarray, t0: float, u: Any, v: Any, params: np.ndarray) -> None:
        """Look at the start."""
        tally[PART_END] = 1
        self.watching.begin(tally, t0, u, v, params)
        self.follower.begin(t0, u, v, params)

    def follow_within(self, formulas: Any, rtol: float) -> None:
        """Find the extremes of quantities within steps of variable length too."""
        self.follower.look_within(formulas, rtol)

    def save_wanted(self, rows: Mapping[str, np.ndarray], n: int) -> None:
        """Let the kernel write what is saved at the wanted times to these rows: u, v and, if they are there, steps."""
        u, v = rows["u"].reshape(-1, n), rows["v"].reshape(-1, n)
        self.watching.save_in(rows["steps"] if "steps" in rows else np.empty(len(u)), u, v)

    def found(self) -> dict[str, Callable[[], Any]]:
        """Return functions that find what a solution has of the look, by the names of its fields."""
        follower = self.follower
        return {"events": self.watching.occurrences, "drift": follower.drift, "extremes": follower.extremes}

    def fork(self) -> Observer:
        """Return an independent copy, which saves nothing."""
        other = object.__new__(Observer)
        other.watching, other.follower = self.watching.fork(), self.follower.fork()
        return other
