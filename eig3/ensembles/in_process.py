"""An ensemble in this process: its members in lanes or one at a time, on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from queue import Empty, Queue
from threading import Event as Flag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback
from ..functions.checks import check_time
from ..functions.companions import constraints_of
from ..functions.guard import NotFiniteAtStartError, ReadsBeyondError, is_finite_at_start
from ..functions.layout import bound_layout
from ..functions.quantities import Functions, Quantity
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.numba_internals import gist
from ..kernels.constraint_lanes import Straight
from ..kernels.lanes import Lanes, Layout, compile_quantity, compile_rhs, compile_watched
from ..kernels.loops.fixed import wide_kernel
from ..kernels.protocol import FOLLOWS, VECTOR
from ..run.progress import Progress
from ..stepping.march import Cancel, March
from ..stepping.options import RunOptions
from ..stepping.team import alone
from ..stepping.watching import further_times
from .adaptive import LANES, Adaptive, AdaptiveBlock, in_lanes, runs_in_lanes
from .block import Block
from .block_setup import BlockSetup, SignOf
from .histories import Histories
from .lanewise import MOST_DEGREES, ROWS_FOLLOWED, constrained_of, keeping_of, lanes_of, layout_of
from .members import Members
from .single_members import Alone, Singles
from .solution import EnsembleSolution
from .stops import Stops

_ALONE = 16  # members of a piece of work that runs them one at a time
_PIECES = 4  # of the members with tolerances, for each thread
_POLL_SECONDS = 0.05  # between two looks for Ctrl-C


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _not_in_lanes(error: Exception) -> str:
    return (
        f"The members run one at a time, because a function does not compile for lanes: {gist(error)}; write "
        "loops over single values, without array expressions and without functions of whole arrays."
    )


_AT_TIMES = "The members run one at a time, because lanes with fixed steps have no t_eval; save_every is possible."
_MANY_CONSTRAINTS = (
    "The members run one at a time, because lanes are for scenes with at most 8 constraints and 24 degrees of freedom, "
    "with forces on at most 8 points of bodies, and without near pairs and constraints that depend on the time or have "
    "a phi of their own."
)
_OTHER_CONSTRAINTS = (
    "The members run one at a time, because params are those of scenes whose constraints join other points than those "
    "of this problem; make a problem of each such scene."
)
_SPARSE = (
    "The members run one at a time, because params have a sparse matrix and differ between members; lanes read "
    "a sparse matrix only from params that all members share."
)
_FOLLOWED = (
    "The members run one at a time, because runs with tolerances in lanes have no save_every, no invariants and no "
    "outputs; t_eval and events are possible."
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

    def __init__(self, rhs: Any, members: Members, options: RunOptions, threads: int, *, is_part: bool = False) -> None:
        self.rhs, self.members, self.options, self.threads, self.is_part = rhs, members, options, threads, is_part
        self.histories = Histories(members, options)
        self.notes: list[str] = []
        self._single = Singles(rhs, members, options)
        self._callback = check_callback(rhs, "rhs", members.form)
        self._straight, self._refusal = _straight_of(rhs, members)
        self._invariants, self._outputs = options.functions.quantities(members.form)
        self._check_start()
        self.work = self._work()

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
        start = self.members.start(i, len(self.options.quadratures))
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
        if not runs_in_lanes(members, self._straight):
            return None
        if self._refusal:
            self.notes.append(self._refusal)
            return None
        if options.save_every is not None or self._invariants or self._outputs:
            self.notes.append(_FOLLOWED)
            return None
        given = members, self._single.prepared(0), [*self._followed().values()], self.histories, self._single
        try:
            adaptive = in_lanes(self.rhs, self._callback, self._straight, *given)
        except Exception as error:
            self.notes.append(_not_in_lanes(error))
            return None
        if adaptive.rhs.obstacle:
            self.notes.append(f"rhs is not vectorised: {adaptive.rhs.obstacle}.")
        return adaptive

    def _shared(self) -> BlockSetup | None:
        """Compile what runs in lanes; return None if the members run one at a time."""
        options, members = self.options, self.members
        if options.has_tolerances:
            return None
        if options.t_eval is not None:
            self.notes.append(_AT_TIMES)
            return None
        if self._refusal:
            self.notes.append(self._refusal)
            return None
        method, straight = options.method.for_force(self._callback.reads_velocity, members.n), self._straight
        method = method.with_constraints() if straight else method
        followed = self._followed()
        rows = sum(1 if isinstance(name, SignOf) else ROWS_FOLLOWED * q.width for name, q in followed.items())
        rows += straight.room + members.n if straight else 0
        layout = layout_of(members, method, rows, self.threads)
        if layout is None:
            return None
        try:
            mine, keeping = (self.rhs, self._callback, layout), None
            if straight:
                rhs = constrained_of(*mine, straight, VECTOR.rhs, compile_rhs)
                keeping = keeping_of(*mine, straight, bool(method.second))
            else:
                rhs = lanes_of(*mine, compile_rhs)
            quantities = {name: (q, self._compiled(name, q, layout)) for name, q in followed.items()}
        except Exception as error:
            self.notes.append(_not_in_lanes(error))
            return None
        if rhs.obstacle:
            self.notes.append(f"rhs is not vectorised: {rhs.obstacle}.")
        looks = FOLLOWS if quantities or (keeping and not keeping.is_leap) else 0
        kernel = wide_kernel(method.formulas, looks, method.second)
        plain: dict[str, Any] = {"save_every": None, "t_eval": None, "events": {}, "functions": Functions({}, {})}
        alone = Singles(self.rhs, members, options, **plain)
        stops = Stops(self._single.prepared(0).system, members, method) if self._is_stopped() else None
        given = rhs, keeping, quantities, stops, self.histories, alone, self._single
        return BlockSetup(members, layout, method, kernel, *given)

    def _is_stopped(self) -> bool:
        """Whether members in lanes with fixed steps look for events that do nothing but end them, and for no more."""
        events = self.options.events.values()
        only_ends = bool(events) and all(event.terminal and event.apply is None for event in events)
        return only_ends and not (self._invariants or self._outputs or self._straight)

    def _compiled(self, name: Any, q: Quantity, layout: Layout) -> Lanes:
        """Compile a quantity, or the function of an event, for lanes."""
        if isinstance(name, SignOf):
            direction = int(self.options.events[name.event].direction)
            return lanes_of(q.function, q.callback, layout, compile_watched, direction, self._is_stopped())
        return lanes_of(q.function, q.callback, layout, compile_quantity, q.shape)

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
                with alone():
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
        seconds = sum(work.seconds for work in self.work)
        again = None if self.is_part else partial(_again, self.rhs, self.members, self.options)
        given = self.rhs, self.members, self.options, self.histories
        return _result(*given, seconds, self.notes, again=again)


def _straight_of(rhs: Any, members: Members) -> tuple[Straight | None, str]:
    """Return the constraints of a scene for lanes, if there are any, or why the members run one at a time."""
    layout = bound_layout(rhs)
    if layout and members.has_own_params and members.n <= MOST_DEGREES and any(kind.ndim < 0 for kind in layout.kinds):
        return None, _SPARSE
    constraints = constraints_of(rhs)
    if constraints is None:
        return None, ""
    if constraints.straight is None:
        return None, _MANY_CONSTRAINTS
    if not constraints.straight.are_those_of(members.params):
        return None, _OTHER_CONSTRAINTS
    return constraints.straight, ""


def at_start(rhs: Any, members: Members, options: RunOptions) -> EnsembleSolution:
    """Return the result of an ensemble whose members have not started."""
    again = partial(_again, rhs, members, options)
    return _result(rhs, members, options, Histories(members, options), again=again)


def _result(
    rhs: Any,
    members: Members,
    options: RunOptions,
    histories: Histories,
    seconds: float = 0.0,
    notes: Sequence[str] = (),
    *,
    again: Callable[..., EnsembleSolution] | None,
) -> EnsembleSolution:
    repeat = Singles(rhs, members, options, save_every=1, t_eval=None)
    return histories.solution(rhs, seconds, notes, repeat, again)


def _again(
    rhs: Any,
    members: Members,
    options: RunOptions,
    t_end: float,
    t_eval: ArrayLike | None,
    progress: bool,
    cancel: Cancel | None,
) -> EnsembleSolution:
    """Run all members to a later end, as `EnsembleSolution.extend` describes it."""
    t_end = check_time(t_end, "t_end")
    times = further_times(options.t_eval, t_eval, members.t_span[1], t_end)
    return Run(rhs, members.until(t_end), options._replace(t_eval=times), cores()).march(progress, cancel)
