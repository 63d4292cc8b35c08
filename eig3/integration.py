"""The run of a whole time history: native chunks under a Python loop that watches them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .analysis.divergence import before_divergence, divergence_message
from .checks import check_count, check_h, check_resolution, check_span
from .memory import check_history
from .methods import Method
from .observers.history import History
from .observers.interrupt import deferred_interrupt
from .observers.invariants import Watch, watches_of
from .observers.progress import check_progress, progress_bar
from .solution import Solution, Status
from .stepper import Stepper

_CHUNK_SECONDS = 0.1  # between looks at Ctrl-C and for divergence
_CHUNK_GROWTH = 16
_SCRATCH_VALUES = 2**19  # of one array of states on which only invariants are evaluated: 4 MB, to stay in cache


class IntegrationError(RuntimeError):
    """A run that did not complete, raised on request; `solution` holds what was computed."""

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
    """Integrate u'' = f(t, u, v) at a fixed step, the whole time history in compiled code.

    Parameters
    ----------
    rhs : jitted function
        The acceleration: ``f(t, u, v, p) -> a`` for one degree of freedom, ``f(t, u, v, p, a)`` writing every a[j] for
        n. Decorate it with ``@eig3.jit`` or ``@numba.njit``. One that writes to u, v or p does not compile.
    t_span : (float, float)
        First and last time.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at the first time. A float picks the first form of rhs, an array the second.
    h : float
        The step. One that does not divide the span is shrunk so that the last step lands on its end.
    params : float or array_like
        What rhs gets as p, a float64 array of one dimension.
    method : str or Method
        "eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", or a record such as ``EIG3(alpha=1.2)``.
    save_every : int or None
        Keep every so many-th state and the last; None keeps the two ends.
    invariants : dict of str to jitted function, optional
        ``e(t, u, v, p) -> float``, evaluated natively at every step, whatever is saved.
    inline : bool
        Compile the loop anew with rhs inlined: for long runs; costs about a second of compiling in each process.
    progress : bool
        Show a progress bar (needs tqdm).
    raise_on_failure : bool
        Raise `IntegrationError` where the run does not complete.

    Returns
    -------
    Solution
        A run that becomes non-finite ends as DIVERGED and keeps its finite part; one whose implicit solve fails ends as
        NOT_CONVERGED; Ctrl-C ends it as INTERRUPTED, with what was computed.

    Raises
    ------
    TypeError, ValueError
        For bad arguments, before anything runs.
    MemoryError
        When the history would not fit in memory.
    IntegrationError
        With `raise_on_failure`.

    Notes
    -----
    An exception raised by rhs comes through, with the part of the run up to the chunk that it ended as its attribute
    `solution`. `Stepper` is the same run in the caller's own chunks.

    An index out of bounds of a, u, v or p is not noticed, and overwrites whatever is there, unless NUMBA_BOUNDSCHECK=1
    is set before Python starts: it is then an IndexError. Numba's own ``cache=True`` does not tell checked code from
    unchecked, so that such a rhs needs an empty NUMBA_CACHE_DIR as well.
    """
    t0, t1 = check_span(t_span)
    n_steps, h = divide(t1 - t0, check_h(h))
    check_resolution(h, t0, t1)
    every = n_steps if save_every is None else min(check_count(save_every, "save_every"), n_steps)
    check_progress(progress)
    stepper = Stepper(rhs, u0, v0, h=h, t0=t0, params=params, method=method, inline=inline)
    check_history(n_steps, every, np.size(stepper.u))
    history = History(n_steps, every, stepper)
    watches = watches_of(invariants, stepper, n_steps)
    with progress_bar(progress, n_steps) as advance_bar:
        solution = _run(stepper, n_steps, history, watches, advance_bar)
    if solution.success:
        solution.t[-1] = t1  # which t0 + n h meets to round-off only
    elif raise_on_failure:
        raise IntegrationError(solution)
    return solution


def divide(span: float, h: float) -> tuple[int, float]:
    """The number of steps of at most `h` that fill `span`, and their length."""
    ratio = span / h
    if not ratio < 2**53:
        raise ValueError(
            f"h must be at least {span / 2**53:.3g} for this t_span, so that steps can be counted, not {h}."
        )
    # a step that divides the span but for round-off must not take one more step
    nearest = round(ratio)
    n_steps = max(1, nearest if math.isclose(ratio, nearest, rel_tol=1e-12) else math.ceil(ratio))
    return n_steps, span / n_steps


def _run(
    stepper: Stepper,
    n_steps: int,
    history: History,
    watches: list[Watch],
    tell: Callable[[int], object],
) -> Solution:
    status = Status.COMPLETED
    message: str | Callable[[], str] = "The run reached the end of its span."
    count = 1
    with deferred_interrupt() as interrupt:
        while stepper.index < n_steps:
            count = min(count, n_steps - stepper.index)
            if watches and history.every > 1:
                count = min(count, max(1, _SCRATCH_VALUES // np.size(stepper.u)))
            first, begin = stepper.index, time.perf_counter()
            try:
                taken = _advance(stepper, count, history, watches)
            except Exception as error:
                message = f"The right-hand side or an invariant raised {type(error).__name__} after t = {stepper.t:g}."
                error.solution = _finish(stepper, history, watches, Status.INTERRUPTED, message)  # type: ignore[attr-defined]
                raise
            if not stepper.is_finite:
                stepper, message = before_divergence(stepper)
                status = Status.DIVERGED
            elif taken < count:
                status, message = _failed_solve(stepper)
            elif interrupt.raised:
                status, message = Status.INTERRUPTED, f"The run was interrupted at t = {stepper.t:g}."
            tell(stepper.index - first)
            if status is not Status.COMPLETED:
                break
            count = _next_count(count, time.perf_counter() - begin)
    return _finish(stepper, history, watches, status, message)


def _advance(stepper: Stepper, count: int, history: History, watches: list[Watch]) -> int:
    """Take `count` steps, keep the rows asked for, and follow the invariants over every one."""
    first = stepper.index
    u_rows, v_rows = history.window(first, count)
    if not watches:
        return stepper.advance(count, history.every, u_rows, v_rows)
    if history.every == 1:
        u_all, v_all = u_rows, v_rows
    else:
        u_all, v_all = (np.empty((count, *u_rows.shape[1:])) for _ in range(2))
    taken = stepper.advance(count, 1, u_all, v_all)
    if history.every > 1:
        kept = slice(history.every - 1 - first % history.every, taken, history.every)
        u_rows[: len(u_all[kept])], v_rows[: len(v_all[kept])] = u_all[kept], v_all[kept]
    finite = taken if stepper.is_finite else _count_finite(u_all[:taken], v_all[:taken])
    for watch in watches:
        watch.follow(u_all[:finite], v_all[:finite])
    return taken


def _count_finite(u_rows: np.ndarray, v_rows: np.ndarray) -> int:
    finite = np.isfinite(u_rows) & np.isfinite(v_rows)
    return int(np.argmin(finite.reshape(len(finite), -1).all(axis=1)))


def _next_count(count: int, seconds: float) -> int:
    if seconds * _CHUNK_GROWTH <= _CHUNK_SECONDS:
        return count * _CHUNK_GROWTH
    return max(1, int(count * _CHUNK_SECONDS / seconds))


def _failed_solve(stepper: Stepper) -> tuple[Status, str | Callable[[], str]]:
    t = stepper.t + stepper.h
    if not math.isfinite(stepper.residual):
        return Status.DIVERGED, partial(divergence_message, stepper, stepper.failed_degree)
    remedies = ["a smaller h", "more max_iterations", "a larger tol"]
    if getattr(stepper.method, "solver", "newton") != "newton":
        remedies.append("solver='newton'")
    return Status.NOT_CONVERGED, (
        f"{stepper.method.label}'s solve for the velocity did not converge at t = {t:g}, where its residual is "
        f"{stepper.residual:.3g}; {', '.join(remedies[:-1])} or {remedies[-1]} may help."
    )


def _finish(
    stepper: Stepper, history: History, watches: list[Watch], status: Status, message: str | Callable[[], str]
) -> Solution:
    t, u, v = history.close(stepper)
    return Solution(
        t=t,
        u=u,
        v=v,
        h=stepper.h,
        n_steps=stepper.index,
        n_rhs=stepper.n_rhs,
        n_newton=stepper.n_iterations,
        status=status,
        _told=message,
        kernel_seconds=stepper.seconds,
        method=stepper.method,
        drift={watch.name: watch.drift for watch in watches},
        notes=_notes(watches, stepper) if status is Status.COMPLETED else (),
    )


def _notes(watches: list[Watch], stepper: Stepper) -> tuple[str, ...]:
    grown = [(watch.name, watch.growth) for watch in watches]
    return tuple(_growth_note(name, growth, stepper.method) for name, growth in grown if growth)


def _growth_note(name: str, growth: float, method: Method) -> str:
    amount = f"by {100 * growth:.2g} %" if growth < 1 else f"to {1 + growth:.3g} times its size"
    amount = amount if math.isfinite(growth) else "beyond the largest number there is,"
    return (
        f"{name} grows steadily, {amount} over the run; if the motion should keep it, {method!r} is "
        "slowly unstable here: take a smaller h, or a method that is stable for this system."
    )
