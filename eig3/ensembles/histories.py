"""The arrays with the results of an ensemble, which its blocks fill."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from threading import Lock
from typing import Any

import numpy as np

from ..functions.extremes import Extremes
from ..kernels.protocol import SCALAR, TERMINAL
from ..result.columns import OF_RUNS, each
from ..result.memory import check_members_history, n_rows
from ..result.occurrences import Occurrences
from ..result.solution import Solution, Status, whole_rows
from ..run.chunks import ended_by_event
from ..stepping.followed import n_invariants, spacing_of
from ..stepping.run_options import RunOptions
from .members import Members
from .occurrences import MemberOccurrences
from .solution import EnsembleSolution, widened

REACHED = "The run reached the end of its span."
_NOT_STARTED = "The run was interrupted before this member started."


class Histories:
    """The saved states, ends, extremes and events of all members.

    Raises
    ------
    MemoryError
        If the states do not fit in memory.
    """

    def __init__(self, members: Members, options: RunOptions) -> None:
        m, n, functions = len(members), members.n, options.functions
        self.members, self.options, self.every = members, options, options.every
        rows = options.rows(int(members.n_steps.max()))
        check_members_history(m, rows, n, functions.n_outputs)
        self.u, self.v = np.full((m, rows, n), np.nan), np.full((m, rows, n), np.nan)
        self._t, self.steps = self._first_times(rows), np.full((m, rows), np.nan) if options.tolerances else None
        self._room, self._longest = Lock(), rows
        if options.t_eval is None:
            self.u[:, 0], self.v[:, 0] = members.u0, members.v0
        counts = (np.zeros(m, dtype=np.int64) for _ in range(5))
        self.n_steps, self.n_rhs, self.n_iterations, self.n_rejected, self.n_invariants = counts
        self.h = np.array(members.steps)
        self.status = np.full(m, Status.INTERRUPTED, dtype=object)
        self.message = np.full(m, _NOT_STARTED, dtype=object)
        self.drift = {name: np.zeros(m) for name in functions.invariants}
        # The arrays have an axis of k values, which is 1 for a quantity with one value.
        shapes = {**dict.fromkeys(functions.invariants, ()), **functions.shapes}
        self._shapes: dict[str, tuple[int, ...]] = shapes
        self.outputs = {name: np.full((m, rows, *(shapes[name] or (1,))), np.nan) for name in functions.outputs}
        self.extremes = {name: Extremes(*np.full((4, m, *(shape or (1,))), np.nan)) for name, shape in shapes.items()}
        self.events: dict[str, list[tuple[np.ndarray, Occurrences]]] = {name: [] for name in options.events}
        self.last: dict[int, dict[str, Any]] = {}  # the columns of the last state, if save_every does not include it

    def save(
        self, chosen: np.ndarray, row: int, u: np.ndarray, v: np.ndarray, outputs: Mapping[str, np.ndarray]
    ) -> None:
        """Save states from a row on; u, v and the outputs have the shape (states, n or k, members)."""
        for whole, values in self._beside(u, v, outputs):
            whole[chosen, row : row + len(u)] = values.transpose(2, 0, 1)

    def end(
        self,
        chosen: np.ndarray,
        index: int,
        u: np.ndarray,
        v: np.ndarray,
        outputs: Mapping[str, np.ndarray],
        n_rhs: np.ndarray,
    ) -> None:
        """End members after `index` steps, with u, v and the outputs of their last states, shape (n, members)."""
        self._count(chosen, np.full(len(chosen), index), n_rhs)
        complete = self.members.n_steps[chosen] == index
        self.status[chosen[complete]], self.message[chosen[complete]] = Status.COMPLETED, REACHED
        row = n_rows(index, self.every) - 1
        for whole, values in self._beside(u, v, outputs):
            whole[chosen[complete], row] = values.T[complete]
        if index % self.every:
            for place in np.flatnonzero(~complete):
                member = int(chosen[place])
                t = self.members.t_span[0] + index * float(self.members.steps[member])
                last: dict[str, Any] = {"t": t, "z": {}}
                last["u"], last["v"] = (self.shaped(x[:, place].copy()) for x in (u, v))
                last["outputs"] = {name: self._valued(name, x[:, place].copy()) for name, x in outputs.items()}
                self.last[member] = last

    def _count(self, chosen: np.ndarray, n_steps: np.ndarray, n_rhs: np.ndarray) -> None:
        """Store the counts of members that ran in lanes."""
        self.n_steps[chosen], self.n_rhs[chosen] = n_steps, n_rhs
        if self.drift:
            spacing = spacing_of(self.options.functions.invariants_every)
            counts, of_member = np.unique(n_steps, return_inverse=True)
            self.n_invariants[chosen] = np.array([n_invariants(int(n), spacing) for n in counts])[of_member]

    def _beside(
        self, u: np.ndarray, v: np.ndarray, outputs: Mapping[str, np.ndarray]
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the arrays of the histories, each with its new values."""
        yield self.u, u
        yield self.v, v
        for name, values in outputs.items():
            yield self.outputs[name], values

    def bound(self, name: str, chosen: np.ndarray, start: np.ndarray, extremes: np.ndarray) -> None:
        """Store the extremes of a quantity, and the drift of an invariant from its values at the start.

        `start` has the shape (k, members), and `extremes` (4, k, members), with step indices instead of times.
        """
        members, (low, high, *indices) = self.members, extremes
        t0, t1 = members.t_span
        times = (np.where(i == members.n_steps[chosen], t1, t0 + i * members.steps[chosen]) for i in indices)
        for row, values in zip(self.extremes[name], (low, high, *times), strict=True):
            row[chosen] = values.T
        if name in self.drift:
            self.drift[name][chosen] = np.maximum(start - low, high - start)[0]

    def judge(self, member: int, status: Status, message: str) -> None:
        """Set how a member ended."""
        self.status[member], self.message[member] = status, message

    def take(self, member: int, solution: Solution) -> None:
        """Store the result of a member that ran alone."""
        t, u, v = whole_rows(solution, self.members.n)
        states = {"t": t, "u": u, "v": v, "steps": solution.steps, "outputs": solution.outputs, "z": {}}
        rows = len(t)
        self.last.pop(member, None)  # from the same member in lanes
        if self.options.has_own_times:
            with self._room:
                self._reserve(rows)
                self._store(member, rows, states)
        else:
            if self.options.t_eval is None and solution.n_steps < self.members.n_steps[member]:
                rows = min(rows, solution.n_steps // self.every + 1)
            self._store(member, rows, states)
            if rows < len(t):  # save_every does not include the last state of a run that failed
                self.last[member] = {name: each(lambda x: x[-1], x) for name, x in states.items() if x is not None}
        for name in OF_RUNS:
            whole, value = getattr(self, name), getattr(solution, name)
            if isinstance(whole, np.ndarray):
                whole[member] = value
            elif whole:
                each(lambda x, one: x.__setitem__(member, one), whole, value)
        for name, occurrences in solution.events.items():
            if len(occurrences):
                self.events[name].append((np.full(len(occurrences), member), occurrences))

    def reach(
        self, chosen: np.ndarray, t: np.ndarray, n_steps: np.ndarray, n_rejected: np.ndarray, n_rhs: np.ndarray
    ) -> None:
        """Store the counts of members with tolerances that ran in lanes to their ends at t."""
        self._count(chosen, n_steps, n_rhs)
        self.n_rejected[chosen] = n_rejected
        self.h[chosen] = (t - self.members.t_span[0]) / np.maximum(1, n_steps)
        self.status[chosen], self.message[chosen] = Status.COMPLETED, REACHED

    def save_rows(self, chosen: np.ndarray, first: Sequence, place: np.ndarray, rows: Sequence, last: Sequence) -> None:
        """Store the first states of members with their own times, some rows, and the last states, if no row has them.

        Each sequence has times, steps, u, v and the outputs. A row belongs to the member at its `place` in `chosen`;
        the places increase.
        """
        if not len(chosen):
            return
        count = np.bincount(place, minlength=len(chosen))
        ends = np.cumsum(count)
        has_rows = np.flatnonzero(count)
        is_new = np.ones(len(chosen), dtype=bool)
        t, _, u, v = (x[ends[has_rows] - 1] == y[has_rows] for x, y in zip(rows[:4], last[:4], strict=True))
        is_new[has_rows] = ~(t & u.all(axis=1) & v.all(axis=1))
        row = 1 + np.arange(len(place)) - (ends - count)[place]
        with self._room:
            self._reserve(1 + int((count + is_new).max()))
            wholes = self._t, self.steps, self.u, self.v, *self.outputs.values()
            for whole, begin, between, end in zip(wholes, first, rows, last, strict=True):
                assert whole is not None
                whole[chosen, 0], whole[chosen[place], row] = begin, between
                whole[chosen[is_new], 1 + count[is_new]] = end[is_new]

    def stop(
        self,
        chosen: np.ndarray,
        index: np.ndarray,
        t: np.ndarray,
        u: np.ndarray,
        v: np.ndarray,
        n_rhs: np.ndarray,
        outputs: Mapping[str, np.ndarray],
    ) -> None:
        """End members after `index` steps, at the times and in the states of events; their later states are dropped.

        u, v and the outputs have the shape (members, n or k).
        """
        assert self._t is not None
        self._count(chosen, index, n_rhs)
        grid = self.members.t_span[0] + index * self.members.steps[chosen]
        last = index // self.every + ((index % self.every > 0) | (t > grid))
        later, places = np.arange(self.u.shape[1]) > last[:, None], np.arange(len(chosen))
        for whole, end in ((self._t, t), *self._beside(u, v, outputs)):
            values = whole[chosen]
            values[later], values[places, last] = np.nan, end
            whole[chosen] = values

    def note_events(self, member: np.ndarray, rows: np.ndarray) -> None:
        """Store occurrences of members that ran in lanes, from the rows of a log: see `eig3.kernels.protocol.Watch`."""
        states = rows[:, 2:].reshape(len(rows), 4, self.members.n)
        for k, name in enumerate(self.events):
            mine = rows[:, 0] == k
            found = Occurrences(rows[mine, 1], *(self.shaped(states[mine, i]) for i in range(4)))
            self.events[name].append((member[mine], self._separated(found)))

    def _separated(self, found: Occurrences) -> Occurrences:
        unknowns = self.options.first_order
        return found.separated(unknowns) if unknowns.names else found

    def end_by_events(self, chosen: np.ndarray, event: np.ndarray, t: np.ndarray) -> None:
        """Set the status of members that the events of these numbers have ended."""
        names = list(self.events)
        for member, k, time in zip(chosen.tolist(), event.tolist(), t.tolist(), strict=True):
            self.judge(member, *ended_by_event(TERMINAL, names[int(k)], time))

    def _store(self, member: int, rows: int, states: Mapping[str, Any]) -> None:
        """Write the rows of a member, and NaN after them."""
        values = [(self._t, states["t"]), (self.u, states["u"]), (self.v, states["v"]), (self.steps, states["steps"])]
        values += [(self.outputs[name], x) for name, x in states["outputs"].items()]
        for whole, x in values:
            if whole is not None:
                whole[member, :rows] = np.reshape(x[:rows], (rows, *whole.shape[2:]))
                whole[member, rows:] = np.nan

    def _reserve(self, rows: int) -> None:
        """Reserve space for members with more states than the others."""
        self._longest = max(self._longest, rows)
        room = self.u.shape[1]
        if rows <= room:
            return
        wanted = max(rows, 2 * room)
        check_members_history(len(self.members), wanted, self.members.n, self.options.functions.n_outputs)
        histories = self.u, self.v, self._t, self.steps, self.outputs
        self.u, self.v, self._t, self.steps, self.outputs = (each(partial(widened, wanted), x) for x in histories)

    def solution(
        self,
        rhs: Any,
        seconds: float,
        notes: Sequence[str],
        repeat: Callable[[int], Solution],
        again: Callable[..., EnsembleSolution] | None,
    ) -> EnsembleSolution:
        """Return the result of the ensemble, or of its part."""
        rows = slice(self._longest)
        none = Occurrences(np.empty(0), *self.shaped(np.empty((4, 0, self.members.n))), labels=self.options.labels)
        none = self._separated(none)
        extremes = {name: each(partial(self._valued, name), x) for name, x in self.extremes.items()}
        solution = EnsembleSolution(
            **{name: getattr(self, name) for name in OF_RUNS} | {"extremes": extremes},
            t=self.t[:, rows],
            u=self.shaped(self.u[:, rows]),
            v=self.shaped(self.v[:, rows]),
            params=self.members.params,
            method=self.options.method,
            outputs={name: self._valued(name, x[:, rows]) for name, x in self.outputs.items()},
            events={name: MemberOccurrences.joined(len(self.u), none, each) for name, each in self.events.items()},
            steps=None if self.steps is None else self.steps[:, rows],
            first=self.members.first,
            labels=self.options.labels,
            kernel_seconds=seconds,
            notes=tuple(notes),
            _last=dict(self.last),
            _rhs=rhs,
            _repeat=repeat,
            _again=again,
        )
        if self.options.first_order.names:
            solution._separate(self.options.first_order)
        return solution

    @property
    def t(self) -> np.ndarray:
        """The times of the saved states, shape (m, s)."""
        if self._t is not None:
            return self._t
        if self.options.t_eval is not None:
            return np.broadcast_to(self.options.t_eval, self.u.shape[:2])
        return self._grid(self.u.shape[1])

    def _first_times(self, rows: int) -> np.ndarray | None:
        """Return an array for separate times of members, filled with the times of members in lanes."""
        if not self.options.has_own_times:
            return None
        t = np.full((len(self.members), rows), np.nan)
        t[:] = self.members.t_span if self.options.tolerances else self._grid(rows)
        return t

    def _grid(self, rows: int) -> np.ndarray:
        """Return the times of every k-th of the fixed steps, and of the end."""
        members = self.members
        t0, t1 = members.t_span
        if not members.has_own_step:
            t = t0 + np.minimum(np.arange(rows) * float(self.every), members.n_steps[0]) * members.h
            t[-1] = t1
            return np.broadcast_to(t, (len(members), rows))
        counts = members.n_steps[:, None]
        t = t0 + np.minimum(np.arange(rows) * float(self.every), counts) * members.h[:, None]
        last = -(-counts // self.every)
        t[np.arange(rows) == last] = t1
        t[np.arange(rows) > last] = np.nan
        return t

    def shaped(self, values: np.ndarray) -> Any:
        """Return values without the axis of the degrees of freedom, in the scalar form."""
        return values[..., 0] if self.members.form is SCALAR else values

    def _valued(self, name: str, values: np.ndarray) -> Any:
        """Return values without the axis of k values, for a quantity with one value."""
        return values if self._shapes[name] else values[..., 0]
