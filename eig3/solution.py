"""The result of a run: its history, its status and its cost."""

from __future__ import annotations

import enum
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .events import Occurrences
from .extremes import Extremes
from .methods import Method


class Status(enum.Enum):
    """How a run ended.

    Attributes
    ----------
    COMPLETED
        The run reached the end of its span.
    DIVERGED
        The state became infinite or NaN, or the motion grew beyond doubt because the step is too long.
    NOT_CONVERGED
        The solve of an implicit step did not converge.
    INTERRUPTED
        Ctrl-C, a cancellation, or an exception in a function of the user ended the run.
    TERMINATED
        A terminal event ended the run, as it should.
    STEP_TOO_SMALL
        The tolerances need a step below the resolution of t.
    TOO_MANY_STEPS
        The run took `max_steps` steps before the end of its span.
    ZENO
        Events with `apply` follow each other in times below the resolution of the run, as the impacts of a ball that
        comes to rest do.
    """

    COMPLETED = "completed"
    DIVERGED = "diverged"
    NOT_CONVERGED = "not converged"
    INTERRUPTED = "interrupted"
    TERMINATED = "ended by an event"
    STEP_TOO_SMALL = "step too small"
    TOO_MANY_STEPS = "too many steps"
    ZENO = "events without end"


@dataclass(repr=False, eq=False)
class Solution:
    """The history of a run, its status and its cost.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Times of the saved states.
    u, v : ndarray, shape (m,) or (m, n)
        Displacements and velocities of the saved states.
    h : float
        The step of the run. It is the requested step, or a shorter one if that does not divide the span. With
        tolerances, it is the mean of the steps.
    n_steps : int
        Number of steps taken.
    n_rhs : int
        Number of evaluations of the right-hand side, including the one at the start.
    n_iterations : int
        Number of iterations of an implicit method's solver.
    status : Status
        How the run ended.
    message : str
        A sentence about how the run ended. `explain` finds out more.
    drift : dict of str to float
        For each invariant e, the maximum of |e_n - e_0| over all steps, not only over the saved states; NaN if e became
        NaN.
    extremes : dict of str to Extremes
        For each invariant and each output, its minimum `low` and its maximum `high` over all steps, and their times
        `t_low` and `t_high`; NaN, and the time of the first NaN, if it became NaN.
    kernel_seconds : float
        Time in the kernel, s, without compilation and without the evaluation of invariants and outputs.
    method : Method
        The method as it was requested.
    notes : tuple of str
        Sentences about what the user should know of the run, such as that an invariant grows steadily, that the solver
        of an implicit method was changed, or that the method has a short limit with a force that reads the velocity.
    integrals : dict of str to ndarray, shape (m,)
        Integrals over time that the problem follows, at the saved times, such as "work" in J.
    events : dict of str to Occurrences
        The occurrences of each event: `t`, `u`, `v`, and `u_after`, `v_after`.
    outputs : dict of str to ndarray, shape (m,) or (m, k)
        The values of each output at the saved states.
    n_rejected : int
        Number of steps that were repeated with a shorter step, because their error was beyond the tolerances.
    steps : ndarray, shape (m,), or None
        With tolerances, the length of the step that led to each saved state, or that contains its time. The first is
        that of the first step. None for a fixed step.
    reason : callable or None
        The function that `explain` calls; None if nothing more can be found out.
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
    extremes: dict[str, Extremes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    integrals: dict[str, np.ndarray] = field(default_factory=dict)
    events: dict[str, Occurrences] = field(default_factory=dict)
    outputs: dict[str, np.ndarray] = field(default_factory=dict)
    n_rejected: int = 0
    steps: np.ndarray | None = None
    reason: Callable[[], str] | None = None
    _explanation: str = ""

    def explain(self) -> str:
        """Find out why a run diverged.

        The explanation compares h with the critical step, and names a shorter step with which the run stays bounded,
        if there is one. To find it, the first call repeats the run with shorter steps. This may take two or three
        times as long as the run, or some tenths of a second for a short run. Later calls return the same text.

        Returns
        -------
        str
            The explanation, or `message` if the run did not diverge. A copied or unpickled solution no longer has the
            right-hand side: it returns the explanation only if it was found before the copy.
        """
        if self.reason is not None:
            self._explanation = self._explanation or self.reason()
        return self._explanation or self.message

    @property
    def n_newton(self) -> int:
        """The old name of `n_iterations`. It gives a DeprecationWarning."""
        warnings.warn("n_newton was renamed: use n_iterations.", DeprecationWarning, stacklevel=2)
        return self.n_iterations

    @property
    def success(self) -> bool:
        """Whether the run did what it should: its status is COMPLETED or TERMINATED."""
        return self.status in (Status.COMPLETED, Status.TERMINATED)

    def at(self, t: ArrayLike) -> tuple[Any, Any]:
        """Interpolate between the saved states by cubic Hermite polynomials.

        Parameters
        ----------
        t : float or array_like
            Times between the first and the last saved state.

        Returns
        -------
        u, v : float or ndarray
            Displacement and velocity, of shape ``t.shape`` or ``t.shape + (n,)``. v is the derivative of the polynomial
            for u. The interpolation error is of fourth order for u, and of third order for v, in the time between saved
            states.

        Raises
        ------
        ValueError
            If a time is outside the span, or is NaN.
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
        return {**vars(self), "reason": None}  # `reason` refers to compiled code, which cannot be pickled

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
