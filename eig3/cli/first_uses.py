"""The main uses of the library as short runs, which compile their code and store it in the cache on the disk."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .. import Event, ensemble, integrate, jit, problems
from ..kernels.compile.numba_internals import compilations


@jit
def scalar(t, u, v, p):  # type: ignore[no-untyped-def]
    """A linear oscillator."""
    return -u - 0.1 * v


@jit
def vector(t, u, v, p, a):  # type: ignore[no-untyped-def]
    """Linear oscillators."""
    for i in range(u.size):
        a[i] = -u[i] - 0.1 * v[i]


@jit
def speed(t, u, v, p):  # type: ignore[no-untyped-def]
    """The velocity of a scalar motion."""
    return v


@jit
def first_speed(t, u, v, p):  # type: ignore[no-untyped-def]
    """The velocity of the first degree of freedom."""
    return v[0]


def _runs(**options: Any) -> None:
    """Take some steps with one, two and three degrees of freedom, alone, with an output, and with an event."""
    starts = (scalar, speed, 1.0), (vector, first_speed, np.ones(2)), (vector, first_speed, np.ones(3))
    for rhs, watched, u0 in starts:
        events = {"turn": Event(watched)}
        for further in ({}, {"outputs": {"speed": watched}}, {"events": events}):
            integrate(rhs, (0, 1), u0, np.zeros_like(u0), **options, **further)


def _lanes(**options: Any) -> None:
    for rhs, u0 in ((scalar, np.ones(20)), (vector, np.ones((20, 2)))):
        ensemble(rhs, (0, 1), u0, np.zeros_like(u0), **options)


def _problem(name: str, h: float) -> None:
    problem = getattr(problems, name)()
    problem.with_(t_span=(0.0, 2 * h)).integrate(h=h)


#: The uses by their names on the command line.
USES: dict[str, tuple[Callable, dict[str, Any]]] = {
    **{name: (_runs, {"h": 0.01, "method": name}) for name in ("eig3", "cd", "rk4", "rk8", "eig9")},
    **{f"{name}-tolerances": (_runs, {"rtol": 1e-6, "method": name}) for name in ("rk5", "rk8")},
    "ensembles": (_lanes, {"h": 0.01}),
    "ensembles-tolerances": (_lanes, {"rtol": 1e-6}),
    "spheres": (_problem, {"name": "argon", "h": 1e-15}),
    "grains": (_problem, {"name": "hopper", "h": 1e-5}),
    "joints": (_problem, {"name": "double_wishbone", "h": 1e-5}),
    "impacts": (_problem, {"name": "pounding_buildings", "h": 1e-4}),
    "structures": (_problem, {"name": "ten_storey_frame", "h": 1e-4}),
    "cells": (_problem, {"name": "jelly", "h": 1e-5}),
}


def compile_use(name: str) -> tuple[int, float]:
    """Compile the code of a use, and return the number of functions that were not on the disk, and the CPU time, s."""
    function, options = USES[name]
    begin = time.process_time()
    with compilations() as compiled:
        function(**options)
    return len(compiled), time.process_time() - begin
