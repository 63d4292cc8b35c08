"""The compiled functions and kernels that the runs of one right-hand side share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..functions.callbacks import Callback, check_callback
from ..functions.companions import Cutoffs, constraints_of, history_of, mark
from ..functions.events import Event
from ..functions.layout import bound_layout
from ..kernels.compile.jit import compiled
from ..kernels.compile.numba_internals import address_of
from ..kernels.protocol import EVENT_COLUMNS, EVENT_VALUES, EVENTS, FOLLOWS, SEARCHES, Form
from ..methods import Method
from .followed import Followed
from .run_options import RunOptions
from .team import Shares

_MOST_REMEMBERED = 16  # largest number of cached systems of one right-hand side


class Kernel(NamedTuple):
    """A kernel for a number of degrees of freedom, with its constant arguments.

    Attributes
    ----------
    running : Method
        The method of the steps, with every option "auto" decided.
    formulas : Formulas or Pair
    rows, carried : int
        Number of rows of the state, and of its first rows without scratch.
    call : callable
        The compiled kernel.
    callbacks : tuple
    settings : ndarray, or Observation with tolerances
    pace_key : tuple
        The key of the kernel in `System.pace`.
    """

    running: Method
    formulas: Any
    rows: int
    carried: int
    call: Callable
    callbacks: tuple
    settings: Any
    pace_key: tuple


class System:
    """A right-hand side with a method, its events and its quantities.

    Parameters
    ----------
    rhs : jitted function
    form : Form
    options : RunOptions
        A system uses the method, events, functions, labels and first_order, whether t_eval is given, and inline.

    Attributes
    ----------
    layout : Layout or None
        The names of the parameters, if they have any.
    callback : Callback
        The compiled right-hand side.
    cutoffs : Cutoffs or None
        The cutoffs of forces between points.
    shares : Shares or None
        The work that the threads of a run share.
    event_callbacks : list of (Callback, Callback or None)
        For each event, g and apply.
    event_table : ndarray, shape (k, EVENT_COLUMNS)
        The table of events for a kernel; see `eig3.kernels.protocol.Watch`.
    history : list of Callback or None
        The functions of the history of the right-hand side, if it has one.
    project : Callback or None
        The projection of u and v onto the constraints of the right-hand side, if it has constraints.
    constrained_step : int or None
        The address of the step of EIG-3 with the constraints of the right-hand side, if it has constraints.
    followed : Followed
        The quantities, compiled.
    looks : int
        The observation in kernels: 0, or `FOLLOWS` or `SEARCHES` of `eig3.kernels.protocol`.
    parts : frozenset of str or None
        What is observed within steps of variable length: see `eig3.kernels.loops.observe.observation`.
    counters_size : int
        Number of entries of the counters of a run.
    pace : dict
        Measured seconds per step, by `Kernel.pace_key`. A system with an observer has a separate dict, because
        quantities take time.
    ignores_velocity : bool
        Whether the method is valid only for a force that does not depend on the velocity.
    last_sizes : dict
        By the relative tolerance: the steps of the last run, and the rows that the next run may need.
    critical_at_start : tuple or None
        K and C at the start of the last run whose growth was judged, as bytes, and their critical step.
    kernels : dict
        The kernels compiled so far: by the number of degrees of freedom for the method, and by this number and a method
        for its fallbacks.

    Raises
    ------
    TypeError, ValueError
        If a function is not valid.
    """

    def __init__(self, rhs: Any, form: Form, options: RunOptions) -> None:
        self.rhs, self.form, self.layout, self.method = rhs, form, bound_layout(rhs), options.method
        self.labels, self.first_order = options.labels, options.first_order
        self.events, self.functions = options.events, options.functions
        history, constraints = history_of(rhs), constraints_of(rhs)
        self.inline = options.inline and history is None and constraints is None
        self._checked: list[tuple[tuple, Callback]] = []
        self.callback = self._check(rhs, "rhs", form)
        self.cutoffs: Cutoffs | None = mark(rhs, "cutoffs")
        self.shares: Shares | None = getattr(getattr(rhs, "py_func", rhs), "shares", None)
        if self.method.jacobian is not None:
            self._check(self.method.jacobian, "jacobian", form)
        self.event_callbacks = [self._check_event(name, event) for name, event in self.events.items()]
        together = _together([g.quiet for g, _ in self.event_callbacks])
        follows = [getattr(event, "follows_resets", False) for event in self.events.values()]
        table = [
            (g.address, apply.address if apply else 0, event.direction, event.terminal, count, *g.quiet, follow)
            for (g, apply), event, count, follow in zip(
                self.event_callbacks, self.events.values(), together, follows, strict=True
            )
        ]
        self.event_table = np.array(table, dtype=np.int64).reshape(len(table), EVENT_COLUMNS)
        self.history = history and [self._check(f, "invariant", form) for f in (history.begin, history.advance)]
        self.remembered = history.places if history else ()
        self.constrained_step = constraints and address_of(
            compiled(constraints.constrained_step, form.constrained_step.args)
        )
        self.project = constraints and self._check(constraints.project, "invariant", form)
        addresses = (
            function.address if function else 0 for function in (self.history and self.history[1], self.project)
        )
        self.followed = Followed(self.functions, form, *addresses)
        for quantity in self.followed.quantities:
            self._checked.append(((quantity.function, quantity.kind, form, quantity.name), quantity.callback))
        searches = options.t_eval is not None or self.events
        self.looks = SEARCHES if searches else FOLLOWS if self.followed.is_needed else 0
        needed = {"quantities": self.followed.quantities, "events": self.events, "times": options.t_eval is not None}
        self.parts = frozenset(part for part, is_needed in needed.items() if is_needed) if self.looks else None
        self.pace = {} if self.looks else self.callback.pace
        self.ignores_velocity = self.method.ignores_velocity
        self.counters_size = EVENTS + EVENT_VALUES * len(table)
        self.kernels: dict[Any, Kernel] = {}
        self.last_sizes: dict[float | None, tuple[int, int]] = {}
        self.critical_at_start: Any = None

    def _check(self, *arguments: Any) -> Callback:
        callback = check_callback(*arguments)
        self._checked.append((arguments, callback))
        return callback

    def _check_event(self, name: str, event: Event) -> tuple[Callback, Callback | None]:
        g = self._check(event.g, "event", self.form, f"g of events[{name!r}]")
        if event.apply is None:
            return g, None
        return g, self._check(event.apply, "apply", self.form, f"apply of events[{name!r}]")

    @property
    def at_times(self) -> System:
        """The same system for runs with tolerances that save their states at given times."""
        given = self.events, self.functions, self.inline, self.labels, self.first_order
        return remembered(self.rhs, self.form, RunOptions(None, None, self.method, None, np.empty(0), *given))

    @property
    def is_present(self) -> bool:
        """Whether no function was recompiled since, and all values that were compiled into functions are unchanged."""
        return all(check_callback(*arguments) is callback for arguments, callback in self._checked)


def _together(quiet: Sequence[tuple[int, int]]) -> list[int]:
    """Return for each event the number of events from it on that are neighbours in a family."""
    counts = [1] * len(quiet)
    for k in range(len(quiet) - 1, 0, -1):
        address, number = quiet[k]
        if address and quiet[k - 1] == (address, number - 1):
            counts[k - 1] = counts[k] + 1
    return counts


def remembered(rhs: Any, form: Form, options: RunOptions) -> System:
    """Return a system, which is the same object in each call with the same functions and options.

    Runs with tolerances and runs with a fixed step have different systems, because their kernels differ. The right-hand
    side holds its systems, which are freed with it. A function that was recompiled, or whose captured values have
    changed, needs another system.
    """
    invariants, outputs, every = options.functions
    functions = (tuple(part.items()) for part in (options.events, invariants, outputs))
    others = every, options.method, options.inline, options.labels, options.first_order
    key = form.name, options.h is None, options.t_eval is None, *functions, *others
    try:
        systems = vars(rhs).setdefault("_eig3_systems", {})
        known = systems.get(key)
    except TypeError:  # rhs is not a jitted function, or an option cannot be a key
        return System(rhs, form, options)
    if known is None or not known.is_present:
        while len(systems) >= _MOST_REMEMBERED:
            systems.pop(next(iter(systems)), None)
        known = systems[key] = System(rhs, form, options)
    return known
