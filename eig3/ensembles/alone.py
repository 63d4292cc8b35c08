"""Members that run one at a time: those of implicit methods, and of systems with many degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..functions.guard import NotFiniteAtStartError
from ..methods import Method
from ..result.solution import Solution, Status
from ..run.integration import integrate
from ..stepping.stepper import Cancel
from .histories import Histories
from .members import Members


def alone(rhs: Any, members: Members, method: Method, i: int, cancel: Cancel | None = None, **options: Any) -> Solution:
    """Integrate member i as a single run."""
    h, method = float(members.steps[i]), method.of_member(members.first + i)
    return integrate(rhs, members.t_span, **members.start(i), h=h, method=method, cancel=cancel, **options)


class Alone:
    """Some members of an ensemble.

    Parameters
    ----------
    numbers : ndarray of int
        The numbers of the members.
    histories : Histories
    integrate : callable
        ``integrate(member, cancel)`` returns the `Solution` of a member.
    """

    def __init__(self, numbers: np.ndarray, histories: Histories, integrate: Callable[[int, Cancel], Solution]) -> None:
        self.numbers, self.histories, self._integrate = numbers, histories, integrate
        self.seconds = 0.0

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members, or those before `stop` is set."""
        for member in self.numbers:
            if stop.is_set():
                return
            try:
                solution = self._integrate(int(member), stop)
            except NotFiniteAtStartError as error:
                self.histories.judge(int(member), Status.DIVERGED, str(error))
                continue
            self.seconds += solution.kernel_seconds
            self.histories.take(int(member), solution)
