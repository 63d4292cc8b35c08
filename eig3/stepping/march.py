"""A state that advances in compiled code: the base class for fixed steps and for tolerances."""

from __future__ import annotations

import contextlib
import copy
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..functions.checks import check_index, check_params, reals, velocity_refused
from ..functions.evaluation import accelerations
from ..functions.guard import evaluation, guarded, not_finite, unwritten
from ..functions.named import in_layout
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.protocol import (
    ENDED_BY,
    EVALUATIONS,
    FULL,
    GOING,
    LOGGED,
    NEXT,
    NOT_A_NUMBER,
    NOT_FINITE,
    RESTING,
    SCALAR,
    TERMINAL,
    TIME,
    WITHIN,
)
from ..methods import Method
from ..result.memory import aligned
from .observer import Observer, not_a_number
from .slices import Slices
from .system import Kernel, System
from .team import team

ENDED_BY_EVENT = (TERMINAL, RESTING)  # the first and the last outcome of an event that ends a run


class Cancel(Protocol):
    """An object that says whether to stop, such as a `threading.Event`."""

    def is_set(self) -> bool:
        """Return True to stop."""


class Rows(NamedTuple):
    """Arrays for saved states: times, steps, u and v; with a fixed step, there are no times."""

    t: np.ndarray
    h: np.ndarray
    u: np.ndarray
    v: np.ndarray


