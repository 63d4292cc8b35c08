"""What a run returns."""

from __future__ import annotations

import enum
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .methods import Method


class Status(enum.Enum):
    """How a run ended."""

    COMPLETED = "completed"
    DIVERGED = "diverged"
    NOT_CONVERGED = "not converged"
    INTERRUPTED = "interrupted"


@dataclass(repr=False, eq=False)
class Solution:
    """The history of a run, and what it cost.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Times of the saved states.
    u, v : ndarray, shape (m,) or (m, n)
        Displacements and velocities.
    h : float
        The step used: that asked for, shrunk where it does not divide the span.
    n_steps : int
        Steps taken.
    n_rhs : int
        Evaluations of the right-hand side, with the one at the start.
    n_iterations : int
        Iterations of an implicit method's solver.
    status : Status
    message : str
        What happened, in a sentence.
    drift : dict of str to float
        For each invariant, max |e_n - e_0| over every step.
    kernel_seconds : float
        Time inside the stepping kernel: no compiling, no invariants.
    method : Method
    notes : tuple of str
        What the numbers do not show by themselves: an invariant that grows steadily, a solver that changed.
    integrals : dict of str to ndarray, shape (m,)
        Integrals over time that the problem follows, at the saved times, such as "work" in J.
    reason : callable, optional
        Finds out more about a run that did not complete: what `explain` calls.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    h: float
    n_steps: int
    n_rhs: int
    n_iterations: int
    status: Status
    message: str
    kernel_seconds: float
    method: Method
    drift: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    integrals: dict[str, np.ndarray] = field(default_factory=dict)
    reason: Callable[[], str] | None = None
    _explanation: str = ""

    def explain(self) -> str:
        """Find out why a run did not complete, as far as that can be found out.

        Of a diverged run this compares h with the critical step and names a step that was tried and holds. It takes
        two or three times as long as the run, the first time.

        Returns
        -------
        str
            The message, with the reason. A solution that was pickled, copied through a process pool or loaded no
            longer has the right-hand side and gives the message alone.
        """
        if self.reason is not None:
            self._explanation = self._explanation or self.reason()
        return self._explanation or self.message

    @property
    def n_newton(self) -> int:
        """The old name of `n_iterations`."""
        warnings.warn("n_newton is now n_iterations.", DeprecationWarning, stacklevel=2)
        return self.n_iterations

    @property
    def success(self) -> bool:
        """Whether the run reached the end of its span."""
        return self.status is Status.COMPLETED

    def at(self, t: ArrayLike) -> tuple[Any, Any]:
        """Interpolate between the saved states by cubic Hermite polynomials.

        Parameters
        ----------
        t : float or array_like
            Times within the span that was integrated.

        Returns
        -------
        u, v : float or ndarray
            Displacement and velocity, of shape ``t.shape`` or ``t.shape + (n,)``. The error of u is of fourth order in
            the distance of the saved states, that of v, the derivative of the polynomial, of third.

        Raises
        ------
        ValueError
            For times outside the span.
        """
        times = np.asarray(t, dtype=np.float64)
        if times.size and not (self.t[0] <= times.min() and times.max() <= self.t[-1]):
            raise ValueError(f"t must lie within the span of the solution, {self.t[0]:g} to {self.t[-1]:g}.")
        if len(self.t) == 1:
            shape = times.shape + self.u.shape[1:]
            return np.broadcast_to(self.u[0], shape).copy(), np.broadcast_to(self.v[0], shape).copy()
        left = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        length = self.t[left + 1] - self.t[left]
        s = (times - self.t[left]) / length
        if self.u.ndim > 1:
            s, length = s[..., None], length[..., None]
        u0, u1 = self.u[left], self.u[left + 1]
        v0, v1 = self.v[left], self.v[left + 1]
        rise = u1 - u0
        u = u0 + s * (length * v0 + s * (3 * rise - length * (2 * v0 + v1) + s * (length * (v0 + v1) - 2 * rise)))
        v = v0 + s * (2 * (3 * rise / length - 2 * v0 - v1) + s * 3 * (v0 + v1 - 2 * rise / length))
        return u, v

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "reason": None}  # which holds compiled code

    def __repr__(self) -> str:
        per_step = 1e9 * self.kernel_seconds / self.n_steps if self.n_steps else 0.0
        dof = "1 degree" if self.u.ndim == 1 else f"{self.u.shape[1]} degree{'s' * (self.u.shape[1] > 1)}"
        lines = [
            f"Solution by {self.method!r}: {self.status.value}",
            f"  {dof} of freedom, t = {self.t[0]:g} to {self.t[-1]:g}, {self.n_steps} steps of h = {self.h:.6g}, "
            f"{len(self.t)} states saved",
            f"  {self.n_rhs} evaluations{f', {self.n_iterations} iterations' * (self.n_iterations > 0)}, "
            f"{self.kernel_seconds:.3g} s in the kernel ({per_step:.3g} ns a step)",
        ]
        lines += [f"  drift of {name}: {value:.4g}" for name, value in self.drift.items()]
        lines += [f"  {self.message}"] * (not self.success)
        lines += [f"  Note: {note}" for note in self.notes]
        return "\n".join(lines)
