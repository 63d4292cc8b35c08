"""What the runs of one right-hand side have in common: its functions and its kernels, compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..functions.callbacks import Callback, check_callback
from ..functions.companions import constraints_of, history_of
from ..functions.events import Event
from ..functions.layout import bound_layout
from ..kernels.compile.jit import compiled
from ..kernels.compile.numba_internals import address_of
from ..kernels.protocol import EVENT_VALUES, EVENTS, FOLLOWS, SEARCHES, Form
from ..methods import Method
from .followed import Followed
from .options import RunOptions
from .team import Shares

_MOST_REMEMBERED = 16  # systems of one right-hand side


class Kernel(NamedTuple):
    """A kernel for a number of degrees of freedom, with the arguments that are the same in each call.

    Attributes
    ----------
    running : Method
        The record that takes the steps: the method with every option "auto" decided.
    formulas : Formulas or Pair
    rows : int
        Number of rows of the state.
    call : callable
        The compiled kernel.
    callbacks : tuple
    settings : ndarray
    pace_key : tuple
        Its key in `System.pace`.
    """

    running: Method
    formulas: Any
    rows: int
    call: Callable
    callbacks: tuple
    settings: np.ndarray
    pace_key: tuple


class System:
    """A right-hand side with a method, its events and its quantities.

    Parameters
    ----------
    rhs : jitted function
    form : Form
    options : RunOptions
        Of these, a system has the method, the events, functions, labels and quadratures, and whether there are wanted
        times and whether the loop is compiled with rhs inside.

    Attributes
    ----------
    layout : Layout or None
        The names of the parameters, if they have any.
    callback : Callback
        The compiled right-hand side.
    shares : Shares or None
        What the threads of a run share of it.
    event_callbacks : list of (Callback, Callback or None)
        For each event, g and apply.
    event_table : ndarray, shape (k, 4)
        What a kernel needs of the events; see `eig3.kernels.protocol.Watch`.
    history : list of Callback or None
        The functions of the history of the right-hand side, if it has one.
    leap : int or None
        The address of the step of EIG-3 with the constraints of the right-hand side, if it has some.
    followed : Followed
        The quantities, compiled.
    looks : int
        What kernels look for: 0, or one of `FOLLOWS` and `SEARCHES` of `eig3.kernels.protocol`.
    tally_size : int
        Number of entries of the tally of a run.
    pace : dict
        Measured seconds per step, by `Kernel.pace_key`. Those of a system that looks are its own: quantities take time.
    ignores_velocity : bool
        Whether the method is valid only for a force that does not depend on the velocity.
    last_sizes : dict
        By the relative tolerance: the steps of the last run, and the rows that the next one may need.
    kernels : dict
        The kernels that were compiled so far: by the number of degrees of freedom for the method, and by this number
        and a record for others that take its steps.

    Raises
    ------
    TypeError, ValueError
        If a function is not valid.
    """

    def __init__(self, rhs: Any, form: Form, options: RunOptions) -> None:
        self.rhs, self.form, self.layout, self.method = rhs, form, bound_layout(rhs), options.method
        self.labels, self.quadratures = options.labels, options.quadratures
        self.events, self.functions = options.events, options.functions
        history, constraints = history_of(rhs), constraints_of(rhs)
        self.inline = options.inline and history is None and constraints is None
        self._checked: list[tuple[tuple, Callback]] = []
        self.callback = self._check(rhs, "rhs", form)
        self.shares: Shares | None = getattr(getattr(rhs, "py_func", rhs), "shares", None)
        if self.method.jacobian is not None:
            self._check(self.method.jacobian, "jacobian", form)
        self.event_callbacks = [self._check_event(name, event) for name, event in self.events.items()]
        table = [
            (g.address, apply.address if apply else 0, event.direction, event.terminal)
            for (g, apply), event in zip(self.event_callbacks, self.events.values(), strict=True)
        ]
        self.event_table = np.array(table, dtype=np.int64).reshape(len(table), 4)
        self.history = history and [self._check(function, "invariant", form) for function in history]
        self.leap = constraints and address_of(compiled(constraints.leap, form.leap.args))
        project = constraints and self._check(constraints.project, "invariant", form)
        self.followed = Followed(
            self.functions, form, self.history[1].address if self.history else 0, project.address if project else 0
        )
        for quantity in self.followed.quantities:
            self._checked.append(((quantity.function, quantity.kind, form, quantity.name), quantity.callback))
        searches = options.t_eval is not None or self.events
        self.looks = SEARCHES if searches else FOLLOWS if self.followed.is_needed else 0
        self.pace = {} if self.looks else self.callback.pace
        self.ignores_velocity = self.method.ignores_velocity
        self.tally_size = EVENTS + EVENT_VALUES * len(table)
        self.kernels: dict[Any, Kernel] = {}
        self.last_sizes: dict[float | None, tuple[int, int]] = {}

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
    def is_present(self) -> bool:
        """Whether no function was compiled anew since, and each value that was compiled into one is the same."""
        return all(check_callback(*arguments) is callback for arguments, callback in self._checked)


def remembered(rhs: Any, form: Form, options: RunOptions) -> System:
    """Return a system, which is the same in each call with the same functions and options.

    The systems of runs with tolerances are others than those of runs with a fixed step, because their kernels are. A
    right-hand side itself has its systems, so that they are forgotten with it. A function that was compiled anew, or
    whose captured values have changed, makes another system.
    """
    invariants, outputs, every = options.functions
    functions = (tuple(part.items()) for part in (options.events, invariants, outputs))
    others = every, options.method, options.inline, options.labels, options.quadratures
    key = form.name, options.h is None, options.t_eval is None, *functions, *others
    try:
        systems = vars(rhs).setdefault("_eig3_systems", {})
        known = systems.get(key)
    except TypeError:  # rhs is no jitted function, or an option cannot be a key
        return System(rhs, form, options)
    if known is None or not known.is_present:
        while len(systems) >= _MOST_REMEMBERED:
            systems.pop(next(iter(systems)), None)
        known = systems[key] = System(rhs, form, options)
    return known