class March:
    """A state that advances in compiled code.

    Attributes
    ----------
    system : System
    form : Form
    n : int
        Number of degrees of freedom.
    start : tuple of float or ndarray
        u0 and v0.
    first_acceleration : float or ndarray
        f(t0, u0, v0).
    first_sizes : tuple of float
        The largest |u0|, |v0| and |f(t0, u0, v0)|.
    t0 : float
        The time of u0 and v0.
    p : ndarray
        The parameters.
    running : Method
        The method of the steps, with every option "auto" decided.
    changed_at : float or None
        The time after which the fallback of the method is used, because the solve of a step did not converge.
    index : int
        Number of steps taken.
    ended : int
        How the last call of the kernel ended; see `eig3.kernels.protocol`.
    raised_before : int or None
        The step index before which a function raised an exception in the last `take`; None without an exception.
    seconds : float
        Time spent in the kernel, s, without compilation.
    look : Observer or None
        The observer of each step; None if nothing is observed.
    """

    system: System
    kernel: Kernel
    running: Method
    state: np.ndarray
    h: float
    index, seconds, ended = 0, 0.0, GOING
    raised_before: int | None = None
    changed_at: float | None = None
    _slices: Slices | None = None
    _before: Any = None  # the state before the last call of `take`
    _has_changed = False  # whether `params` have changed since the last call that took steps

    def _begin(self, system: System, t0: float, u: Any, v: Any, params: np.ndarray, times: np.ndarray | None) -> Any:
        """Set the state to the start, and return the acceleration there; `params` must come from `guarded`."""
        self.system, self.form, self.start, self.t0, self.p = system, system.form, (u, v), t0, params
        self.n = n = 1 if self.form is SCALAR else u.size
        self._lock = threading.Lock()
        if system.history:
            system.history[0].call(t0, u, v, params)
        a, self.first_sizes = evaluation(system.callback, self.form, t0, u, v, params)
        if not math.isfinite(self.first_sizes[2]):
            raise not_finite(system.callback, self.form, t0, u, v, params, a)
        self.first_acceleration = a
        self.counters = np.zeros(system.counters_size)
        self.counters[TIME] = t0
        if system.ignores_velocity and system.callback.reads_velocity:
            self._check_velocity(a)  # before its kernels compile
        self._use(system.kernels.get(n) or self._compiled(system.method))
        self.look = Observer(system, times, n, self._work_rows()) if system.looks else None
        if self.look:
            self.look.begin(self.counters, t0, u, v, params)
        return a

    @property
    def params(self) -> np.ndarray:
        values = self.p.view()
        values.flags.writeable = False  # a method must start anew with other values
        return values

    @params.setter
    def params(self, values: Any) -> None:
        given = np.asarray(check_params(in_layout(self.system.layout, values)))
        if given.shape != self.p.shape:
            raise ValueError(f"params must keep their shape {self.p.shape}, and not have {given.shape}.")
        if not np.array_equal(given, self.p):
            kept = [self.p[place].copy() for place in self.system.remembered]
            self.p[...] = given
            for place, values in zip(self.system.remembered, kept, strict=True):
                self.p[place] = values  # history variables are a part of the state, and no parameters
            self._start_anew()
            self._has_changed = True

    def _start_anew(self) -> None:
        """Let the method forget the past accelerations, because f has changed."""
        raise NotImplementedError

    def _check_velocity(self, a: Any) -> None:
        """Refuse a method that ignores the velocity if another velocity changes the acceleration at the start."""
        u, v = self.start
        with np.errstate(over="ignore"):
            other = v + (1.0 + np.abs(u) + np.abs(v))  # differs from v by at least the size of u
        if np.any(self.acceleration(self.t0, u, other) != a):
            raise velocity_refused(self.method)

    def _work_rows(self) -> int:
        """Return the number of rows of scratch for events and times of t_eval."""
        raise NotImplementedError

    def _compiled(self, method: Method) -> Kernel:
        """Return the kernel of a method for this number of degrees of freedom."""
        kernels, key = self.system.kernels, self.n if method is self.system.method else (self.n, method)
        if key not in kernels:
            kernels[key] = self._new_kernel(method)
        return kernels[key]

    def _new_kernel(self, method: Method) -> Kernel:
        """Compile or load this kernel."""
        raise NotImplementedError

    def steps(self, count: int, every: int, row: int, rows: Rows) -> Any:
        """Return the argument `steps` of the kernel."""
        raise NotImplementedError

    def _use(self, kernel: Kernel) -> None:
        """Use a kernel for the next steps, with a state of the size that it needs."""
        self.kernel, self.running = kernel, kernel.running
        self.state = aligned((kernel.rows, self.n))

    @property
    def method(self) -> Method:
        """The requested method."""
        return self.system.method

    @property
    def inline(self) -> bool:
        return self.system.inline

    @property
    def n_rhs(self) -> int:
        """Number of evaluations of the right-hand side, including the evaluation at the start."""
        return 1 + int(self.counters[EVALUATIONS])

    @property
    def is_over(self) -> bool:
        """Whether an event ended the run."""
        return ENDED_BY_EVENT[0] <= self.ended <= ENDED_BY_EVENT[1]

    @property
    def ended_by(self) -> str:
        """The name of the event that ended the run."""
        return list(self.system.events)[int(self.counters[ENDED_BY])]

    @property
    def is_within_log(self) -> bool:
        """Whether a call of the kernel ended within a step because the log was full: u and v are then not valid."""
        return bool(self.counters[WITHIN] == 1)

    @property
    def n_wanted(self) -> int:
        """The number of times of t_eval whose states are written."""
        return int(self.counters[NEXT])

    @property
    def is_finite(self) -> bool:
        """Whether u and v are finite. Values that are not finite remain so in all later steps."""
        return bool(np.logical_and.reduce(np.isfinite(self.state[:2]), axis=None))

    @property
    def u(self) -> Any:
        """The displacement: a float, or a new array of shape (n,)."""
        return self._component(0)

    @property
    def v(self) -> Any:
        """The velocity: a float, or a new array of shape (n,)."""
        return self._component(1)

    def _component(self, row: int) -> Any:
        return self.state[row].copy() if self.form is not SCALAR else float(self.state[row].item())

    def take(self, count: int, every: int, row: int, rows: Rows, cancels: tuple[Cancel, ...]) -> int:
        """Take at most `count` steps, in slices, and return the row after the last written row.

        The state after each step whose index is a multiple of `every` is written, from `row` on. If one of `cancels` is
        set, the call ends soon. `ended` gives the reason why it ended: GOING after all steps, or if it was cancelled.
        After an exception in a function, the march is at the state before the call.
        """
        self._before, self._has_changed = self.kept(), False
        end, kernel = self.index + count, self.kernel
        self.ended, self.raised_before = GOING, None
        if self.system.shares is None:
            return self._take(end, kernel, every, row, rows, cancels)
        with team(self.system.shares, self.p, count):
            return self._take(end, kernel, every, row, rows, cancels)

    def _take(self, end: int, kernel: Kernel, every: int, row: int, rows: Rows, cancels: tuple[Cancel, ...]) -> int:
        arguments = self.look and self.look.arguments
        slices = self._slices = self._slices or self._new_slices()
        while self.index < end:
            # After a call that ended within a step, the next call takes only this step: then the run may stop.
            steps, *begun = slices.begin(1 if self.look and self.is_within_log else end - self.index)
            try:
                taken, row, ended = kernel.call(
                    kernel.callbacks,
                    self.state,
                    kernel.settings,
                    self.counters,
                    self.steps(steps, every, row, rows),
                    arguments,
                )
                if ended in (NOT_A_NUMBER, NOT_FINITE):
                    self.ended = ended
                    raise not_a_number(self, float(self.counters[TIME]))
            except BaseException:
                self.raised_before = self.index + steps
                self.restore(self._before)
                raise
            self.seconds += slices.end(taken, *begun)
            self.index += taken
            if self.look and self.counters[LOGGED]:
                self.look.collect(self.counters)
            if ended != GOING:
                if ended == FULL and self._has_room(row, rows):
                    continue
                if not self._goes_on_after(ended):
                    self.ended = ended
                    break
                kernel = self.kernel
            elif self.index < end and not (self.look and self.is_within_log) and any(x.is_set() for x in cancels):
                break
        return row

    def _new_slices(self) -> Slices:
        return Slices(self.pace)

    def _has_room(self, row: int, rows: Rows) -> bool:
        """Return whether rows are left: then the log of events was full."""
        return True

    def _goes_on_after(self, ended: int) -> bool:
        """Change to another kernel with which the run can continue; return whether there is such a kernel."""
        return False

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """A block that only one thread can enter."""
        if not self._lock.acquire(blocking=False):
            raise RuntimeError("this stepper is in use: give each thread a separate stepper, made with fork().")
        try:
            yield
        finally:
            self._lock.release()

    def back(self) -> None:
        """Restore the state before the last call of `advance`, whose time is still in `seconds`.

        After a call that has taken no steps, and after `back` itself, the state does not change.

        If `params` have changed since then, the method starts anew with these.

        Raises
        ------
        RuntimeError
            If `advance` was never called, or if `params`, which have changed, hold the springs between grains.
        """
        if self._before is None:
            raise RuntimeError("this stepper has taken no steps: call advance before back.")
        if self._has_changed and self.system.history:
            raise RuntimeError("params hold the springs between grains: go back before you change params.")
        with DeferredInterrupt(), self._alone():
            self.restore(self._before)
            if self._has_changed:
                self._start_anew()

    def fork(self) -> Any:
        """Return an independent march at the same state, as `copy.copy` does. It saves nothing at times of t_eval."""
        with DeferredInterrupt(), self._alone():
            other = object.__new__(type(self))
            vars(other).update(vars(self))
            other._lock = threading.Lock()
            other.state, other.counters = aligned(self.state.shape), self.counters.copy()
            other.p = guarded(self.p)  # a scene stores neighbour lists in them
            other.state[...] = self.state
            other._slices = copy.copy(self._slices)
            other.look = self.look and self.look.fork()
        return other

    __copy__ = fork

    def __deepcopy__(self, memo: dict) -> Any:
        return self.fork()

    def before(self) -> Any:
        """Return an independent march at the state before the last call of `take`."""
        other = self.fork()
        other.restore(self._before)
        return other

    def kept(self) -> dict[str, Any]:
        """Return the state from which this march can continue, in numbers and arrays."""
        look, remembers = self.look, self.system.history
        return {
            "index": self.index,
            "changed_at": self.changed_at,
            "seconds": self.seconds,
            "state": self.state[: self.kernel.carried].copy(),
            "counters": self.counters.copy(),
            "numbers": look.numbers.copy() if look else None,
            "n_found": look.n_found if look else 0,
            "remembered": self.p.copy() if remembers else None,
        }

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Restore the state `kept` of this march, or of a march with the same arguments; `seconds` does not change."""
        changed_at = kept["changed_at"]
        if (changed_at is None) != (self.changed_at is None):
            self._use(self._compiled(self.method if changed_at is None else self._fallback()))
        self.index, self.changed_at, self.ended = kept["index"], changed_at, GOING
        self.state[: self.kernel.carried], self.counters[...] = kept["state"], kept["counters"]
        if self.look:
            self.look.numbers[...] = kept["numbers"]
            self.look.forget_from(kept["n_found"])
        if kept["remembered"] is not None:
            self.p[...] = kept["remembered"]

    def load(self, kept: Mapping[str, Any]) -> None:
        """Restore a state from a file, after a check.

        Raises
        ------
        ValueError
            If `kept` belongs to a different march.
        """
        changed_at = None if kept["changed_at"] is None else float(kept["changed_at"])
        state, counters = (reals(kept[name], name) for name in ("state", "counters"))
        if state.shape != (self.kernel.carried, self.n) or counters.shape != self.counters.shape:
            raise ValueError(f"a state of the shape {state.shape} does not belong to {self.method!r}.")
        counts = counters[[EVALUATIONS, TIME, NEXT]]
        if not (np.isfinite(counts).all() and counters[EVALUATIONS] >= 0 and counters[NEXT] >= 0):
            raise ValueError(f"{counts} are not the counts and the time of a run.")
        counters[[LOGGED, ENDED_BY, WITHIN]] = 0  # indices of arrays of another process
        checked = {"index": check_index(kept["index"]), "changed_at": changed_at, "state": state, "counters": counters}
        if self.look:
            checked["numbers"] = self.look.checked(kept["numbers"])
        self.restore({**kept, **checked, "n_found": 0})
        self.seconds = float(kept["seconds"])

    def _fallback(self) -> Method:
        fallback = self.method.fallback(self.n)
        if fallback is None:
            raise ValueError(f"{self.method!r} has no other solver.")
        return fallback

    @property
    def accelerations(self) -> Any:
        """A function that evaluates f(t_i, u_i, v_i) at rows of states, without a reference to this march.

        It is None for a right-hand side with a history, which p has only for the last state.
        """
        if self.system.history:
            return None
        return partial(accelerations, self.system.callback, self.p)

    def acceleration(self, t: float, u: Any, v: Any) -> Any:
        """Evaluate f(t, u, v): a float, or a new array of shape (n,).

        Raises
        ------
        ValueError
            If u or v has another shape than u0.
        """
        return self.evaluator()(t, u, v)

    def evaluator(self) -> Callable[[float, Any, Any], Any]:
        """Return `acceleration` for many evaluations: a copy of p, which has the neighbour lists, takes longer."""
        call, params = self.system.callback.call, guarded(self.p)  # another thread may take steps
        is_scalar = self.form is SCALAR
        shape = () if is_scalar else (self.n,)

        def acceleration(t: float, u: Any, v: Any) -> Any:
            # The compiled function reads any array as a contiguous array of this size.
            u, v = np.asarray(u, dtype=np.float64, order="C"), np.asarray(v, dtype=np.float64, order="C")
            if not u.shape == v.shape == shape:
                raise ValueError(f"u and v must have the shape of u0, {shape}, not {u.shape}, {v.shape}.")
            if is_scalar:
                return call(float(t), float(u), float(v), params)
            a = np.full(u.size, np.nan)  # an entry that rhs does not write stays NaN
            call(t, u, v, params, a)
            return a

        return acceleration

    def find_unwritten(self, t: float) -> int | None:
        """Return an index j such that rhs, in the vector form, does not write a[j] at the time t, if any.

        The check takes one evaluation, which `n_rhs` does not count.
        """
        u, v, callback = self.state[0], self.state[1], self.system.callback
        try:
            a, (_, _, size) = evaluation(callback, self.form, t, u, v, self.p)
            return None if math.isfinite(size) else unwritten(callback, t, u, v, self.p, a)
        except Exception:  # rhs may fail at a time at which the method does not evaluate it
            return None

    @property
    def pace(self) -> float | None:
        """Seconds per step of the last run with this right-hand side and kernel; None before the first run."""
        return self.system.pace.get(self.kernel.pace_key)

    def note_pace(self) -> None:
        """Store the measured time per step for later runs."""
        if self.index:
            self.system.pace[self.kernel.pace_key] = self.seconds / self.index
