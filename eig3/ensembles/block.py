"""A block of members that run together, in the lanes of SIMD registers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..analysis.divergence import became_non_finite
from ..kernels.lanes import Lanes, Layout
from ..kernels.protocol import EVALUATIONS, SCALAR, VECTOR, Run
from ..memory import aligned
from ..methods import Method
from ..observers.growth import BLOWN_UP, OVERFLOWING
from ..observers.written import unwritten_entry
from ..solution import Solution, Status
from ..stepper import Cancel
from .histories import Histories
from .members import Members

_CHUNK_SECONDS = 0.02  # duration of a chunk of steps, after which the members are looked at
_CHUNK_GROWTH = 16  # largest factor from the steps of one chunk to the steps of the next
_FIRST_CHUNK = 64  # steps
_SCRATCH_VALUES = 2**15  # values in an array of states that are not saved: 256 kB, so that it stays in the cache


@dataclass(frozen=True, eq=False)
class Shared:
    """What the blocks of an ensemble have in common.

    Attributes
    ----------
    members : Members
    layout : Layout
    method : Method
        The record that takes the steps.
    kernel : callable
        The kernel of the method.
    rhs : Lanes
    invariants : dict of str to Lanes
    histories : Histories
    alone : callable
        ``alone(member)`` returns the `Solution` of a member from a run of its own.
    """

    members: Members
    layout: Layout
    method: Method
    kernel: Callable
    rhs: Lanes
    invariants: dict[str, Lanes]
    histories: Histories
    alone: Callable[[int], Solution]


class Block:
    """At most as many members of an ensemble as there are lanes, on their way.

    Parameters
    ----------
    shared : Shared
    numbers : ndarray of int
        The numbers of the members.
    """

    def __init__(self, shared: Shared, numbers: np.ndarray) -> None:
        self.shared, self.numbers = shared, numbers
        self.seconds = 0.0

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        self._begin()
        while self._runs.any() and not stop.is_set():
            try:
                self._advance(self._next_target())
            except Exception as error:
                self._interrupt(f"The run raised {type(error).__name__} after")
                raise
        self._interrupt("The run was interrupted after")

    def _begin(self) -> None:
        layout, members, formulas = self.shared.layout, self.shared.members, self.shared.method.formulas
        lanes = np.arange(layout.lanes)
        self._runs = lanes < len(self.numbers)  # the lanes whose member has not ended; the others repeat one of these
        self._members = self.numbers[np.where(self._runs, lanes, 0)]
        self._h, self._t0 = np.ascontiguousarray(members.steps[self._members]), members.t_span[0]
        self._ends = members.n_steps[self._members]  # the step indices at which the members end
        self._failed: dict[int, str] = {}  # why a member ends early, by its lane
        # With steps of their own, the members are integrated in units of their steps.
        self._unit = self._h if layout.has_own_step else np.ones(layout.lanes)
        self._kernel_h, self._kernel_t0 = (1.0, 0.0) if layout.has_own_step else (float(self._h[0]), self._t0)
        self._p = self._params()
        u, v = (np.ascontiguousarray(x[self._members].T) for x in (members.u0, members.v0))
        v *= self._unit
        a = np.full_like(u, np.nan)  # an entry that rhs does not write stays NaN
        self.shared.rhs.call(self._kernel_t0, u.ravel(), v.ravel(), self._p, a.ravel())
        self._state = aligned((formulas.state_rows(u.size), u.size))
        self._rows = self._state.reshape(-1, layout.n, layout.lanes)
        with np.errstate(over="ignore", invalid="ignore"):
            past = formulas.start(u, v, a, self._kernel_h)
        for row, values in zip(self._rows, (u, v, *past), strict=False):
            row[:] = values
        self._settings, self._tally = np.array(self.shared.method.settings, dtype=np.float64), np.zeros(4)
        self._index, self._chunk = 0, _FIRST_CHUNK
        self._set_natural(u, v / self._unit, a / self._unit**2)
        self._extremes = {name: self._at_start(invariant) for name, invariant in self.shared.invariants.items()}
        self._start = {name: low.copy() for name, (low, _) in self._extremes.items()}
        self._save(0, *(x[None].copy() for x in self._values()))
        broken = self._runs & ~np.isfinite(a).all(axis=0)
        for lane in np.flatnonzero(broken):
            self._failed[lane] = f"rhs gives {a[:, lane][~np.isfinite(a[:, lane])][0]} at the start."
        self._end(broken)

    def _params(self) -> np.ndarray:
        """Return the array p of the kernel."""
        layout, members = self.shared.layout, self.shared.members
        p = aligned((layout.size,))
        p[: layout.params_size] = members.params if layout.shares_params else members.params[self._members].T.ravel()
        if layout.has_own_step:
            own = p[layout.params_size :].reshape(-1, layout.lanes)
            own[0], own[1] = self._h, self._t0
        return p

    def _set_natural(self, u: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
        """Set the natural sizes of u and v, as `eig3.observers.growth` defines them."""
        with np.errstate(all="ignore"):
            span = self._ends * self._h
            self._v_natural = np.abs(v).max(axis=0) + span * np.abs(a).max(axis=0)
            self._u_natural = np.abs(u).max(axis=0) + span * self._v_natural
        self._half = np.where(self._v_natural == 0, self._ends // 2, 0)

    def _at_start(self, invariant: Lanes) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.full(self._h.size, np.inf), np.full(self._h.size, -np.inf)
        self._widen(invariant, low, high, 0, *(x[None].copy() for x in self._values()))
        return low, high

    def _widen(
        self, invariant: Lanes, low: np.ndarray, high: np.ndarray, first: int, u: np.ndarray, v: np.ndarray
    ) -> None:
        """Widen the extremes of an invariant by its values in the states from step index `first` on."""
        flat = len(u), self._state.shape[1]
        invariant.call(first, self._h, self._t0, self._p, u.reshape(flat), v.reshape(flat), low, high)

    def _next_target(self) -> int:
        """Return the step index of the end of the next chunk, before which no member ends."""
        half = self._half[self._runs & (self._half > self._index)]
        most = max(1, _SCRATCH_VALUES // self._state.shape[1]) * self._every
        nearest = min([self._ends[self._runs].min(), *half])
        return min(int(nearest), self._index + min(self._chunk, most))

    @property
    def _every(self) -> int:
        """The kernel writes the states whose step index is a multiple of this."""
        return 1 if self.shared.invariants else self.shared.histories.every

    def _advance(self, target: int) -> None:
        """Go on to a step index. If a member fails on the way, stay, and let it end at its last finite state."""
        first, every, before = self._index, self._every, (self._state.copy(), self._tally.copy())
        try:
            u, v = self._take(target, every)
            failed = self._runs & ~np.isfinite(self._rows[:2]).all(axis=(0, 1))
            if failed.any():
                self._go_back(first, before)
                self._find_ends(np.flatnonzero(failed), target)
        except Exception:
            self._go_back(first, before)
            raise
        if failed.any():
            self._go_back(first, before)
        else:
            self._observe(first, every, u, v)
        self._end(self._runs & (self._ends == self._index))

    def _take(self, target: int, every: int) -> tuple[np.ndarray, np.ndarray]:
        """Call the kernel up to a step index, and return the states that it writes, each of shape (n, lanes)."""
        first, count = self._index, target - self._index
        u, v = (np.empty((target // every - first // every, self._state.shape[1])) for _ in range(2))
        run = Run(self._kernel_h, self._kernel_t0, self._p, first, count, every, u, v)
        begin = time.perf_counter()
        self.shared.kernel((self.shared.rhs.address, None), self._state, self._settings, self._tally, run)
        seconds = time.perf_counter() - begin
        self.seconds += seconds
        self._chunk = max(1, int(count * min(_CHUNK_GROWTH, _CHUNK_SECONDS / (seconds + 1e-9))))
        self._index = target
        shape = -1, *self._rows.shape[1:]
        return u.reshape(shape), v.reshape(shape) / self._unit

    def _go_back(self, index: int, before: tuple[np.ndarray, np.ndarray]) -> None:
        self._index, (self._state[:], self._tally[:]) = index, before

    def _find_ends(self, lanes: np.ndarray, target: int) -> None:
        """Set the ends of the members in these lanes, which are not finite at the step index `target`."""
        self._ends[lanes] = target - 1
        most = max(1, _SCRATCH_VALUES // self._state.shape[1])
        while lanes.size and self._index < target:
            first = self._index
            u, v = self._take(min(target, first + most), every=1)
            finite = np.isfinite(u[..., lanes]) & np.isfinite(v[..., lanes])  # shape (steps, n, lanes)
            good = finite.all(axis=1)
            for place in np.flatnonzero(~good.all(axis=0)):
                lane, step = int(lanes[place]), int(np.argmin(good[:, place]))
                degree = None if self.shared.layout.form is SCALAR else int(np.argmin(finite[step, :, place]))
                what = became_non_finite(self._t0 + (first + step) * self._h[lane], self._h[lane], degree)
                self._ends[lane] = first + step
                self._failed[lane] = f"{what}; solution.explain() looks for the reason."
            lanes = lanes[good.all(axis=0)]

    def _observe(self, first: int, every: int, u: np.ndarray, v: np.ndarray) -> None:
        """Process the states of a chunk: the extremes, and the states to save."""
        if self.shared.layout.form is VECTOR:
            self._check_written()
        for name, invariant in self.shared.invariants.items():
            self._widen(invariant, *self._extremes[name], first + 1, u, v)
        kept = self.shared.histories.every
        rows = slice(-(first + 1) % kept, None, kept) if every < kept else slice(None)
        self._save(first // kept + 1, u[rows], v[rows])
        half = self._half == self._index
        if half.any():
            u_size, v_size = self._sizes()
            self._u_natural = np.where(half, u_size, self._u_natural)
            self._v_natural = np.where(half, v_size, self._v_natural)

    def _check_written(self) -> None:
        """Refuse a rhs that stops writing an entry of a: the entry would keep its value from an earlier evaluation."""
        u, v = (np.ascontiguousarray(row).ravel() for row in self._rows[:2])
        t = self._kernel_t0 + (self._index - 1) * self._kernel_h  # no method has to evaluate rhs at the end of a run
        filled = [np.full_like(u, value) for value in (np.nan, 0.0)]  # a value that rhs computes may be NaN too
        for a in filled:
            self.shared.rhs.call(t, u, v, self._p, a)
        unwritten = (np.isnan(filled[0]) & (filled[1] == 0)).reshape(self._rows.shape[1:])[:, self._runs]
        if unwritten.any():
            raise unwritten_entry(int(np.argmax(unwritten.any(axis=1))), self._t0 + (self._index - 1) * self._h[0])

    def _save(self, row: int, u: np.ndarray, v: np.ndarray) -> None:
        if len(u):
            self.shared.histories.save(self._members[self._runs], row, u[..., self._runs], v[..., self._runs])

    def _values(self) -> tuple[np.ndarray, np.ndarray]:
        """Return u and v, each of shape (n, lanes)."""
        return self._rows[0], self._rows[1] / self._unit

    def _sizes(self) -> tuple[np.ndarray, np.ndarray]:
        u, v = self._values()
        return np.abs(u).max(axis=0), np.abs(v).max(axis=0)

    def _interrupt(self, what: str) -> None:
        """End all members that still run."""
        for lane in np.flatnonzero(self._runs):
            t = self._t0 + self._index * self._h[lane]
            self._failed[lane] = f"{what} t = {t:g}."
        self._end(self._runs.copy(), Status.INTERRUPTED)

    def _end(self, ended: np.ndarray, failure: Status = Status.DIVERGED) -> None:
        """End the members in the lanes of a mask. Those with an entry in `_failed` get the status `failure`."""
        if not ended.any():
            return
        histories, members = self.shared.histories, self._members
        u, v = self._values()
        n_rhs = 1 + int(self._tally[EVALUATIONS])
        histories.end(members[ended], self._index, u[:, ended], v[:, ended], n_rhs)
        for name, (low, high) in self._extremes.items():
            histories.bound(name, members[ended], self._start[name][ended], low[ended], high[ended])
        for lane in np.flatnonzero(ended):
            if lane in self._failed:
                histories.judge(int(members[lane]), failure, self._failed[lane])
        for member in members[self._suspects() & ended]:
            if histories.status[member] is Status.COMPLETED:
                alone = self.shared.alone(int(member))
                histories.judge(int(member), alone.status, alone.message)
        self._runs &= ~ended
        if self._runs.any():
            self._repeat_a_member(~self._runs)

    def _suspects(self) -> np.ndarray:
        """Return a mask of the members that grew so much that the step may be the reason."""
        u, v = self._sizes()
        with np.errstate(all="ignore"):
            u_grown = (u > BLOWN_UP * self._u_natural) & (self._u_natural > 0)
            v_grown = (v > BLOWN_UP * self._v_natural) & (self._v_natural > 0)
        return u_grown | v_grown | (np.maximum(u, v) > OVERFLOWING)

    def _repeat_a_member(self, idle: np.ndarray) -> None:
        """Let the lanes of a mask repeat a member that still runs: it cannot fail where they do not."""
        layout, model = self.shared.layout, int(np.argmax(self._runs))
        self._rows[:, :, idle] = self._rows[:, :, model, None]
        self._h[idle] = self._h[model]
        first = layout.params_size if layout.shares_params else 0
        p = self._p[first:].reshape(-1, layout.lanes)
        p[:, idle] = p[:, model, None]
