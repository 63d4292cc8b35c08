"""A block of members that run together, in the lanes of SIMD registers."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..diagnosis.divergence import became_non_finite, lost_constraints
from ..diagnosis.singular_position import AT_WHOLE_TURN, is_at_whole_turn
from ..functions.guard import not_finite_at_start
from ..kernels.loops.lane_search import LOST, SEARCHED, STOPPED
from ..kernels.protocol import SCALAR, VECTOR
from ..result.solution import Status
from ..run.chunks import unwritten_entry
from ..run.growth import BLOWN_UP, OVERFLOWING, natural_sizes
from ..stepping.march import Cancel
from ..stepping.run_options import NEVER
from .lane_state import LaneState
from .lanewise import FIRST_CHUNK, Setup
from .single_members import Alone

_SCRATCH_VALUES = 2**16  # values in an array of the states of a chunk: 512 kB, which fit in the cache
_CHECKED_STEPS = 1000  # between two checks that rhs writes every entry of a
_LONGER = 4  # largest ratio of the ends of consecutive chunks, if events may end members
_SAME = 2.0  # sizes with h and with h/2 within this factor are a property of the system, not of the step
_OTHER = 1e3  # sizes that differ by this factor are a result of the step
_FEW = 4  # members that are not clear; single runs of more take longer than a further run of all lanes
_SHORT = 2000  # in more steps, a motion that is unstable with half the step too becomes infinite


class Block(Alone):
    """Members of an ensemble that run together, one in each lane.

    A lane without a running member repeats a running member, so it fails only if that member fails.

    A member runs again alone if its events need a single run: see `eig3.kernels.loops.lane_search`.
    """

    def __init__(self, shared: Setup, numbers: np.ndarray) -> None:
        super().__init__(numbers, shared.histories, shared.single)
        self.shared, self._may_stop = shared, shared.histories.options.has_own_times
        self._state: Any = None
        self._runs = np.zeros(shared.layout.lanes, dtype=bool)  # the lanes whose member has not ended
        self._lost: list[int] = []  # the members that run again alone
        self._found: list[tuple[np.ndarray, np.ndarray]] = []  # the members and the rows of the occurrences
        self._checked = 0  # the step index at which rhs was last seen to write every entry

    def run(self, stop: Cancel) -> None:
        """Run the members to their ends, or until `stop` is set."""
        self._stop = stop
        with np.errstate(all="ignore"):  # members may overflow
            try:
                self._begin()
                while self._runs.any() and not stop.is_set():
                    self._advance()
                self._interrupt("The run was interrupted")
                self._drop_state()
                self.run_alone(self._lost, stop)
            except Exception as error:
                self._interrupt(f"The run raised {type(error).__name__}")
                raise
            finally:
                self._drop_state()
                self._note_events()

    def _drop_state(self) -> None:
        """Free the memory of the states: many blocks may wait for the others."""
        if self._state:
            self.seconds += self._state.seconds
        self._state = None

    def _note_events(self) -> None:
        """Store the occurrences of the members that did not run again alone."""
        if self._found:
            member, rows = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
            mine = ~np.isin(member, self._lost)
            self.histories.note_events(member[mine], rows[mine])
        self._found.clear()

    def _begin(self) -> None:
        shared, lanes = self.shared, np.arange(self.shared.layout.lanes)
        runs = lanes < len(self.numbers)
        self._members = self.numbers[np.where(runs, lanes, 0)]
        self._ends = self.histories.members.n_steps[self._members]  # the step indices at which the members end
        self._failed: dict[int, str] = {}  # the reason why a member ends early, by lane
        self._state = state = LaneState(shared, self.histories.members, self._members)
        self._runs = runs
        state.observer.rest(~runs)
        self._set_natural()
        u, v = state.values
        self._save(0, u[None], v[None], {name: state.observer.start[name][None] for name in self.histories.outputs})
        self._end_broken(state.first_acceleration)

    def _set_natural(self) -> None:
        """Set the natural sizes of u and v."""
        state = self._state
        first = *state.sizes, np.abs(state.first_acceleration).max(axis=0)
        self._u_natural, self._v_natural = natural_sizes(first, self._ends * state.h)
        self._half = np.where(self._v_natural == 0, self._ends // 2, 0)  # step indices at which they are set again

    def _end_broken(self, a: np.ndarray) -> None:
        """End the members whose acceleration at the start is not finite."""
        broken = self._runs & ~np.isfinite(a).all(axis=0)
        for lane in np.flatnonzero(broken).tolist():
            self._failed[lane] = not_finite_at_start(a[:, lane])
        self._end(broken)

    @property
    def _most_states(self) -> int:
        width = max([self.shared.layout.n, *(quantity.width for quantity, _ in self.shared.quantities.values())])
        return max(1, _SCRATCH_VALUES // (width * self.shared.layout.lanes))

    def _target(self) -> int:
        """Return the step index of the end of the next chunk; no member ends before it."""
        index = self._state.index
        half = self._half[self._runs & (self._half > index)]
        nearest = min([self._ends[self._runs].min(), *half])
        if self._may_stop:  # events may end most members soon
            nearest = min(nearest, _LONGER * max(index, FIRST_CHUNK))
        return min(int(nearest), index + min(self.shared.pace.steps, self._most_states * self.histories.every))

    def _advance(self) -> None:
        """Take a chunk of steps. If a member fails within it, do not advance, and end it at its last finite state."""
        state, target, before = self._state, self._target(), self._state.save()
        begin = time.perf_counter()
        try:
            states = state.advance(target, self.histories.every, self._stop)
            reached = state.index
            failed = self._runs & state.observer.doing(SEARCHED) & ~state.is_finite
            if failed.any():
                state.restore(before)
                self._find_ends(np.flatnonzero(failed), reached)
                state.restore(before)
            else:
                self._observe(before[0], *states)
                if self.shared.events:
                    self._take_events()
                if reached - before[0] >= self.shared.pace.steps:  # the time of a shorter chunk is inaccurate
                    self.shared.pace.note(reached - before[0], time.perf_counter() - begin)
        except Exception:
            state.restore(before)
            raise
        self._end(self._runs & (self._ends == state.index))

    def _take_events(self) -> None:
        """Take the occurrences of a chunk, and end the members that it has ended or lost."""
        observer = self._state.observer
        for lanes, rows in observer.found():
            self._found.append((self._members[lanes], rows))
        lost = self._runs & observer.doing(LOST)
        for member in self._members[lost].tolist():
            self.histories.judge(member, Status.INTERRUPTED, "The run was interrupted before the events were found.")
            self._lost.append(member)
        self._stop_members(self._runs & observer.doing(STOPPED))
        self._leave(lost)

    def _stop_members(self, stopped: np.ndarray) -> None:
        """End the members in the lanes of a mask, which events have ended."""
        if not stopped.any():
            return
        histories, state, chosen = self.histories, self._state, self._members[stopped]
        observer, formulas = state.observer, self.shared.method.formulas.names(VECTOR)
        t, event, index, u, v = (x[..., stopped] for x in observer.ends)
        index = index.astype(np.int64)
        started = np.minimum(index, formulas["START_STEPS"])
        n_rhs = 1 + formulas["START_COST"] * started + formulas["COST"] * (index - started)
        ends = {name: observer.at_end(name) for name in observer.start}
        outputs = {name: ends[name][0][:, stopped].T for name in histories.outputs}
        histories.stop(chosen, index - 1, t, u.T, v.T, n_rhs + observer.evaluations[stopped], outputs)
        histories.end_by_events(chosen, event, t)
        for name, start in observer.start.items():
            histories.bound(name, chosen, start[:, stopped], state.in_steps(ends[name][1])[..., stopped])
        self._leave(stopped)

    def _find_ends(self, lanes: np.ndarray, target: int) -> None:
        """Find the ends of the members in these lanes, which are not finite at the step index `target`."""
        state = self._state
        self._ends[lanes] = target - 1
        while lanes.size and state.index < target and not self._stop.is_set():
            first, begin = state.index, [x.copy() for x in state.values]
            u, v, _ = state.advance(min(target, first + self._most_states), 1, self._stop)
            finite = np.isfinite(u[..., lanes]) & np.isfinite(v[..., lanes])  # shape (states, n, lanes)
            good = finite.all(axis=1)
            for place in np.flatnonzero(~good.all(axis=0)):
                lane, step = int(lanes[place]), int(np.argmin(good[:, place]))
                degree = None if self.shared.layout.form is SCALAR else int(np.argmin(finite[step, :, place]))
                labels, h = self.histories.options.labels, state.h[lane]
                what = became_non_finite(state.t0 + (first + step) * h, h, degree, labels)
                self._ends[lane] = first + step
                last_u, last_v = ((x[step - 1] if step else x0)[:, lane] for x, x0 in zip((u, v), begin, strict=True))
                lost = lost_constraints(bool(self.shared.constrained_step or self.shared.project))
                is_turned = is_at_whole_turn(labels, last_u, last_v, h)
                why = f"{AT_WHOLE_TURN}." if is_turned else f"{lost}; solution.explain() looks for the reason."
                self._failed[lane] = f"{what}{why}"
            lanes = lanes[good.all(axis=0)]

    def _observe(self, first: int, u: np.ndarray, v: np.ndarray, outputs: dict[str, np.ndarray]) -> None:
        """Process a chunk, with its saved states and outputs."""
        shared, state = self.shared, self._state
        ends = (self._runs & (self._ends == state.index)).any()
        if shared.layout.form is VECTOR and (ends or state.index - self._checked >= _CHECKED_STEPS):
            self._check_written()
        self._save(first // self.histories.every + 1, u, v, outputs)
        half = self._half == state.index
        if half.any():
            u_size, v_size = state.sizes
            self._u_natural = np.where(half, u_size, self._u_natural)
            self._v_natural = np.where(half, v_size, self._v_natural)

    def _check_written(self) -> None:
        """Refuse a rhs that does not write an entry of a, which would keep its value from an earlier evaluation."""
        state = self._state
        self._checked = state.index
        degrees, lanes = np.nonzero(state.unwritten() & self._runs)
        if degrees.size:
            raise unwritten_entry(int(degrees[0]), state.t0 + (state.index - 1) * state.h[lanes[0]])

    def _save(self, row: int, u: np.ndarray, v: np.ndarray, outputs: dict[str, np.ndarray]) -> None:
        if len(u):
            runs = self._runs
            chosen = {name: values[..., runs] for name, values in outputs.items()}
            self.histories.save(self._members[runs], row, u[..., runs], v[..., runs], chosen)

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
        histories, members, state = self.histories, self._members, self._state
        u, v = state.values
        outputs = {name: state.observer.latest(name)[:, ended] for name in histories.outputs}
        histories.end(members[ended], state.index, u[:, ended], v[:, ended], outputs, state.n_rhs[ended])
        for name, start in state.observer.start.items():
            histories.bound(name, members[ended], start[:, ended], state.extremes(name)[..., ended])
        for lane in np.flatnonzero(ended).tolist():
            if lane in self._failed:
                histories.judge(int(members[lane]), failure, self._failed[lane])
        self._judge_growth(self._suspects() & ended)
        self._leave(ended)

    def _leave(self, ended: np.ndarray) -> None:
        """Make the lanes of a mask repeat a running member, if there is one."""
        self._runs &= ~ended
        if self._runs.any():
            self._state.repeat(int(np.argmax(self._runs)), ~self._runs)

    def _suspects(self) -> np.ndarray:
        """Return a mask of the members that grew so much that the step may be the reason."""
        u, v = self._state.sizes
        u_grown = (u > BLOWN_UP * self._u_natural) & (self._u_natural > 0)
        v_grown = (v > BLOWN_UP * self._v_natural) & (self._v_natural > 0)
        return u_grown | v_grown | (np.maximum(u, v) > OVERFLOWING)

    def _judge_growth(self, suspects: np.ndarray) -> None:
        """End suspects that grew because of their step as diverged.

        Numerical growth changes by orders of magnitude with half the step, or with a quarter of it: in a run of few
        steps, the sizes with h and with h/2 may be the same by chance. If these tests are not conclusive, or the motion
        is random, a single run finds the critical steps, which takes longer than thousands of steps in lanes.
        """
        histories, state = self.histories, self._state
        suspects = suspects & (histories.status[self._members] == Status.COMPLETED)
        if not suspects.any():
            return
        sizes, parts = np.array(state.sizes), np.full(len(suspects), 2)
        if self.shared.method.is_stochastic:
            finer, ratio = sizes, np.full(len(suspects), _SAME)
        else:
            finer, ratio = self._compared(suspects, 2, sizes)
            is_short = state.index < _SHORT
            unclear = suspects & (ratio < _OTHER) & (is_short | (ratio >= _SAME))
            if unclear.sum() > (0 if is_short else _FEW):
                quarter, other = self._compared(unclear, 4, sizes)
                clear = unclear & (other >= _OTHER)
                finer[:, clear], ratio[clear], parts[clear] = quarter[:, clear], other[clear], 4
        for lane in np.flatnonzero(suspects & ~(ratio < _SAME)).tolist():
            member, h = int(self._members[lane]), state.h[lane]
            if self._stop.is_set():
                message = "The run was interrupted before it was known whether the motion grew because of its step."
                histories.judge(member, Status.INTERRUPTED, message)
            elif ratio[lane] < _OTHER:
                alone = self.single.plain(member, self._stop)
                histories.judge(member, alone.status, alone.message)
            else:
                histories.judge(
                    member,
                    Status.DIVERGED,
                    f"The motion stayed finite, but grew because of the step h = {h:g}: its largest u or v at the end "
                    f"is {sizes[:, lane].max():.2g}, and {finer[:, lane].max():.2g} with h = {h / parts[lane]:g}; "
                    "solution.explain() looks for the reason.",
                )

    def _compared(self, suspects: np.ndarray, parts: int, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest |u| and |v| at the end of the suspects with a part of the step, and the ratio to `sizes`.

        The shapes are (2, lanes) and (lanes,). The ratio is at least 1.
        """
        everyone, model = self.histories.members, self._members[np.argmax(suspects)]
        members = np.where(suspects, self._members, model)
        divided = replace(everyone, h=everyone.h / parts, n_steps=parts * everyone.n_steps)
        state = LaneState(self.shared, divided, members)
        state.advance(int(divided.n_steps[members[0]]), NEVER, self._stop)
        finer = np.array(state.sizes)
        return finer, np.where(sizes == finer, 1.0, np.maximum(sizes / finer, finer / sizes)).max(axis=0)
