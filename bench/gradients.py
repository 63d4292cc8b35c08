"""The derivatives of a Duffing oscillator's end by parameters and start: `eig3.sensitivities` beside diffrax in JAX.

``python -m eig3.bench.gradients`` prints for each the time with the longest step, or the largest tolerance, with which
all derivatives have errors below a target. The extra "rivals" installs JAX and diffrax.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import eig3

from . import text
from .choices import add_repeats
from .environment import in_words
from .rivals.rival import is_installed
from .rivals.symbolic import diffrax_run, jax_with_doubles
from .timing import medians, seconds_of

TARGET = 1e-6  # the largest error of a derivative, relative to its size
_SPANS = 20.0, 200.0
_VALUES = {"k": 1.0, "cubic": 0.5, "c": 0.1, "amplitude": 0.3, "u0": 1.0, "v0": 0.2}
_STEPS = tuple(0.4 / 2 ** (i / 2) for i in range(17))
_TOLERANCES = tuple(10 ** (-i / 2) for i in range(6, 23))
_METHODS = ("rk4", "rk8", "eig9")
_RIVALS = ("Tsit5", "Dopri8")
_MOST_STEPS = 16**4  # of diffrax

#: Returns the derivatives of u and v at the end, shape (2, parameters).
Run = Callable[[], np.ndarray]


class Found(NamedTuple):
    """A run that reaches the target: its step or tolerance, and its error."""

    label: str
    setting: float
    error: float
    run: Run


@eig3.jit
def duffing(t, u, v, p):
    return p.amplitude * eig3.math.cos(t) - p.c * v - u * (p.k + p.cubic * u * u)


def _eig3(method: str, t_end: float, h: float) -> Run:
    params = {name: value for name, value in _VALUES.items() if name not in ("u0", "v0")}
    problem = eig3.Problem("duffing", duffing, _VALUES["u0"], _VALUES["v0"], params, (0.0, t_end))

    def run() -> np.ndarray:
        found = eig3.sensitivities(problem, _VALUES, h=h, method=method, save_every=None).derivatives
        return np.array([found.u[:, -1], found.v[:, -1]])

    return run


def _diffrax(method: str, adjoint: str, t_end: float, tolerance: float) -> Run:
    derivative = _compiled(method, adjoint, t_end)
    return lambda: np.asarray(derivative(np.array([*_VALUES.values()]), tolerance))


@functools.cache
def _compiled(method: str, adjoint: str, t_end: float) -> Any:
    jax = jax_with_doubles()
    import diffrax

    def slope(t, y, p):
        u, v = y
        k, cubic, c, amplitude = p
        return v, amplitude * jax.numpy.cos(t) - c * v - u * (k + cubic * u * u)

    def end(values, tolerance):
        *p, u0, v0 = values
        options = {"max_steps": _MOST_STEPS}
        options["adjoint"] = diffrax.ForwardMode() if adjoint == "forward" else diffrax.RecursiveCheckpointAdjoint()
        solution = diffrax_run(method, slope, (0.0, t_end), (u0, v0), tuple(p), tolerance, tolerance, **options)
        return jax.numpy.concatenate(solution.ys)

    return jax.jit((jax.jacfwd if adjoint == "forward" else jax.jacrev)(end))


def reference(t_end: float) -> np.ndarray:
    """The derivatives by the method of the order 8 with short steps, whose differences are the only error."""
    return _eig3("rk8", t_end, 0.01)()


def search(label: str, at: Callable[[float], Run], settings: Sequence[float], exact: np.ndarray) -> Found | None:
    """Find the longest step, or the largest tolerance, whose derivatives reach the target."""
    size = np.abs(exact).max(axis=1, keepdims=True)
    for setting in settings:
        run = at(setting)
        try:
            error = float((np.abs(run() - exact) / size).max())
        except eig3.IntegrationError:  # the step is beyond the stability limit
            continue
        if error <= TARGET:
            return Found(label, setting, error, run)
    return None


def benchmark(repeats: int, write: Callable[[str], None] = print) -> None:
    """Print a table for each span."""
    write(f"Machine: {in_words()}")
    has_diffrax = is_installed("diffrax")
    if not has_diffrax:
        write('Not installed, and left out: diffrax. `pip install "eig3[rivals]"` installs it.')
    for t_end in _SPANS:
        what = f"Derivatives of u and v at t = {t_end:g} by {len(_VALUES)} values"
        write(f"\n{what}; medians of {repeats} interleaved runs.\n")
        write(table(t_end, repeats, has_diffrax=has_diffrax))


def table(t_end: float, repeats: int, *, has_diffrax: bool) -> str:
    """Return the table of one span, with the ratios of the medians to the shortest one."""
    exact = reference(t_end)
    candidates = [(f"eig3.sensitivities, {method}", partial(_eig3, method, t_end), _STEPS) for method in _METHODS]
    for method in _RIVALS if has_diffrax else ():
        for adjoint in ("forward", "reverse"):
            candidates.append((f"diffrax {method}, {adjoint}", partial(_diffrax, method, adjoint, t_end), _TOLERANCES))
    found = [each for each in (search(*candidate, exact) for candidate in candidates) if each]
    seconds = medians({each.label: partial(seconds_of, each.run) for each in found}, repeats, "derivatives")
    best = min(seconds.values())
    rows = []
    for label, setting, error, _ in found:
        times = f"{1e3 * seconds[label]:.2f}", f"{seconds[label] / best:.1f}"
        rows.append([label, f"{setting:.2g}", f"{error:.1e}", *times])
    return text.table(["method", "step or tolerance", "error", "ms", "ratio"], rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    add_repeats(parser, 15)
    benchmark(parser.parse_args().repeats)
