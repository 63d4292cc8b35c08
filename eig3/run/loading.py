"""Load a saved run, with the functions that it needs to continue."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np

from ..functions.checks import check_flag
from ..functions.events import Event, check_events
from ..functions.first_order import FirstOrder, check_z0
from ..functions.layout import Layout
from ..functions.quantities import Functions, check_functions
from ..kernels.protocol import SCALAR, SPACING, VECTOR
from ..keywords import with_suggestions
from ..result import storage
from ..result.labels import Labels
from ..result.solution import Solution
from ..stepping.run_options import RunOptions
from ..stepping.system import System
from .fixed_run import FixedRun
from .variable_run import VariableRun


@with_suggestions()
def load(
    path: str | PathLike[str],
    *,
    rhs: Any = None,
    events: Mapping[str, Event] | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    jacobian: Any = None,
) -> Any:
    """Read a solution or an ensemble that its method `save`, or a run with `save_to`, has written.

    Parameters
    ----------
    path : str or path
        The file, to which ".npz" is added if it does not end with this, or the directory of `save_to`.
    rhs : jitted function, optional
        The right-hand side of the run. The solution then has `extend`, as a solution from `integrate`. `Problem.load`
        loads a run of a problem in this way.
    events, invariants, outputs : dict, optional
        With rhs: the events and functions of the run, as for `eig3.integrate`.
    jacobian : jitted function, optional
        With rhs: the jacobian of the method, if it has one.

    Returns
    -------
    Solution or EnsembleSolution
        The values are bitwise the saved values. Without rhs, `explain` returns an earlier result, and `at` uses the
        saved accelerations. A directory has no accelerations, and `at` is then a cubic polynomial; t, u, v and outputs
        are read-only maps of the files. `load` reads these files once, to compare their checksums. If the process of
        the run was killed, or is still running, the status is INTERRUPTED, and the solution ends at the last record:
        some tenths of a second of computing earlier, or more for a large system, because records take at most a
        twentieth of the time. An ensemble needs rhs for `at` of its members. From a directory, it has the members of
        the finished parts; the status of the others is INTERRUPTED, and with the functions of the ensemble, `resume`
        runs them.

    Raises
    ------
    OSError
        If the file cannot be read.
    TypeError, ValueError
        If the file is not from `Solution.save`, is damaged or comes from another version of eig3, or if its method is a
        class of the user that is not imported yet. With rhs, if the run cannot be continued, or the names of the
        functions differ from the run; only the names are checked. The parameters come from the file.

    Notes
    -----
    A file may come from others: nothing in it is run, and everything is checked to have its type.
    """
    solution = storage.load(path)
    if not isinstance(solution, Solution):  # an ensemble
        return solution.with_functions(rhs, events, invariants, outputs, jacobian)
    given = {"events": events, "invariants": invariants, "outputs": outputs, "jacobian": jacobian}
    if rhs is not None:
        return with_functions(solution, rhs, **given)
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} needs rhs too: the right-hand side of the run.")
    return solution


def with_functions(
    solution: Solution,
    rhs: Any,
    *,
    events: Any = None,
    invariants: Any = None,
    outputs: Any = None,
    jacobian: Any = None,
    labels: Labels | None = None,
    first_order: FirstOrder | None = None,
) -> Solution:
    """Give a loaded solution the functions of its run, as `eig3.load` describes it, and return it."""
    state = solution._state
    if state is None:
        why = "it is a copy, is a member of an ensemble, or ended with an exception"
        if not solution.can_go_on:
            why = f"its status is {solution.status.name}"
        raise ValueError(f"this run cannot be continued: {why}; load it without functions.")
    if first_order is None:
        # not the values: the run may have ended before the first time of t_eval
        first_order, _ = check_z0(rhs, {name: np.zeros(x.shape[1:]) for name, x in solution.z.items()} or None)
    rhs = first_order.bind_rhs(rhs)
    events, invariants, outputs = map(first_order.bind_all, (events, invariants, outputs))
    if state["layout"]:
        with storage.going_on():
            layout = Layout.of_text(state["layout"])
        rhs, jacobian = layout.bind(rhs), layout.bind(jacobian)
        events, invariants, outputs = map(layout.bind_all, (events, invariants, outputs))
    with storage.going_on():  # a run from the start on, as `extend` may need it, evaluates them as often
        invariants_every = max(1, int(state["stepper"]["counters"][SPACING]))
    functions = check_functions(invariants, outputs, invariants_every)
    given: dict[str, Any] = {"events": check_events(events), **functions._asdict()}
    names: dict[str, Mapping[str, Any]]
    names = {"events": solution.events, "invariants": solution.drift, "outputs": solution.outputs}
    for argument, known in names.items():
        if set(known) != set(given[argument]):
            wanted = ", ".join(map(repr, known)) or "none"
            raise ValueError(
                f"{argument} must have the same names as in the run: {wanted}; problem.load gives the functions of a "
                "problem."
            )
        given[argument] = {name: given[argument][name] for name in known}
    if (jacobian is not None) != state["has_jacobian"]:
        what = "the method of the run has a jacobian: give" if jacobian is None else "the run has none: leave out"
        raise ValueError(f"{what} jacobian.")
    if jacobian is not None:
        solution.method = dataclasses.replace(solution.method, jacobian=jacobian)  # type: ignore[type-var]
        solution.notes = tuple(note for note in solution.notes if note != storage.WITHOUT_JACOBIAN)
    kind: Any = FixedRun if "h" in state else VariableRun
    form = SCALAR if np.ndim(state["start"][0]) == 0 else VECTOR
    options = RunOptions(
        method=solution.method,
        t_eval=state["times"],
        events=given.pop("events"),
        functions=Functions(**given),
        inline=check_flag(state["inline"], "inline"),
        labels=Labels.of(labels, functions.columns),
        first_order=first_order,
    )
    run = kind.restored(solution, System(rhs, form, options))
    solution._accelerations, solution._reads_z = run.stepper.accelerations, first_order.is_read
    if isinstance(run, VariableRun):
        solution._between = run.between
    solution._extend = lambda: run
    return solution
