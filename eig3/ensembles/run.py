"""`ensemble`: run many trajectories of one system, in SIMD lanes and on all cores."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from os import PathLike
from queue import Empty, Queue
from threading import Event as Flag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback, form_of
from ..functions.checks import check_cancel, check_count, check_time
from ..functions.events import Event
from ..functions.guard import NotFiniteAtStartError, ReadsBeyondError, is_finite_at_start
from ..functions.layout import bound_layout
from ..functions.named import has_names
from ..functions.quantities import Quantity
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.numba_internals import Jitted, gist, options_of
from ..kernels.lanes import compile_quantity, compile_rhs
from ..kernels.loops.fixed import wide_kernel
from ..kernels.protocol import FOLLOWS
from ..methods import Method
from ..result.labels import Labels
from ..run.progress import Progress, check_progress
from ..stepping.march import Cancel, March
from ..stepping.watching import further_times
from .adaptive import LANES, Adaptive, AdaptiveBlock, in_lanes, runs_in_lanes
from .alone import Alone, Singles
from .block import Block
from .files import Directory
from .histories import Histories
from .lanewise import lanes_of, layout_of
from .members import Members, check_members
from .named_members import split
from .options import Options, check_options
from .parts import Joined, Listed, Recipe, Results, parts_of
from .shared import Shared, SignOf
from .shipping import check_executor, check_reduce, march_parts
from .solution import EnsembleSolution, Reduce

_ALONE = 16  # members of a piece of work that runs them one at a time
_PIECES = 4  # of the members with tolerances, for each thread
_POLL_SECONDS = 0.05  # between two looks for Ctrl-C
_REFUSED = {
    "inline": "the functions of members are compiled into the loop of the lanes",
    "raise_on_failure": "a member that fails does not stop the others; look at solution.status",
}


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
    h_max: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    reduce: Reduce | None = None,
    progress: bool = False,
    cancel: Cancel | None = None,
    save_to: str | PathLike[str] | None = None,
    integrals: Sequence[str] = (),
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
    params : array_like, shape (k,) or (m, k); or NamedTuple or dict
        The parameters. rhs gets those of a member as p, of shape (k,). Of parameters with names, each array whose first
        axis has the length m has a value for each member.
    rtol, atol, method, save_every, t_eval, events, invariants, outputs, h_max, first_step, max_steps, progress, cancel
        As for `eig3.integrate`. By default only the first and the last state are saved.
    threads : int
        Number of threads; by default all cores that the process may use.
    executor : concurrent.futures.Executor
        Run the ensemble in parts on the workers of this executor, such as a `ProcessPoolExecutor` that spawns, or that
        of a dask.distributed Client. A part whose worker dies runs again. Each part takes one thread, or `threads`.
    reduce : callable
        ``reduce(part)`` gets the `EnsembleSolution` of a part, whose `first` is the number of its first member, and
        returns what you need of it. It runs where the part ran, and the states of the part are dropped after it. With
        an executor, it and what it returns must be picklable.
    save_to : str or path
        A new or empty directory, to which each part is written when it has finished; `eig3.load` reads it, also if the
        process was killed.
    integrals, labels
        What `Problem.ensemble` adds: the names of integrals over time, which are the velocities of the last degrees of
        freedom and do not decide about the steps, and the names and units of the others.
    **refused
        Options of single runs that an ensemble refuses by a sentence.

    Returns
    -------
    EnsembleSolution or list
        With `reduce`, the list of what it returned for each part. A member that fails ends at its last good state, and
        its `status` says why; the others continue. After `cancel`, members that had not ended are INTERRUPTED.

    Raises
    ------
    TypeError, ValueError
        An argument is not valid, two shapes do not fit, or no member can start because rhs reads beyond its arrays.
    MemoryError, OSError, ImportError
        The histories do not fit in memory, or on the disk; or `progress` is True and tqdm is not installed.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` has the members that were finished, and the others as INTERRUPTED. With
        `reduce` it is the list, with None for unfinished parts. It is None if no member had started. What rhs raises is
        raised too, with the same attribute.

    Notes
    -----
    The numbers of a member do not depend on the other members, on its place or on the number of threads, to the last
    bit. A single member keeps these bits if it keeps its axis: ``params[i : i + 1]``, of shape (1, k). With `Langevin`,
    member i has the random numbers of the stream i: ``Langevin(..., stream=i)``.
    """
    _refuse(refused)
    try:
        check_progress(progress)
        check_executor(executor)
        check_reduce(reduce)
        if cancel is not None:
            check_cancel(cancel)
        if reduce is not None and save_to is not None:
            raise ValueError("reduce and save_to exclude each other: save_to keeps the states that reduce drops.")
        if has_names(params):
            params, one = split(params, form_of(rhs), u0, v0, 0.0 if h is None else h)
            rhs = one.layout.bind(rhs)
        layout = bound_layout(rhs)  # a problem's function is bound already
        if layout:
            method = layout.bind_method(method)
            events, invariants, outputs = (layout.bind_all(given) for given in (events, invariants, outputs))
        _refuse_parallel(rhs)
        members = check_members(rhs, t_span, u0, v0, params, h)
        options = check_options(
            rhs,
            members.form,
            members.t_span,
            None if h is None else float(members.steps[0]),
            rtol=rtol,
            atol=atol,
            method=method,
            save_every=save_every,
            t_eval=t_eval,
            events=events,
            invariants=invariants,
            outputs=outputs,
            h_max=h_max,
            first_step=first_step,
            max_steps=max_steps,
            integrals=tuple(integrals),
            labels=labels,
        )
        cores = _cores() if threads is None else check_count(threads, "threads")
        if executor is None and reduce is None and save_to is None:
            return Run(rhs, members, options, cores).march(progress, cancel)
        place = None if save_to is None else Directory(save_to)
        return _in_parts(rhs, members, options, reduce, place, executor, (cores, threads or 1), progress, cancel)
    except KeyboardInterrupt as error:
        if not hasattr(error, "solution"):  # it came before the first member began
            error.solution = None  # type: ignore[attr-defined]
        raise


