"""Timing as in the article: the kernel alone, on memory allocated and written before, without compiling."""

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from eig3.problem import Problem
from eig3.result.memory import available_memory
from eig3.run.fixed_run import divide
from eig3.stepping.stepper import Stepper

from . import text

_SHARE_OF_MEMORY = 0.5


def seconds_of(call: Callable[[], object]) -> float:
    """The seconds of a call, with its Python."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


class Storage:
    """Rows for whole histories of u and v.

    A history that does not fit in half the free memory gets fewer rows. A run then overwrites them again and again.
    """

    def __init__(self, n: int | None, n_steps: int) -> None:
        row = 16 * (n or 1)
        rows = min(n_steps, max(1, int(_SHARE_OF_MEMORY * available_memory() // row)))
        shape = (rows,) if n is None else (rows, n)
        self.u, self.v = np.ones(shape), np.ones(shape)  # written now, so that no run pays for the first access

    @classmethod
    def for_steps(cls, problem: Problem, n_steps: int) -> "Storage":
        """Rows for this many states of a problem."""
        shape = np.shape(problem.u0)
        return cls(shape[0] if shape else None, n_steps)

    @classmethod
    def for_runs(cls, problem: Problem, steps: Sequence[float]) -> "Storage":
        """Rows for the history of a problem over its span with the smallest of these steps h."""
        return cls.for_steps(problem, divide(*problem.t_span, min(steps))[0])


def kernel_run(start: Stepper, n_steps: int, *, every: int = 1, storage: Storage | None = None) -> Callable[[], float]:
    """A run of `n_steps` from where `start` stands, which can be repeated; it returns the seconds in the kernel.

    It stores each `every`-th state in `storage`, or no state if there is none.
    """

    def run() -> float:
        stepper = start.fork()
        if storage is None:
            stepper.advance(n_steps)
            return stepper.seconds
        while stepper.index < n_steps:
            count = min(n_steps - stepper.index, every * len(storage.u))
            if stepper.advance(count, every, storage.u, storage.v) < count:
                break
        return stepper.seconds

    return run


def continued_run(stepper: Stepper, n_steps: int) -> Callable[[], float]:
    """A run that takes the next `n_steps` at each call; it returns the seconds in the kernel.

    It is for systems larger than the cache: they run up to 20 % slower in the fresh memory of a copy.
    """

    def run() -> float:
        before = stepper.seconds
        stepper.advance(n_steps)
        return stepper.seconds - before

    return run


def interleave(
    runs: Mapping[str, Callable[[], float]], repeats: int, where: str, enough: float = math.inf
) -> dict[str, list[float]]:
    """Call every run once in each of `repeats` rounds, after one round to warm up; return the seconds of each run.

    A disturbance by another process then hits all runs alike. `where` is shown on the progress line. A run is not
    called again when it has taken `enough` seconds in three rounds, or three times as long in fewer rounds. The round
    to warm up then counts too: it hardly changes so long a run.
    """
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for round_ in range(repeats + 1):
        for name, run in runs.items():
            if sum(seconds[name]) >= enough * (1 if len(seconds[name]) >= 3 else 3):
                continue
            text.status(f"{where}, {name}: {f'run {round_} of {repeats}' if round_ else 'warming up'}")
            elapsed = run()
            if round_ or elapsed >= enough:
                seconds[name].append(elapsed)
    text.status("")
    return seconds


def medians(runs: Mapping[str, Callable[[], float]], repeats: int, where: str) -> dict[str, float]:
    """The median seconds of each run, from interleaved rounds."""
    return {name: statistics.median(seconds) for name, seconds in interleave(runs, repeats, where).items()}
