"""Solvers that compile the equations from their own symbols: heyoka's Taylor series, and diffrax."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from eig3.problem import Problem

from .expressions import EXPRESSIONS
from .impacts import heyoka_events
from .rival import Answer, absolute

_ENDLESS = 300_000  # steps of diffrax; an orbit that falls into the sun takes ever smaller ones


def heyoka(problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    import heyoka as package

    system, y0 = heyoka_form(problem)

    def at(tolerance: float) -> Callable[[], Answer]:
        u, v = ([variable for variable, _ in half] for half in (system[: len(y0) // 2], system[len(y0) // 2 :]))
        events = heyoka_events(package.t_event, u, v, problem, tolerance)
        # without compact mode a large system takes minutes to compile
        solver = package.taylor_adaptive(system, y0, tol=tolerance, compact_mode=len(u) > 20, t_events=events)

        def run() -> Answer:
            solver.time = times[0]
            solver.state[:] = y0
            if events:
                solver.pars[:] = 0
                solver.reset_cooldowns()
            begin = time.perf_counter()
            outcome, *_, states = solver.propagate_grid(times)
            seconds = time.perf_counter() - begin
            return Answer.of(seconds, states.T, times, None, outcome == package.taylor_outcome.time_limit)

        return run

    return at


def heyoka_form(problem: Problem, real: Any = float) -> tuple[list[tuple], list]:
    """The first-order system in heyoka's symbols, and y0 = (u0, v0), with constants of the type `real`."""
    import heyoka as package

    start = [*np.ravel(problem.u0), *np.ravel(problem.v0)]
    n = len(start) // 2
    u, v = ([package.make_vars(f"{letter}{j}") for j in range(n)] for letter in "uv")
    accelerations = EXPRESSIONS[problem.name](package, u, v, [real(x) for x in np.ravel(problem.params)])
    return [*zip(u, v, strict=True), *zip(v, accelerations, strict=True)], [real(x) for x in start]


def jax_with_doubles() -> Any:
    """JAX, whose numbers are otherwise of single precision."""
    import jax

    jax.config.update("jax_enable_x64", True)
    return jax


def jax_symbols(t: Any) -> SimpleNamespace:
    """What the expressions need, at the time t."""
    jnp = jax_with_doubles().numpy
    functions = {name: getattr(jnp, name) for name in ("sin", "cos", "tanh", "sqrt", "maximum")}
    return SimpleNamespace(time=t, sum=sum, **functions)


def diffrax(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    jax = jax_with_doubles()
    import diffrax as package

    n, params = np.size(problem.u0), np.ravel(problem.params).tolist()
    y0 = np.concatenate([np.ravel(problem.u0), np.ravel(problem.v0)]).astype(np.float64)

    def slope(t: Any, y: Any, args: None) -> Any:
        u, v = y[:n], y[n:]
        return jax.numpy.stack([*v, *EXPRESSIONS[problem.name](jax_symbols(t), list(u), list(v), params)])

    @jax.jit
    def solve(rtol: float, atol: float) -> tuple[Any, Any]:
        found = package.diffeqsolve(
            package.ODETerm(slope),
            getattr(package, method)(),
            times[0],
            times[-1],
            None,  # the first step is the controller's choice
            y0,
            saveat=package.SaveAt(ts=times),
            stepsize_controller=package.PIDController(rtol=rtol, atol=atol),
            max_steps=_ENDLESS,
            throw=False,
        )
        return found.ys, found.result == package.RESULTS.successful

    def run(tolerance: float) -> Answer:
        begin = time.perf_counter()
        y, success = solve(tolerance, absolute(tolerance, problem))
        y = np.asarray(y)
        return Answer.of(time.perf_counter() - begin, y.T, times, None, bool(success))

    return lambda tolerance: partial(run, tolerance)
