"""The errors of the members of an ensemble, from the same ensemble with other steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..functions.guard import guarded
from ..result.memory import check_error
from ..run.chunks import check_repeatable
from ..run.variable_run import companion_ratios, companion_tolerances
from ..stepping.march import Cancel
from ..stepping.run_options import RunOptions
from .in_process import EnsembleRun
from .member_errors import MemberErrors
from .members import Members
from .solution import EnsembleSolution


def errors_of_members(
    rhs: Any,
    members: Members,
    options: RunOptions,
    threads: int,
    solution: EnsembleSolution,
    cancel: Cancel | None,
    is_goal: bool,
) -> MemberErrors:
    """Run the ensemble with finer and with coarser steps; for a goal, a finer ensemble with tolerances is enough."""
    check_error(solution.u, solution.v, *solution.outputs.values(), *solution.z.values())
    others: list[tuple[Members, RunOptions, float]]
    if options.tolerances:
        ratios = companion_ratios(options.tolerances)[: 1 if is_goal else None]
        others = [(members, _with_tolerances(options, ratio), ratio) for ratio in ratios]
    else:
        tried = (_with_steps(members, options, steps) for steps in (_finer(members, options), 1))
        others = [other for other in tried if other]
    found = [(EnsembleRun(rhs, some, own, threads).march(cancel=cancel), ratio) for some, own, ratio in others]
    return MemberErrors(solution, found, _starts(members, options, solution))


def _starts(members: Members, options: RunOptions, solution: EnsembleSolution) -> dict[str, np.ndarray]:
    """Return the values at the start of the invariants that are no energy minus the work; NaN after a failure."""
    functions, (t0, _) = options.functions, members.t_span
    invariants, _ = functions.quantities(members.form)
    starts = {name: np.full(len(members), np.nan) for name in invariants if functions.work_in(name) is None}
    for i in np.flatnonzero(solution.success).tolist() if starts else ():
        u, v, p = members.start(i)
        p = guarded(p)
        for name, values in starts.items():
            values[i] = invariants[name].callback.call(t0, u, v, p)
    return starts


def check_members_repeatable(options: RunOptions, what: str, **given: Any) -> None:
    """Refuse an ensemble that cannot be repeated here; `what` is the argument that needs this."""
    check_repeatable(options.method)
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{what} and {name} exclude each other: {what} compares the states of the whole ensemble.")


def _finer(members: Members, options: RunOptions) -> int:
    """Return the number of steps in place of two: three if all members can be compared, otherwise four."""
    is_even = bool((members.n_steps % 2 == 0).all()) and (options.save_every is None or options.save_every % 2 == 0)
    return 3 if is_even or options.t_eval is not None else 4


def _with_steps(members: Members, options: RunOptions, steps: int) -> tuple[Members, RunOptions, float] | None:
    """Return the members with `steps` steps in place of two; None if their states are at other times."""
    n_steps = np.maximum(1, members.n_steps * steps // 2)
    h = (members.t_span[1] - members.t_span[0]) / n_steps
    every = options.save_every
    if every is not None:
        if steps == 1 and (members.n_steps % 2).any():
            return None
        every = every * steps // 2 if every * steps % 2 == 0 else every * steps
    h = h if members.has_own_step else float(h[0])
    options = options._replace(h=float(np.ravel(h)[0]), save_every=every)
    return replace(members, h=h, n_steps=n_steps), options, 2 / steps


def _with_tolerances(options: RunOptions, ratio: float) -> RunOptions:
    assert options.tolerances
    tolerances = companion_tolerances(options.tolerances, ratio)
    every = None if options.save_every is None else 1
    return options._replace(tolerances=tolerances, save_every=every)
