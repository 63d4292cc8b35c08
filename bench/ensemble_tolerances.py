"""Ensembles with tolerances in lanes beside a loop of prepared runs, and what an event costs that never occurs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import eig3
from eig3 import problems
from eig3.problem import Problem

from . import text
from .timing import medians, seconds_of

_RTOL = 1e-6
_STEP = 0.01  # s
_FEW = 100  # members of the loop of prepared runs, whose time is scaled
_HEADER = ["ensemble, method", "steps a member", "lanes (us a member)", "prepared runs", "prepared / lanes"]


@eig3.jit
def far(t, u, v, p):
    return u - 1e6


@eig3.jit
def far_of_many(t, u, v, p):
    return u[0] - 1e6


def sets(m: int) -> dict[str, tuple[Problem, dict[str, Any]]]:
    """Return the problems of the ensembles, each with the u0, v0 and parameters of m members."""
    rng = np.random.default_rng(0)

    def members(problem: Problem, u0: Any, v0: Any, **columns: np.ndarray) -> tuple[Problem, dict[str, Any]]:
        params = np.tile(np.asarray(problem.params, dtype=np.float64), (m, 1))
        for column, values in columns.items():
            params[:, int(column[1:])] = values
        return replace(problem, energy=None), {"u0": u0, "v0": v0, "params": params}

    e, rest = np.linspace(0.0, 0.9, m), np.zeros(m)
    ellipse = np.column_stack([1 - e, rest]), np.column_stack([rest, np.sqrt((1 + e) / (1 - e))])
    duffing = problems.duffing(delta=0.1, a=1.0, b=1.0, t_end=100.0)
    amplitudes, frequencies = rng.uniform(0.1, 0.5, m), rng.uniform(0.5, 1.5, m)
    return {
        "duffing": members(duffing, rng.uniform(-0.5, 0.5, m), rest, p3=amplitudes, p4=frequencies),
        "van_der_pol, mu from 1 to 20": members(
            problems.van_der_pol(t_end=50.0), np.full(m, 2.0), rest, p0=np.linspace(1, 20, m)
        ),
        "kepler, e from 0 to 0.9": members(problems.kepler(t_end=20.0), *ellipse),
        "bouncing_ball": members(problems.bouncing_ball(), rng.uniform(0.5, 2.0, m), rest),
    }


def tolerance_tables(m: int, repeats: int) -> str:
    """Return the two tables."""
    found = sets(m)
    ways: dict[str, dict[str, Any]] = {"RK5": {"rtol": _RTOL, "method": "rk5"}, "RK8": {"rtol": _RTOL, "method": "rk8"}}
    rows = [_row(f"{name}, {way}", *one, ways[way], repeats) for name, one in found.items() for way in ways]
    fixed = {name: one for name, one in found.items() if one[0].events}
    rows += [_row(f"{name}, EIG-3, h = {_STEP:g}", *one, {"h": _STEP}, repeats) for name, one in fixed.items()]
    events = [_event_row(name, *one, repeats) for name, one in found.items() if name not in fixed]
    head = (
        f"Microseconds a member for {m} members on one core with rtol = {_RTOL:g}, or with h: `problem.ensemble` with "
        f"its Python, and a loop of `problem.prepare(...)` over {min(_FEW, m)} members; medians of {repeats} runs.\n"
    )
    event_head = "\nThe time of an ensemble with an event that never occurs, in units of the time without it.\n"
    tables = text.table(_HEADER, rows), text.table(["ensemble", "h = 0.01, EIG-3", "rtol, RK8"], events)
    return "\n".join([head, tables[0], event_head, tables[1]])


def _row(name: str, problem: Problem, members: dict[str, Any], options: dict[str, Any], repeats: int) -> list[str]:
    prepared = problem.prepare(save_every=None, invariants={}, **options)
    m = len(members["u0"])
    few = range(min(_FEW, m))
    starts = [(None, *(values[i] for values in members.values())) for i in few]
    seconds = medians(
        {
            "lanes": partial(seconds_of, lambda: problem.ensemble(**members, **options, threads=1)),
            "loop": partial(seconds_of, lambda: [prepared(*start) for start in starts]),
        },
        repeats,
        name,
    )
    lanes, loop = 1e6 * seconds["lanes"] / m, 1e6 * seconds["loop"] / len(few)
    steps = problem.ensemble(**members, **options).n_steps.mean()
    return [name, f"{steps:.0f}", text.number(lanes), text.number(loop), f"{loop / lanes:.1f}"]


def _event_row(name: str, problem: Problem, members: dict[str, Any], repeats: int) -> list[str]:
    g = far if np.ndim(problem.u0) == 0 else far_of_many
    event, ratios = {"far": eig3.Event(g)}, []
    for options in ({"h": 0.01}, {"rtol": _RTOL, "method": "rk8"}):
        given: dict[str, Any] = {**members, **options, "threads": 1}
        seconds = medians(
            {
                "without": partial(seconds_of, lambda given=given: problem.ensemble(**given)),  # type: ignore[misc]
                "with": partial(seconds_of, lambda given=given: problem.ensemble(**given, events=event)),  # type: ignore[misc]
            },
            repeats,
            f"{name}, event",
        )
        ratios.append(seconds["with"] / seconds["without"])
    return [name, *(f"{ratio:.2f}" for ratio in ratios)]
