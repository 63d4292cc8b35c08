"""The default step of a first run of a problem."""

from __future__ import annotations

from ..diagnosis.critical import NoCriticalStepError
from ..methods import Method
from ..problem import Problem

_STEPS = 2000  # least number of steps for a problem without a suggested step


def first_step(problem: Problem, method: str | Method, span: float) -> float:
    """Return the step that the problem suggests, or a step well below the critical step and the span."""
    if problem.h is not None:
        return problem.h
    try:
        return min(span / _STEPS, problem.critical_step(method=method).h / 10)
    except NoCriticalStepError:
        return span / _STEPS
