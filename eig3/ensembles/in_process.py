"""An ensemble in this process: its members in lanes or one at a time, on all cores."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from queue import Empty, Queue
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback
from ..functions.checks import check_time
from ..functions.guard import NotFiniteAtStartError, ReadsBeyondError, is_finite_at_start
from ..functions.records import records_of, shortest_loads, skips
from ..kernels.compile.interrupt import DeferredInterrupt
from ..run.progress import Progress
from ..stepping.march import Cancel, March
from ..stepping.observer import further_times
from ..stepping.run_options import RunOptions
from ..stepping.team import alone
from ..stepping.threads import Stop, cores
from .adaptive import AdaptiveBlock
from .block import Block
from .histories import Histories
from .lanewise import in_lanes
from .members import Members
from .single_members import Alone, Singles
from .solution import EnsembleSolution
from .step_notes import step_notes

_ALONE = 16  # members in a task that runs them one at a time
_PIECES = 4  # tasks for each thread, with tolerances
_READ = 16  # members whose records are read to find a step that skips much of them
_POLL_SECONDS = 0.05  # between two checks for Ctrl-C


class EnsembleRun:
    """A running ensemble in this process."""

    def __init__(self, rhs: Any, members: Members, options: RunOptions, threads: int, *, is_part: bool = False) -> None:
        self.rhs, self.members, self.options, self.threads, self.is_part = rhs, members, options, threads, is_part
        self.histories = Histories(members, options)
        self._single = Singles(rhs, members, options)
        self._callback = check_callback(rhs, "rhs", members.form)
        self._check_start()
        self.work = self._work()

    def _check_start(self) -> None:
        """Check rhs, the method, the events and the outputs in a first state, as for a single run.

        The check uses the first member whose rhs is finite at the start. If there is none, each member will end at its
        start.
        """
        members, (t0, _) = self.members, self.members.t_span
        for i in range(len(members)):
            u, v, p = members.start(i)
            if is_finite_at_start(self._callback, members.form, t0, u, v, p):
                self._at_start(i)
                return
        try:
            self._at_start(0)
        except NotFiniteAtStartError as error:
            if isinstance(error, ReadsBeyondError):
                raise

    def _at_start(self, i: int) -> March:
        return self._single.prepared(i).at_start(self.members.t_span, *self.members.start(i))

    def _work(self) -> list[Alone]:
        shared, note = in_lanes(self.rhs, self._callback, self.histories, self._single, self.threads)
        self.notes = [each for each in (note, self._skips()) if each]
        m = len(self.members)
        order = np.argsort(self.members.n_steps, kind="stable")  # the members of a block end at similar times
        if shared is None:
            return [Alone(order[i : i + _ALONE], self.histories, self._single) for i in range(0, m, _ALONE)]
        lanes = shared.layout.lanes
        if self.options.tolerances:
            pieces = max(1, min(_PIECES * self.threads, m // (_PIECES * lanes))) if self.threads > 1 else 1
            return [AdaptiveBlock(shared, numbers) for numbers in np.array_split(order, pieces)]
        return [Block(shared, order[i : i + lanes]) for i in range(0, m, lanes)]

    def _skips(self) -> str:
        """Return the note about the fixed steps of a member that skip much of a record; empty if there are none."""
        members = self.members
        if records_of(self.rhs) is None or self.options.tolerances:
            return ""
        loads = shortest_loads(self.rhs, members.params, members.own, members.t_span)
        rows, evaluations = np.atleast_2d(members.params), self.options.method.evaluations
        ratios = members.h / loads
        for i in np.argsort(-ratios, kind="stable")[:_READ].tolist():
            whose = f" of member {members.first + i}" if len(ratios) > 1 else ""
            given = rows[i % len(rows)], members.t_span, float(members.steps[i]), evaluations
            if note := skips(self.rhs, *given, whose):
                return note
        return ""

    def march(self, progress: bool = False, cancel: Cancel | None = None) -> EnsembleSolution:
        """Run the members to their ends, or until `cancel` is set."""
        try:
            with DeferredInterrupt() as interrupt, Progress(len(self.members), "member", shown=progress) as bar:
                with alone():
                    self._march(Stop(interrupt, cancel), bar)
                solution = self.solution()
            if not self.is_part:
                solution.notes += step_notes(solution, self._single, self.members, self.options)
        except BaseException as error:  # raised by rhs, or after Ctrl-C
            with DeferredInterrupt() as again:
                error.solution = self.solution()  # type: ignore[attr-defined]
                if isinstance(error, KeyboardInterrupt):
                    again.forget()  # it is raised now
            raise
        return solution

    def _march(self, stop: Stop, bar: Progress) -> None:
        if self.threads > 1 and len(self.work) > 1:
            self._march_in_threads(stop, bar)
            return
        for work in self.work:
            if stop.is_set():
                break
            work.run(stop)
            bar.add(len(work))

    def _march_in_threads(self, stop: Stop, bar: Progress) -> None:
        # Waiting for thousands of futures is slow. A `SimpleQueue` may wait for ever after a signal: the rest of its
        # timeout can then be negative, which means no timeout (CPython 3.11).
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
        """Return the results so far."""
        seconds = sum([work.seconds for work in self.work])
        return _result(self.rhs, self.histories, seconds, self.notes, is_part=self.is_part)


def at_start(rhs: Any, members: Members, options: RunOptions) -> EnsembleSolution:
    """Return the result of an ensemble whose members have not started."""
    return _result(rhs, Histories(members, options))


def _result(
    rhs: Any, histories: Histories, seconds: float = 0.0, notes: Sequence[str] = (), *, is_part: bool = False
) -> EnsembleSolution:
    given = rhs, histories.members, histories.options
    repeat = Singles(*given, save_every=1, t_eval=None)
    return histories.solution(rhs, seconds, notes, repeat, None if is_part else partial(_again, *given))


def _again(
    rhs: Any,
    members: Members,
    options: RunOptions,
    t_end: float,
    t_eval: ArrayLike | None,
    progress: bool,
    cancel: Cancel | None,
) -> EnsembleSolution:
    """Run all members to a later end, as `EnsembleSolution.extend` describes."""
    t_end = check_time(t_end, "t_end")
    times = further_times(options.t_eval, t_eval, members.t_span[1], t_end)
    return EnsembleRun(rhs, members.until(t_end), options._replace(t_eval=times), cores()).march(progress, cancel)
