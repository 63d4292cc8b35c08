"""Run an ensemble to an accuracy: repeat it with smaller tolerances until the error of each member is small enough."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..functions.checks import check_method, shown
from ..functions.companions import history_of, remembered
from ..result.solution import Status
from ..run.accuracy import (
    AIM,
    LARGEST_CHANGE,
    LEAST,
    LEAST_GAIN,
    MOST_RUNS,
    MOST_STALLED,
    WITH_TOLERANCES,
    Deadline,
    Goal,
    Known,
    check_accuracy_names,
    first_rtol,
    why,
)
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from .solution import EnsembleSolution

_INTERRUPTED = "The ensemble was interrupted before this member had reached the accuracy."


def check_members_method(rhs: Any, method: Any) -> Any:
    """Refuse a method with a fixed step, and grains."""
    if history_of(rhs):
        raise ValueError(
            "accuracy of an ensemble needs tolerances, which do not bound the error of springs between grains: give h "
            "and check=True."
        )
    if method is None or isinstance(check_method(method), WITH_TOLERANCES):
        return method
    raise ValueError(f"accuracy of an ensemble needs a method with tolerances: RK5, RK8 or RKN12, not {shown(method)}.")


def reach_members(
    goal: Goal,
    rhs: Any,
    options: RunOptions,
    run: Callable[[RunOptions, Cancel | None], EnsembleSolution],
    cancel: Cancel | None,
) -> EnsembleSolution:
    """Return the first run in which all members reach an accuracy, or the best run.

    In the best run, a member that does not reach it has the status ACCURACY_NOT_REACHED. After `cancel`, or if the
    first run takes more than `max_seconds`, the last run is returned, and members whose accuracy is not known have the
    status INTERRUPTED. ``run(options, cancel)`` runs the ensemble, with tolerances, and with the check of errors.
    """
    check_accuracy_names(goal, options)
    for name in () if options.save_every is None else (*options.functions.outputs, *options.first_order.names):
        if name in goal.wanted:
            raise ValueError(f"accuracy of {name!r} in an ensemble needs t_eval, or save_every=None.")
    assert options.tolerances
    known, key = remembered(rhs, "accuracies"), ("ensemble", options.method, *sorted(goal.wanted.items()), goal.scale)
    rtol, deadline = known[key].value if key in known else first_rtol(goal), Deadline(goal, cancel)
    best: tuple[tuple[int, float], EnsembleSolution, np.ndarray] | None = None
    stalled, reason = 0, f"{MOST_RUNS} runs were not enough"
    for _ in range(MOST_RUNS):
        before = deadline.spent
        solution = run(options._replace(tolerances=options.tolerances._replace(rtol=rtol)), deadline.of_runs)
        if solution.error.is_interrupted and best and deadline.has_passed:
            reason = deadline.reason(0.0)
            break
        largest = np.max([*goal.misses(solution).values()], axis=0)
        misses = np.where(solution.success, largest, np.nan)  # of members that did not fail
        if solution.error.is_interrupted:
            for i in np.flatnonzero(misses > 1).tolist():
                solution.status[i], solution.message[i] = Status.INTERRUPTED, _INTERRUPTED
            for i in np.flatnonzero(solution.status == Status.INTERRUPTED).tolist():
                solution.message[i] = deadline.explain(solution.message[i])
            return solution
        missing = misses[misses > 1]
        if not len(missing):
            known[key] = Known(rtol, None)
            return solution
        rank = len(missing), float(np.median(missing))
        is_better = best is None or rank[0] < best[0][0] or rank[1] < LEAST_GAIN * best[0][1]
        stalled += not is_better
        best = (rank, solution, misses) if best is None or rank < best[0] else best
        if stalled >= MOST_STALLED or rtol <= LEAST:
            reason = ""
            break
        if late := deadline.reason(deadline.spent - before):
            reason = late
            break
        rtol = max(LEAST, rtol * min(0.5, max(LARGEST_CHANGE, AIM / rank[1])))
    assert best
    _, solution, misses = best
    for i in np.flatnonzero(misses > 1).tolist():
        error = solution.error[i]
        solution.status[i] = Status.ACCURACY_NOT_REACHED
        amount = f"{misses[i]:.2g} times as large" if np.isfinite(misses[i]) else "not known"
        solution.message[i] = (
            f"The accuracy is not reached, because {reason or why(error)}: the estimated error is {amount}."
        )
    return solution
