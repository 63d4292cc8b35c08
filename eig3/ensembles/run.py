"""`ensemble`: run many trajectories of one system, in SIMD lanes and on all cores."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from queue import Empty, Queue
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback, form_of
from ..functions.checks import check_count, check_method
from ..functions.guard import NotFiniteAtStartError, ReadsBeyondError, is_finite_at_start
from ..functions.layout import bound_layout
from ..functions.named import has_names
from ..functions.quantities import Functions, check_functions
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.numba_internals import Jitted, gist, options_of
from ..kernels.lanes import compile_quantity, compile_rhs
from ..kernels.loops.fixed import wide_kernel
from ..kernels.protocol import FOLLOWS
from ..methods import Method
from ..run.progress import Progress, check_progress
from ..stepping.stepper import Stepper
from .alone import Alone, alone
from .block import Block
from .histories import Histories
from .lanewise import lanes_of, layout_of
from .members import Members, check_members
from .named_members import split
from .parts import Joined, Listed, Recipe, Results, parts_of
from .shared import Shared
from .shipping import check_executor, check_reduce, march_parts
from .solution import EnsembleSolution, Reduce

_ALONE = 16  # members of a piece of work that runs them one at a time
_POLL_SECONDS = 0.05  # between two looks for Ctrl-C


def ensemble(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: ArrayLike,
    params: Any = (),
    method: str | Method = "eig3",
    save_every: int | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    reduce: Reduce | None = None,
    progress: bool = False,
    save_to: None = None,
) -> Any:
    """Integrate many trajectories of u'' = f(t, u, v) with fixed steps, in SIMD lanes and on all cores.

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
        The step. If it does not divide the span, the run takes the next shorter step that does.
    params : array_like, shape (k,) or (m, k); or NamedTuple or dict
        The parameters. rhs gets those of a member as p, of shape (k,). Of parameters with names, each array whose first
        axis has the length m has a value for each member.
    method, save_every, invariants, outputs, progress
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
    save_to : None
        An ensemble refuses this option of `eig3.integrate`, because `reduce` bounds its memory.

    Returns
    -------
    EnsembleSolution or list
        With `reduce`, the list of what it returned for each part. A member that becomes infinite or NaN has the status
        DIVERGED, and ends at its last finite state; the others continue.

    Raises
    ------
    TypeError, ValueError
        An argument is not valid, two shapes do not fit, or no member can start because rhs reads beyond its arrays.
    MemoryError
        The histories do not fit in memory.
    ImportError
        `progress` is True and tqdm is not installed.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` has the members that were finished, and the others as INTERRUPTED. With
        `reduce` it is the list, with None for unfinished parts. It is None if no member had started. What rhs raises is
        raised too, with the same attribute.

    Notes
    -----
    The numbers of a member do not depend on the other members, on its place or on the number of threads, to the last
    bit. A single member keeps these bits if it keeps its axis: ``params[i : i + 1]``, of shape (1, k). With `Langevin`,
    member i has the random numbers of the stream i, and takes this stream along: ``Langevin(..., stream=i)``.
    """
    if save_to is not None:
        raise TypeError("save_to is for single runs: take reduce=, a function that saves what you need of each part.")
    try:
        check_progress(progress)
        check_executor(executor)
        check_reduce(reduce)
        if has_names(params):
            params, first = split(params, form_of(rhs), u0, v0, h)
            rhs = first.layout.bind(rhs)
        layout = bound_layout(rhs)  # a problem's function is bound already
        if layout:
            method = layout.bind_method(method)
            invariants, outputs = layout.bind_all(invariants), layout.bind_all(outputs)
        _refuse_parallel(rhs)
        members = check_members(rhs, t_span, u0, v0, params, h)
        every = save_every if save_every is None else check_count(save_every, "save_every")
        cores = _cores() if threads is None else check_count(threads, "threads")
        given = rhs, members, check_method(method), every, check_functions(invariants, outputs)
        if executor is None and reduce is None:
            return Run(*given, cores).march(progress)
        return _in_parts(*given, reduce, executor, (cores, threads or 1), progress)
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


def _in_parts(
    rhs: Any,
    members: Members,
    method: Method,
    save_every: int | None,
    functions: Functions,
    reduce: Reduce | None,
    executor: Executor | None,
    threads: tuple[int, int],
    progress: bool,
) -> Any:
    """Run an ensemble in parts; `threads` are the numbers of threads of a part in this process, and on a worker."""
    parts = parts_of(members, save_every, functions.n_outputs)
    results: Results
    if reduce is None:
        histories = Histories(members, save_every, functions)
        results = Joined(histories, rhs, method, partial(alone, rhs, members, method))
    else:
        results = Listed(len(parts))
    recipe = Recipe(partial(_march, rhs, method, save_every, functions), reduce)
    return march_parts(parts, recipe, results, executor, threads, progress)


def _march(
    rhs: Any,
    method: Method,
    save_every: int | None,
    functions: Functions,
    members: Members,
    first: int,
    threads: int,
) -> EnsembleSolution:
    return Run(rhs, members, method, save_every, functions, threads, first).march()


def _cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Run:
    """An ensemble on its way in this process."""

    def __init__(
        self,
        rhs: Any,
        members: Members,
        method: Method,
        save_every: int | None,
        functions: Functions,
        threads: int,
        first: int = 0,
    ) -> None:
        self.rhs, self.members, self.method, self.first = rhs, members, method, first
        self.save_every, self.functions, self.threads = save_every, functions, threads
        self.histories = Histories(members, save_every, functions)
        self.notes: list[str] = []
        self._alone = partial(alone, rhs, members, method, save_every=None)
        self._callback = check_callback(rhs, "rhs", members.form)
        self._quantities = functions.quantities(members.form)
        self._check_start()
        self.work = self._work()

    def _check_start(self) -> None:
        """Check rhs, the method and the outputs in a first state, as for a single run.

        The member that serves for this is the first whose rhs is finite at the start. If there is none, each member
        will end at its start.
        """
        members, t0 = self.members, self.members.t_span[0]
        for i in range(len(members)):
            u, v, p = members.start(i).values()
            if is_finite_at_start(self._callback, members.form, t0, u, v, p):
                stepper = self._stepper(i)
                for output in self._quantities[1].values():
                    output.at_start(t0, *stepper.start, stepper.params, np.empty(output.width))
                return
        try:
            self._stepper(0)
        except NotFiniteAtStartError as error:
            if isinstance(error, ReadsBeyondError):
                raise

    def _stepper(self, i: int) -> Stepper:
        members = self.members
        return Stepper(
            self.rhs, **members.start(i), h=float(members.steps[i]), t0=members.t_span[0], method=self.method
        )

    def _work(self) -> list[Block | Alone]:
        order = np.argsort(self.members.n_steps, kind="stable")  # the members of a block end at similar times
        shared = self._shared()
        if shared:
            lanes = shared.layout.lanes
            return [Block(shared, order[i : i + lanes]) for i in range(0, len(order), lanes)]
        integrate = partial(self._alone, save_every=self.save_every, **self.functions._asdict())
        return [Alone(order[i : i + _ALONE], self.histories, integrate) for i in range(0, len(order), _ALONE)]

    def _shared(self) -> Shared | None:
        """Compile what runs in lanes; return None if the members run one at a time."""
        method = self.method.for_force(self._callback.reads_velocity, self.members.n)
        followed = self._quantities[0] | self._quantities[1]
        layout = layout_of(self.members, method, sum(q.width for q in followed.values()), self.threads)
        if layout is None:
            return None
        try:
            rhs = lanes_of(self.rhs, self._callback, layout, compile_rhs)
            quantities = {
                name: (q, lanes_of(q.function, q.callback, layout, compile_quantity, q.shape))
                for name, q in followed.items()
            }
        except Exception as error:
            self.notes.append(
                f"The members run one at a time, because a function does not compile for lanes: {gist(error)}; write "
                "loops over single values, without array expressions and without functions of whole arrays."
            )
            return None
        if rhs.obstacle:
            self.notes.append(f"rhs is not vectorised: {rhs.obstacle}.")
        kernel = wide_kernel(method.formulas, FOLLOWS if quantities else 0)
        return Shared(self.members, layout, method, kernel, rhs, quantities, self.histories, self._alone)

    def march(self, progress: bool = False) -> EnsembleSolution:
        """Run the members to their ends."""
        try:
            with DeferredInterrupt() as interrupt, Progress(len(self.members), "member", shown=progress) as bar:
                self._march(interrupt, bar)
                solution = self.solution()
        except BaseException as error:  # raised by rhs, or after Ctrl-C
            with DeferredInterrupt() as again:
                error.solution = self.solution()  # type: ignore[attr-defined]
                if isinstance(error, KeyboardInterrupt):
                    again.forget()  # it is raised now
            raise
        return solution

    def _march(self, interrupt: DeferredInterrupt, bar: Progress) -> None:
        # To wait for thousands of futures takes long. A `SimpleQueue` may wait for ever after a signal: what is left of
        # its timeout can then be negative, which means without an end (CPython 3.11).
        stop, done = Event(), Queue[Future]()
        with ThreadPoolExecutor(self.threads) as pool:
            running = {pool.submit(work.run, stop): len(work) for work in self.work}
            try:
                for future in running:
                    future.add_done_callback(done.put)
                left = len(running)
                while left and not interrupt.is_set():
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
        return self.histories.solution(self.rhs, self.method, self.first, seconds, self.notes, self._alone)
