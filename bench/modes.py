"""What is timed of a run of the library: the whole call or the kernel, with the right-hand side inlined or not."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from eig3.problem import Problem
from eig3.result.solution import Solution

#: Makes a run, and returns its seconds and the solution.
Timed = Callable[[], tuple[float, Solution]]


@dataclass(frozen=True)
class Mode:
    """One way to time a run.

    Attributes
    ----------
    words : str
        What is timed, after "counting".
    is_inline : bool
        Whether the right-hand side is compiled into the kernel; otherwise, the kernel calls it through a pointer.
    is_whole : bool
        Whether the whole call is timed, and not only its kernel.
    is_prepared : bool
        Whether a prepared run is called.
    """

    words: str
    is_inline: bool
    is_whole: bool = False
    is_prepared: bool = False

    def timed(self, problem: Problem, options: dict[str, Any]) -> Timed:
        """Return a function that makes a run of a problem; its first run may compile."""
        options = {**options, "inline": self.is_inline, "invariants": {}}
        call = problem.prepare(**options) if self.is_prepared else partial(problem.integrate, **options)

        def run() -> tuple[float, Solution]:
            begin = time.perf_counter()
            solution = call()
            seconds = time.perf_counter() - begin
            return seconds if self.is_whole else solution.kernel_seconds, solution

        return run


#: By name. The first is shown by default.
MODES = {
    "prepared": Mode("the whole call of a prepared run with the right-hand side compiled in", True, True, True),
    "integrate": Mode("the whole call of eig3.integrate", is_inline=False, is_whole=True),
    "pointer": Mode("the kernel, which calls the right-hand side through a pointer", is_inline=False),
    "inline": Mode("the kernel, which has the right-hand side compiled in", is_inline=True),
}
