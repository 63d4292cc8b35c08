"""The ensembles of the benchmark: systems whose members differ in their parameters, each with EIG-3 by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numba
import numpy as np

from eig3 import problems
from eig3.kernels.compile.jit import OPTIONS
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
    by_hand : callable, optional
        EIG-3 as a loop over members: ``by_hand(u0, v0, params, h, n_steps, ends)``, with arrays of shape (m, n). A case
        without it has members of such different time scales that only steps with tolerances suit them.
    """

    build: Callable[[], Problem]
    h: float
    spreads: tuple[Spread, ...]
    by_hand: Callable | None = None

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

    def states(self, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the u0, the v0 and the params of m members, each with the members along its first axis."""
        values = self.members(m)
        v0 = np.tile(np.ravel(self.problem.v0).astype(np.float64), (m, 1))
        return values["u0"].reshape(m, -1), v0, values["params"]

    def one_by_one(self, m: int) -> list[Problem]:
        """Return m members as problems of their own."""
        values = self.members(m)
        return [self.problem.with_(u0=u0, params=params) for u0, params in zip(*values.values(), strict=True)]

    def run_by_hand(self, m: int, n_steps: int) -> Callable[[], np.ndarray]:
        """Return a run of the loop by hand, which returns the displacements at the end, of shape (m, n)."""
        assert self.by_hand
        loop = numba.njit(**OPTIONS)(self.by_hand)
        u0, v0, params = self.states(m)

        def run() -> np.ndarray:
            ends = np.empty_like(u0)
            loop(u0, v0, params, self.h, n_steps, ends)
            return ends

        return run


def duffing(u0, v0, params, h, n_steps, ends):
    for i in range(len(u0)):
        p0, p1, p2, p3, p4 = params[i, 0], params[i, 1], params[i, 2], params[i, 3], params[i, 4]
        u, v = u0[i, 0], v0[i, 0]
        before = p3 - u * (p0 + p1 * u * u) - p2 * v
        for step in range(n_steps):
            a = p3 * math.cos(p4 * (step * h)) - u * (p0 + p1 * u * u) - p2 * v
            u += h * v - h * h / 2 * before + h * h * a
            v += 1.5 * h * a - h / 2 * before
            before = a
        ends[i, 0] = u


def spring_pendulum(u0, v0, params, h, n_steps, ends):
    for i in range(len(u0)):
        m, l0, k, g = params[i, 0], params[i, 1], params[i, 2], params[i, 3]
        r, theta, vr, vt = u0[i, 0], u0[i, 1], v0[i, 0], v0[i, 1]
        r_before = r * vt * vt - k / m * (r - l0) + g * math.cos(theta)
        t_before = -(2 * vr * vt + g * math.sin(theta)) / r
        for _ in range(n_steps):
            ar = r * vt * vt - k / m * (r - l0) + g * math.cos(theta)
            at = -(2 * vr * vt + g * math.sin(theta)) / r
            r += h * vr - h * h / 2 * r_before + h * h * ar
            theta += h * vt - h * h / 2 * t_before + h * h * at
            vr += 1.5 * h * ar - h / 2 * r_before
            vt += 1.5 * h * at - h / 2 * t_before
            r_before, t_before = ar, at
        ends[i, 0], ends[i, 1] = r, theta


CHAIN = 6  # masses


def hardening_chain(u0, v0, params, h, n_steps, ends):
    u, v, a, before = np.empty(CHAIN), np.empty(CHAIN), np.empty(CHAIN), np.empty(CHAIN)
    for i in range(len(u0)):
        k, s = params[i, 0], params[i, 1]
        for j in range(CHAIN):
            u[j], v[j] = u0[i, j], v0[i, j]
        for step in range(n_steps):
            force = k * u[0] * (1 + s * u[0] * u[0])
            for j in range(CHAIN - 1):
                stretch = u[j + 1] - u[j]
                after = k * stretch * (1 + s * stretch * stretch)
                a[j] = after - force
                force = after
            a[CHAIN - 1] = -force
            for j in range(CHAIN):
                if step == 0:
                    before[j] = a[j]
                u[j] += h * v[j] - h * h / 2 * before[j] + h * h * a[j]
                v[j] += 1.5 * h * a[j] - h / 2 * before[j]
                before[j] = a[j]
        for j in range(CHAIN):
            ends[i, j] = u[j]


SAMPLES = 1001  # of the record of the ground
_SECONDS = 10.0  # of the record


def shear_building(u0, v0, params, h, n_steps, ends):
    for i in range(len(u0)):
        p = params[i]
        times, ground = p[1 : 1 + SAMPLES], p[1 + SAMPLES : 1 + 2 * SAMPLES]
        k, c, spacing = p[p.size - 2] * p[0], p[p.size - 1] * p[0], times[1]
        u1, u2, u3, v1, v2, v3 = u0[i, 0], u0[i, 1], u0[i, 2], v0[i, 0], v0[i, 1], v0[i, 2]
        b1 = b2 = b3 = 0.0
        for step in range(n_steps):
            t = step * h
            j = min(int(t / spacing), SAMPLES - 2)
            j -= t < times[j]
            j += t >= times[j + 1]
            speed = (ground[j + 1] - ground[j]) / (times[j + 1] - times[j])
            x = ground[j] + speed * (t - times[j])
            f1 = k * (u1 - x) + c * (v1 - speed)
            f2 = k * (u2 - u1) + c * (v2 - v1)
            f3 = k * (u3 - u2) + c * (v3 - v2)
            a1, a2, a3 = f2 - f1, f3 - f2, -f3
            if step == 0:
                b1, b2, b3 = a1, a2, a3
            u1 += h * v1 - h * h / 2 * b1 + h * h * a1
            u2 += h * v2 - h * h / 2 * b2 + h * h * a2
            u3 += h * v3 - h * h / 2 * b3 + h * h * a3
            v1 += 1.5 * h * a1 - h / 2 * b1
            v2 += 1.5 * h * a2 - h / 2 * b2
            v3 += 1.5 * h * a3 - h / 2 * b3
            b1, b2, b3 = a1, a2, a3
        ends[i, 0], ends[i, 1], ends[i, 2] = u1, u2, u3


_CASES = (
    Case(
        partial(problems.duffing, delta=0.1, a=1.0, b=1.0, u0=0.0, t_end=50.0),
        h=5e-3,
        spreads=(Spread("params", (3,), 0.1, 0.5), Spread("params", (4,), 0.5, 1.5), Spread("u0", (0,), -0.5, 0.5)),
        by_hand=duffing,
    ),
    Case(
        partial(problems.spring_pendulum, t_end=10.0),
        h=1e-3,
        spreads=(Spread("params", (2,), 80.0, 120.0), Spread("u0", (1,), 0.2, 1.0)),
        by_hand=spring_pendulum,
    ),
    Case(
        partial(problems.hardening_chain, n=CHAIN, stiffness=100.0, hardening=5.0, t_end=20.0),
        h=1e-3,
        spreads=(Spread("params", (0,), 80.0, 120.0),),
        by_hand=hardening_chain,
    ),
    Case(
        partial(problems.shear_building, t_end=_SECONDS),
        h=_SECONDS / 10_000,
        # the scene has separate parameters for the first storey
        spreads=(Spread("params", (-5, -2), 8e6, 16e6), Spread("params", (-4, -1), 40e3, 80e3)),
        by_hand=shear_building,
    ),
)
_WITH_TOLERANCES = (
    Case(partial(problems.van_der_pol, t_end=50.0), h=1e-3, spreads=(Spread("params", (0,), 1.0, 20.0),)),
    # from the aphelion, with e = 1 - 1 / GM from 0 to 0.9
    Case(partial(problems.kepler, e=0.0, t_end=10.0), h=1e-3, spreads=(Spread("params", (0,), 1.0, 10.0),)),
    # in 4 s, no ball comes to rest: they bounce up to 14 times
    Case(partial(problems.bouncing_ball, restitution=0.9, t_end=4.0), h=1e-3, spreads=(Spread("u0", (0,), 0.5, 2.0),)),
)
#: The cases by the names of their problems.
CASES: Mapping[str, Any] = {case.by_hand.__name__: case for case in _CASES if case.by_hand}
CASES_WITH_TOLERANCES: Mapping[str, Any] = {case.problem.name: case for case in _WITH_TOLERANCES}
