# ruff: noqa: F821
"""Scenes with few constraints in the lanes of SIMD registers: their accelerations, a step of EIG-3, and the projection.

The formulas are in `eig3.kernels.constraints`. There, a table in p says which arms and points belong to a row,
and what is computed on the way is in p too. Here, the rows are straight lines of source, written by the scene: see
`eig3.scene.unrolled_text`. Each of the parts, such as `stand`, is one loop over the lanes. What a lane needs from one
loop to the next, such as S, has its room on the stack.

Newton's iteration runs until the last lane has converged. A lane that has, stays as it is: its numbers do not depend
on the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numba.types import int64, none

from .compile.jit import bound, function_at
from .compile.source import Writer, define
from .constraints import MOST_ITERATIONS
from .lanes import BlockLayout, Lanes, compile_block, compile_rhs, options_for, view
from .protocol import VECTOR, array_on_stack, vector_type

#: The first number in the room of a lane: the residual before, or, if it is one of these, how the iteration has ended.
CONVERGED, LOST = 0.0, -1.0

_given, _written = VECTOR.rhs.args[1], vector_type
_KINDS = {  # the arguments of the functions of a block: in small letters for one lane, and how to get them
    "react": (none(_given, _given, _given, _written), "uvpa"),
    "stand": (none(_given, _given, _written), "upr"),
    "approach": (int64(_given, _written, _given, _written), "uxpr"),
    "level": (none(_given, _written, _given), "uvp"),
}
_VIEWS = {"u": "GIVEN", "p": "PARAMS", "r": "ROOM"}
_AT = {name: function_at(signature) for name, (signature, _) in _KINDS.items()}


@dataclass(frozen=True, eq=False)
class UnrolledConstraints:
    """A few constraints as straight lines of source, for the arrays of one member.

    Attributes
    ----------
    forces : jitted function
        ``forces(t, u, v, p, a)`` writes the accelerations that do not know the constraints.
    react : str
        Add the accelerations from the constraints to `a`.
    stand : str
        Write S in u, factorised, to the room r of a lane, and how an iteration begins.
    approach : str
        One iteration of `constraints.approach` for u + x. It adds 1 to `going` if another one follows.
    level : str
        Project the velocity v.
    room : int
        The number of values in the room of a lane.
    structure : (int, ndarray)
        A place in p, and the numbers from there on, which say for what constraints the lines are.
    """

    forces: Any
    react: str
    stand: str
    approach: str
    level: str
    room: int
    structure: tuple[int, np.ndarray]

    def are_those_of(self, params: np.ndarray) -> bool:
        """Return whether parameters, of shape (..., k), are for these constraints."""
        first, wanted = self.structure
        given = params[..., first : first + len(wanted)]
        return given.shape[-1] == len(wanted) and given.tobytes() == np.broadcast_to(wanted, given.shape).tobytes()


def rhs(t, u, v, p, a):
    FORCES_AT(FORCES)(t, u, v, p, a)
    REACT_AT(REACT)(u, v, p, a)


def constrained_step(t, h, u, v, drift, p):
    """Take a step of EIG-3, as the task CONSTRAINED_STEP of `constraints.hold` does."""
    x, room = ROWS_ON_STACK(), ROOM_ON_STACK()
    FORCES_AT(FORCES)(t, u, v, p, x)
    for j in range(SIZE):
        x[j] = h * (drift[j] + h * x[j])
    FIND(u, x, p, room)
    for j in range(SIZE):
        now = x[j] / h
        u[j] += x[j]
        v[j] = now + (now - drift[j]) / 2
        drift[j] = now
    LEVEL_AT(LEVEL)(u, v, p)


def project(t, u, v, p):
    """Move u and v to the nearest state that keeps the constraints, as its task PROJECT does."""
    x, room = ROWS_ON_STACK(), ROOM_ON_STACK()
    for j in range(SIZE):
        x[j] = 0.0
    FIND(u, x, p, room)
    for j in range(SIZE):
        u[j] += x[j]
    LEVEL_AT(LEVEL)(u, v, p)
    return 0.0


def find(u, x, p, room):
    """Add W G^T l to x, with the gradients in u, until u + x keeps the constraints; x is NaN where it does not."""
    STAND_AT(STAND)(u, p, room)
    for _ in range(MOST_ITERATIONS):
        if APPROACH_AT(APPROACH)(u, x, p, room) == 0:
            break
    for first in range(0, SIZE, LANES):
        for lane in range(LANES):
            x[first + lane] = x[first + lane] if room[lane] == CONVERGED else math.nan


def compile_constrained(functions: UnrolledConstraints, layout: BlockLayout, is_checked: bool = False) -> Lanes:
    """Compile the right-hand side of a block, which knows the constraints."""
    forces = compile_rhs(functions.forces.py_func, layout, is_checked)
    parts = {"forces": forces, **_parts(("react",), functions, layout, is_checked)}
    names = {"FORCES_AT": function_at(layout.rhs), "REACT_AT": _AT["react"]}
    return _joined(rhs, layout.rhs.args, names, parts, is_checked)


def compile_keeping(
    functions: UnrolledConstraints, layout: BlockLayout, is_constrained_step: bool, is_checked: bool = False
) -> Lanes:
    """Compile the function of a block that keeps the constraints: a step of EIG-3, or else the projection."""
    size = layout.n * layout.lanes
    names: dict[str, Any] = {"LANES": layout.lanes, "SIZE": size, "FORCES_AT": function_at(VECTOR.rhs)}
    names |= {"ROWS_ON_STACK": array_on_stack(size), "ROOM_ON_STACK": array_on_stack(functions.room * layout.lanes)}
    names |= {f"{name.upper()}_AT": at for name, at in _AT.items()}
    parts = _parts(("stand", "approach", "level"), functions, layout, is_checked)
    if is_constrained_step:
        parts["forces"] = compile_rhs(functions.forces.py_func, layout, is_checked)
    inlined = numba.njit(inline="always", **options_for(is_checked))
    names["FIND"] = inlined(bound(find, names | _addresses(parts)))
    template, arguments = (
        (constrained_step, VECTOR.constrained_step.args) if is_constrained_step else (project, VECTOR.apply.args)
    )
    return _joined(template, arguments, names, parts, is_checked)


def _joined(
    template: Callable, arguments: tuple, names: dict[str, Any], parts: dict[str, Lanes], is_checked: bool
) -> Lanes:
    """Compile a function of a block that calls its parts, each of which has a loop over the lanes."""
    function = bound(template, names | _addresses(parts))  # with addresses of this process
    joined = compile_block(function, arguments, options_for(is_checked), is_kept=False)
    obstacles = [part.obstacle for part in parts.values() if part.obstacle]
    return replace(joined, obstacle=obstacles[0] if obstacles else "", compiled=(joined.compiled, parts))


def _addresses(parts: dict[str, Lanes]) -> dict[str, int]:
    return {name.upper(): part.address for name, part in parts.items()}


def _parts(
    wanted: Sequence[str], functions: UnrolledConstraints, layout: BlockLayout, is_checked: bool
) -> dict[str, Lanes]:
    """Compile the loops over the lanes around the lines of some parts."""
    names = {**layout.names(), "ROOM": view(functions.room, layout.lanes), "nan": math.nan, "inf": math.inf}
    found = {}
    for name in wanted:
        signature, arrays = _KINDS[name]
        views = ", ".join(f"{_VIEWS.get(x, 'WRITTEN')}({x.upper()}, lane)" for x in arrays)
        out = Writer()
        with out.block(f"def {name}({', '.join(arrays.upper())})"):
            out.line("going = 0")
            with out.block("for lane in range(LANES)"):
                out.line(f"{', '.join(arrays)} = {views}")
                out.insert(getattr(functions, name))
            out.line(*["return going"] * (name == "approach"))
        function = define(str(out), "lanes", {"__name__": __name__, **names})[name]
        found[name] = compile_block(function, signature.args, options_for(is_checked))
    return found
