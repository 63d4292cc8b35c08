"""A block of members that run together, in the lanes of SIMD registers."""

from __future__ import annotations

import time

import numpy as np

from ..analysis.divergence import became_non_finite
from ..kernels.protocol import SCALAR, VECTOR
from ..observers.growth import BLOWN_UP, OVERFLOWING
from ..observers.written import unwritten_entry
from ..solution import Status
from ..stepper import Cancel
from .growth import grown_by_step
from .lane_state import LaneState
from .shared import Shared

_CHUNK_SECONDS = 0.02  # duration of a chunk of steps, after which the members are looked at
_CHUNK_GROWTH = 16  # largest factor from the steps of one chunk to the steps of the next
_FIRST_CHUNK = 64  # steps
_SCRATCH_VALUES = 2**15  # values in an array of states that are not saved: 256 kB, so that it stays in the cache


class Block:
    """At most as many members of an ensemble as there are lanes.

    A lane whose member has ended, or that has none, repeats a member that still runs. So it cannot fail where that
    member does not.

    Parameters
    ----------
    shared : Shared
    numbers : ndarray of int
        The numbers of the members.
    """

    def __init__(self, shared: Shared, numbers: np.ndarray) -> None:
        self.shared, self.numbers = shared, numbers
        self.seconds = 0.0  # in the kernel

    def __len__(self) -> int:
        return len(self.numbers)

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        self._stop = stop
        self._begin()
        while self._runs.any() and not stop.is_set():
            try:
                self._advance()
            except Exception as error:
                self._interrupt(f"The run raised {type(error).__name__}")
                raise
        self._interrupt("The run was interrupted")
        self.seconds = self._state.seconds

    def _begin(self) -> None:
        shared, lanes = self.shared, np.arange(self.shared.layout.lanes)
        self._runs = lanes < len(self.numbers)  # the lanes whose member has not ended
        self._members = self.numbers[np.where(self._runs, lanes, 0)]
        self._ends = shared.members.n_steps[self._members]  # the step indices at which the members end
        self._failed: dict[int, str] = {}  # why a member ends early, by its lane
        self._state = state = LaneState(shared, self._members)
        self._chunk = _FIRST_CHUNK
        self._set_natural()
        u, v = (x[None].copy() for x in state.values)
        self._extremes = {}
        for name, invariant in shared.invariants.items():
            self._extremes[name] = np.full(lanes.size, np.inf), np.full(lanes.size, -np.inf)
            state.widen(self._extremes[name], invariant, 0, u, v)
        self._start = {name: low.copy() for name, (low, _) in self._extremes.items()}
        self._save(0, u, v)
        self._end_broken(state.first_acceleration)

    def _set_natural(self) -> None:
        """Set the natural sizes of u and v, as `eig3.observers.growth` defines them."""
        state = self._state
        u, v = state.sizes
        with np.errstate(all="ignore"):
            span = self._ends * state.h
            self._v_natural = v + span * np.abs(state.first_acceleration).max(axis=0)
            self._u_natural = u + span * self._v_natural
        self._half = np.where(self._v_natural == 0, self._ends // 2, 0)  # step indices at which they are set again

    def _end_broken(self, a: np.ndarray) -> None:
        """End the members whose acceleration at the start is not finite."""
        broken = self._runs & ~np.isfinite(a).all(axis=0)
        for lane in np.flatnonzero(broken).tolist():
            self._failed[lane] = f"rhs gives {a[:, lane][~np.isfinite(a[:, lane])][0]} at the start."
        self._end(broken)

    @property
    def _every(self) -> int:
        """The kernel writes the states whose step index is a multiple of this."""
        return 1 if self.shared.invariants else self.shared.histories.every

    @property
    def _most_states(self) -> int:
        return max(1, _SCRATCH_VALUES // self._state.values[0].size)

    def _target(self) -> int:
        """Return the step index of the end of the next chunk, before which no member ends."""
        index = self._state.index
        half = self._half[self._runs & (self._half > index)]
        nearest = min([self._ends[self._runs].min(), *half])
        return min(int(nearest), index + min(self._chunk, self._most_states * self._every))

    def _advance(self) -> None:
        """Take a chunk of steps. If a member fails on the way, stay, and let it end at its last finite state."""
        state, target, before = self._state, self._target(), self._state.save()
        begin = time.perf_counter()
        try:
            u, v = state.advance(target, self._every)
            self._set_chunk(target - before[0], time.perf_counter() - begin)
            failed = self._runs & ~state.is_finite
            if failed.any():
                state.restore(before)
                self._find_ends(np.flatnonzero(failed), target)
        except Exception:
            state.restore(before)
            raise
        if failed.any():
            state.restore(before)
        else:
            self._observe(before[0], u, v)
        self._end(self._runs & (self._ends == state.index))

    def _set_chunk(self, steps: int, seconds: float) -> None:
        self._chunk = max(1, int(steps * min(_CHUNK_GROWTH, _CHUNK_SECONDS / (seconds + 1e-9))))

    def _find_ends(self, lanes: np.ndarray, target: int) -> None:
        """Set the ends of the members in these lanes, which are not finite at the step index `target`."""
        state = self._state
        self._ends[lanes] = target - 1
        while lanes.size and state.index < target:
            first = state.index
            u, v = state.advance(min(target, first + self._most_states), every=1)
            finite = np.isfinite(u[..., lanes]) & np.isfinite(v[..., lanes])  # shape (states, n, lanes)
            good = finite.all(axis=1)
            for place in np.flatnonzero(~good.all(axis=0)):
                lane, step = int(lanes[place]), int(np.argmin(good[:, place]))
                degree = None if self.shared.layout.form is SCALAR else int(np.argmin(finite[step, :, place]))
                what = became_non_finite(state.t0 + (first + step) * state.h[lane], state.h[lane], degree)
                self._ends[lane] = first + step
                self._failed[lane] = f"{what}; solution.explain() looks for the reason."
            lanes = lanes[good.all(axis=0)]

    def _observe(self, first: int, u: np.ndarray, v: np.ndarray) -> None:
        """Process the states of a chunk: the extremes, and the states to save."""
        shared, state, kept = self.shared, self._state, self.shared.histories.every
        if shared.layout.form is VECTOR:
            self._check_written()
        for name, invariant in shared.invariants.items():
            state.widen(self._extremes[name], invariant, first + 1, u, v)
        rows = slice(-(first + 1) % kept, None, kept) if self._every < kept else slice(None)
        self._save(first // kept + 1, u[rows], v[rows])
        half = self._half == state.index
        if half.any():
            u_size, v_size = state.sizes
            self._u_natural = np.where(half, u_size, self._u_natural)
            self._v_natural = np.where(half, v_size, self._v_natural)

    def _check_written(self) -> None:
        """Refuse a rhs that stops writing an entry of a: the entry would keep its value from an earlier evaluation."""
        state = self._state
        unwritten = state.unwritten()[:, self._runs].any(axis=1)
        if unwritten.any():
            raise unwritten_entry(int(np.argmax(unwritten)), state.t0 + (state.index - 1) * state.h[0])

    def _save(self, row: int, u: np.ndarray, v: np.ndarray) -> None:
        if len(u):
            self.shared.histories.save(self._members[self._runs], row, u[..., self._runs], v[..., self._runs])

    def _interrupt(self, what: str) -> None:
        """End all members that still run."""
        state = self._state
        for lane in np.flatnonzero(self._runs).tolist():
            self._failed[lane] = f"{what} after t = {state.t0 + state.index * state.h[lane]:g}."
        self._end(self._runs.copy(), Status.INTERRUPTED)

    def _end(self, ended: np.ndarray, failure: Status = Status.DIVERGED) -> None:
        """End the members in the lanes of a mask. Those with an entry in `_failed` get the status `failure`."""
        if not ended.any():
            return
        histories, members, state = self.shared.histories, self._members, self._state
        u, v = state.values
        histories.end(members[ended], state.index, u[:, ended], v[:, ended], state.n_rhs)
        for name, (low, high) in self._extremes.items():
            histories.bound(name, members[ended], self._start[name][ended], low[ended], high[ended])
        for lane in np.flatnonzero(ended).tolist():
            if lane in self._failed:
                histories.judge(int(members[lane]), failure, self._failed[lane])
        self._judge_growth(np.flatnonzero(self._suspects() & ended))
        self._runs &= ~ended
        if self._runs.any():
            state.repeat(int(np.argmax(self._runs)), ~self._runs)

    def _suspects(self) -> np.ndarray:
        """Return a mask of the members that grew so much that the step may be the reason."""
        u, v = self._state.sizes
        with np.errstate(all="ignore"):
            u_grown = (u > BLOWN_UP * self._u_natural) & (self._u_natural > 0)
            v_grown = (v > BLOWN_UP * self._v_natural) & (self._v_natural > 0)
        return u_grown | v_grown | (np.maximum(u, v) > OVERFLOWING)

    def _judge_growth(self, lanes: np.ndarray) -> None:
        """Let runs alone tell whether the members in these lanes grew because of their step, if they may have."""
        shared, histories = self.shared, self.shared.histories
        lanes = lanes[histories.status[self._members[lanes]] == Status.COMPLETED]
        if not lanes.size:
            return
        sizes = np.array(self._state.sizes)[:, lanes]
        for member in grown_by_step(shared, self._members[lanes], sizes, self._stop).tolist():
            alone = shared.alone(member, self._stop)
            histories.judge(member, alone.status, alone.message)
