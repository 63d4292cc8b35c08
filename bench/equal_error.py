"""Runs of one system by several programs, each with the fewest steps for the same error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import text
from .rivals import exudyn, mujoco
from .timing import medians

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
    reached = {name: found for name, found in needed.items() if found}
    runs = {name: lambda run=contenders[name], steps=steps: run(steps)[0] for name, (steps, _) in reached.items()}
    seconds = medians(runs, repeats, "equal error")
    rows = {name: [name, *["-"] * 4] for name in contenders}
    for name, (steps, error) in reached.items():
        ratio = seconds[name] / seconds[next(iter(contenders))]
        rows[name] = [name, str(steps), f"{error:.1e}", f"{1e6 * seconds[name] / steps:.3g}", f"{ratio:.2g}"]
    return list(rows.values())


def page(heads: list[str], rows: list[list[str]], note: str) -> str:
    """Return a table with its note, and how to install the rivals that are not there."""
    missing = [rival.INSTALL for rival in (exudyn, mujoco) if not rival.is_there()]
    return "\n\n".join([text.table(heads, rows), note, *missing])
