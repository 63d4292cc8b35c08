"""Run the parts of an ensemble: on the workers of an executor, or one after the other in this process."""

from __future__ import annotations

import traceback
import uuid
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from typing import Any

from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.numba_internals import gist, pickled, unpickled
from ..methods import shown
from ..run.progress import Progress
from ..stepping.march import Cancel
from .members import Members
from .parts import Results
from .solution import EnsembleSolution, Reduce

_IN_FLIGHT = 128  # parts submitted to the executor at a time, to limit its memory
_TRIES = 3  # attempts for a part whose worker dies
_POLL_SECONDS = 0.05  # between two checks for Ctrl-C

#: ``march(members, threads, cancel)`` integrates the members of a part.
March = Callable[[Members, int, Cancel | None], EnsembleSolution]


def check_executor(executor: Any) -> None:
    """Raise a TypeError if `executor` is neither an executor nor None."""
    if executor is None or isinstance(executor, Executor):
        return
    if callable(getattr(executor, "get_executor", None)):
        raise TypeError("executor must be a concurrent.futures.Executor: pass client.get_executor(), not the client.")
    raise TypeError(
        "executor must be a concurrent.futures.Executor, such as a ProcessPoolExecutor or the get_executor() of a "
        f"dask.distributed Client, not {shown(executor)}."
    )


def check_reduce(reduce: Any) -> None:
    """Raise a TypeError if `reduce` is neither callable nor None."""
    if reduce is not None and not callable(reduce):
        raise TypeError(f"reduce must be a function of an EnsembleSolution, not {shown(reduce)}.")


def march_parts(
    parts: list[Members],
    march: March,
    reduce: Reduce | None,
    results: Results,
    executor: Executor | None,
    threads: tuple[int, int],
    progress: bool,
    cancel: Cancel | None = None,
) -> Any:
    """Run all parts, or the parts until `cancel` is set, and return all results.

    They run in this process without an executor; `threads` are the numbers of threads of a part here, and on a worker.
    """
    note = ""
    try:
        with Progress(sum(map(len, parts)), "member", shown=progress) as bar:

            def end(part: Members, value: Any) -> None:
                with DeferredInterrupt():
                    results.put(part, value)
                bar.add(len(part))

            left = parts
            if executor is not None:
                shipment = Shipment(executor, parts, march, reduce, threads[1])
                left = shipment.run(end, cancel)
                if shipment.is_broken and left:
                    note = f"The executor broke, and {len(left)} of {len(parts)} parts ran in this process."
            for part in left:
                if cancel is not None and cancel.is_set():
                    break
                solution = march(part, threads[0], cancel)
                if cancel is not None and cancel.is_set():
                    results.rescue(solution)
                else:
                    end(part, solution if reduce is None else reduce(solution))
                del solution  # the next part needs the memory
        with DeferredInterrupt():
            whole = results.whole(note)
    except BaseException as error:  # raised by rhs or reduce, or after Ctrl-C
        with DeferredInterrupt() as again:
            results.rescue(getattr(error, "solution", None))
            error.solution = results.whole(note)  # type: ignore[attr-defined]
            if isinstance(error, KeyboardInterrupt):
                again.forget()  # it is raised now
        raise
    return whole


class Shipment:
    """The parts submitted to the workers of an executor, each with a number of threads.

    Raises
    ------
    TypeError
        If a function of the user cannot be pickled.
    """

    def __init__(
        self, executor: Executor, parts: list[Members], march: March, reduce: Reduce | None, threads: int
    ) -> None:
        self.executor, self.threads = executor, threads
        self.waiting, self.running = deque(parts), dict[Future, Members]()
        self.losses: Counter[int] = Counter()
        self.is_broken = False
        packed = _packed(march, "rhs, the events, the invariants and the outputs")
        self.recipe = packed, _packed(reduce, "reduce")

    def run(self, end: Callable[[Members, Any], None], cancel: Cancel | None = None) -> list[Members]:
        """Run the parts; call ``end(part, value)`` for each. Return the unfinished parts if the executor broke."""
        try:
            with DeferredInterrupt() as interrupt:
                while self.running or (self.waiting and not self.is_broken):
                    self._submit()
                    done, _ = wait(self.running, _POLL_SECONDS, FIRST_COMPLETED)
                    if interrupt.is_set() or (cancel is not None and cancel.is_set()):
                        break
                    for future in done:
                        self._receive(self.running.pop(future), future, end)
        finally:
            for future in self.running:
                future.cancel()
        return sorted(self.waiting, key=lambda part: part.first)

    def _submit(self) -> None:
        while self.waiting and len(self.running) < _IN_FLIGHT and not self.is_broken:
            unique = str(uuid.uuid4())
            try:
                future = self.executor.submit(run_part, *self.recipe, self.waiting[0], self.threads, unique)
            except BrokenExecutor:
                self.is_broken = True
            else:
                self.running[future] = self.waiting.popleft()

    def _receive(self, part: Members, future: Future, end: Callable[[Members, Any], None]) -> None:
        loss = CancelledError() if future.cancelled() else future.exception()
        if loss is None:
            value, error, trace = unpickled(future.result())
            if error is not None:
                raise error from RuntimeError(f"On the worker:\n{trace}")
            end(part, value)
            return
        self.waiting.appendleft(part)
        self.losses[part.first] += 1
        if isinstance(loss, BrokenExecutor):
            self.is_broken = True
        elif self.losses[part.first] == _TRIES:
            raise RuntimeError(
                f"the executor lost members {part.first} to {part.first + len(part) - 1} {_TRIES} times; a worker may "
                f"have too little memory, or no eig3. The last time it raised {type(loss).__name__}: {loss}"
            ) from loss


def run_part(march: bytes, reduce: bytes, part: Members, threads: int, unique: str) -> bytes:
    """Run a part on a worker by pickled functions, and return ``(value, error, trace)``, pickled.

    An exception of the user's function is returned, not raised: if the future has an exception, the worker is lost. The
    text `unique` differs in each call: dask merges calls with equal arguments.
    """
    try:
        runs, reduces = unpickled(march), unpickled(reduce)
        value = runs(part, threads, None)
        return _packed((value if reduces is None else reduces(value), None, ""), "What reduce returns")
    except Exception as error:
        return _packed_error(error, traceback.format_exc())


def _packed(value: Any, name: str) -> bytes:
    try:
        return pickled(value)
    except Exception as error:
        raise TypeError(f"{name} must be picklable, to be sent between processes: {gist(error)}.") from error


def _packed_error(error: Exception, trace: str) -> bytes:
    try:
        packed = pickled((None, error, trace))
        unpickled(packed)  # this fails for many exception classes with several arguments
    except Exception:
        return pickled((None, RuntimeError(f"{type(error).__name__}: {error}"), trace))
    return packed