def _refuse_parallel(rhs: Any) -> None:
    """Refuse a function with threads of its own: with some of Numba's threading layers they would end the process."""
    inner = getattr(getattr(rhs, "py_func", None), "named", rhs)
    if isinstance(inner, Jitted) and options_of(inner).get("parallel"):
        raise ValueError(
            "rhs shares its work between threads, but the members already do so: compile it without parallel=True, or "
            "give threads=1 to eig3.linear."
        )


def _refuse(options: dict[str, Any]) -> None:
    """Refuse options that an ensemble does not have."""
    for name in options:
        if name not in _REFUSED:
            raise TypeError(f"ensemble() got an unexpected keyword argument {name!r}.")
        raise TypeError(f"{name} is for single runs: {_REFUSED[name]}.")


def _in_parts(
    rhs: Any,
    members: Members,
    options: Options,
    reduce: Reduce | None,
    place: Directory | None,
    executor: Executor | None,
    threads: tuple[int, int],
    progress: bool,
    cancel: Cancel | None,
) -> Any:
    """Run an ensemble in parts; `threads` are the numbers of threads of a part in this process, and on a worker."""
    parts = parts_of(members, options)
    results: Results = Listed(len(parts))
    if reduce is None:
        results = Joined(Run.blank(rhs, members, options, threads[0]), place)
    recipe = Recipe(partial(_march, rhs, options), reduce)
    return march_parts(parts, recipe, results, executor, threads, progress, cancel)


def _march(
    rhs: Any, options: Options, members: Members, first: int, threads: int, cancel: Cancel | None
) -> EnsembleSolution:
    return Run(rhs, members, options, threads, first, is_part=True).march(cancel=cancel)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _not_in_lanes(error: Exception) -> str:
    return (
        f"The members run one at a time, because a function does not compile for lanes: {gist(error)}; write "
        "loops over single values, without array expressions and without functions of whole arrays."
    )


