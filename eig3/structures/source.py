"""The source of a structure's right-hand side and energy: only what the structure has is in it.

    M a = f(t, u, v) - K (u + b v) - C v - M (a_R v + r g(t))        a -= Phi (2 xi omega) (M Phi)^T v

with Rayleigh's coefficients a_R and b, the ground's acceleration g and its influences r.
"""

from __future__ import annotations

import functools
from typing import Any

from ..effects.sampled_motion import interval
from ..functions.callbacks import jit
from ..kernels.compile.jit import element
from ..kernels.compile.source import define

_KEPT = 64  # functions; one of the user would otherwise stay in memory for ever

#: The parts that change the energy.
LOADED = frozenset({"C", "rayleigh", "modal", "ground", "force", "table"})

_PRODUCT = """\
    for i in range(n):
        a[i] -= {row}
"""
_FIRST = """\
    for i in range(n):
        a[i] = -{row}
"""
_TABLE = """\
    place, part = weight(t, p.force_times)
    if place >= 0:
        for k in range(p.degrees.size):
            low, high = p.forces[place, k], p.forces[place + 1, k]
            a[p.degrees[k]] += p.force_scale * (low + part * (high - low))
"""
_LUMPED = """\
    for i in range(n):
        a[i] = a[i] / p.m[i]
"""
_CONSISTENT = """\
    for row in range(n):
        a[p.order[row]] -= of_row(p.L, row, a)
    for row in range(n - 1, -1, -1):
        i = p.order[row]
        a[i] = (a[i] - of_row(p.U, row, a)) * p.inverse[row]
"""
_RAYLEIGH = """\
    for i in range(n):
        a[i] -= p.a * v[i]
"""
_MODAL = """\
    for j in range(p.modes.shape[0]):
        speed = 0.0
        for i in range(n):
            speed += p.rates[j, i] * v[i]
        for i in range(n):
            a[i] -= p.modes[j, i] * speed
"""
_GROUND = """\
    place, part = weight(t, p.ground_times)
    if place >= 0:
        g = p.ground_scale * (p.ground[place] + part * (p.ground[place + 1] - p.ground[place]))
        for i in range(n):
            a[i] -= p.influence[i] * g
"""
_FORM = """\
    for i in range(n):
        energy += 0.5 * {x}[i] * of_row(p.{A}, i, {x})
"""
_KINETIC = """\
    for i in range(n):
        energy += 0.5 * p.m[i] * v[i] * v[i]
"""
_POWER = """\
    if u.size > n:
        power = 0.0
        for i in range(n):
            power += v[i] * ({force})
        a[n] = power
"""


@element
def of_row(A: Any, i: Any, x: Any) -> Any:
    """Return row i of A x."""
    total = 0.0
    for k in range(A.indptr[i], A.indptr[i + 1]):
        total += A.data[k] * x[A.indices[k]]
    return total


@element
def of_row_with_rate(A: Any, i: Any, x: Any, b: Any, v: Any) -> Any:
    """Return row i of A (x + b v)."""
    total = 0.0
    for k in range(A.indptr[i], A.indptr[i + 1]):
        j = A.indices[k]
        total += A.data[k] * (x[j] + b * v[j])
    return total


@element
def weight(t: Any, times: Any) -> Any:
    """Return the interval of a record at a time, or -1 outside the record, and the part of it that has passed."""
    last = times.size - 1
    if t < times[0] or t > times[last]:
        return -1, 0.0
    i = interval(t, times)
    return i, (t - times[i]) / (times[i + 1] - times[i])


_NAMES = {"__name__": __name__, "weight": weight, "of_row": of_row, "of_row_with_rate": of_row_with_rate}


@functools.lru_cache(_KEPT)
def right_hand_side(has: frozenset[str], force: Any) -> Any:
    """Return the jitted right-hand side of a structure that has these parts: structures of the same parts share it."""
    lines = ["def rhs(t, u, v, p, a):\n", "    n = p.size\n"]
    if "force" in has:
        lines += ["    for i in range(a.size):\n        a[i] = 0.0\n", "    force(t, u, v, p, a)\n"]
    first = "force" not in has
    stiffness = "of_row_with_rate(p.K, i, u, p.b, v)" if "rayleigh" in has else "of_row(p.K, i, u)"
    for name, row in (("K", stiffness), ("C", "of_row(p.C, i, v)")):
        if name in has:
            lines.append((_FIRST if first else _PRODUCT).format(row=row))
            first = False
    if first:
        lines.append("    for i in range(n):\n        a[i] = 0.0\n")
    lines.append(_TABLE if "table" in has else "")
    lines.append(_CONSISTENT if "consistent" in has else _LUMPED)
    for name, text in (("rayleigh", _RAYLEIGH), ("modal", _MODAL), ("ground", _GROUND)):
        lines.append(text if name in has else "")
    if "work" in has:
        lines.append(_POWER.format(force="of_row(p.M, i, a)" + " + of_row(p.K, i, u)" * ("K" in has)))
    return jit(define("".join(lines), "structure", {**_NAMES, "force": force})["rhs"])


@functools.lru_cache(_KEPT)
def energy(has: frozenset[str]) -> Any:
    """Return the jitted energy of a structure: kinetic and elastic, less the work if a run follows it."""
    lines = ["def energy(t, u, v, p):\n", "    n, energy = p.size, 0.0\n"]
    lines.append(_FORM.format(A="M", x="v") if "consistent" in has else _KINETIC)
    lines.append(_FORM.format(A="K", x="u") if "K" in has else "")
    lines.append("    if v.size > n:\n        energy -= v[n]\n" if "work" in has else "")
    return jit(define("".join([*lines, "    return energy\n"]), "structure", _NAMES)["energy"])
