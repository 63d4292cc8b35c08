"""The seven problems of `eig3 bench precision`, `plan` and `report`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
    """

    build: Callable[[], Problem]
    omega: float
    title: str
    metric: str = "trajectory"
    cd: tuple[tuple[str, Method], ...] = ()


_NEWTON = ("cd newton", CentralDifference(velocity="implicit", solver="newton"))
_FIXED_POINT = ("cd fixed-point", CentralDifference(velocity="implicit", solver="fixed-point"))
_BAR_OMEGA = 2 * 5000.0 * 1001

PROBLEM_SET = {
    "single_dof": BenchmarkProblem(problems.single_dof, 4.0, "single degree of freedom, 637 periods"),
    "hardening_spring": BenchmarkProblem(problems.hardening_spring, 83.0, "hardening spring, 100 periods"),
    "softening_spring": BenchmarkProblem(problems.softening_spring, 10.0, "softening spring, 123 periods"),
    "spring_pendulum": BenchmarkProblem(
        problems.spring_pendulum, 9.9, "spring pendulum, 100 s", cd=(_NEWTON, _FIXED_POINT)
    ),
    "elastic_bar": BenchmarkProblem(
        problems.elastic_bar, _BAR_OMEGA, "elastic bar, 1000 masses, ten passes", "continuum"
    ),
    "damped_bar": BenchmarkProblem(
        problems.damped_bar, _BAR_OMEGA, "damped bar, 1000 masses, ten passes", "continuum", cd=(_FIXED_POINT,)
    ),
    "hardening_chain": BenchmarkProblem(problems.hardening_chain, 260.0, "chain of 200 masses, hardening, struck"),
}
