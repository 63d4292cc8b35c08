"""Runs of one system by several programs, each with the fewest steps for the same error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: ``run(steps)`` returns the seconds that it took, and what is compared at its end.
Run = Callable[[int], tuple[float, np.ndarray]]

HEADS = ["method", "steps", "error", "us a step", "time / EIG-3"]
_FEWEST, _DOUBLINGS, _LONGEST = 50, 16, 30.0  # steps, and s of a run that is tried


def fewest_steps(run: Run, error_of: Callable[[np.ndarray], float], largest: float) -> tuple[int, float] | None:
    """Return the fewest steps, among 50, 100, 200, ..., of a run with an error that is not larger than the largest.

    Returns
    -------
    (int, float) or None
        The steps and the error; None if it takes too long.
    """
    steps = _FEWEST
    for _ in range(_DOUBLINGS):
        seconds, found = run(steps)
        error = error_of(found)
        if error <= largest:
            return steps, error
        if 2 * seconds > _LONGEST:
            return None
        steps *= 2
    return None


def rows(
    contenders: dict[str, Run], error_of: Callable[[np.ndarray], float], largest: float, repeats: int
) -> list[list[str]]:
    """Return the rows of the table. The runs are repeated and interleaved; EIG-3 is the first."""
    needed = {name: fewest_steps(run, error_of, largest) for name, run in contenders.items()}
    taken = {name: (*found, list[float]()) for name, found in needed.items() if found}
    for _ in range(repeats):
        for name, (steps, _, seconds) in taken.items():
            seconds.append(contenders[name](steps)[0])
    first = np.median(taken[next(iter(contenders))][2])
    found = []
    for name in contenders:
        cells = ["-"] * 4
        if name in taken:
            steps, error, seconds = taken[name]
            middle = np.median(seconds)
            cells = [str(steps), f"{error:.1e}", f"{1e6 * middle / steps:.3g}", f"{middle / first:.2g}"]
        found.append([name, *cells])
    return found
