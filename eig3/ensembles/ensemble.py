"""`ensemble`: run many trajectories of one system, in SIMD lanes and on all cores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_cancel, check_count, check_flag, check_span
from ..functions.events import Event
from ..functions.first_order import NONE, FirstOrder, check_z0
from ..functions.layout import bound_layout
from ..functions.named import has_names
from ..functions.records import check_left_out, check_together, left_out_of
from ..kernels.compile.interrupt import keeping, with_solution
from ..keywords import with_suggestions
from ..methods import Method
from ..result.labels import Labels
from ..run.accuracy import check_goal, first_rtol, refuse_steps, refuse_without_accuracy
from ..run.prepare import Prepared
from ..run.progress import check_progress
from ..stepping.march import Cancel
from ..stepping.observer import check_times
from ..stepping.run_options import RunOptions, run_options
from ..stepping.threads import cores, starts_threads
from .accuracy import check_members_method, reach_members
from .checked import check_members_repeatable, errors_of_members
from .files import Directory
from .in_parts import run_in_parts
from .in_process import EnsembleRun
from .member_tables import is_table
from .members import Members, check_members
from .named_members import OfMembers, split, with_lengths
from .recipe import recipe_of
from .shipping import check_executor, check_reduce
from .solution import EnsembleSolution, Reduce

_REFUSED = {
    "inline": "the functions of members are compiled into the loop of the lanes",
    "raise_on_failure": "a member that fails does not stop the others; look at solution.status",
}


@with_solution
@with_suggestions()
def ensemble(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: ArrayLike | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    params: Any = (),
    method: str | Method | None = None,
    save_every: int | None = None,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event] | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    invariants_every: int = 1,
    h_max: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    check: bool = False,
    accuracy: float | Mapping[str, float] | None = None,
    scale: float | None = None,
    max_seconds: float | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    reduce: Reduce | None = None,
    progress: bool = False,
    cancel: Cancel | None = None,
    save_to: str | PathLike[str] | None = None,
    z0: ArrayLike | Mapping[str, ArrayLike] | None = None,
    first_order: FirstOrder = NONE,
    labels: Labels | None = None,
    **refused: Any,
) -> Any:
    """Integrate many trajectories of u'' = f(t, u, v), in SIMD lanes and on all cores.

    The members differ in their start, their parameters or their step: an argument with a first axis of length m has a
    value for each of the m members, and all members share any other. The page eig3/ensembles/README.md has examples.

    Parameters
    ----------
    rhs : jitted function
        The acceleration, in the scalar or in the vector form, as for `eig3.integrate`.
    t_span : (float, float)
        First and last time.
    u0, v0 : array_like, shape () or (m,), or in the vector form (n,) or (m, n)
        Displacements and velocities at the first time.
    h : float or array_like, shape (m,)
        The fixed step. If it does not divide the span, the run takes the next shorter step that does. Or take rtol.
    params : array_like, shape (k,) or (m, k); or NamedTuple or dict; or DataFrame; or list of dict or NamedTuple
        rhs gets the parameters of a member as p, of shape (k,). A named array whose first axis has the length m has a
        value for each member; it is refused if rhs could take it as a whole. A DataFrame has a row for each member.
    rtol, atol, method, save_every, t_eval, events, invariants, outputs, invariants_every : optional
    h_max, first_step, max_steps, check, accuracy, scale, max_seconds, progress, cancel : optional
        As for `eig3.integrate`. By default only the first and the last state are saved.
    threads : int
        Number of threads; by default all cores that the process may use.
    executor : concurrent.futures.Executor
        Run the ensemble in parts on its workers, such as a `ProcessPoolExecutor` that spawns, or a dask.distributed
        Client's. A part whose worker dies runs again. Each part takes one thread, or `threads`.
    reduce : callable
        ``reduce(part)`` gets the `EnsembleSolution` of a part, whose `first` is the number of its first member, and
        returns what you need of it, where the part ran. With an executor, it and what it returns must be picklable.
    save_to : str or path
        A new or empty directory for the finished parts, or one with parts of this ensemble, which do not run again.
    z0 : array_like, shape (k,) or (m, k); or dict of str to array_like, shape () or (m,)
        First-order unknowns at the first time.
    first_order, labels
        Set by `Problem.ensemble`. Other options are refused.

    Returns
    -------
    EnsembleSolution or list
        With `reduce`, the list of its return values for each part. A member that fails ends at its last valid state,
        and its `status` gives the reason; the others continue. After `cancel`, unfinished members are INTERRUPTED.

    Raises
    ------
    TypeError, ValueError
        An argument is not valid, two shapes do not match, or no member can start because rhs reads beyond its arrays.
    MemoryError, OSError, ImportError
        The histories do not fit in memory, or on the disk; or `progress` is True and tqdm is not installed.
    KeyboardInterrupt
        After Ctrl-C. `solution` has the finished members, and the others as INTERRUPTED. With `reduce` it is the list,
        with None for unfinished parts; None before any start. Exceptions from rhs have the same attribute.

    Notes
    -----
    The result of a member is bitwise independent of the other members, of its position and of the number of threads. To
    reproduce a single member, keep its axis: ``params[i : i + 1]``, of shape (1, k). With `rtol`, fewer than 16 members
    run one at a time, bitwise as `eig3.integrate`. Member i has the stream i of random numbers of `Langevin`.
    """
    _refuse(refused)
    goal = None
    if accuracy is None:
        refuse_without_accuracy(scale=scale, max_seconds=max_seconds)
    else:
        goal = check_goal(accuracy, scale, max_seconds)
        refuse_steps(h=h, rtol=rtol, atol=atol, first_step=first_step, max_steps=max_steps)
        method, rtol = check_members_method(rhs, method), first_rtol(goal)
    check_progress(progress)
    check_executor(executor)
    check_reduce(reduce)
    check_cancel(cancel)
    if reduce is not None and save_to is not None:
        raise ValueError("reduce and save_to exclude each other: save_to keeps the states that reduce drops.")
    if z0 is not None:
        first_order, z = check_z0(rhs, z0, of_members=True)
        (u0, v0), rhs = first_order.start(u0, v0, z), first_order.bind_rhs(rhs)
    named_params = params
    if not isinstance(params, OfMembers | np.ndarray) and (has_names(params) or is_table(params, rhs)):
        params, one = split(rhs, params, check_span(t_span)[0], u0, v0, 0.0 if h is None else h)
        rhs = one.layout.bind(rhs)
    if starts_threads(rhs):
        raise ValueError(
            "rhs uses threads, but the members already use all threads: compile it without parallel=True, or "
            "give threads=1 to eig3.linear."
        )
    flat, own_names = params if isinstance(params, OfMembers) else (params, ())
    members = check_members(rhs, t_span, u0, v0, flat, h, own_names)
    if isinstance(params, OfMembers) and not own_names:  # shared, also by a single member
        members = replace(members, params=members.params.reshape(-1))
    try:
        options = run_options(
            bound_layout(rhs),  # the function of a problem is already bound
            h=None if h is None else float(members.steps[0]),
            rtol=rtol,
            atol=atol,
            method=method,
            save_every=save_every,
            t_eval=t_eval,
            events=events,
            invariants=invariants,
            outputs=outputs,
            invariants_every=invariants_every,
            h_max=h_max,
            first_step=first_step,
            max_steps=max_steps,
            first_order=first_order,
            labels=labels,
        )
        members, options = ready(rhs, members, options)
    except TypeError as error:
        raise with_lengths(error, named_params, len(members)) from error
    own = cores() if threads is None else check_count(threads, "threads")
    place = None if save_to is None else Directory(save_to, recipe_of(rhs, members, options))
    if check_flag(check, "check") or goal:
        in_files = {"save_to": save_to} if goal else {}
        check_members_repeatable(options, "accuracy" if goal else "check", executor=executor, reduce=reduce, **in_files)

        def checked(options: RunOptions, cancel: Cancel | None) -> EnsembleSolution:
            if place is None:
                solution = EnsembleRun(rhs, members, options, own).march(progress, cancel)
            else:
                solution = run_in_parts(rhs, members, options, None, place, None, (own, 1), progress, cancel)
            with keeping(solution):
                solution.error = errors_of_members(rhs, members, options, own, solution, cancel, goal is not None)
            if place and not solution.error.is_interrupted:
                place.keep_error(solution)
            return solution

        return reach_members(goal, rhs, options, checked, cancel) if goal else checked(options, cancel)
    if executor is None and reduce is None and save_to is None:
        return EnsembleRun(rhs, members, options, own).march(progress, cancel)
    return run_in_parts(rhs, members, options, reduce, place, executor, (own, threads or 1), progress, cancel)


def ready(rhs: Any, members: Members, options: RunOptions) -> tuple[Members, RunOptions]:
    """Return members and their options with the method of their runs, after all checks of a single run."""
    n, starts = members.n - options.first_order.size, (members.u0, members.v0, members.params)
    check_together(rhs, members.params, members.own, n)
    check_left_out(left_out_of(rhs), members.params)
    times, prepared = check_times(options.t_eval, *members.t_span), Prepared(rhs, members.form, options)
    if prepared.rules:
        u0, v0 = prepared.rules.starts(n, members.t_span, *starts, members.first)
        members = replace(members, u0=u0, v0=v0)
    return members, prepared.options._replace(t_eval=times)


def _refuse(options: dict[str, Any]) -> None:
    """Refuse options that an ensemble does not have."""
    for name in options:
        if name not in _REFUSED:
            raise TypeError(f"ensemble() got an unexpected keyword argument {name!r}.")
        raise TypeError(f"{name} is for single runs: {_REFUSED[name]}.")
