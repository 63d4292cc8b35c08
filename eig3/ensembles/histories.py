"""The arrays with the results of an ensemble, which its blocks fill."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..kernels.protocol import SCALAR
from ..memory import check_members_history, n_rows
from ..methods import Method
from ..solution import Solution, Status
from ..stepper import NEVER
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
    names : sequence of str
        The names of the invariants.

    Raises
    ------
    MemoryError
        If the states do not fit in memory.
    """

    def __init__(self, members: Members, save_every: int | None, names: Sequence[str]) -> None:
        m, n = len(members), members.n
        self.members = members
        self.every = NEVER if save_every is None else save_every
        rows = n_rows(int(members.n_steps.max()), self.every)
        check_members_history(m, rows, n)
        self.u, self.v = np.full((m, rows, n), np.nan), np.full((m, rows, n), np.nan)
        self.u[:, 0], self.v[:, 0] = members.u0, members.v0
        self.n_steps, self.n_rhs, self.n_iterations = (np.zeros(m, dtype=np.int64) for _ in range(3))
        self.status = np.full(m, Status.INTERRUPTED, dtype=object)
        self.message = np.full(m, _NOT_STARTED, dtype=object)
        self.drift = {name: np.zeros(m) for name in names}
        self.extremes = {name: np.full((m, 2), np.nan) for name in names}
        self.last: dict[int, tuple[Any, Any, Any]] = {}

    def save(self, chosen: np.ndarray, row: int, u: np.ndarray, v: np.ndarray) -> None:
        """Save states from a row on; u and v have the shape (states, n, members)."""
        self.u[chosen, row : row + len(u)] = u.transpose(2, 0, 1)
        self.v[chosen, row : row + len(v)] = v.transpose(2, 0, 1)

    def end(self, chosen: np.ndarray, index: int, u: np.ndarray, v: np.ndarray, n_rhs: int) -> None:
        """End members after `index` steps; u and v are their last states, shape (n, members)."""
        self.n_steps[chosen], self.n_rhs[chosen] = index, n_rhs
        complete = self.members.n_steps[chosen] == index
        self.status[chosen[complete]], self.message[chosen[complete]] = Status.COMPLETED, REACHED
        row = n_rows(index, self.every) - 1
        self.u[chosen[complete], row], self.v[chosen[complete], row] = u.T[complete], v.T[complete]
        if index % self.every:
            for place in np.flatnonzero(~complete):
                member = int(chosen[place])
                t = self.members.t_span[0] + index * float(self.members.steps[member])
                self.last[member] = t, *(self.shaped(x[:, place].copy()) for x in (u, v))

    def bound(self, name: str, chosen: np.ndarray, start: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Store the extremes of an invariant, and its drift from its values at the start."""
        self.extremes[name][chosen] = np.stack([low, high], axis=1)
        self.drift[name][chosen] = np.maximum(start - low, high - start)

    def judge(self, member: int, status: Status, message: str) -> None:
        """Set how a member ended."""
        self.status[member], self.message[member] = status, message

    def take(self, member: int, solution: Solution) -> None:
        """Store the result of a member that ran alone."""
        rows = len(solution.t) - (solution.n_steps % self.every > 0 and solution.n_steps < self.members.n_steps[member])
        self.u[member, :rows] = solution.u[:rows].reshape(rows, -1)
        self.v[member, :rows] = solution.v[:rows].reshape(rows, -1)
        if rows < len(solution.t):
            self.last[member] = solution.t[-1], solution.u[-1], solution.v[-1]
        self.n_steps[member], self.n_rhs[member] = solution.n_steps, solution.n_rhs
        self.n_iterations[member] = solution.n_iterations
        for name, drift in solution.drift.items():
            self.drift[name][member], self.extremes[name][member] = drift, solution.extremes[name]
        self.judge(member, solution.status, solution.message)

    def place(self, part: EnsembleSolution) -> None:
        """Store the results of some of the members, from member `part.first` on."""
        chosen, rows = slice(part.first, part.first + len(part)), part.u.shape[1]
        for name in ("u", "v"):
            getattr(self, name)[chosen, :rows] = getattr(part, name).reshape(len(part), rows, -1)
        for name in ("n_steps", "n_rhs", "n_iterations", "status", "message"):
            getattr(self, name)[chosen] = getattr(part, name)
        for name in self.drift:
            self.drift[name][chosen], self.extremes[name][chosen] = part.drift[name], part.extremes[name]
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
            extremes=self.extremes,
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