class _Stop:
    """Whether the members should stop: after Ctrl-C, after a cancellation, or because one of them raised an error."""

    def __init__(self, interrupt: DeferredInterrupt, cancel: Cancel | None) -> None:
        self._own = Flag()
        self._events: list[Cancel] = [event for event in (self._own, interrupt, cancel) if event is not None]

    def set(self) -> None:
        self._own.set()

    def is_set(self) -> bool:
        return any(event.is_set() for event in self._events)


class Run:
    """An ensemble on its way in this process."""

    def __init__(
        self, rhs: Any, members: Members, options: Options, threads: int, first: int = 0, *, is_part: bool = False
    ) -> None:
        self.rhs, self.members, self.options, self.threads = rhs, members, options, threads
        self.first, self.is_part = first, is_part
        self.histories = Histories(members, options)
        self.notes: list[str] = []
        self._single = Singles(rhs, members, options)
        self._callback = check_callback(rhs, "rhs", members.form)
        self._invariants, self._outputs = options.functions.quantities(members.form)
        self._check_start()
        self.work = self._work()

    @classmethod
    def blank(cls, rhs: Any, members: Members, options: Options, threads: int) -> EnsembleSolution:
        """Return the result of an ensemble whose members have not started."""
        run = cls.__new__(cls)
        run.rhs, run.members, run.options, run.threads = rhs, members, options, threads
        run.first, run.is_part, run.work, run.notes = 0, False, [], []
        run.histories = Histories(members, options)
        return run.solution()

    def _check_start(self) -> None:
        """Check rhs, the method, the events and the outputs in a first state, as for a single run.

        The member that serves for this is the first whose rhs is finite at the start. If there is none, each member
        will end at its start.
        """
        members, (t0, _) = self.members, self.members.t_span
        for i in range(len(members)):
            u, v, p = members.start(i)
            if is_finite_at_start(self._callback, members.form, t0, u, v, p):
                stepper = self._at_start(i)
                for output in self._outputs.values():
                    output.at_start(t0, *stepper.start, stepper.params, np.empty(output.width))
                return
        try:
            self._at_start(0)
        except NotFiniteAtStartError as error:
            if isinstance(error, ReadsBeyondError):
                raise

    def _at_start(self, i: int) -> March:
        start = self.members.start(i, len(self.options.integrals))
        return self._single.prepared(i).at_start(self.members.t_span, *start)

    def _work(self) -> list[Block | AdaptiveBlock | Alone]:
        adaptive = self._adaptive() if self.options.has_tolerances else None
        if adaptive:
            m = len(self.members)
            pieces = max(1, min(_PIECES * self.threads, m // (_PIECES * LANES))) if self.threads > 1 else 1
            return [AdaptiveBlock(adaptive, numbers) for numbers in np.array_split(np.arange(m), pieces)]
        order = np.argsort(self.members.n_steps, kind="stable")  # the members of a block end at similar times
        shared = self._shared()
        if shared:
            lanes = shared.layout.lanes
            return [Block(shared, order[i : i + lanes]) for i in range(0, len(order), lanes)]
        return [Alone(order[i : i + _ALONE], self.histories, self._single) for i in range(0, len(order), _ALONE)]

    def _adaptive(self) -> Adaptive | None:
        """Compile what runs in lanes with tolerances; return None if the members run one at a time."""
        options, members = self.options, self.members
        if options.t_eval is not None or options.save_every is not None or self._invariants or self._outputs:
            return None
        if not runs_in_lanes(members):
            return None
        tolerances, events = self._single.prepared(0).tolerances(members.n), [*self._followed().values()]
        given = members, options.method, events, tolerances, self.histories, self._single
        try:
            adaptive = in_lanes(self.rhs, self._callback, *given)
        except Exception as error:
            self.notes.append(_not_in_lanes(error))
            return None
        if adaptive.rhs.obstacle:
            self.notes.append(f"rhs is not vectorised: {adaptive.rhs.obstacle}.")
        return adaptive

    def _shared(self) -> Shared | None:
        """Compile what runs in lanes; return None if the members run one at a time."""
        options, members = self.options, self.members
        if options.has_tolerances or options.t_eval is not None:
            return None
        method = options.method.for_force(self._callback.reads_velocity, members.n)
        followed = self._followed()
        layout = layout_of(members, method, sum(q.width for q in followed.values()), self.threads)
        if layout is None:
            return None
        try:
            rhs = lanes_of(self.rhs, self._callback, layout, compile_rhs)
            quantities = {
                name: (q, lanes_of(q.function, q.callback, layout, compile_quantity, q.shape))
                for name, q in followed.items()
            }
        except Exception as error:
            self.notes.append(_not_in_lanes(error))
            return None
        if rhs.obstacle:
            self.notes.append(f"rhs is not vectorised: {rhs.obstacle}.")
        kernel = wide_kernel(method.formulas, FOLLOWS if quantities else 0)
        plain: dict[str, Any] = {"save_every": None, "t_eval": None, "events": {}, "invariants": {}, "outputs": {}}
        alone = Singles(self.rhs, members, options, **plain)
        return Shared(members, layout, method, kernel, rhs, quantities, self.histories, alone, self._single)

    def _followed(self) -> dict[Any, Quantity]:
        """Return what is evaluated at each step: the invariants, the outputs, and the functions of the events."""
        form = self.members.form
        events = {
            SignOf(name): Quantity(f"events[{name!r}].g", event.g, form=form)
            for name, event in self.options.events.items()
        }
        return {**self._invariants, **self._outputs, **events}

    def march(self, progress: bool = False, cancel: Cancel | None = None) -> EnsembleSolution:
        """Run the members to their ends, or until `cancel` is set."""
        try:
            with DeferredInterrupt() as interrupt, Progress(len(self.members), "member", shown=progress) as bar:
                self._march(_Stop(interrupt, cancel), bar)
                solution = self.solution()
        except BaseException as error:  # raised by rhs, or after Ctrl-C
            with DeferredInterrupt() as again:
                error.solution = self.solution()  # type: ignore[attr-defined]
                if isinstance(error, KeyboardInterrupt):
                    again.forget()  # it is raised now
            raise
        return solution

    def _march(self, stop: _Stop, bar: Progress) -> None:
        if self.threads > 1 and len(self.work) > 1:
            self._march_in_threads(stop, bar)
            return
        for work in self.work:
            if stop.is_set():
                break
            work.run(stop)
            bar.add(len(work))

    def _march_in_threads(self, stop: _Stop, bar: Progress) -> None:
        # To wait for thousands of futures takes long. A `SimpleQueue` may wait for ever after a signal: what is left of
        # its timeout can then be negative, which means without an end (CPython 3.11).
        done = Queue[Future]()
        with ThreadPoolExecutor(self.threads) as pool:
            running = {pool.submit(work.run, stop): len(work) for work in self.work}
            try:
                for future in running:
                    future.add_done_callback(done.put)
                left = len(running)
                while left and not stop.is_set():
                    try:
                        future = done.get(timeout=_POLL_SECONDS)
                    except Empty:
                        continue
                    left -= 1
                    bar.add(running[future])
                    future.result()
            finally:
                stop.set()
                for future in running:
                    future.cancel()

    def solution(self) -> EnsembleSolution:
        """Return the results up to now."""
        seconds, first = sum(work.seconds for work in self.work), self.first
        repeat = Singles(self.rhs, self.members, self.options, save_every=1, t_eval=None)
        return self.histories.solution(
            self.rhs, first, seconds, self.notes, repeat, None if self.is_part else self._again
        )

    def _again(self, t_end: float, t_eval: ArrayLike | None, progress: bool, cancel: Cancel | None) -> EnsembleSolution:
        """Run all members to a later end."""
        end, t_end = self.members.t_span[1], check_time(t_end, "t_end")
        times = further_times(self.options.t_eval, t_eval, end, t_end)
        options = replace(self.options, t_eval=times)
        return Run(self.rhs, self.members.until(t_end), options, self.threads).march(progress, cancel)
