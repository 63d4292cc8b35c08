"""Prepare a run once and run it many times: all checks, choices and compilation happen before the first run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback, form_of
from ..functions.checks import check_flag, check_params, check_resolution, check_span, check_state, shown
from ..functions.first_order import check_z0
from ..functions.guard import guarded
from ..functions.named import WITHOUT_NAMES, has_names, in_layout, named
from ..functions.records import check_left_out, check_size, left_out_of, longest_step, records_of
from ..functions.rules import Rules
from ..kernels.compile.interrupt import with_solution
from ..kernels.protocol import SCALAR, VECTOR, Form
from ..keywords import refusal, with_suggestions
from ..methods import Method
from ..result.memory import n_rows
from ..result.solution import Solution
from ..result.storage import Place, keep_error
from ..stepping.march import Cancel, March
from ..stepping.observer import check_times
from ..stepping.run_options import NEVER, RunOptions, run_options
from ..stepping.stepper import Stepper
from ..stepping.system import System, remembered
from ..stepping.tolerances import Tolerances, usual_method
from ..stepping.variable_stepper import VariableStepper
from . import short
from .chunks import Run, carry_out, check_repeatable
from .fixed_run import FixedRun, divide
from .progress import check_progress
from .variable_run import VariableRun, short_with_tolerances

_OF_A_CALL = "t_span", "u0", "v0", "params", "z0", "check", "progress", "raise_on_failure", "cancel", "save_to"
_SHORT = 1e-12  # a step shorter than this fraction of the time may be too short for floating-point times


class Prepared:
    """A prepared run: call it with a span and initial values as often as you like, in any thread.

    `eig3.prepare` and `Problem.prepare` return it. A call takes some microseconds in addition to its steps.

    Attributes
    ----------
    form : str
        "scalar" or "vector": whether u0 and v0 are numbers or arrays.
    method : Method
    options : RunOptions
    system : System
        The functions and the kernels of the run, compiled.
    rules : Rules or None
        What holds at a start that does not lie behind an event.
    """

    @with_solution
    def __init__(
        self,
        rhs: Any,
        form: Form,
        options: RunOptions,
        defaults: tuple = (),
        z0: np.ndarray | None = None,
        longest: float = math.inf,
    ) -> None:
        self._defaults, self._z0, self._longest, layout = defaults, z0, longest, options.layout
        unknowns = options.first_order
        rhs = unknowns.bind_rhs(rhs) if unknowns.is_read else rhs
        rhs = layout.bind(rhs) if layout else rhs
        self._t_eval, self._every = options.t_eval, options.every
        if defaults:  # arrays are checked faster than other sequences at each call
            span, u0, v0, params = defaults
            self._defaults = span, *check_state(u0, v0)[:2], params if layout else check_params(params)
        if options.tolerances and not options.method:
            reads_velocity = check_callback(rhs, "rhs", form).reads_velocity
            options = options._replace(method=usual_method(options.tolerances.rtol, reads_velocity))
        self.options = options
        self.system: System = remembered(rhs, form, options)
        records = records_of(rhs)
        self._left_out = left_out_of(rhs)
        self._records = records if records and (records.check or options.tolerances) else None
        self.rules = Rules(options.events, self.system.event_table, self.system.project) or None
        self._tolerances: dict[int, Tolerances] = {}
        self._checked_times: tuple[Any, Any] = None, None

    @property
    def form(self) -> str:
        return self.system.form.name

    @property
    def method(self) -> Method:
        return self.system.method

    def __call__(
        self,
        t_span: Sequence[float] | None = None,
        u0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        params: Any = (),
        *,
        z0: Any = None,
        check: bool = False,
        progress: bool = False,
        raise_on_failure: bool = False,
        cancel: Cancel | None = None,
        save_to: str | PathLike[str] | None = None,
        **unknown: Any,
    ) -> Solution:
        """Run from a start.

        Parameters
        ----------
        t_span : (float, float)
        u0, v0 : float or array_like, shape (n,)
        params : float or array_like, NamedTuple or dict
        z0 : float or array_like, or dict
            Arguments left out have the values of the problem, for a run from `Problem.prepare`. Other runs need a span,
            u0 and v0; without z0, they start from the z0 of `eig3.prepare`.
        check, progress, raise_on_failure, cancel, save_to
            As for `eig3.integrate`.

        Returns
        -------
        Solution

        Raises
        ------
        TypeError, ValueError, MemoryError, OSError, ImportError, IntegrationError, KeyboardInterrupt
            As for `eig3.integrate`.
        """
        if unknown:  # a decorator would cost a call
            raise refusal("Prepared", next(iter(unknown)), _OF_A_CALL)
        if check is not False and check_flag(check, "check"):
            check_repeatable(self.system.method)
        span: Any = t_span
        if self._defaults:
            own_span, own_u0, own_v0, own_params = self._defaults
            span = own_span if span is None else span
            u0, v0 = (own_u0 if u0 is None else u0), (own_v0 if v0 is None else v0)
            params = own_params if type(params) is tuple and not params else params
        u, v, form = check_state(u0, v0)
        if form is not self.system.form:
            raise self._wrong_form(u0)
        if z0 is not None or self.system.first_order.names:
            u, v = self._with_first_order(u, v, z0)
        if self.options.layout or (type(params) not in WITHOUT_NAMES and has_names(params)):
            params = in_layout(self.options.layout, params)
        span, p, longest = check_span(span), guarded(check_params(params)), math.inf
        is_own = bool(self._defaults) and params is self._defaults[3]
        if self._left_out is not None and self._defaults and not is_own:
            check_size(self.system.rhs, p, np.size(self._defaults[3]))
            check_left_out(self._left_out, p)
        if self._records or self.rules:
            n = u.size - self.system.first_order.size
            longest = self._longest if is_own else longest_step(self._records, params, n)
            if self.rules:
                u, v = self.rules.starts(n, span, u, v, p)
        start = span, u, v, p
        is_plain = cancel is None and save_to is None and progress is False and type(raise_on_failure) is bool
        solution = self._if_short(*start, longest) if is_plain else None
        if solution is None:
            solution = carry_out(partial(self._begin, *start, longest, progress, save_to), cancel, raise_on_failure)
        if check and solution.success:
            error = solution.check(cancel=cancel)
            if save_to is not None and error is not None:
                keep_error(save_to, error)
        return solution

    def member(
        self,
        span: tuple[float, float],
        u: Any,
        v: Any,
        params: np.ndarray,
        cancel: Cancel | None,
        longest: float | None = None,
    ) -> Solution:
        """Run a member of an ensemble from a checked start. A short run ignores `cancel`.

        With tolerances, no step is longer than `longest`, by default for the loads of the problem.
        """
        start = span, u, v, guarded(params), self._longest if longest is None else longest
        solution = self._if_short(*start)
        return solution or carry_out(partial(self._begin, *start, False, None), cancel, raise_on_failure=False)

    def at_start(self, span: tuple[float, float], u: Any, v: Any, params: np.ndarray) -> March:
        """Return a stepper at a checked start, after the checks of the right-hand side and the method."""
        start = span, u, v, guarded(params), None
        return self._variable_stepper(*start, math.inf) if self.options.tolerances else self._fixed_stepper(*start)[0]

    def _with_first_order(self, u: Any, v: Any, z0: Any) -> tuple[Any, Any]:
        """Return u and v with first-order unknowns at their first values."""
        unknowns = self.system.first_order
        if not unknowns:
            raise TypeError("z0 needs z0 in eig3.prepare too, which shows the number of first-order unknowns.")
        return unknowns.start(u, v, self._z0 if z0 is None else unknowns.again(z0))  # type: ignore[arg-type]

    def _if_short(self, span: tuple[float, float], u: Any, v: Any, p: np.ndarray, longest: float) -> Solution | None:
        """Run in one call of the kernel; return None if the run is long, or may not complete."""
        tolerances = self.options.tolerances
        try:
            times, every = None if self._t_eval is None else self._times_in(span), self._every
            if tolerances:
                return short_with_tolerances(self._variable_stepper(span, u, v, p, times, longest), every, times)
            stepper, steps = self._fixed_stepper(span, u, v, p, times)
            every = min(every, steps)
            rows = n_rows(steps, every)
            if times is not None:
                every, rows = NEVER, len(times)
            pace = self.system.pace.get(stepper.kernel.pace_key)
            if pace is None or not steps or steps * pace > short.MOST_SECONDS or rows * stepper.n > short.MOST_VALUES:
                return None
            given = steps, span[1], self.options.save_every, times
            return short.at_once(stepper, steps, span[1], every, rows, times, FixedRun, given)
        except KeyboardInterrupt as error:
            error.solution = None  # type: ignore[attr-defined]
            raise
        except Exception:  # a `Run` raises it again, with the solution so far
            return None

    def _wrong_form(self, u0: Any) -> ValueError:
        form = self.system.form
        wanted = "a number" if form is SCALAR else "an array"
        return ValueError(f"u0 must be {wanted}, because rhs has the {form.name} form, not {shown(u0)}.")

    def _begin(
        self, span: tuple[float, float], u: Any, v: Any, p: np.ndarray, longest: float, progress: bool, save_to: Any
    ) -> Run:
        """Return a run at its start."""
        if progress is not False:
            check_progress(progress)
        place = None if save_to is None else Place.of(save_to, self.system.labels, self.system.first_order)
        times, options = None if self._t_eval is None else self._times_in(span), self.options
        if options.tolerances:
            stepper = self._variable_stepper(span, u, v, p, times, longest)
            return VariableRun(stepper, self._every, times, place, progress).begin()
        fixed, n_steps = self._fixed_stepper(span, u, v, p, times)
        return FixedRun(fixed, n_steps, span[1], options.save_every, times, place, progress).begin()

    def _times_in(self, span: tuple[float, float]) -> np.ndarray:
        """Return the times of t_eval, checked whenever the span has changed."""
        checked, times = self._checked_times
        if checked != span:
            times = np.array(check_times(self._t_eval, *span))
            self._checked_times = span, times
        return times

    def _fixed_stepper(
        self, span: tuple[float, float], u: Any, v: Any, p: np.ndarray, times: np.ndarray | None
    ) -> tuple[Stepper, int]:
        """Return a stepper at the start, and the number of its steps."""
        t0, t1 = span
        n_steps, h = divide(t0, t1, self.options.h)  # type: ignore[arg-type]
        if h < _SHORT * max(1.0, abs(t0), abs(t1)):
            check_resolution(h, t0, t1)
        return Stepper.of(self.system, t0, h, u, v, p, times), n_steps

    def _variable_stepper(
        self, span: tuple[float, float], u: Any, v: Any, p: np.ndarray, times: np.ndarray | None, longest: float
    ) -> VariableStepper:
        n = 1 if self.system.form is SCALAR else u.size
        tolerances = self._tolerances.get(n) or self.tolerances(n)
        if longest != tolerances.h_max and self.options.tolerances.h_max == math.inf:  # type: ignore[union-attr]
            tolerances = tolerances._replace(h_max=longest)
        return VariableStepper(self.system, span, u, v, p, tolerances, times)

    def tolerances(self, n: int) -> Tolerances:
        """Return the tolerances for n degrees of freedom."""
        if n not in self._tolerances:
            unknowns = self.system.first_order
            size = unknowns.size
            assert self.options.tolerances
            own = self.options.tolerances.of(n - size, size, are_read=unknowns.is_read)
            self._tolerances[n] = own._replace(h_max=self._longest) if own.h_max == math.inf else own
        return self._tolerances[n]

    def __reduce__(self) -> tuple:
        given = self._defaults, self._z0, self._longest
        return Prepared, (self.system.rhs, self.system.form, self.options, *given)


@with_solution
def prepared_again(rhs: Any, form: Form, options: RunOptions) -> Prepared:
    """Return the prepared run of the last call with a right-hand side if it has the same options and functions.

    `run_options` returns the same object for the same options. Another object needs another prepared run.
    """
    kept = getattr(rhs, "__dict__", {})
    given, known = kept.get("_eig3_prepared", (None, None))
    if given is options and known.system.form is form and known.system.is_present:
        return known
    prepared = Prepared(rhs, form, options)
    kept["_eig3_prepared"] = options, prepared
    return prepared


@with_suggestions(run_options)
def prepare(rhs: Any, *, params: Any = None, z0: Any = None, **options: Any) -> Prepared:
    """Check the options, choose the method and compile the code, for many runs with different initial values.

    Parameters
    ----------
    rhs : jitted function
        As for `eig3.integrate`: with four arguments for one degree of freedom, with five for n, and with seven for
        first-order unknowns.
    params : NamedTuple or dict, optional
        An example of the parameters if they have names: ``prepare(rhs, h=0.01, params={"k": 4.0})``. In a call, the
        arrays may have other sizes. Pass parameters without names only to each call.
    z0 : float or array_like, or dict, optional
        The first values of first-order unknowns, for calls without other values.
    **options
        As for `eig3.integrate`, without the options of a call, which are check, progress, raise_on_failure, cancel
        and save_to. The prepared run copies them.

    Returns
    -------
    Prepared
        Call it as ``prepared(t_span, u0, v0, params)``: it returns bitwise the same `Solution` as `eig3.integrate`,
        some microseconds after its last step. It is thread-safe, and can be pickled if rhs can be pickled.

    Raises
    ------
    TypeError, ValueError
        If an option is not valid.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` is None.

    Notes
    -----
    Global variables keep the values that they had when the run was prepared. With ``inline=True``, the loop is compiled
    at the first call for a number of degrees of freedom.
    """
    if params is not None and not has_names(params):
        raise TypeError("params is for parameters with names; give an array to each call: prepared(t_span, u0, v0, p).")
    layout = None if params is None else named(params).layout
    unknowns, z = check_z0(rhs, z0)
    form = VECTOR if unknowns.names else form_of(rhs)
    return Prepared(rhs, form, run_options(layout, first_order=unknowns, **options), z0=z)
