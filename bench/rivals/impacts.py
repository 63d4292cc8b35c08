"""Events of the rivals: terminal events after which the solver starts anew, and events in heyoka's symbols."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eig3.problem import Problem
from eig3.problems.hertz_impact import largest_indentation


def restarted(solve: Callable[..., Any], problem: Problem, times: np.ndarray, y0: np.ndarray) -> list[Any]:
    """The results of the solver over the whole span, or, for a problem with an event, from one event to the next.

    ``solve(span, y, times, events)`` is a solver with SciPy's events, for one degree of freedom and one event.
    """
    if not problem.events:
        return [solve((times[0], times[-1]), y0, times, None)]
    (event,) = problem.events.values()
    params = np.array(problem.params, dtype=np.float64)

    def zero(t: float, y: np.ndarray) -> float:
        return event.g(t, y[0], y[1], params)

    vars(zero).update(terminal=True, direction=event.direction)
    t, y, left, results = times[0], y0, times, []
    while True:
        result = solve((t, times[-1]), y, left, [zero])
        results.append(result)
        left = left[len(result.t) :]
        if not len(left) or not len(result.t_events[0]):
            return results
        t = result.t_events[0][0]
        y = np.array(event.apply(t, *np.ravel(result.y_events[0]), params))  # SciPy has a row, CyRK a column


def states(results: list[Any]) -> np.ndarray:
    """The states at the requested times in all results."""
    return np.concatenate([result.y for result in results if len(result.t)], axis=1)


def _impact(heyoka, event, u, problem, tolerance):
    restitution = problem.params[1]

    def bounce(solver, sign, *member):
        solver.state[(1, *member)] *= -restitution
        return True

    return [event(u, callback=bounce, direction=heyoka.event_direction.negative)]


def _contact(heyoka, event, u, problem, tolerance):
    """Switch the force on where the impulse up to there is as small as the tolerance.

    The force has no Taylor series where the contact begins.
    """
    touch = largest_indentation(problem.params[0], abs(problem.v0)) * tolerance**0.4

    def switch(solver, sign):
        solver.pars[0] = float(sign < 0)
        return True

    return [event(u + touch, callback=switch)]


_EVENTS = {"bouncing_ball": _impact, "hertz_impact": _contact}


def heyoka_events(event: Any, system: list[tuple], problem: Problem, tolerance: float) -> list[Any]:
    """Return the terminal events of a problem for heyoka, which has this system.

    `event` is `heyoka.t_event`, or `heyoka.t_event_batch` for the members of a batch.
    """
    import heyoka

    make = _EVENTS.get(problem.name)
    return make(heyoka, event, system[0][0], problem, tolerance) if make else []
