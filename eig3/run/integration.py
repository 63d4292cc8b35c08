"""`integrate`: run a whole time history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from ..functions.checks import check_state
from ..functions.events import Event
from ..methods import Method
from ..result.solution import Solution
from ..stepping.march import Cancel
from .prepare import Prepared


def integrate(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: float | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    params: ArrayLike = (),
    method: str | Method | None = None,
    save_every: int | None = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event] | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    h_max: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    inline: bool = False,
    progress: bool = False,
    raise_on_failure: bool = False,
    cancel: Cancel | None = None,
    save_to: str | PathLike[str] | None = None,
) -> Solution:
    """Integrate u'' = f(t, u, v), with a fixed step or with tolerances. All steps run in compiled code.

    Give either h, the step, or rtol, from which the lengths of the steps follow.

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
        The step. If it does not divide the span, the run uses the next shorter step that does. If it is long for the
        motion, `solution.notes` says so.
    rtol : float
        The relative tolerance, such as 1e-6. The steps then have such lengths that the estimated error of each step is
        at most ``atol + rtol * size``, for u and v of each degree of freedom. With EIG-3, this holds for u only. The
        errors of the steps add up over the run: `eig3.plan` finds the rtol for an accuracy.
    atol : float or array_like, shape (n,) or (2, n), optional
        The absolute tolerance: a number, one for each degree of freedom, or a row for u and a row for v. The size of
        each value is then its own. Without atol, the size is the largest |u| so far of the degree of freedom, and the
        largest |v|: no unit has to be known, and a value that passes through zero does not shorten the steps. A size is
        at least 1e-3 of the largest one of all degrees of freedom, and more for rtol below 2e-8, where the round-off of
        large values would decide.
    params : float or array_like
        The parameters. rhs gets them as p, a one-dimensional array of float64.
    method : str or Method
        The name of a method, such as "eig3", "cd", "rk4" or "eig9" (all are in `eig3.METHODS`), its label in tables,
        such as "EIG-3", or a record such as ``EIG3(alpha=1.2)``. The default is "eig3". With tolerances, it is "rk5",
        "rk8" or "eig3"; the default is "rk8" for rtol below 1e-4, and "rk5" otherwise. EIG-3 with variable steps does
        not keep the energy as it does with a fixed step: the energy drifts.
    save_every : int or None
        Save every `save_every`-th state, the first and the last. None saves only the first and the last. With
        tolerances, 1 also saves the states before and after each event with `apply`.
    t_eval : array_like, optional
        Save the states at these increasing times instead; at the time of a reset, the state before it. They come from
        the dense output within the steps: of RK8 its continuous extension, of methods of other orders above 5 that of a
        step of RK8 from the same state, and of all others the polynomial of degree 5 through u, v and a at both ends of
        the step.
    events : dict of str to Event, optional
        Functions of the state whose zeros are found, by name, such as ``{"impact": eig3.Event(height)}``; see
        `eig3.Event`.
    invariants : dict of str to jitted function, optional
        Functions ``e(t, u, v, p) -> float`` by name. Compiled code evaluates them at every step, including steps that
        are not saved. The solution has their `drift`, over the ends of steps, and their `extremes`, as for outputs.
    outputs : dict of str to jitted function, or to (jitted function, k), optional
        Functions ``f(t, u, v, p) -> float`` by name, such as a spring force or a storey drift. For k values, give the
        pair (f, k) with ``f(t, u, v, p, out)``, which writes every out[j]. They are evaluated as invariants are:
        `solution.outputs` has their values at the saved states, and `solution.extremes` their extremes over the run,
        with their times. With a fixed step, these are the extremes over the ends of all steps and the states before and
        after events: the peak of a sine of angular frequency omega is up to the part ``(omega * h)**2 / 8`` too low.
        With tolerances, they are those of the motion, also within the steps: for a value that is smooth within a step,
        their error is of the size of the run's. This takes 3 more evaluations of rhs in each step of RK8.
    h_max, first_step : float, optional
        With tolerances: the longest step, and the first one. As long as the acceleration is zero and rhs reads t, a
        step is at most 2 % of the time since the start: give h_max if a load may act for less than that.
    max_steps : int, optional
        With tolerances: the run ends with the status TOO_MANY_STEPS after so many steps.
    inline : bool
        Compile the loop again, with rhs inlined. This makes long runs faster. It takes about a second of compilation in
        each process.
    progress : bool
        Show a progress bar. This needs tqdm.
    raise_on_failure : bool
        Raise `IntegrationError` if the run does not complete.
    cancel : threading.Event, optional
        Set it in another thread to end the run, which then has the status INTERRUPTED.
    save_to : str or path, optional
        A new or an empty directory. The history is written there while the run goes on, into the files t.npy, u.npy,
        v.npy and one for each output, so that it may be larger than memory, and `eig3.load` reads the directory. If the
        process is killed, by SIGKILL too, it returns the run up to its last record, some tenths of a second before, and
        `eig3.load(directory, rhs=...)` a run that can go on; this does not hold if the power fails.

    Returns
    -------
    Solution
        Its status is DIVERGED if the state becomes infinite or NaN, and the solution is then the finite part of the
        run. It is also DIVERGED if the motion stays finite, but grows by orders of magnitude because of the step. It is
        NOT_CONVERGED if the solve of an implicit step fails, and INTERRUPTED if `cancel` is set. It is TERMINATED after
        a terminal event, ZENO if the resets of an event follow each other without end or cannot hold the state
        where it rests, and STEP_TOO_SMALL if the tolerances need a step below the resolution of t.

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid. These errors are raised before the run starts.
    MemoryError
        If the history or the matrix of an implicit method does not fit in memory.
    OSError
        If `save_to` is a directory that holds files, or its disk is full. The space for the history is reserved before
        the run starts.
    ImportError
        If `progress` is True and tqdm is not installed.
    IntegrationError
        If `raise_on_failure` is True and the run does not complete.
    KeyboardInterrupt
        After Ctrl-C, within some milliseconds, or when the compiler is done. Its attribute `solution` contains the run
        up to then; it is None if no run had started. A program with a handler of its own decides itself: the handler is
        called, and if it raises nothing, the run goes on.

    Notes
    -----
    If rhs raises an exception, `integrate` raises it too, and its attribute `solution` contains the run up to the
    failing step. Use `Stepper` to control the run step by step.

    Numba does not check indices. The evaluation at the start detects a rhs that reads or writes just beyond its arrays.
    Later errors of this kind go undetected, and may overwrite other data, unless the environment variable
    NUMBA_BOUNDSCHECK is 1 when Python starts. They then raise an IndexError.
    """
    u, v, form = check_state(u0, v0)
    try:
        prepared = Prepared(
            rhs,
            form,
            h=h,
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
            inline=inline,
        )
    except KeyboardInterrupt as error:  # while a function was compiled
        error.solution = None  # type: ignore[attr-defined]
        raise
    options: dict[str, Any] = {"progress": progress, "raise_on_failure": raise_on_failure}
    return prepared(t_span, u, v, params, cancel=cancel, save_to=save_to, **options)
