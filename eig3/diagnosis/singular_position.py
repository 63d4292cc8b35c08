"""Singular positions of mechanisms, at which the constraints depend on each other, and ways past them.

A rotation vector, as of a node of a corotational frame in space, is singular at a whole turn.

A parallelogram of bars is singular where all bars are in line: from there it can move as a parallelogram, or with its
cranks turning against each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..functions.companions import constraints_of
from ..functions.guard import evaluation, guarded
from ..kernels.constraints import FLOATS, HEAD, Areas
from ..kernels.protocol import BEFORE_END
from ..methods import EIG3
from ..result.labels import Labels
from ..stepping.march import Rows
from ..stepping.run_options import NEVER, RunOptions
from ..stepping.stepper import Stepper
from ..stepping.system import remembered
from ..stepping.tolerances import check_tolerances, usual_method
from ..stepping.variable_stepper import VariableStepper

AT_SINGULAR = ", at a singular position of the mechanism, where its constraints depend on each other"
AT_WHOLE_TURN = ", where a node has rotated by 2 pi: no run passes this angle, at which rx, ry and rz are singular"

_SINGULAR = 1e-4  # a position with less than this part of the independence at the start is singular
_TURNED = 1.0  # rad in two steps; nodes turn further where a step is unstable
_NEAR = 1e-6  # relative distance of a run with tolerances from a whole turn, at which its steps are too short
_AHEAD = 2.0  # steps after the last state within which a singular position is looked for
_PLACES = 200  # places in them
_SHORTER = 0.9, 0.7  # parts of the step with which a run may not meet a singular position
_RTOL = 1e-8
_BEYOND = 20  # steps after the last state that a run takes to be past a singular position
_MOST_WORK = 3e7  # a run that takes more steps than this, divided by the degrees of freedom plus 10, is not tried


def is_singular(last: Stepper | VariableStepper, h: float) -> bool:
    """Return whether the constraints depend on each other at the state of a run, or within two steps after it."""
    constraints = constraints_of(last.system.rhs)
    if constraints is None:
        return False
    places = last.u + np.linspace(0.0, _AHEAD * h, _PLACES)[:, None] * last.v
    least = min(_independence(last, last.t, u, constraints.place) for u in places)
    return least < _SINGULAR * _independence(last, last.t0, last.start[0], constraints.place)


def is_at_whole_turn(labels: Labels | None, u: np.ndarray, v: np.ndarray, h: float) -> bool:
    """Return whether the rotation vector of a node reaches 2 pi within two steps of a state."""
    names = labels.names if labels else ()
    kinds, whole = [name[-3:] for name in names], 2 * np.pi
    turns = [[i, i + 1, i + 2] for i in range(len(names)) if kinds[i : i + 3] == [".rx", ".ry", ".rz"]]
    if not turns:
        return False
    way = _AHEAD * h * v
    before, after, turned = (np.linalg.norm(x[turns], axis=1) for x in (u - way, u + way, way))
    return bool(((turned < _TURNED) & (before < whole) & (after > (1 - _NEAR) * whole)).any())


def ways_past(last: Stepper, t_end: float) -> str:
    """Say which runs to t_end pass a singular position after the state of a run, and which do not."""
    beyond = min(last.t + _BEYOND * last.h, t_end)
    found: dict[bool, list[str]] = {True: [], False: []}
    for name, run, count in _others(last, beyond, t_end):
        found[_passes(run, count, beyond)].append(name)
    passed, failed = (", ".join(names) for names in (found[True], found[False]))
    if passed:
        lost = f", and {failed} did not" if failed else ""
        return f"{passed} passed it{lost}; beyond it there may be more than one motion"
    return f"{failed} did not pass it either; begin after it, or change the mechanism so that it does not come there"


def _independence(last: Stepper | VariableStepper, t: float, u: np.ndarray, place: int) -> float:
    """Return the least pivot of the matrix of the constraints in a position, relative to the entry on its diagonal."""
    p = guarded(last.params)
    _, sizes = evaluation(last.system.callback, last.form, t, u, np.zeros_like(u), p)
    if not math.isfinite(sizes[2]):
        return 0.0
    pivots, profile, starts = (_area(p, place, name) for name in ("pivots", "profile", "starts"))
    return float(1 / (pivots * profile[starts[1:] - 1]).max())


def _area(p: np.ndarray, place: int, name: str) -> np.ndarray:
    """Return an area of the table of constraints at a place of p."""
    k = Areas._fields.index(name)
    begin, length = p[place + HEAD + 2 * k :][:2].astype(int)
    return p[begin : begin + length] if k < FLOATS else p[begin:].view(np.int32)[:length]


def _others(last: Stepper, beyond: float, t_end: float) -> Iterator[tuple[str, Stepper | VariableStepper, int]]:
    """Yield runs with tolerances, and with other steps and methods: their names, their starts, and a count of steps."""
    rhs, form, start, most = last.system.rhs, last.form, last.start, int(_MOST_WORK / (10 + last.n))
    tolerances, method = check_tolerances(_RTOL, None, None, None, most), usual_method(_RTOL, True)
    system = remembered(rhs, form, RunOptions(tolerances=tolerances, method=method))
    march = VariableStepper(system, (last.t0, t_end), *start, guarded(last.params), tolerances.of(last.n))
    yield f"{method.name!r} with rtol={_RTOL:g}", march, most
    for method in dict.fromkeys([last.method, EIG3()]):
        system = remembered(rhs, form, RunOptions(h=last.h, method=method))
        for part in _SHORTER:
            given = float(f"{part * last.h:.3g}")
            h = (t_end - last.t0) / math.ceil((t_end - last.t0) / given)  # as a run with the given step has it
            count = math.ceil((beyond - last.t0) / h)
            if count <= most:
                name = f"{method.name!r} with h={given:g}"
                yield name, Stepper.of(system, last.t0, h, *start, guarded(last.params)), count


def _passes(run: Stepper | VariableStepper, count: int, beyond: float) -> bool:
    """Return whether a run passes a time within a number of steps."""
    none, rows = np.empty(0), np.empty((0, run.n))
    try:
        run.take(count, NEVER, 0, Rows(none, none, rows, rows), ())
    except Exception:  # a function of the user fails
        return False
    return run.is_finite and (run.ended == BEFORE_END or run.t >= beyond - 1e-9 * abs(run.h))
