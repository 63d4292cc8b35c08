"""`ensemble`: run many trajectories of one system, in SIMD lanes and on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..callbacks import check_callback, gist
from ..checks import check_count, check_method
from ..integration import integrate
from ..kernels.fixed import pointer_kernel
from ..kernels.interrupt import DeferredInterrupt
from ..kernels.protocol import VECTOR
from ..methods import Method
from ..observers.progress import check_progress
from ..solution import Solution
from ..stepper import Cancel, Stepper
from .alone import Alone
from .block import Block, Shared
from .histories import Histories
from .lanewise import lanes_of, layout_of
from .members import Members, check_members
from .solution import EnsembleSolution

_ALONE = 16  # members of a piece of work that runs them one at a time
_POLL_SECONDS = 0.05  # between two looks for Ctrl-C


def ensemble(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: ArrayLike,
    params: ArrayLike = (),
    method: str | Method = "eig3",
    save_every: int | None = None,
    invariants: Mapping[str, Any] | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    reduce: Callable[[EnsembleSolution], Any] | None = None,
    progress: bool = False,
) -> Any:
    """..."""
    members = check_members(rhs, t_span, u0, v0, params, h)
    if save_every is not None:
        save_every = check_count(save_every, "save_every")
    threads = _cores() if threads is None else check_count(threads, "threads")
    check_progress(progress)
    return Run(rhs, members, check_method(method), save_every, invariants or {}).march(threads, progress)


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Run:
    """An ensemble on its way in this process."""

    def __init__(
        self, rhs: Any, members: Members, method: Method, save_every: int | None, invariants: Mapping[str, Any],
        first: int = 0,
    ) -> None:
        self.rhs, self.members, self.method, self.first = rhs, members, method, first
        self.save_every, self.invariants = save_every, invariants
        self.histories = Histories(members, save_every, list(invariants))
        self.notes: list[str] = []
        self.work = self._work(self._checked())

    def _checked(self) -> Stepper:
        """Return the stepper of a member, which checks rhs, the method and their arguments as for a single run.

        The first member may start where rhs is not finite.
        """
        places = sorted({0, len(self.members) // 2, len(self.members) - 1})
        for i in places:
            try:
                return self._stepper(i)
            except ValueError:
                if i == places[-1]:
                    return self._stepper(0)
        raise AssertionError

    def _stepper(self, i: int) -> Stepper:
        members = self.members
        return Stepper(self.rhs, **members.start(i), h=float(members.steps[i]), t0=members.t_span[0], method=self.method)

    def _alone(self, i: int, cancel: Cancel | None = None, **options: Any) -> Solution:
        members = self.members
        return integrate(
            self.rhs, members.t_span, **members.start(i), h=float(members.steps[i]), method=self.method, cancel=cancel,
            **options,
        )

    def _work(self, stepper: Stepper) -> list[Block | Alone]:
        order = np.argsort(self.members.n_steps, kind="stable")  # the members of a block end at similar times
        shared = self._shared(stepper)
        if shared:
            lanes = shared.layout.lanes
            return [Block(shared, order[i : i + lanes]) for i in range(0, len(order), lanes)]
        options = {"save_every": self.save_every, "invariants": self.invariants}

        def alone(i: int, cancel: Cancel) -> Solution:
            return self._alone(i, cancel, **options)

        return [Alone(order[i : i + _ALONE], self.histories, alone) for i in range(0, len(order), _ALONE)]

    def _shared(self, stepper: Stepper) -> Shared | None:
        """Compile what runs in lanes; return None if the members run one at a time."""
        form, method = stepper.form, stepper.running
        layout = layout_of(self.members, method)
        if layout is None:
            return None
        functions = {name: (e, check_callback(e, "invariant", form, f"invariants[{name!r}]")) for name, e in self.invariants.items()}
        try:
            rhs = lanes_of(self.rhs, check_callback(self.rhs, "rhs", form), "rhs", layout)
            invariants = {name: lanes_of(*both, "invariant", layout) for name, both in functions.items()}
        except Exception as error:
            self.notes.append(f"The members run one at a time, because rhs does not compile for lanes: {gist(error)}.")
            return None
        if rhs.obstacle:
            self.notes.append(rhs.obstacle)
        kernel = pointer_kernel(method.formulas, VECTOR)
        return Shared(self.members, layout, method, kernel, rhs, invariants, self.histories, self._alone)

    def march(self, threads: int, progress: bool) -> EnsembleSolution:
        stop = Event()
        with DeferredInterrupt() as interrupt, ThreadPoolExecutor(threads) as pool:
            futures = {pool.submit(work.run, stop) for work in self.work}
            try:
                while futures:
                    done, futures = wait(futures, _POLL_SECONDS, FIRST_COMPLETED)
                    for future in done:
                        future.result()
                    if interrupt.is_set():
                        stop.set()
            finally:
                stop.set()
                for future in futures:
                    future.cancel()
        return self.solution()

    def solution(self) -> EnsembleSolution:
        members, histories = self.members, self.histories
        return EnsembleSolution(
            t=histories.t,
            u=histories.shaped(histories.u),
            v=histories.shaped(histories.v),
            h=members.steps,
            n_steps=histories.n_steps,
            n_rhs=histories.n_rhs,
            n_iterations=histories.n_iterations,
            status=histories.status,
            message=histories.message,
            params=members.params,
            method=self.method,
            drift=histories.drift,
            extremes=histories.extremes,
            first=self.first,
            kernel_seconds=sum(work.seconds for work in self.work),
            notes=tuple(self.notes),
            _last=histories.last,
            _repeat=self._alone,
        )
