"""The source of the right-hand side and the energy of a structure, with only the terms that the structure has.

    M a = f(t, u, v) - K (u + b v) - C v - M (a_R v + r g(t))        a -= Phi (2 xi omega) (M Phi)^T v

with the Rayleigh coefficients a_R and b, the ground acceleration g and the influences r.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numba

from ..effects.sampled_motion import interval
from ..functions.callbacks import jit, without_runtime
from ..kernels.compile.jit import element
from ..kernels.compile.numba_internals import flat
from ..kernels.compile.source import Writer, define
from . import links
from .factors import solution
from .links import Kind
from .products import product

_KEPT = 64  # functions; without a limit, functions of the user would stay in memory for ever

#: The terms that change the energy.
LOADED = frozenset({"C", "rayleigh", "modal", "ground", "force", "table", "links"})
#: The integrals over time of a run with `work=True`.
INTEGRALS = "work", "dissipated"
_LOADS = frozenset({"force", "table", "links"})  # on single degrees of freedom, computed first

_TABLE = """\
place, part = weight(t, p.force_times)
if place >= 0:
    for k in range(p.degrees.size):
        low, high = p.forces[place, k], p.forces[place + 1, k]
        a[p.degrees[k]] += p.force_scale * (low + part * (high - low))
"""
_GROUND = """\
place, part = weight(t, p.ground_times)
g = 0.0
if place >= 0:
    g = p.ground_scale * (p.ground[place] + part * (p.ground[place + 1] - p.ground[place]))
"""
_MODAL = """\
for j in range(p.modes.shape[0]):
    speed = 0.0
    for i in range(n):
        speed += p.rates[j, i] * v[i]
    for i in range(n):
        a[i] -= p.modes[j, i] * speed
