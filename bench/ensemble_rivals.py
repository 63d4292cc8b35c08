"""Packages that a user could choose instead for an ensemble, each with its best settings, and EIG-3 in JAX.

They get the parameters that all members share as constants.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .ensemble_cases import SAMPLES, Case
from .rivals.expressions import EXPRESSIONS
from .rivals.impacts import heyoka_events
from .rivals.rival import is_installed
from .rivals.symbolic import diffrax_run, heyoka_system, jax_symbols, jax_with_doubles
from .timing import seconds_of

#: A run of all members, which returns their displacements at the end, of shape (m, n).
Run = Callable[[], np.ndarray]

TOLERANCES = tuple(10 ** (-k / 2) for k in range(4, 27))
_CHUNK = 500  # members that diffrax integrates together: the members of a chunk wait for the slowest one
_TRIAL = 128  # members for the choice of heyoka's batch size


@dataclass(frozen=True)
class Contestant:
    """A method or a package. ``prepare(case, m)(setting)`` returns a run to the end of the span of the problem."""

    label: str
    prepare: Callable[[Case, int], Callable[[Any], Run]]
    settings: Sequence[float] = TOLERANCES  # the fastest first
    package: str = ""  # empty for a method of the library

    @property
    def is_ours(self) -> bool:
        return not self.package

    @property
    def is_installed(self) -> bool:
        return is_installed(self.package)

    def cannot(self, case: Case) -> str:
        """Return what of the problem the package cannot express, if there is something."""
        if self.package == "heyoka":
            return "" if case.problem.name in EXPRESSIONS else "no tables in heyoka"
        return "no resets in diffrax" if case.problem.events else ""


def _split(values: np.ndarray, symbol: Callable[[int], Any]) -> tuple[list[Any], np.ndarray]:
    """Return the columns of values, shape (m, k), as numbers where all members agree, and as symbol(i) elsewhere.

    The second result has the columns that differ, shape (number of symbols, m).
    """
    differs = np.flatnonzero(np.ptp(values, axis=0))
    columns = values[0].tolist()
    for i, column in enumerate(differs):
        columns[column] = symbol(i)
    return columns, np.ascontiguousarray(values[:, differs].T)


def _heyoka_system(case: Case, m: int) -> tuple[list[Any], np.ndarray, np.ndarray]:
    """Return the equations, the states at the start, shape (2 n, m), and the parameters, shape (k, m)."""
    import heyoka

    u0, v0, params = case.states(m)
    p, own = _split(params, lambda i: heyoka.par[i])
    return heyoka_system(case.problem, p), np.concatenate([u0.T, v0.T]), own


def _heyoka_batch(
    case: Case, m: int, tolerance: float, width: int
) -> tuple[Any, Callable[[Any, int], Any], Callable[[int], slice]]:
    """Return a batch integrator, a function that sets it to the start of batch i, and the members of batch i."""
    import heyoka

    system, y0, own = _heyoka_system(case, m)
    solver = heyoka.taylor_adaptive_batch(
        system,
        np.zeros((len(y0), width)),
        tol=tolerance,
        pars=np.zeros((len(own), width)),
        t_events=heyoka_events(heyoka.t_event_batch, system, case.problem, tolerance),
    )

    def members(i: int) -> slice:
        """The last batch begins early, so that it is full."""
        first = min(i * width, m - width)
        return slice(first, first + width)

    def begin(solver: Any, i: int) -> Any:
        solver.set_time(0.0)
        solver.state[:], solver.pars[:] = y0[:, members(i)], own[:, members(i)]
        if case.problem.events:
            solver.reset_cooldowns()
        return solver

    return solver, begin, members


def _heyoka_batches(threads: int, case: Case, m: int) -> Callable[[float], Run]:
    """Batches one after the other, in each of some threads: heyoka releases the lock of Python."""
    import heyoka

    t_end, n = case.problem.t_span[1], np.size(case.problem.u0)

    def with_width(tolerance: float, width: int) -> Callable[[int], np.ndarray]:
        first, begin, members = _heyoka_batch(case, m, tolerance, width)
        solvers = [copy.copy(first) for _ in range(threads)]

        def run(count: int) -> np.ndarray:
            ends = np.empty((m, n))

            def some(thread: int) -> None:
                solver = solvers[thread]
                for i in range(thread, count, threads):
                    begin(solver, i).propagate_until(t_end)
                    ends[members(i)] = solver.state[:n].T

            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(some, range(threads)))
            return ends

        return run

    def at(tolerance: float) -> Run:
        recommended = heyoka.recommended_simd_size()
        sizes = sorted({min(recommended, m), min(2 * recommended, m)})
        runs = {size: with_width(tolerance, size) for size in sizes}
        trial = min(_TRIAL, m)
        best = min(sizes, key=lambda size: seconds_of(partial(runs[size], trial // size)))
        return partial(runs[best], -(-m // best))

    return at


def _heyoka_ensemble_of_batches(case: Case, m: int) -> Callable[[float], Run]:
    import heyoka

    width = min(heyoka.recommended_simd_size(), m)
    n = np.size(case.problem.u0)

    def at(tolerance: float) -> Run:
        solver, begin, members = _heyoka_batch(case, m, tolerance, width)

        def run() -> np.ndarray:
            results = heyoka.ensemble_propagate_until_batch(solver, case.problem.t_span[1], -(-m // width), begin)
            ends = np.empty((m, n))
            for i, (finished, *_) in enumerate(results):
                ends[members(i)] = finished.state[:n].T
            return ends

        return run

    return at


def _heyoka_ensemble(case: Case, m: int) -> Callable[[float], Run]:
    import heyoka

    system, y0, own = _heyoka_system(case, m)
    n = len(y0) // 2

    def at(tolerance: float) -> Run:
        events = heyoka_events(heyoka.t_event, system, case.problem, tolerance)
        solver = heyoka.taylor_adaptive(system, y0[:, 0], tol=tolerance, pars=own[:, 0], t_events=events)

        def begin(solver: Any, i: int) -> Any:
            solver.time = 0.0
            solver.state[:], solver.pars[:] = y0[:, i], own[:, i]
            if events:
                solver.reset_cooldowns()
            return solver

        def run() -> np.ndarray:
            results = heyoka.ensemble_propagate_until(solver, case.problem.t_span[1], m, begin)
            return np.array([finished.state[:n] for finished, *_ in results])

        return run

    return at


def _jax_members(case: Case, m: int) -> tuple[tuple, Callable]:
    """Return u0, v0 and the parameters of the members as tuples of arrays, and ``f(t, u, v, own)`` for one member."""
    jax_with_doubles()
    u0, v0, params = case.states(m)
    _, own = _split(params, int)
    expression = {**EXPRESSIONS, "shear_building": _shear_building}[case.problem.name]

    def f(t: Any, u: Sequence[Any], v: Sequence[Any], own: Sequence[Any]) -> tuple:
        p, _ = _split(params, lambda i: own[i])
        return tuple(expression(jax_symbols(t), u, v, p))

    return (tuple(u0.T), tuple(v0.T), tuple(own)), f


def _shear_building(symbols: Any, u: Sequence[Any], v: Sequence[Any], p: Sequence[Any]) -> list[Any]:
    jnp, t = jax_with_doubles().numpy, symbols.time
    times, ground = jnp.array(p[1 : 1 + SAMPLES]), jnp.array(p[1 + SAMPLES : 1 + 2 * SAMPLES])
    i = jnp.clip((t / times[1]).astype(int), 0, SAMPLES - 2)
    i = i - (t < times[i])
    i = jnp.clip(i + (t >= times[i + 1]), 0, SAMPLES - 2)
    speed = (ground[i + 1] - ground[i]) / (times[i + 1] - times[i])
    x, k, c = ground[i] + speed * (t - times[i]), p[-2] * p[0], p[-1] * p[0]
    forces = [
        k * (after - before) + c * (fast - slow)
        for before, after, slow, fast in zip((x, *u), u, (speed, *v), v, strict=False)
    ]
    return [above - below for below, above in zip(forces, (*forces[1:], 0.0), strict=True)]


def jax_eig3(case: Case, m: int, n_steps: int) -> Run:
    """Return EIG-3 as a loop in JAX, vectorised over the members and compiled."""
    jax = jax_with_doubles()
    arguments, f = _jax_members(case, m)
    h = case.h

    def member(u: tuple, v: tuple, own: tuple) -> tuple:
        def step(i: Any, state: tuple) -> tuple:
            u, v, before = state
            a = f(i * h, u, v, own)
            u = tuple(x + h * y - h * h / 2 * b + h * h * c for x, y, b, c in zip(u, v, before, a, strict=True))
            return u, tuple(y + 1.5 * h * c - h / 2 * b for y, b, c in zip(v, before, a, strict=True)), a

        return jax.lax.fori_loop(0, n_steps, step, (u, v, f(jax.numpy.float64(0), u, v, own)))[0]

    members = jax.jit(jax.vmap(member))
    return lambda: np.array(members(*arguments)).T


def _diffrax(method: str, case: Case, m: int) -> Callable[[float], Run]:
    jax, t_end = jax_with_doubles(), case.problem.t_span[1]
    arguments, f = _jax_members(case, m)

    def slope(t: Any, y: tuple, own: tuple) -> tuple:
        u, v = y
        return v, f(t, u, v, own)

    def member(u: tuple, v: tuple, own: tuple, tolerance: float) -> tuple:
        return diffrax_run(method, slope, (0.0, t_end), (u, v), own, tolerance, tolerance, max_steps=None).ys[0]

    members = jax.jit(jax.vmap(member, in_axes=(0, 0, 0, None)))
    chunks = [jax.tree.map(lambda x, i=i: x[i : i + _CHUNK], arguments) for i in range(0, m, _CHUNK)]

    def run(tolerance: float) -> np.ndarray:
        def ends(chunk: tuple) -> np.ndarray:
            return np.array(members(*chunk, tolerance))[:, :, 0].T

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return np.concatenate(list(pool.map(ends, chunks)))

    return lambda tolerance: partial(run, tolerance)


ENSEMBLE_RIVALS = (
    Contestant("heyoka, batches in threads", partial(_heyoka_batches, os.cpu_count() or 1), package="heyoka"),
    Contestant("heyoka, batches in a loop", partial(_heyoka_batches, 1), package="heyoka"),
    Contestant("heyoka, ensemble of batches", _heyoka_ensemble_of_batches, package="heyoka"),
    Contestant("heyoka, ensemble", _heyoka_ensemble, package="heyoka"),
    Contestant("diffrax Tsit5", partial(_diffrax, "Tsit5"), package="diffrax"),
    Contestant("diffrax Dopri8", partial(_diffrax, "Dopri8"), package="diffrax"),
)
