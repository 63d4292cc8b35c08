"""The options of a run, shared by single runs, prepared runs, ensembles, problems and loaded runs."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count, check_flag, check_h, check_method, reals
from ..functions.events import Event, check_events
from ..functions.first_order import NONE, FirstOrder
from ..functions.layout import Layout
from ..functions.quantities import Functions, check_functions
from ..methods import METHODS, Method
from ..result.labels import Labels
from ..result.memory import n_rows
from .tolerances import Tolerances, check_tolerances, check_variable

NEVER = 2**62  # `every` of a run that writes no states
_NO_EVENTS: Mapping[str, Event] = {}
_NO_FUNCTIONS = Functions({}, {})


class RunOptions(NamedTuple):
    """The checked options of a run, independent of the arrays and dictionaries of the caller.

    Attributes
    ----------
    h : float or None
        The fixed step; None with tolerances.
    tolerances : Tolerances or None
        The tolerances for any number of degrees of freedom; None with a fixed step.
    method : Method or None
        None for the default method of a run with tolerances, which depends on the right-hand side.
    save_every : int or None
        None saves the first and the last state, or the states at `t_eval`.
    t_eval : ndarray or None
    events : dict of str to Event
    functions : Functions
        The invariants and the outputs, and how often the invariants are evaluated.
    inline : bool
    labels : Labels or None
        Names and units of the degrees of freedom.
    first_order : FirstOrder
        The first-order unknowns, to which the functions are bound.
    layout : Layout or None
        The names of the parameters of each call, to which the functions are bound; None for an array.
    """

    h: float | None = None
    tolerances: Tolerances | None = None
    method: Any = None  # None until the run is prepared
    save_every: int | None = None
    t_eval: np.ndarray | None = None
    events: Mapping[str, Event] = _NO_EVENTS
    functions: Functions = _NO_FUNCTIONS
    inline: bool = False
    labels: Labels | None = None
    first_order: FirstOrder = NONE
    layout: Layout | None = None

    @property
    def every(self) -> int:
        """The number of steps between saved states."""
        return NEVER if self.save_every is None else self.save_every

    @property
    def has_own_times(self) -> bool:
        """Whether the times of saved states are known only after the run."""
        return self.t_eval is None and (bool(self.tolerances) or any(event.terminal for event in self.events.values()))

    def rows(self, n_steps: int) -> int:
        """Return the number of saved states in a run of `n_steps` steps; with tolerances, there may be more."""
        if self.t_eval is not None:
            return len(self.t_eval)
        return 2 if self.tolerances else n_rows(n_steps, self.every)


def _remembered(check: Callable[..., RunOptions]) -> Callable[..., RunOptions]:
    """Return a function that checks options once: most calls in a loop have the same ones."""

    @functools.lru_cache(64, typed=True)
    def known(methods: tuple, *layout: Layout | None, **options: Any) -> RunOptions:
        return check(*layout, **{name: dict(x) if type(x) is _Items else x for name, x in options.items()})

    @functools.wraps(check)
    def checked(*layout: Layout | None, **options: Any) -> RunOptions:
        hashable = options
        # A notebook may define the method of a name again.
        methods = tuple(METHODS.values()) if isinstance(options.get("method"), str) else ()
        for name in ("events", "invariants", "outputs"):
            functions = options.get(name)
            if type(functions) is dict and tuple not in map(type, functions.values()):  # k of (function, k) has a type
                hashable = {**hashable, name: _Items(functions.items())}
        if {*_FIXED, type(options.get("method"))}.issuperset(map(type, hashable.values())):
            with suppress(TypeError, ValueError):  # a method cannot be remembered, or an option is not valid
                return known(methods, *layout, **hashable)
        return check(*layout, **options)

    return checked


class _Items(tuple):
    """The items of a dictionary, which can be remembered."""


#: The types of options whose values cannot change. Other objects may change although they have a hash, such as tensors.
_FIXED = type(None), bool, int, float, np.float64, str, tuple, _Items, FirstOrder, Labels


@_remembered
def run_options(
    layout: Layout | None = None,
    *,
    h: float | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
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
    labels: Labels | None = None,
    first_order: FirstOrder = NONE,
) -> RunOptions:
    """Check the options of `eig3.integrate`. Functions are bound to first-order unknowns and to named parameters.

    Raises
    ------
    TypeError, ValueError
        If an option is not valid, or two exclude each other.
    """
    if first_order.is_read:
        if getattr(method, "jacobian", None) is not None:
            raise ValueError(
                "method must be without a jacobian, which would lack the first-order unknowns: leave it out."
            )
        events, invariants, outputs = map(first_order.bind_all, (events, invariants, outputs))
    if layout:
        method = layout.bind_method(method)
        events, invariants, outputs = map(layout.bind_all, (events, invariants, outputs))
    t_eval = None if t_eval is None else reals(t_eval, "t_eval")
    if t_eval is not None and save_every not in (1, None):
        raise ValueError("save_every and t_eval exclude each other: give one of them.")
    tolerances = None
    if h is not None:
        _refuse({"rtol": rtol, "atol": atol, "h_max": h_max, "first_step": first_step, "max_steps": max_steps})
        h, method = check_h(h), check_method("eig3" if method is None else method)
    elif rtol is None and atol is None:
        raise ValueError("give h for a fixed step, or rtol for tolerances: one of the two is needed.")
    else:
        tolerances = check_tolerances(rtol, atol, h_max, first_step, max_steps)
        method = None if method is None else check_variable(method)
    save_every = None if save_every is None or t_eval is not None else check_count(save_every, "save_every")
    functions = check_functions(invariants, outputs, invariants_every)
    events, inline = check_events(events), check_flag(inline, "inline")
    labels = Labels.of(labels, functions.columns)
    return RunOptions(h, tolerances, method, save_every, t_eval, events, functions, inline, labels, first_order, layout)


def _refuse(given: dict[str, Any]) -> None:
    """Refuse options of tolerances together with h."""
    for name, value in given.items():
        if value is not None:
            what = "the steps follow from it" if name == "rtol" else "it belongs to rtol"
            raise ValueError(
                f"h and {name} exclude each other: give h for a fixed step, or rtol for tolerances ({what})."
            )
