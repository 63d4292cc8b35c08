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
        events = heyoka_events(package.t_event, system, problem, tolerance)
        # without compact mode a large system takes minutes to compile
        solver = package.taylor_adaptive(system, y0, tol=tolerance, compact_mode=len(y0) > 40, t_events=events)

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
    start = [real(x) for x in (*np.ravel(problem.u0), *np.ravel(problem.v0))]
    return heyoka_system(problem, [real(x) for x in np.ravel(problem.params)]), start


def heyoka_system(problem: Problem, params: list[Any]) -> list[tuple]:
    """The first-order system in heyoka's symbols, whose parameters are numbers or symbols."""
    import heyoka as package

    u, v = ([package.make_vars(f"{letter}{j}") for j in range(np.size(problem.u0))] for letter in "uv")
    accelerations = EXPRESSIONS[problem.name](package, u, v, params)
    return [*zip(u, v, strict=True), *zip(v, accelerations, strict=True)]


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


def diffrax_run(method: str, slope: Callable, span: Any, y0: Any, p: Any, rtol: Any, atol: Any, **options: Any) -> Any:
    """What diffrax finds with ``slope(t, y, p)``; without further options, the state at the end."""
    import diffrax as package

    return package.diffeqsolve(
        package.ODETerm(slope),
        getattr(package, method)(),
        *span,
        None,  # the first step is the controller's choice
        y0,
        p,
        stepsize_controller=package.PIDController(rtol=rtol, atol=atol),
        **options,
    )


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
        options = {"saveat": package.SaveAt(ts=times), "max_steps": _ENDLESS, "throw": False}
        found = diffrax_run(method, slope, (times[0], times[-1]), y0, None, rtol, atol, **options)
        return found.ys, found.result == package.RESULTS.successful

    def run(tolerance: float) -> Answer:
        begin = time.perf_counter()
        y, success = solve(tolerance, absolute(tolerance, problem))
        y = np.asarray(y)
        return Answer.of(time.perf_counter() - begin, y.T, times, None, bool(success))

    return lambda tolerance: partial(run, tolerance)
