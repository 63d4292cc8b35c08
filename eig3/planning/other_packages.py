"""Say where a method of another package may be faster than the fastest method of a plan."""

from __future__ import annotations

import time
from importlib.util import find_spec

import numpy as np

from ..diagnosis.stiffness import MANY_STEPS, STATES, stiffness
from ..methods import Method
from .pilots import Pilots

_HIGH_ACCURACY = 1e-8  # from here on, the best order of a Taylor series is above the order of RK8
_LONGEST_TRIAL = 0.5  # processor time of the run with an implicit method, s
_FEWEST_STEPS = 5  # least number of its steps for an estimate


def faster_elsewhere(pilots: Pilots, accuracy: float, method: Method, n_steps: int, rtol: float | None) -> str:
    """Name an implicit method for a stiff motion, or Taylor series for a high accuracy; otherwise empty.

    For a force that does not read the velocity, RKN12 is faster than Taylor series: bench/README.md has the times.
    """
    if not pilots.problem.uses_velocity:
        return ""
    if n_steps >= MANY_STEPS:
        states = pilots.states(STATES, pilots.span / n_steps)
        stiff = stiffness(method, pilots.acceleration, states, "the accuracy")
        if stiff:
            return f"{stiff} {_implicit_run(pilots, accuracy)}".rstrip()
    if accuracy > _HIGH_ACCURACY or pilots.problem.events or pilots.problem.unknowns.is_read:
        return ""
    return _taylor_series(pilots, rtol or accuracy / 10)


def _implicit_run(pilots: Pilots, accuracy: float) -> str:
    """Estimate the time of an implicit method by a run over the span, or over its beginning if this takes long."""
    if find_spec("scipy") is None:
        return ""
    from scipy.integrate import Radau

    f, (t0, end), (u0, v0) = pilots.acceleration, pilots.problem.t_span, pilots.at_start
    n = np.size(u0)

    def both(t: float, y: np.ndarray) -> np.ndarray:
        u, v = (y[:n], y[n:]) if np.ndim(u0) else y
        return np.append(y[n:], f(t, u, v))

    begin, steps = time.thread_time(), 0
    run = Radau(both, t0, np.append(u0, v0), end, rtol=accuracy, atol=accuracy * max(np.abs(u0).max(), pilots.size))
    while run.status == "running" and time.thread_time() - begin < _LONGEST_TRIAL:
        run.step()
        steps += 1
    if run.status == "failed" or steps < _FEWEST_STEPS:
        return ""
    seconds, part = time.thread_time() - begin, (run.t - t0) / (end - t0)
    return f"It takes about {steps / part:.2g} steps and {seconds / part:.2g} s, with rtol={accuracy:g}."


def _taylor_series(pilots: Pilots, rtol: float) -> str:
    """How to integrate by the Taylor series of heyoka."""
    u0, _ = pilots.at_start
    if np.ndim(u0):
        names = f'([heyoka.make_vars(f"{{x}}{{j}}") for j in range({np.size(u0)})] for x in "uv")'
        equations = "[*zip(u, v), *zip(v, f)], [*u0, *v0]"
    else:
        names, equations = 'heyoka.make_vars("u", "v")', "[(u, v), (v, f)], [u0, v0]"
    return (
        "For this accuracy, the Taylor series of the package heyoka may take down to 0.4 of the time, if the "
        f"acceleration f is a formula without kinks: u, v = {names}; "
        f"heyoka.taylor_adaptive({equations}, tol={rtol:.0e}).propagate_until(t_end), with f as an expression of u, v."
    )
