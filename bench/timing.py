"""Timing as the article did it: the kernel alone, on storage allocated and touched before, compiling left out."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from eig3.integration import divide
from eig3.memory import available_memory
from eig3.methods import Method
from eig3.problem import Problem

_SHARE_OF_MEMORY = 0.5


class Storage:
    """Rows for whole histories of u and v; a history that does not fit in half the free memory reuses them."""

    def __init__(self, n: int | None, n_steps: int) -> None:
        row = 16 * (n or 1)
        rows = min(n_steps, max(1, int(_SHARE_OF_MEMORY * available_memory() // row)))
        shape = (rows,) if n is None else (rows, n)
        self.u, self.v = np.ones(shape), np.ones(shape)  # written, so that no page is first touched while timed

    @classmethod
    def for_runs(cls, problem: Problem, steps: Sequence[float]) -> "Storage":
        """Room for the longest history of `problem` at any of these steps."""
        shape = np.shape(problem.u0)
        return cls(shape[0] if shape else None, divide(problem.t_span[1] - problem.t_span[0], min(steps))[0])


def time_run(problem: Problem, h: float, method: str | Method, storage: Storage) -> float:
    """Seconds in the kernel for the whole span with every state stored."""
    n_steps, h = divide(problem.t_span[1] - problem.t_span[0], h)
    stepper = problem.stepper(h=h, method=method)
    while stepper.index < n_steps:
        count = min(n_steps - stepper.index, len(storage.u))
        if stepper.advance(count, 1, storage.u[:count], storage.v[:count]) < count:
            break
    return stepper.seconds


def interleave(
    runs: Mapping[str, Callable[[], float]], repeats: int, progress: Callable[[str], None] = lambda text: None
) -> dict[str, list[float]]:
    """Call every run once in each of `repeats` rounds, after a round that warms up; return the seconds of each."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for round_ in range(repeats + 1):
        for name, run in runs.items():
            progress(f"{name}: {f'run {round_} of {repeats}' if round_ else 'warming up'}")
            elapsed = run()
            if round_:
                seconds[name].append(elapsed)
    return seconds
