"""The arrays with the results of an ensemble, which its blocks fill."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..functions.extremes import Extremes
from ..functions.quantities import Functions
from ..kernels.protocol import SCALAR
from ..methods import Method
from ..result.memory import check_members_history, n_rows
from ..result.solution import Solution, Status
from ..stepping.stepper import NEVER
from .members import Members
from .solution import EnsembleSolution

REACHED = "The run reached the end of its span."
_NOT_STARTED = "The run was interrupted before this member started."


class Histories:
    """The saved states, ends and extremes of all members.

    Parameters
    ----------
    members : Members
    save_every : int or None
    functions : Functions
        The invariants and the outputs.

    Raises
    ------
    MemoryError
        If the states do not fit in memory.
    """

    def __init__(self, members: Members, save_every: int | None, functions: Functions) -> None:
        m, n = len(members), members.n
        self.members = members
        self.every = NEVER if save_every is None else save_every
        rows = n_rows(int(members.n_steps.max()), self.every)
        check_members_history(m, rows, n, functions.n_outputs)
        self.u, self.v = np.full((m, rows, n), np.nan), np.full((m, rows, n), np.nan)
        self.u[:, 0], self.v[:, 0] = members.u0, members.v0
        self.n_steps, self.n_rhs, self.n_iterations = (np.zeros(m, dtype=np.int64) for _ in range(3))
        self.status = np.full(m, Status.INTERRUPTED, dtype=object)
        self.message = np.full(m, _NOT_STARTED, dtype=object)
        self.drift = {name: np.zeros(m) for name in functions.invariants}
        # The arrays have an axis of k values, which is 1 for a quantity with one value.
        shapes = {**dict.fromkeys(functions.invariants, ()), **functions.shapes}
        self._shapes: dict[str, tuple[int, ...]] = shapes
        self.outputs = {name: np.full((m, rows, *(shapes[name] or (1,))), np.nan) for name in functions.outputs}
        self.extremes = {name: np.full((4, m, *(shape or (1,))), np.nan) for name, shape in shapes.items()}
        self.last: dict[int, tuple] = {}  # t, u, v and the outputs of the last state, if it is not one to save

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
        n_rhs: int,
    ) -> None:
        """End members after `index` steps; u, v and the outputs are those of their last states, shape (n, members)."""
        self.n_steps[chosen], self.n_rhs[chosen] = index, n_rhs
        complete = self.members.n_steps[chosen] == index
        self.status[chosen[complete]], self.message[chosen[complete]] = Status.COMPLETED, REACHED
        row = n_rows(index, self.every) - 1
        for whole, values in self._beside(u, v, outputs):
            whole[chosen[complete], row] = values.T[complete]
        if index % self.every:
            for place in np.flatnonzero(~complete):
                member = int(chosen[place])
                t = self.members.t_span[0] + index * float(self.members.steps[member])
                state = (self.shaped(x[:, place].copy()) for x in (u, v))
                self.last[member] = t, *state, *(self._valued(name, x[:, place].copy()) for name, x in outputs.items())

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
        rows = len(solution.t) - (solution.n_steps % self.every > 0 and solution.n_steps < self.members.n_steps[member])
        self.u[member, :rows] = solution.u[:rows].reshape(rows, -1)
        self.v[member, :rows] = solution.v[:rows].reshape(rows, -1)
        for name, values in solution.outputs.items():
            self.outputs[name][member, :rows] = values[:rows].reshape(rows, -1)
        if rows < len(solution.t):
            self.last[member] = tuple(x[-1] for x in (solution.t, solution.u, solution.v, *solution.outputs.values()))
        self.n_steps[member], self.n_rhs[member] = solution.n_steps, solution.n_rhs
        self.n_iterations[member] = solution.n_iterations
        for name, drift in solution.drift.items():
            self.drift[name][member] = drift
        for name, extremes in solution.extremes.items():
            self.extremes[name][:, member] = np.reshape(extremes, (4, -1))
        self.judge(member, solution.status, solution.message)

    def place(self, part: EnsembleSolution) -> None:
        """Store the results of some of the members, from member `part.first` on."""
        chosen, rows = slice(part.first, part.first + len(part)), part.u.shape[1]
        for name in ("u", "v"):
            getattr(self, name)[chosen, :rows] = getattr(part, name).reshape(len(part), rows, -1)
        for name in ("n_steps", "n_rhs", "n_iterations", "status", "message"):
            getattr(self, name)[chosen] = getattr(part, name)
        for name, drift in part.drift.items():
            self.drift[name][chosen] = drift
        for name, values in part.outputs.items():
            self.outputs[name][chosen, :rows] = values.reshape(len(part), rows, -1)
        for name, extremes in part.extremes.items():
            self.extremes[name][:, chosen] = np.reshape(extremes, (4, len(part), -1))
        self.last |= {part.first + i: state for i, state in part._last.items()}

    def solution(
        self,
        rhs: Any,
        method: Method,
        first: int,
        seconds: float,
        notes: Sequence[str],
        repeat: Callable[[int], Solution],
    ) -> EnsembleSolution:
        """Return the result of the ensemble, or of its part that begins with member `first`."""
        return EnsembleSolution(
            t=self.t,
            u=self.shaped(self.u),
            v=self.shaped(self.v),
            h=self.members.steps,
            n_steps=self.n_steps,
            n_rhs=self.n_rhs,
            n_iterations=self.n_iterations,
            status=self.status,
            message=self.message,
            params=self.members.params,
            method=method,
            drift=self.drift,
            extremes={name: Extremes(*(self._valued(name, x) for x in e)) for name, e in self.extremes.items()},
            outputs={name: self._valued(name, x) for name, x in self.outputs.items()},
            first=first,
            kernel_seconds=seconds,
            notes=tuple(notes),
            _last=self.last,
            _rhs=rhs,
            _repeat=repeat,
        )

    @property
    def t(self) -> np.ndarray:
        """The times of the saved states, shape (m, s)."""
        members, rows = self.members, self.u.shape[1]
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
