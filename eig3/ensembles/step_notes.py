"""The notes about the steps and the angles of members, from the results of all of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np

from ..diagnosis.coarseness import coarse_events, limited_ways, links_of, long_ways
from ..diagnosis.half_turns import TURNED, half_turns
from ..diagnosis.stiffness import VERY_MANY_STEPS
from ..functions.companions import Angles, mark
from ..result.solution import Status
from ..run.instability import has_grown, instability
from ..stepping.run_options import RunOptions
from ..stepping.tolerances import Tolerances, longest_way
from .members import Members
from .single_members import Singles
from .solution import EnsembleSolution

_MOST = 8  # members whose critical step is found, which takes longer than a thousand steps in lanes


def step_notes(solution: EnsembleSolution, single: Singles, members: Members, options: RunOptions) -> tuple[str, ...]:
    """Return the notes on angles, contacts and growth that single runs have."""
    notes = [*islice(_half_turns(solution, single.rhs, members), 1)]
    if options.tolerances:
        notes.append(_limited_ways(solution, single, members, options.tolerances))
        return (*filter(None, notes),)
    if links := links_of(options.events) if options.events else ():
        notes.append(coarse_events(members.steps, solution.events, links, members.first))
    if cutoffs := mark(single.rhs, "cutoffs"):
        ends = solution.v[np.arange(len(solution)), solution._n_rows() - 1]
        speeds = np.where(solution.status == Status.COMPLETED, cutoffs.speeds(members.v0, ends), 0.0)
        notes.append(long_ways(members.steps, speeds, cutoffs.least(members.params), members.first))
    if np.maximum.reduce(members.n_steps) >= VERY_MANY_STEPS:  # the search takes far longer than a short ensemble
        notes.append(_instability(solution, single, members))
    return (*filter(None, notes),)


def _limited_ways(solution: EnsembleSolution, single: Singles, members: Members, tolerances: Tolerances) -> str:
    """Describe the longest way of a point in a step, if it limits the steps of the member with the most steps."""
    points, way = longest_way(mark(single.rhs, "cutoffs"), tolerances, members.params)
    i = int(solution.n_steps.argmax())
    if not points or solution.n_steps[i] < VERY_MANY_STEPS:
        return ""
    run = solution[i]
    is_limit = run.h * np.abs(run.v[-1, :points]).max() > way / 2
    return f"{limited_ways(way)} This is member {members.first + i}." if is_limit else ""


def _half_turns(solution: EnsembleSolution, rhs: Any, members: Members) -> Iterator[str]:
    """Describe the angles of members that pass half a turn, if a torque jumps there."""
    angles: Angles | None = mark(rhs, "angles")
    if not angles:
        return
    turned = np.zeros(len(solution), dtype=bool)
    for j in angles.degrees.tolist():
        turned |= np.fmax.reduce(solution.u[..., j], axis=1) - np.fmin.reduce(solution.u[..., j], axis=1) > TURNED
    params, counts = np.atleast_2d(members.params), solution._n_rows()
    for i in np.flatnonzero(turned).tolist():
        rows = (x[i, : counts[i]] for x in (solution.t, solution.u, solution.v))
        for note in half_turns(angles, params[i % len(params)], *rows):
            yield f"{note} This is member {members.first + i}."


def _instability(solution: EnsembleSolution, single: Singles, members: Members) -> str:
    """Describe an unstable step of a member that has grown, if one of the members that have grown most has one."""
    completed = np.flatnonzero(solution.status == Status.COMPLETED)
    if not len(completed):
        return ""
    rows = solution._n_rows()[completed] - 1
    ends = [_sizes(x[completed, rows]) for x in (solution.u, solution.v)]
    starts = [_sizes(x[completed]) for x in (members.u0, members.v0)]
    system = single.prepared(int(completed[0])).system
    grown = np.flatnonzero(has_grown(system, solution.n_steps[completed], ends, starts))
    with np.errstate(all="ignore"):
        growth = np.fmax(*(end[grown] / start[grown] for end, start in zip(ends, starts, strict=True)))
    found = completed[grown[np.argsort(-growth)]]
    if mark(single.rhs, "is_linear") and not members.has_own_params and len(found):
        found = found[[members.steps[found].argmax()]]  # the members differ in their start, and share the critical step
    for i in found[:_MOST].tolist():
        stepper: Any = single.prepared(i).at_start(members.t_span, *members.start(i))
        if note := instability(stepper, int(solution.n_steps[i])):
            return f"{note} This is member {members.first + i} of the {len(grown)} members that have grown."
    return ""


def _sizes(states: np.ndarray) -> np.ndarray:
    """Return the size of each state, shape (m,)."""
    return np.abs(states).reshape(len(states), -1).max(axis=1)
