"""Detect runs with a fixed step that have too few steps in a period of the motion, in some microseconds.

A harmonic motion with theta = omega h has the second differences u_{n+1} - 2 u_n + u_{n-1} = -(2 sin(theta/2))^2 u_n.
The sums of their squares over all degrees of freedom give a mean theta of the motion, to which small vibrations of high
modes contribute little.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..functions.events import EffectEvent, Event
from ..methods import Method
from ..result.occurrences import is_jump
from ..stability import limit
from ..stepping.stepper import Stepper

_SUFFICIENT = 20  # steps in a period, for the step to suggest
_FEW, _FEW_OF_HIGH_ORDER = 6, 3  # least steps in a period, for methods up to and above _LOW_ORDER
_LOW_ORDER = 4
_CONTACTS = 10  # fewer events may be rare
_JUMP, _SHORT_WAY = 0.5, 0.125  # ways in a step, of a contact distance: one that may jump over it, one to suggest
_SHORT = 8  # a shorter run does not show its period, because any motion has a curvature
_ROWS, _VALUES = 64, 2**14  # the largest part of the history that is analysed
_STANDING = 1e-10  # a smaller motion relative to |u| is round-off
_OVERDAMPED = 5.0  # damping ratio at which the limit of c h is found


def coarseness(stepper: Stepper, u: np.ndarray | None) -> str:
    """Describe a step that is too long for the motion; empty if it is short enough.

    The stepper is at the end of the run, and u has the displacements after every step, if they were saved.
    """
    if u is None or len(u) <= _SHORT or stepper.method.is_stochastic:  # noise bends the path in every step
        return _at_start(stepper)
    theta = _theta(u[-max(_SHORT + 1, min(_ROWS, _VALUES // stepper.n)) :])
    return _few(stepper.h, theta, "end", "") if theta > _most(stepper.method) else ""


def links_of(events: Mapping[str, Event]) -> list[str]:
    """Return the names of the events of links."""
    return [name for name, event in events.items() if isinstance(event, EffectEvent)]


def coarse_events(h: np.ndarray, events: Mapping[str, Any], links: Iterable[str], first: int = 0) -> str:
    """Describe a step that is too long between two events of the same link; empty if it is short enough.

    A spring behind a gap pushes for half a period of its vibration. A step that is stable while it stays closed may add
    energy in each contact, because some contacts have one evaluation more than others. An event that changes the state
    is no such contact.

    h has the step of each member, or of a run, and `events` the Occurrences or MemberOccurrences by name. `links` are
    the names of the events of links, and `first` is the number of the first member.
    """
    steps = {name: _steps_between(h, events[name]) for name in links if not is_jump(events[name]).any()}
    name = min(steps, key=lambda name: steps[name].min(), default="")
    if not name or not (few := steps[name] < _FEW / 2).any():
        return ""
    i, half = int(steps[name].argmin()), _SUFFICIENT / 2
    wanted = h[i] * steps[name][i] / half
    whose = f" This is member {first + i} of the {few.sum()} members with such contacts." if len(h) > 1 else ""
    return (
        f"h = {h[i]:g} is long for the contacts: a quarter of the events of {name!r} follows the event before "
        f"within {steps[name][i]:.2g} steps, and each contact may add energy. Take h = {wanted:.2g} "
        f"for {half:g} steps in a contact.{whose}"
    )


def long_ways(h: np.ndarray, speeds: np.ndarray, least: float, first: int = 0) -> str:
    """Describe a step in which a point may pass through another; empty if all ways are short enough.

    `speeds` are the largest speeds along an axis of each member, or of a run. `least` is the shortest distance at which
    two points touch, or act on each other, and `first` the number of the first member.
    """
    i = int((h * speeds).argmax())
    if (shorter := _without_jumps(h[i], speeds[i], least)) == h[i]:
        return ""
    whose = f" This is member {first + i}." if len(h) > 1 else ""
    return (
        f"h = {h[i]:g} is long for the contacts: a point moves by {h[i] * speeds[i]:.2g} in a step, and may pass "
        f"through another that acts on it within {least:.2g} only. Take h = {shorter:.2g}.{whose}"
    )


def limited_ways(way: float) -> str:
    """Describe the longest way of a point in a step, which limits the steps of a run with tolerances."""
    return (
        "A short contact distance or cutoff limits the steps, and not rtol: no point moves further than an eighth of "
        f"it, {way:.2g}, in a step, so that none passes through another. h_max replaces this limit."
    )


def h_without_jumps(stepper: Stepper) -> float:
    """Return the step, or a shorter step if a point may pass through another in the step."""
    cutoffs = stepper.system.cutoffs
    if not cutoffs:
        return stepper.h
    speed = float(cutoffs.speeds(stepper.start[1], stepper.v)[0])
    return _without_jumps(stepper.h, speed, cutoffs.least(stepper.p))


def _without_jumps(h: float, speed: float, least: float) -> float:
    return _SHORT_WAY * least / speed if _JUMP * least < h * speed < math.inf else h


def _steps_between(h: np.ndarray, found: Any) -> np.ndarray:
    """Return the lower quartile of the steps between the events of each member; infinity with few events."""
    member = getattr(found, "member", np.zeros(len(found), dtype=np.int64))
    is_same = member[1:] == member[:-1]
    between, of = np.diff(found.t)[is_same], member[1:][is_same]
    between, counts = between[np.lexsort((between, of))], np.bincount(of, minlength=len(h))
    many = np.flatnonzero(counts >= _CONTACTS - 1)
    places, shares = np.divmod(0.25 * (counts[many] - 1), 1.0)
    low = (np.cumsum(counts) - counts)[many] + places.astype(np.intp)
    steps = np.full(len(h), np.inf)
    steps[many] = ((1 - shares) * between[low] + shares * between[low + 1]) / h[many]
    return steps


def _theta(u: np.ndarray) -> float:
    """Return the mean of omega h over equidistant states; 0.0 if they do not move."""
    with np.errstate(over="ignore", invalid="ignore"):
        about = u - u.mean(axis=0)
        bend = about[2:] - 2 * about[1:-1] + about[:-2]
        spread, bends = np.vdot(about, about), np.vdot(bend, bend)
        if not (spread > (_STANDING * np.abs(u).max()) ** 2 and bends < math.inf):
            return 0.0
    return 2 * math.asin(min(1.0, (bends / spread) ** 0.25 / 2))


def _most(method: Method) -> float:
    return 2 * math.pi / (_FEW if method.order <= _LOW_ORDER else _FEW_OF_HIGH_ORDER)


def _at_start(stepper: Stepper) -> str:
    """Assess h by the changes of the acceleration along the first step, at a fixed time.

    A single degree of freedom has one period. Many degrees of freedom have a range of periods, the shortest of which
    may be only just stable.
    """
    if stepper.system.history:  # the history variables belong to the end of the run, not to the start
        stepper = stepper.restarted(stepper.h)
    h, (u, v), a = stepper.h, stepper.start, stepper.first_acceleration
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            theta = math.sqrt(h * h * _rate(stepper, a, u + h * (v + h / 2 * a), v))
            damping = h * _rate(stepper, a, u, v + h * a)
        except Exception:  # rhs may fail beyond the states of the motion
            return ""
    if theta > _most(stepper.method):
        most = limit(stepper.running)
        if theta > most:
            beyond = f"; {stepper.method.label} is unstable beyond h = {h * most / theta:.2g}"
            return _few(h, theta, "start", beyond)
        if stepper.n == 1:
            return _few(h, theta, "start", "")
    if damping > 1 and not stepper.running.is_implicit:
        most = 2 * _OVERDAMPED * limit(stepper.running, _OVERDAMPED)
        if damping > most:
            return (
                f"h = {h:g} is beyond the critical step: with the damping at the start, {stepper.method.label} is "
                f"stable up to h = {h * most / damping:.2g}."
            )
    return ""


def _rate(stepper: Stepper, a: Any, u: Any, v: Any) -> float:
    """Return the change of f along the change of the state, relative to it, from the start to the state u, v.

    It is 0.0 if the state does not change. The change of f in other degrees of freedom may have another unit, and is
    ignored.
    """
    u0, v0 = stepper.start
    change = (u - u0) + (v - v0)  # one of them is zero
    square = np.vdot(change, change)
    if not 0 < square < math.inf:
        return 0.0
    rate = abs(float(np.vdot(stepper.acceleration(stepper.t0, u, v) - a, change) / square))
    return rate if rate < math.inf else 0.0


def _few(h: float, theta: float, where: str, more: str) -> str:
    period = 2 * math.pi / theta
    return (
        f"h = {h:g} is long for this motion: at the {where} of the run, a period has about {period:.2g} steps{more}. "
        f"Take h = {h * period / _SUFFICIENT:.2g} for {_SUFFICIENT} steps in a period, or the step of eig3.plan."
    )
