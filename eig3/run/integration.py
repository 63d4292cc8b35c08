"""`integrate`: run a whole time history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_state
from ..functions.events import Event
from ..functions.first_order import check_z0
from ..functions.named import named
from ..functions.records import longest_step, records_of
from ..keywords import with_suggestions
from ..methods import Method
from ..result.solution import Solution
from ..stepping.march import Cancel
from ..stepping.run_options import run_options
from .accuracy import check_goal, reach, refuse_without_accuracy
from .prepare import Prepared, prepared_again


@with_suggestions()
def integrate(
    rhs: Any,
    t_span: Sequence[float],
    u0: ArrayLike,
    v0: ArrayLike,
    *,
    h: float | None = None,
    rtol: float | None = None,
    accuracy: float | Mapping[str, float] | None = None,
    scale: float | None = None,
    max_seconds: float | None = None,
    atol: ArrayLike | None = None,
    params: Any = (),
    z0: ArrayLike | Mapping[str, ArrayLike] | None = None,
    method: str | Method | None = None,
    save_every: int | None = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event] | None = None,
    invariants: Mapping[str, Any] | None = None,
    outputs: Mapping[str, Any] | None = None,
    invariants_every: int = 1,
    h_max: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    inline: bool = False,
    check: bool = False,
    progress: bool = False,
    raise_on_failure: bool = False,
    cancel: Cancel | None = None,
    save_to: str | PathLike[str] | None = None,
) -> Solution:
    """Integrate u'' = f(t, u, v) with a fixed step h or with tolerances; eig3/run/README.md has examples.

    Parameters
    ----------
    rhs : jitted function
        ``@eig3.jit`` of ``f(t, u, v, p) -> a``, or for n degrees of freedom ``f(t, u, v, p, a)``, which writes a only.
        With z0, ``f(t, u, v, z, p, a, dz)``, which writes z' to dz.
    t_span : (float, float)
        First and last time.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at the first time: floats for the first form of rhs, arrays for the second.
    h : float
        The fixed step. If it does not divide the span, the run takes the next shorter step that does.
    rtol, atol : float; atol also array_like, shape (n,) or (2, n)
        Tolerances, which bound the estimated error of each step by ``atol + rtol * size``. Without atol, a size is the
        largest |u| or |v| of the degree of freedom so far; with atol, it is the current |u| or |v|.
    accuracy, scale, max_seconds : float; accuracy also dict of str to float
        Instead of h or rtol: the largest estimated error of u, relative to max |u| or `scale`; max_seconds ends trials.
    params : float or array_like; or NamedTuple or dict
        The parameters. rhs gets them as p, a one-dimensional array of float64, or with their names, as ``p.k``.
    z0 : float or array_like, shape (k,); or dict of str to these
        First values of first-order unknowns z. Functions of events, invariants and outputs may take z before p.
    method : str or Method
        A name in `eig3.METHODS` such as "eig9", or a record such as ``EIG3(alpha=1.2)``; by default "eig3". With rtol:
        "rkn12" (default up to 1e-6 if rhs ignores v), "rk8" (default below 1e-4), "rk5" or "eig3".
    save_every : int or None
        Save every `save_every`-th state, and the first and the last; None saves only these two.
    t_eval : array_like, shape (m,)
        Save the states at these increasing times instead, from the dense output within the steps.
    events : dict of str to Event
        Events by name: functions of the state, whose zeros the run locates; see `eig3.Event`.
    invariants, invariants_every : dict of str to jitted function, int
        Functions ``e(t, u, v, p) -> float`` that the motion should conserve, evaluated at about every so many steps.
    outputs : dict of str to jitted function, or to (jitted function, k)
        Functions ``f(t, u, v, p) -> float``, or ``f(t, u, v, p, out)`` for k values; a tuple of their names may be k.
    h_max, first_step, max_steps : float, float, int
        With rtol: the longest step (by default, none jumps over a load or a pair force), the first, and the most steps.
    inline : bool
        Compile the loop with rhs inside: faster for long runs, for about a second of compilation.
    check, progress, raise_on_failure, cancel : bool, bool, bool, threading.Event
        Estimate the errors, by `Solution.check`; show a progress bar; raise `IntegrationError`; end when it is set.
    save_to : str or path
        A new or empty directory, to which the run writes its history as it computes; `eig3.load` reads it.

    Returns
    -------
    Solution
        Its `status` says how the run ended. A run that fails returns the states up to the last valid state.

    Raises
    ------
    TypeError, ValueError, ImportError
        An argument is not valid, or tqdm is missing. These errors are raised before the run starts.
    MemoryError, OSError
        The history does not fit in memory, or on the disk of `save_to`.
    KeyboardInterrupt
        After Ctrl-C. `solution` is the run up to then, or None. Exceptions from rhs have the same attribute.
    """
    u, v, form = check_state(u0, v0)
    params, unknowns = named(params), check_z0(rhs, z0, form)
    options: dict[str, Any] = {
        "h": h,
        "rtol": rtol,
        "atol": atol,
        "method": method,
        "save_every": save_every,
        "t_eval": t_eval,
        "events": events,
        "invariants": invariants,
        "outputs": outputs,
        "invariants_every": invariants_every,
        "h_max": h_max,
        "first_step": first_step,
        "max_steps": max_steps,
        "inline": inline,
        "first_order": unknowns[0],
    }
    layout = getattr(params, "layout", None)
    of_call: dict[str, Any] = {
        "check": check,
        "progress": progress,
        "raise_on_failure": raise_on_failure,
        "cancel": cancel,
        "save_to": save_to,
    }
    if accuracy is None:
        if scale is not None or max_seconds is not None:
            refuse_without_accuracy(scale=scale, max_seconds=max_seconds)
        return prepared_again(rhs, form, run_options(layout, **options))(t_span, u, v, params, z0=z0, **of_call)

    def prepared(**options: Any) -> Prepared:
        return Prepared(rhs, form, run_options(layout, **options), z0=unknowns[1])

    goal, longest = check_goal(accuracy, scale, max_seconds), longest_step(records_of(rhs), params, np.size(u))
    return reach(goal, rhs, prepared, options, (t_span, u, v, params), of_call, longest)
