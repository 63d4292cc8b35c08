"""The ensembles of the benchmark: systems whose members differ in their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from eig3 import problems
from eig3.problem import Problem


@dataclass(frozen=True)
class Spread:
    """Random values from `low` to `high`, one for each member, in columns of u0 or params."""

    field: str
    columns: tuple[int, ...]
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Case:
    """An ensemble of any number of members.

    Attributes
    ----------
    build : callable
        Makes the problem.
    h : float
        The step with which the time of a step is measured.
    spreads : tuple of Spread
    """

    build: Callable[[], Problem]
    h: float
    spreads: tuple[Spread, ...]

    @cached_property
    def problem(self) -> Problem:
        """The problem without its energy, which an ensemble would follow at every step."""
        return replace(self.build(), energy=None)

    def longest_step(self, method: str) -> float:
        """Return the stability limit of a method for the problem, at its start."""
        return self.problem.critical_step(method=method, safety=1.0).h

    def members(self, m: int) -> dict[str, Any]:
        """Return the u0 and the params of m members. More members begin with the same ones."""
        values = {name: np.array([getattr(self.problem, name)] * m, dtype=np.float64) for name in ("u0", "params")}
        shares = np.random.default_rng(0).random((m, len(self.spreads)))
        for spread, share in zip(self.spreads, shares.T, strict=True):
            columns = values[spread.field].reshape(m, -1)
            columns[:, spread.columns] = (spread.low + (spread.high - spread.low) * share)[:, None]
        return values

    def one_by_one(self, m: int) -> list[Problem]:
        """Return m members as problems of their own."""
        values = self.members(m)
        return [self.problem.with_(u0=u0, params=params) for u0, params in zip(*values.values(), strict=True)]


CHAIN = 6  # masses
SAMPLES = 1001  # of the record of the ground
_SECONDS = 10.0  # of the record


_CASES = (
    Case(
        partial(problems.duffing, delta=0.1, a=1.0, b=1.0, u0=0.0, t_end=50.0),
        h=5e-3,
        spreads=(
            Spread("params", (3,), 0.1, 0.5),
            Spread("params", (4,), 0.5, 1.5),
            Spread("u0", (0,), -0.5, 0.5),
        ),
    ),
    Case(
        partial(problems.spring_pendulum, t_end=10.0),
        h=1e-3,
        spreads=(Spread("params", (2,), 80.0, 120.0), Spread("u0", (1,), 0.2, 1.0)),
    ),
    Case(
        partial(problems.hardening_chain, n=CHAIN, stiffness=100.0, hardening=5.0, t_end=20.0),
        h=1e-3,
        spreads=(Spread("params", (0,), 80.0, 120.0),),
    ),
    Case(
        partial(problems.shear_building, t_end=_SECONDS),
        h=_SECONDS / 10_000,
        # the scene has separate parameters for the first storey
        spreads=(Spread("params", (-5, -2), 8e6, 16e6), Spread("params", (-4, -1), 40e3, 80e3)),
    ),
)
# The members have such different time scales that only steps with tolerances suit them.
_WITH_TOLERANCES = (
    Case(partial(problems.van_der_pol, t_end=50.0), h=1e-3, spreads=(Spread("params", (0,), 1.0, 20.0),)),
    # from the aphelion, with e = 1 - 1 / GM from 0 to 0.9
    Case(partial(problems.kepler, e=0.0, t_end=10.0), h=1e-3, spreads=(Spread("params", (0,), 1.0, 10.0),)),
    # in 4 s, no ball comes to rest: they bounce up to 14 times
    Case(partial(problems.bouncing_ball, restitution=0.9, t_end=4.0), h=1e-3, spreads=(Spread("u0", (0,), 0.5, 2.0),)),
)
#: The cases by the names of their problems.
CASES: Mapping[str, Any] = {case.problem.name: case for case in _CASES}
CASES_WITH_TOLERANCES: Mapping[str, Any] = {case.problem.name: case for case in _WITH_TOLERANCES}