"""


@dataclass(frozen=True)
class Parts:
    """The properties of a structure on which its compiled code depends.

    Attributes
    ----------
    has : frozenset of str
    edge : int
        The rows of a block of K and C.
    copies : int
        The number of directions with the same consistent mass matrix.
    threads : int
    links : tuple of Kind
    """

    has: frozenset[str]
    edge: int = 1
    copies: int = 1
    threads: int = 1
    links: tuple[Kind, ...] = ()

    @property
    def end(self) -> str:
        """The text of the number of degrees of freedom and states."""
        return "n + p.states" if self.links else "n"


@element
def weight(t: Any, times: Any) -> Any:
    """Return the interval of a record at a time, or -1 outside the record, and the elapsed fraction of the interval."""
    last = times.size - 1
    if t < times[0] or t > times[last]:
        return -1, 0.0
    i = interval(t, times)
    return i, (t - times[i]) / (times[i + 1] - times[i])


@functools.lru_cache(_KEPT)
def right_hand_side(parts: Parts, force: Any) -> Any:
    """Return the jitted right-hand side of a structure with these parts, which structures with the same parts share."""
    has, edge = parts.has, parts.edge
    out, of_links = Writer(), dict[str, Any]()
    with out.block("def rhs(t, u, v, p, a)"):
        out.line("n = p.size")
        if has & _LOADS:
            with out.block("for i in range(a.size)"):
                out.line("a[i] = 0.0")
        out.line(*["force(t, u, v, p, a)"] * ("force" in has))
        if parts.links:
            links.write(parts.links, out, of_links)
        out.insert(_TABLE * ("table" in has) + _GROUND * ("ground" in has))
        out.line(*(_arrays(name) for name in "KC" if name in has), *["m = p.m"] * ("lumped" in has))
        out.line(*["influence = p.influence"] * ("ground" in has), *["rate, decay = p.b, p.a"] * ("rayleigh" in has))
        if parts.threads == 1:
            with out.block(f"for row in range(n // {edge})"):
                out.line(*_row(parts))
        else:
            out.line(f"rows = n // {edge}")
            share = f"part * rows // {parts.threads}, (part + 1) * rows // {parts.threads}"
            with out.block(f"for part in prange({parts.threads})"), out.block(f"for row in range({share})"):
                out.line(*_row(parts))
        if "consistent" in has:
            out.line("solution(p.order, p.panels, p.rows, p.values, p.inverse, a)")
            if later := _without_mass(parts, "i"):
                with out.block("for i in range(n)"):
                    out.line(f"a[i] -= {later}")
        out.insert(_MODAL * ("modal" in has))
        if "work" in has:
            with out.block(f"if u.size > {parts.end}"):
                _power(parts, out)
    names = {
        "__name__": __name__,
        "prange": numba.prange,
        "weight": weight,
        "flat": flat,
        "force": force,
        "stiff": product(edge, "rayleigh" in has),
        "product": product(edge, False),
        "of_mass": product(1, False),
        "solution": solution(parts.copies),
        **of_links,
    }
    written = define(str(out), "structure", names)["rhs"]
    is_plain = parts.threads == 1 and force is None  # a function of the user may need the runtime
    rhs = without_runtime(written) if is_plain else jit(written, parallel=parts.threads > 1)
    rhs.py_func.links = parts.links  # for outputs; this is pickled with the Python function
    return links.marked(rhs, parts.links)


@functools.lru_cache(_KEPT)
def energy(parts: Parts) -> Any:
    """Return the jitted energy of a structure: kinetic and elastic, minus the work if a run integrates it."""
    out, is_consistent = Writer(), "consistent" in parts.has
    with out.block("def energy(t, u, v, p)"):
        out.line("n, energy = p.size, 0.0", *[_arrays("M")] * is_consistent)
        with out.block("for i in range(n)"):
            double = f"v[i] * {_of_mass(parts, 'v')}" if is_consistent else "p.m[i] * v[i] * v[i]"
            out.line(f"energy += 0.5 * {double}")
        if "K" in parts.has:
            out.line(_arrays("K"))
            with out.block(f"for row in range(n // {parts.edge})"):
                out.line("sums = product(K_data, K_indices, K_indptr, row, u)")
                out.line(*(f"energy += 0.5 * u[{_at(parts.edge, i)}] * sums[{i}]" for i in range(parts.edge)))
        if "work" in parts.has:
            with out.block(f"if v.size > {parts.end}"):
                out.line(f"energy -= v[{parts.end}]")
        out.line("return energy")
    names = {"__name__": __name__, "flat": flat, "product": product(parts.edge, False), "of_mass": product(1, False)}
    return links.marked(without_runtime(define(str(out), "structure", names)["energy"]), parts.links)


def _row(parts: Parts) -> list[str]:
    """Return the lines of a row of blocks: the accelerations, or the forces on a consistent mass."""
    has, lines = parts.has, []
    if "K" in has:
        further = ", rate, v" * ("rayleigh" in has)
        lines.append(f"elastic = stiff(K_data, K_indices, K_indptr, row, u{further})")
    if "C" in has:
        lines.append("viscous = product(C_data, C_indices, C_indptr, row, v)")
    for k in range(parts.edge):
        i = f"i_{k}"
        lines.append(f"{i} = {_at(parts.edge, k)}")
        terms = [f" - elastic[{k}]"] * ("K" in has) + [f" - viscous[{k}]"] * ("C" in has)
        f = (f"a[{i}]" if has & _LOADS else "0.0") + "".join(terms)
        if "lumped" in has:
            f = f"({f}) / m[{i}]"
            later = _without_mass(parts, i)
            f += f" - ({later})" if later else ""
        lines.append(f"a[{i}] = {f}")
    return lines


def _without_mass(parts: Parts, i: str) -> str:
    """Return the negative of the acceleration terms that do not depend on the mass."""
    terms = [f"decay * v[{i}]"] * ("rayleigh" in parts.has) + [f"influence[{i}] * g"] * ("ground" in parts.has)
    return " + ".join(terms)


def _power(parts: Parts, out: Writer) -> None:
    """Write the powers for a run that integrates the work.

    The power of loads, ground and damping is v (M a + K u), and the power of the damping alone is v (C v + ...).
    """
    has, edge = parts.has, parts.edge
    out.line("power, lost = 0.0, 0.0", *[_arrays("M")] * ("consistent" in has))
    with out.block("for i in range(n)"):
        out.line(f"power += v[i] * {_of_mass(parts, 'a')}")
        out.line(*[f"lost += decay * v[i] * {_of_mass(parts, 'v')}"] * ("rayleigh" in has))
    for name, x, power in (("K", "u", "power += "), ("K", "v", "lost += rate * "), ("C", "v", "lost += ")):
        if name in has and ("rate" not in power or "rayleigh" in has):
            with out.block(f"for row in range(n // {edge})"):
                out.line(f"sums = product({name}_data, {name}_indices, {name}_indptr, row, {x})")
                out.line(*(f"{power}v[{_at(edge, k)}] * sums[{k}]" for k in range(edge)))
    if "modal" in has:
        with out.block("for j in range(p.modes.shape[0])"):
            out.line("speed, amount = 0.0, 0.0")
            with out.block("for i in range(n)"):
                out.line("speed += p.rates[j, i] * v[i]", f"amount += p.modes[j, i] * {_of_mass(parts, 'v')}")
            out.line("lost += speed * amount")
    out.line(f"a[{parts.end}] = power", f"a[{parts.end} + 1] = lost")


def _of_mass(parts: Parts, x: str) -> str:
    """Return the text of an entry of the product of the mass and x."""
    return f"of_mass(M_data, M_indices, M_indptr, i, {x})[0]" if "consistent" in parts.has else f"m[i] * {x}[i]"


def _at(edge: int, k: int) -> str:
    """Return the text of the degree of freedom k of a row of blocks."""
    return "row" if edge == 1 else f"{edge} * row + {k}"


def _arrays(name: str) -> str:
    """Return the line that unpacks the arrays of a matrix, because a parallel loop cannot read tuples of tuples."""
    return f"{name}_data, {name}_indices, {name}_indptr = flat(p.{name}.data), p.{name}.indices, p.{name}.indptr"
