"""A second-order initial value problem with what is known of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .analysis.critical import CriticalStep, critical_step
from .callbacks import check_callback
from .checks import check_method, check_params, check_state
from .integration import integrate
from .methods import Method
from .solution import Solution
from .stepper import Stepper


@dataclass(frozen=True, eq=False)
class Problem:
    """A second-order initial value problem with what is known of it.

    Attributes
    ----------
    name : str
    rhs : jitted function
        The acceleration, in one of the two forms of `eig3.integrate`.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at ``t_span[0]``.
    params : array_like
        What rhs and energy get as p.
    t_span : (float, float)
    energy : jitted function, optional
        ``energy(t, u, v, p) -> float``, constant along the exact solution: the invariant "energy" of `integrate`.
    energy_unit : str
        Unit of the energy, "J" or, where the right-hand side is divided by the mass, "J/kg".
    exact : callable, optional
        ``exact(t) -> (u, v)`` for an array of times.
    continuum : callable, optional
        ``continuum(t) -> (u, v)`` of the continuous body that a lumped problem stands for, at its masses.
    uses_velocity : bool
        Whether rhs reads v. Where it does not, "cd" by name takes its form of one evaluation a step, and "eig3" that
        which touches fewer arrays.
    source : str
        Where the problem comes from.
    note : str
        What a scene's problem contains.
    h : float, optional
        A step that resolves the motion, for a first look at it.
    draw : callable, optional
        ``draw(figure, solution)`` draws the response on a matplotlib figure, with the panels of `eig3.drawing`.
    follows_work : bool
        Whether the velocity of the last degree of freedom is the work done so far, J.
    """

    name: str
    rhs: Any
    u0: ArrayLike
    v0: ArrayLike
    params: ArrayLike
    t_span: tuple[float, float]
    energy: Any = None
    exact: Callable | None = None
    continuum: Callable | None = None
    uses_velocity: bool = True
    source: str = ""
    note: str = ""
    h: float | None = None
    draw: Callable[[Any, Solution], None] | None = None
    energy_unit: str = "J"
    follows_work: bool = False

    def integrate(
        self, *, h: float, method: str | Method = "eig3", t_end: float | None = None, **options: Any
    ) -> Solution:
        """Run the problem; `options` are those of `eig3.integrate`, and `invariants` replaces the energy."""
        options.setdefault("invariants", {} if self.energy is None else {"energy": self.energy})
        span = (self.t_span[0], self.t_span[1] if t_end is None else t_end)
        method = self.method(method)
        return integrate(self.rhs, span, self.u0, self.v0, h=h, params=self.params, method=method, **options)

    def stepper(self, *, h: float, method: str | Method = "eig3", inline: bool = False) -> Stepper:
        """The problem at its start, prepared to advance."""
        options: dict[str, Any] = {"t0": self.t_span[0], "params": self.params, "inline": inline}
        return Stepper(self.rhs, self.u0, self.v0, h=h, method=self.method(method), **options)

    def critical_step(
        self, *, method: str | Method = "eig3", t: float | None = None, safety: float = 0.9
    ) -> CriticalStep:
        """The longest stable step about the start, as `eig3.critical_step` finds it."""
        time = self.t_span[0] if t is None else t
        options: dict[str, Any] = {"method": self.method(method), "t": time, "safety": safety}
        return critical_step(self.rhs, self.u0, self.v0, self.params, **options)

    def energy_of(self, u: ArrayLike, v: ArrayLike, t: ArrayLike | None = None) -> Any:
        """The energy of a state, or of each of a history.

        Parameters
        ----------
        u, v : array_like
            Of the shape of u0, or with one more axis in front, such as a solution's.
        t : float or array_like, optional
            Their times; ``t_span[0]`` if not given.

        Returns
        -------
        float or ndarray

        Raises
        ------
        ValueError
            Where the problem has no energy.
        """
        if self.energy is None:
            raise ValueError(f"{self.name} has no energy; that of a scene has, with scene.problem(..., work=True).")
        energy = check_callback(self.energy, "invariant", check_state(self.u0, self.v0)[2], "energy")
        params = check_params(self.params)

        def of(t: Any, u: ArrayLike, v: ArrayLike) -> float:
            u, v, _ = check_state(u, v)
            return energy.call(float(t), u, v, params)

        time = self.t_span[0] if t is None else t
        if np.ndim(u) == np.ndim(self.u0):
            return of(time, u, v)
        u, v = np.asarray(u), np.asarray(v)
        times = np.broadcast_to(np.asarray(time, dtype=np.float64), len(u))
        return np.array([of(*state) for state in zip(times, u, v, strict=True)])

    def method(self, method: str | Method) -> Method:
        """The record for this problem: a name stands for the form without velocity where rhs does not read v."""
        record = check_method(method)
        return record if self.uses_velocity or not isinstance(method, str) else record.without_velocity()
