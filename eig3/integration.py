"""`integrate`: run a whole time history. A Python loop calls the kernel for one chunk of steps after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .analysis.divergence import Divergence, find_blow_up, find_divergence
from .checks import check_count, check_h, check_resolution, check_span
from .memory import check_history
from .methods import Method
from .observers.chunk import Chunk, Observer
from .observers.growth import Growth
from .observers.history import History
from .observers.interrupt import Flag, deferred_interrupt
from .observers.invariants import Watch, watches_of
from .observers.progress import Progress, check_progress
from .solution import Solution, Status
from .stepper import Stepper

_CHUNK_SECONDS = 0.1  # duration of a chunk; Ctrl-C and divergence are checked between chunks
_CHUNK_GROWTH = 16  # largest factor from the steps of one chunk to the steps of the next
_SHORT_SECONDS = 1e-3  # a run that is expected to be shorter does not defer Ctrl-C


class IntegrationError(RuntimeError):
    """A run with ``raise_on_failure=True`` did not complete.

    Attributes
    ----------
    solution : Solution
        The part of the run that was computed.
    """

    def __init__(self, solution: Solution) -> None:
        super().__init__(solution.message)
        self.solution = solution

    def __reduce__(self) -> tuple:
        return type(self), (self.solution,)


def integrate(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: float,
    params: ArrayLike = (),
    method: str | Method = "eig3",
    save_every: int | None = 1,
    invariants: Mapping[str, Any] | None = None,
    inline: bool = False,
    progress: bool = False,
    raise_on_failure: bool = False,
) -> Solution:
    """Integrate u'' = f(t, u, v) with a fixed step. All steps run in compiled code.

    Parameters
    ----------
    rhs : jitted function
        The acceleration. For one degree of freedom it has the scalar form ``f(t, u, v, p) -> a``. For n degrees of
        freedom it has the vector form ``f(t, u, v, p, a)``, and writes every a[j]. Decorate it with ``@eig3.jit`` or
        ``@numba.njit``. A function that writes to u, v or p does not compile.
    t_span : (float, float)
        First and last time.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at the first time. Floats need the scalar form of rhs, arrays the vector form.
    h : float
        The step. If it does not divide the span, the run uses the next shorter step that does.
    params : float or array_like
        The parameters. rhs gets them as p, a one-dimensional array of float64.
    method : str or Method
        "eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", or a record such as ``EIG3(alpha=1.2)``.
    save_every : int or None
        Save every `save_every`-th state, the first and the last. None saves only the first and the last.
    invariants : dict of str to jitted function, optional
        Functions ``e(t, u, v, p) -> float`` by name. Compiled code evaluates them at every step, including steps that
        are not saved.
    inline : bool
        Compile the loop again, with rhs inlined. This makes long runs faster. It takes about a second of compilation in
        each process.
    progress : bool
        Show a progress bar. This needs tqdm.
    raise_on_failure : bool
        Raise `IntegrationError` if the run does not complete.

    Returns
    -------
    Solution
        Its status is DIVERGED if the state becomes infinite or NaN, and the solution is then the finite part of the
        run. It is also DIVERGED if the motion stays finite, but grows by orders of magnitude because of the step. It is
        NOT_CONVERGED if the solve of an implicit step fails, and INTERRUPTED after Ctrl-C, with the states up to then.
        In a run shorter than about a millisecond, Ctrl-C raises KeyboardInterrupt as usual.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid. These errors are raised before the run starts.
    MemoryError
        If the history or the matrix of an implicit method does not fit in memory.
    ImportError
        If `progress` is True and tqdm is not installed.
    IntegrationError
        If `raise_on_failure` is True and the run does not complete.

    Notes
    -----
    If rhs raises an exception, `integrate` raises it too, and its attribute `solution` contains the run up to the
    failing step. Use `Stepper` to control the run step by step.

    Numba does not check indices. The evaluation at the start detects a rhs that reads or writes just beyond its arrays.
    Later errors of this kind go undetected, and may overwrite other data, unless the environment variable
    NUMBA_BOUNDSCHECK is 1 when Python starts. They then raise an IndexError. If rhs has ``cache=True``, this also needs
    an empty NUMBA_CACHE_DIR, because Numba's cache does not distinguish checked code from unchecked code.
    """
    t0, t1 = check_span(t_span)
    n_steps, h = divide(t1 - t0, check_h(h))
    check_resolution(h, t0, t1)
    every = n_steps if save_every is None else min(check_count(save_every, "save_every"), n_steps)
    check_progress(progress)
    stepper = Stepper(rhs, u0, v0, h=h, t0=t0, params=params, method=method, inline=inline)
    check_history(n_steps, every, np.size(stepper.start[0]))
    watches = watches_of(invariants, stepper, n_steps)
    run = _Run(stepper, n_steps, History(n_steps, every, stepper, bool(watches)), watches, progress)
    solution = run.solution()
    if solution.n_steps == n_steps:
        solution.t[-1] = t1  # t0 + n h may differ from t1 by round-off
    if raise_on_failure and not solution.success:
        raise IntegrationError(solution)
    return solution


def divide(span: float, h: float) -> tuple[int, float]:
    """Return the number of steps of at most `h` that fill `span`, and the length of these steps."""
    ratio = span / h
    if not ratio < 2**53:
        raise ValueError(
            f"h must be at least {span / 2**53:.3g} for this t_span, so that steps can be counted, not {h}."
        )
    # If h divides the span except for round-off, there must not be one more step.
    nearest = round(ratio)
    n_steps = max(1, nearest if math.isclose(ratio, nearest, rel_tol=1e-12) else math.ceil(ratio))
    return n_steps, span / n_steps


class _Run:
    """A run in chunks of steps, with its observers."""

    def __init__(self, stepper: Stepper, n_steps: int, history: History, watches: list[Watch], progress: bool) -> None:
        self.stepper, self.n_steps = stepper, n_steps
        self.history, self.watches, self.growth = history, watches, Growth(stepper, n_steps)
        self.bar = Progress(n_steps) if progress else None
        self.observers: list[Observer] = [history, *watches, self.growth, *([self.bar] if self.bar else [])]
        self.status = Status.COMPLETED
        self.message = "The run reached the end of its span."
        self.reason: Callable[[], str] | None = None

    def solution(self) -> Solution:
        """Run to the end, or until the run fails or is interrupted, and return the solution."""
        try:
            with self._interrupt() as interrupt:
                self._march(interrupt)
        except Exception as error:
            self._end(
                Status.INTERRUPTED, f"A function of the run raised {type(error).__name__} after t = {self.stepper.t:g}."
            )
            error.solution = self._result()  # type: ignore[attr-defined]
            raise
        finally:
            if self.bar:
                self.bar.close()
        if self.status is Status.COMPLETED:
            self._judge_growth()
        return self._result()

    def _interrupt(self) -> AbstractContextManager[Flag]:
        """Defer Ctrl-C, except in a very short run: in a loop of such runs, an INTERRUPTED run could go unnoticed."""
        pace = self.stepper.pace
        return nullcontext(Flag()) if pace and pace * self.n_steps < _SHORT_SECONDS else deferred_interrupt()

    def _march(self, interrupt: Flag) -> None:
        stepper, failing = self.stepper, False
        count = self._first_count()
        while stepper.index < self.n_steps and self.status is Status.COMPLETED:
            count = min(count, self.n_steps - stepper.index, self.history.most)
            begin = time.perf_counter()
            try:
                chunk = self.history.advance(stepper, count)
            except Exception:
                if count == 1:
                    raise
                failing, count = True, count // 2  # compute the steps before the one that raises
                continue
            if not stepper.is_finite:
                chunk = self._end_diverged(chunk)
            elif stepper.index - chunk.first < count:
                self._end_unsolved()
            elif interrupt.raised:
                self._end(Status.INTERRUPTED, f"The run was interrupted at t = {stepper.t:g}.")
            for observer in self.observers:
                observer.see(chunk)
            if not failing:
                count = _next_count(count, time.perf_counter() - begin)
        self.stepper.note_pace()

    def _first_count(self) -> int:
        """The steps of the first chunk: as many as fill its duration if the time per step is known, and 1 otherwise."""
        most = (self.n_steps + 1) // 2 if self.growth.needs_half else self.n_steps
        pace = self.stepper.pace
        return min(most, max(1, int(_CHUNK_SECONDS / pace))) if pace else 1

    def _end(self, status: Status, message: str, reason: Callable[[], str] | None = None) -> None:
        self.status, self.message, self.reason = status, message, reason

    def _end_diverged(self, chunk: Chunk) -> Chunk:
        """End the run at its last finite state, and return the part of the chunk up to that state."""
        divergence = find_divergence(self.stepper)
        self.stepper = divergence.last
        self._end(Status.DIVERGED, divergence.message, divergence.explain)
        finite = self.stepper.index // chunk.every - chunk.first // chunk.every
        return chunk._replace(u=chunk.u[:finite], v=chunk.v[:finite], stepper=self.stepper)

    def _end_unsolved(self) -> None:
        stepper = self.stepper
        if not math.isfinite(stepper.residual):
            divergence = Divergence(stepper, stepper.failed_degree, stepper.before())
            self._end(Status.DIVERGED, divergence.message, divergence.explain)
            return
        remedies = ["a smaller h", "more max_iterations", "a larger tol"]
        if not stepper.running.formulas.matrix:
            remedies.append("solver='newton'")
        self._end(
            Status.NOT_CONVERGED,
            f"{stepper.method.label}'s solve for the velocity did not converge at t = {stepper.t + stepper.h:g}, where "
            f"its residual is {stepper.residual:.3g}; {', '.join(remedies[:-1])} or {remedies[-1]} may help.",
        )

    def _judge_growth(self) -> None:
        """Change the status to DIVERGED if the motion stayed finite, but grew because of its step."""
        suspect = self.growth.suspect
        blow_up = suspect and find_blow_up(self.stepper, suspect)
        if blow_up:
            self._end(Status.DIVERGED, blow_up.message, blow_up.explain)

    def _result(self) -> Solution:
        stepper = self.stepper
        t, u, v = self.history.close(stepper)
        return Solution(
            t=t,
            u=u,
            v=v,
            h=stepper.h,
            n_steps=stepper.index,
            n_rhs=stepper.n_rhs,
            n_iterations=stepper.n_iterations,
            status=self.status,
            message=self.message,
            kernel_seconds=stepper.seconds,
            method=stepper.method,
            drift={watch.name: watch.drift for watch in self.watches},
            notes=(*self._notes(), *stepper.notes),
            reason=self.reason,
        )

    def _notes(self) -> Iterator[str]:
        for watch in self.watches if self.status is Status.COMPLETED else ():
            if watch.growth:
                yield watch.note(self.stepper.method)


def _next_count(count: int, seconds: float) -> int:
    if seconds * _CHUNK_GROWTH <= _CHUNK_SECONDS:
        return count * _CHUNK_GROWTH
    return max(1, int(count * _CHUNK_SECONDS / seconds))
