"""The source of the right-hand side and the energy of a structure, with only the terms that the structure has.

    M a = f(t, u, v) - K (u + b v) - C v - M (a_R v + r g(t))        a -= Phi (2 xi omega) (M Phi)^T v

with the Rayleigh coefficients a_R and b, the ground acceleration g and the influences r.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numba

from ..functions.callbacks import jit, without_runtime
from ..kernels.compile.jit import element
from ..kernels.compile.numba_internals import flat
from ..kernels.compile.source import Writer, define
from ..kernels.table import interval
from . import links
from .factors import solution
from .links import Kind
from .loads import RECORDS
from .products import product
from .text import Lines, Loops, Pattern, pattern_of

_KEPT = 64  # functions; without a limit, functions of the user would stay in memory for ever

#: The terms that change the energy.
LOADED = frozenset({"C", "rayleigh", "modal", "ground", "force", "table", "links"})
#: The integrals over time of a run with `work=True`.
INTEGRALS = "work", "dissipated", "absorbed"
_LOADS = frozenset({"force", "table", "links"})  # on single degrees of freedom, computed first

_BETWEEN = "{0}[place{1}] + part * ({0}[place + 1{1}] - {0}[place{1}])"
_MODAL = """\
for j in range({modes}):
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
    pattern : Pattern, optional
        For source line by line, without loops.
    """

    has: frozenset[str]
    edge: int = 1
    copies: int = 1
    threads: int = 1
    links: tuple[Kind, ...] = ()
    pattern: Pattern | None = None

    @property
    def text(self) -> Any:
        """The writer of rows and links."""
        return Lines(self.edge, self.pattern) if self.pattern else Loops(self.edge)

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
    has, edge, text = parts.has, parts.edge, parts.text
    out, of_links = Writer(), dict[str, Any]()
    with out.block("def rhs(t, u, v, p, a)"):
        out.line(f"n = {text.n}")
        if has & _LOADS:
            text.begin_forces(out, "force(t, u, v, p, a)" * ("force" in has))
        if parts.links:
            links.write(parts.links, text, out, of_links, has_power="work" in has)
        if "table" in has:
            out.line(f"is_within = {text.sample(out, 'force_times')}")
            for k, degree in text.loads(out):
                out.line(f"load = p.force_scale * ({_BETWEEN.format('p.forces', f', {k}')})")
                out.line(f"{text.force(degree)} += load if is_within else 0.0")
        if "ground" in has:
            is_within = text.sample(out, "ground_times")
            out.line(f"g = p.ground_scale * ({_BETWEEN.format('p.ground', '')})", f"g = g if {is_within} else 0.0")
        out.line(*(_arrays(name) for name in "KC" if name in has), *["m = p.m"] * ("lumped" in has))
        out.line(*["influence = p.influence"] * ("ground" in has), *["rate, decay = p.b, p.a"] * ("rayleigh" in has))
        for row in text.rows(out) if parts.threads == 1 else text.rows_of_threads(out, parts.threads):
            _write_row(parts, row, out)
        if "consistent" in has:
            out.line("solution(p.order, p.panels, p.rows, p.values, p.inverse, a)")
            if later := _without_mass(parts, "i"):
                with out.block("for i in range(n)"):
                    out.line(f"a[i] -= {later}")
        out.insert(_MODAL.format(modes=text.modes) * ("modal" in has))
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
    rhs.py_func.parts, rhs.py_func.records = parts, RECORDS  # these are pickled with the Python function
    rhs.py_func.is_linear = not parts.has & {"force", "links"}
    return marked(rhs, parts, right_hand_side, force)


@functools.lru_cache(_KEPT)
def energy(parts: Parts) -> Any:
    """Return the jitted energy of a structure: kinetic and elastic, minus the work if a run integrates it."""
    out, is_consistent = Writer(), "consistent" in parts.has
    with out.block("def energy(t, u, v, p)"):
        out.line(f"n, energy = {parts.text.n}, 0.0", *[_arrays("M")] * is_consistent)
        with out.block("for i in range(n)"):
            double = f"v[i] * {_of_mass(parts, 'v')}" if is_consistent else "p.m[i] * v[i] * v[i]"
            out.line(f"energy += 0.5 * {double}")
        if "K" in parts.has:
            out.line(_arrays("K"))
            for row in parts.text.rows(out):
                sums = parts.text.product(out, "K", row, "u")
                out.line(*(f"energy += 0.5 * u[{parts.text.at(row, i)}] * {x}" for i, x in enumerate(sums)))
        if "work" in parts.has:
            with out.block(f"if v.size > {parts.end}"):
                out.line(f"energy -= v[{parts.end}]")
        out.line("return energy")
    names = {"__name__": __name__, "flat": flat, "product": product(parts.edge, False), "of_mass": product(1, False)}
    return marked(without_runtime(define(str(out), "structure", names)["energy"]), parts, energy)


@functools.lru_cache(_KEPT)
def shear(parts: Parts) -> Any:
    """Return the jitted elastic force in the direction of the ground motion, and of the links."""
    out, names = Writer(), {"__name__": __name__, "flat": flat, "product": product(parts.edge, False)}
    with out.block("def shear(t, u, v, p)"):
        out.line(f"n, total = {parts.text.n}, 0.0")
        if "K" in parts.has:
            out.line(_arrays("K"))
            for row in parts.text.rows(out):
                forces = parts.text.product(out, "K", row, "u")
                out.line(*(f"total += p.influence[{parts.text.at(row, k)}] * {x}" for k, x in enumerate(forces)))
        links.write_shear(parts.links, parts.text, out, names)
        out.line("return total")
    return marked(without_runtime(define(str(out), "structure", names)["shear"]), parts, shear)


@functools.lru_cache(_KEPT)
def of_links(parts: Parts, what: str) -> Any:
    """Return an output with a value of each link, in the order of the kinds: "pull", the stretch "r" or "ductility"."""
    out, names = Writer(), dict[str, Any](__name__=__name__)
    with out.block("def of_links(t, u, v, p, out)"):
        out.line(f"n, at = {parts.text.n}, 0")
        links.write_output(parts.links, parts.text, out, names, what)
    return marked(without_runtime(define(str(out), "structure", names)["of_links"]), parts, of_links, what)


@functools.lru_cache(_KEPT)
def of_events(parts: Parts, k: int) -> Any:
    """Return an output with the value of each event of a kind of links."""
    out, names = Writer(), dict[str, Any](__name__=__name__)
    with out.block("def of_events(t, u, v, p, out)"):
        out.line(f"n, at = {parts.text.n}, 0")
        links.write_events(parts.links, parts.text, out, names, k)
    return marked(without_runtime(define(str(out), "structure", names)["of_events"]), parts, of_events, k)


def marked(function: Any, parts: Parts, write: Callable[..., Any], *given: Any) -> Any:
    """Mark a function of a structure: how it is written line by line, and whether it takes the states of links."""
    if not parts.has & {"consistent"} and parts.threads == 1:
        function.py_func.line_by_line = functools.partial(_line_by_line, write, parts, *given)
    if any(kind.has_state for kind in parts.links):
        function.py_func.reads_z = True
    return function


def _line_by_line(write: Callable[..., Any], parts: Parts, *given: Any) -> Any:
    *others, has = given
    return write(replace(parts, pattern=pattern_of(has)), *others)


def _write_row(parts: Parts, row: str, out: Writer) -> None:
    """Write a row of blocks: the accelerations, or the forces on a consistent mass."""
    has, text = parts.has, parts.text
    elastic = text.product(out, "K", row, "u", "rayleigh" in has) if "K" in has else []
    viscous = text.product(out, "C", row, "v") if "C" in has else []
    for k in range(parts.edge):
        i = text.at(row, k)
        terms = [f" - {products[k]}" for products in (elastic, viscous) if products]
        f = (text.force(i) if has & _LOADS else "0.0") + "".join(terms)
        if "lumped" in has:
            f = f"({f}) / m[{i}]"
            later = _without_mass(parts, i)
            f += f" - ({later})" if later else ""
        out.line(f"a[{i}] = {f}")


def _without_mass(parts: Parts, i: str) -> str:
    """Return the negative of the acceleration terms that do not depend on the mass."""
    terms = [f"decay * v[{i}]"] * ("rayleigh" in parts.has) + [f"influence[{i}] * g"] * ("ground" in parts.has)
    return " + ".join(terms)


def _power(parts: Parts, out: Writer) -> None:
    """Write the powers for a run that integrates the work.

    The power of loads, ground and damping is v (M a + K u), and the power of the damping alone is v (C v + ...).
    """
    has, text = parts.has, parts.text
    out.line("power, lost = 0.0, 0.0", *[_arrays("M")] * ("consistent" in has))
    with out.block("for i in range(n)"):
        out.line(f"power += v[i] * {_of_mass(parts, 'a')}")
        out.line(*[f"lost += decay * v[i] * {_of_mass(parts, 'v')}"] * ("rayleigh" in has))
    for name, x, power in (("K", "u", "power += "), ("K", "v", "lost += rate * "), ("C", "v", "lost += ")):
        if name in has and ("rate" not in power or "rayleigh" in has):
            for row in text.rows(out):
                sums = text.product(out, name, row, x)
                out.line(*(f"{power}v[{text.at(row, k)}] * {y}" for k, y in enumerate(sums)))
    if "modal" in has:
        with out.block(f"for j in range({text.modes})"):
            out.line("speed, amount = 0.0, 0.0")
            with out.block("for i in range(n)"):
                out.line("speed += p.rates[j, i] * v[i]", f"amount += p.modes[j, i] * {_of_mass(parts, 'v')}")
            out.line("lost += speed * amount")
    out.line(f"a[{parts.end}] = power", f"a[{parts.end} + 1] = lost")
    out.line(*[f"a[{parts.end} + 2] = absorbed"] * bool(parts.links))


def _of_mass(parts: Parts, x: str) -> str:
    """Return the text of an entry of the product of the mass and x."""
    return f"of_mass(M_data, M_indices, M_indptr, i, {x})[0]" if "consistent" in parts.has else f"m[i] * {x}[i]"


def _arrays(name: str) -> str:
    """Return the line that unpacks the arrays of a matrix, because a parallel loop cannot read tuples of tuples."""
    return f"{name}_data, {name}_indices, {name}_indptr = flat(p.{name}.data), p.{name}.indices, p.{name}.indptr"
