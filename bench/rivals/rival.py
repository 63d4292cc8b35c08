"""What a rival is: a package with its best settings, how it is run, and the problems that it suits."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from eig3.problem import Problem


def is_installed(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


@dataclass(frozen=True)
class Answer:
    """One run of a rival: seconds, states at the given times, and evaluations if the rival counts them."""

    seconds: float
    u: np.ndarray
    v: np.ndarray
    evaluations: int | None
    success: bool

    @classmethod
    def of(cls, seconds: float, y: np.ndarray, times: np.ndarray, evaluations: int | None, success: bool) -> Answer:
        """The answer from the states y = (u, v) at the times, shape (2 n, number of times)."""
        n = len(y) // 2
        u, v = (y[0], y[1]) if n == 1 else (y[:n].T, y[n:].T)
        is_complete = len(u) == len(times) and bool(np.isfinite(u).all())
        return cls(seconds, u, v, evaluations, bool(success) and is_complete)


@dataclass(frozen=True)
class Rival:
    """A solver. ``prepare(problem, times)(setting)`` returns a function without arguments that makes a run.

    Attributes
    ----------
    label, package : str
    prepare : callable
    tolerances : sequence of float
        The settings, from the fastest run to the most accurate.
    substeps : sequence of int
        For a solver with a fixed step, in place of tolerances: the steps from one of the times to the next.
    most_degrees : int
        With more degrees of freedom the solver takes too long.
    expressed : collection of str, optional
        The names of the problems that are written for the solver. Without it, the solver takes any right-hand side.
    cannot : callable
        Says why the solver does not suit a problem; the text is empty if it does.
    """

    label: str
    package: str
    prepare: Callable[..., Callable[[float], Callable[[], Answer]]]
    tolerances: Sequence[float] = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 3e-14)
    substeps: Sequence[int] = ()
    most_degrees: int = 10_000
    expressed: Collection[str] | None = None
    cannot: Callable[[Problem], str] = lambda problem: ""

    @property
    def is_installed(self) -> bool:
        return is_installed(self.package)

    def settings(self, times: np.ndarray) -> Sequence[float]:
        """The tolerances, or the steps, of the runs that compute the states at these times."""
        return [float(times[1] - times[0]) / k for k in self.substeps] or self.tolerances

    def refusal(self, problem: Problem, *, is_of_the_library: bool = True) -> str:
        """Why the rival is not measured; empty if it is."""
        if not self.is_installed:
            return "not installed"
        if self.expressed is not None and not (is_of_the_library and problem.name in self.expressed):
            return "needs the equations in its own symbols"
        if np.size(problem.u0) > self.most_degrees:
            return f"more than {self.most_degrees} degrees of freedom"
        return self.cannot(problem)


def absolute(tolerance: float, problem: Problem) -> float:
    """The absolute tolerance: the relative one of the size of the initial state.

    With a hundredth of it, DOP853 takes up to 40 % more evaluations to an error, and nowhere 10 % fewer.
    """
    size = float(max(np.abs(problem.u0).max(), np.abs(problem.v0).max()))
    return tolerance * (size or 1.0)  # of a motion that starts at rest, nothing is known


def without_velocity(problem: Problem) -> str:
    """Why a solver for forces without velocity does not suit a problem."""
    return "the forces read the velocity" if problem.uses_velocity else without_events(problem)


def without_events(problem: Problem) -> str:
    """Why a solver without events does not suit a problem."""
    return "has no events" if problem.events else ""
