"""The problems of `eig3 bench precision`, `plan` and `report`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from eig3 import problems
from eig3.methods import CentralDifference, Method
from eig3.problem import Problem


@dataclass(frozen=True)
class BenchmarkProblem:
    """A problem of the set.

    Attributes
    ----------
    build : callable
        Builds the problem.
    omega : float
        The highest angular frequency, rad/s.
    title : str
    metric : str
        The metric of error that is printed first.
    cd : tuple of (str, Method)
        The forms of CD to compare if f depends on the velocity; without them, CD as the problem takes it by name.
    targets : tuple of float
        The errors to reach.
    tolerances : bool
        Whether the library is measured with tolerances too.
    """

    build: Callable[[], Problem]
    omega: float
    title: str
    metric: str = "trajectory"
    cd: tuple[tuple[str, Method], ...] = ()
    targets: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
    tolerances: bool = False


def about(build: Callable[[], Problem]) -> str:
    """The first paragraph about what builds a problem."""
    return " ".join((getattr(build, "func", build).__doc__ or "").partition("\n\n")[0].split())


def describe(problem: Problem, what: str) -> str:
    """What the problem is, and a sentence of what it asks of a method."""
    n, span = np.size(problem.u0), problem.t_span[1] - problem.t_span[0]
    degrees = "one degree of freedom" if n == 1 else f"{n} degrees of freedom"
    reads = "read the velocity" if problem.uses_velocity else "do not read the velocity"
    plural = "s" if len(problem.events) > 1 else ""
    events = f"; it has the event{plural} {', '.join(problem.events)}" if problem.events else ""
    return f"{what} It has {degrees} and lasts {span:.4g} s; its forces {reads}{events}.".lstrip()


_NEWTON = ("cd newton", CentralDifference(velocity="implicit", solver="newton"))
_FIXED_POINT = ("cd fixed-point", CentralDifference(velocity="implicit", solver="fixed-point"))
_BAR_OMEGA = 2 * 5000.0 * 1001
_REGULAR = 20.0  # s; the double pendulum and Duffing's oscillator are not chaotic for so long

PROBLEM_SET = {
    "single_dof": BenchmarkProblem(problems.single_dof, 4.0, "single degree of freedom, 637 periods"),
    "hardening_spring": BenchmarkProblem(
        problems.hardening_spring, 83.0, "hardening spring, 100 periods", tolerances=True
    ),
    "softening_spring": BenchmarkProblem(
        problems.softening_spring, 10.0, "softening spring, 123 periods", tolerances=True
    ),
    "spring_pendulum": BenchmarkProblem(
        problems.spring_pendulum, 9.9, "spring pendulum, 100 s", cd=(_NEWTON, _FIXED_POINT), tolerances=True
    ),
    "henon_heiles": BenchmarkProblem(problems.henon_heiles, 1.2, "Henon and Heiles, 100 periods", tolerances=True),
    "rotor": BenchmarkProblem(
        problems.rotor, 16.0, "rotor with cubic springs, 100 periods", cd=(_FIXED_POINT,), tolerances=True
    ),
    "kepler_03": BenchmarkProblem(
        partial(problems.kepler, e=0.3), 1.8, "Kepler with e = 0.3, 20 orbits", tolerances=True
    ),
    "kepler_06": BenchmarkProblem(
        partial(problems.kepler, e=0.6), 4.0, "Kepler with e = 0.6, 20 orbits", tolerances=True
    ),
    "double_pendulum": BenchmarkProblem(
        partial(problems.double_pendulum, t_end=_REGULAR),
        8.0,
        "double pendulum, 20 s",
        cd=(_FIXED_POINT,),
        tolerances=True,
    ),
    "duffing": BenchmarkProblem(
        partial(problems.duffing, t_end=_REGULAR),
        2.0,
        "Duffing, damped and forced, 20 s",
        cd=(_FIXED_POINT,),
        tolerances=True,
    ),
    "elastic_bar": BenchmarkProblem(
        problems.elastic_bar, _BAR_OMEGA, "elastic bar, 1000 masses, ten passes", "continuum"
    ),
    "damped_bar": BenchmarkProblem(
        problems.damped_bar, _BAR_OMEGA, "damped bar, 1000 masses, ten passes", "continuum", cd=(_FIXED_POINT,)
    ),
    "hardening_chain": BenchmarkProblem(problems.hardening_chain, 260.0, "chain of 200 masses, hardening, struck"),
}

_varying = partial(BenchmarkProblem, targets=(1e-3, 1e-6, 1e-9), tolerances=True)

#: Problems whose speed varies much, so that they need tolerances, and orbits. `eig3 bench precision` alone has them.
VARIABLE_SPEED = {
    "van_der_pol": _varying(problems.van_der_pol, 30.0, "Van der Pol, mu = 10, five periods", cd=(_FIXED_POINT,)),
    "kepler_09": _varying(problems.kepler, 45.0, "Kepler with e = 0.9, 20 orbits"),
    "arenstorf": _varying(problems.arenstorf, 320.0, "Arenstorf's orbit, one period", cd=(_FIXED_POINT,)),
    "hertz_impact": _varying(problems.hertz_impact, 310.0, "Hertz's impact"),
    "figure_eight": _varying(problems.figure_eight, 6.0, "three bodies on an eight, 20 periods"),
    "outer_solar_system": _varying(problems.outer_solar_system, 1.7e-8, "outer solar system, 10,000 years"),
    "bouncing_ball": _varying(problems.bouncing_ball, 1.0, "bouncing ball, 30 impacts"),
}
