# ruff: noqa: F821
"""Scenes with few constraints in the lanes of SIMD registers: a step of EIG-3, and the way back to the constraints.

The formulas are those of `eig3.kernels.constraints`. There, a table in p says which arms and points belong to a row, and
p has room for what is computed on the way. Here, the source of the scene has the rows as straight code: see
`eig3.scene.straight_text`. What a lane needs from one loop over lanes to the next, such as S, has its room on the stack.

Newton's iteration goes on until the last lane has converged. A lane that has, stays as it is: so its numbers do not
depend on the others.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba.extending import intrinsic
from numba.types import intp

from .compile.jit import bound
from .compile.numba_internals import array_over, floats_on_stack
from .constraints import MOST_ITERATIONS
from .lanes import Lanes, Layout, compile_block, inlined, options_for, vector, vector_own_step, view
from .protocol import VECTOR, vector_type

#: The first number in the room of a lane: the residual before, or, if it is one of these, how the iteration has ended.
CONVERGED, LOST = 0.0, -1.0


class Straight(NamedTuple):
    """The functions of a scene with few constraints, for one member.

    Attributes
    ----------
    forces : jitted function
        ``forces(t, u, v, p, a)`` writes the accelerations that do not know the constraints.
    stand : jitted function
        ``stand(t, u, p, room)`` writes S, factorised, to the room of a lane, and how an iteration begins.
    approach : jitted function
        ``approach(t, u, x, p, room)`` is one iteration of `constraints.approach`; it returns whether another one follows.
    level : jitted function
        ``level(t, u, v, p)`` projects the velocity.
    room : int
        The number of values in the room of a lane.
    """

    forces: Any
    stand: Any
    approach: Any
    level: Any
    room: int


def find(t, there, u, x, p, room):
    """Add W G^T l to x, with the gradients in u, until u + x keeps the constraints."""
    for lane in range(LANES):
        STAND(TIME(t, p, lane), GIVEN(u, lane), PARAMS(p, lane), ROOM(room, lane))
    for _ in range(MOST_ITERATIONS):
        going = 0
        for lane in range(LANES):
            time = TIME(there, p, lane)
            going += APPROACH(time, GIVEN(u, lane), WRITTEN(x, lane), PARAMS(p, lane), ROOM(room, lane))
        if going == 0:
            break
    for first in range(0, N * LANES, LANES):
        for lane in range(LANES):
            x[first + lane] = x[first + lane] if room[lane] == CONVERGED else math.nan


def leap(t, h, u, v, drift, p):
    """Take a step of EIG-3, as `constraints.leap` does."""
    x, room = ROWS_ON_STACK(), ROOM_ON_STACK()
    FORCES(t, u, v, p, x)
    for j in range(N * LANES):
        x[j] = h * (drift[j] + h * x[j])
    FIND(t, t + h, u, x, p, room)
    for j in range(N * LANES):
        now = x[j] / h
        u[j] += x[j]
        v[j] = now + (now - drift[j]) / 2
        drift[j] = now
    for lane in range(LANES):
        LEVEL(TIME(t + h, p, lane), GIVEN(u, lane), WRITTEN(v, lane), PARAMS(p, lane))


def project(t, u, v, p):
    """Move u and v to the nearest state that keeps the constraints, as `constraints.project` does."""
    x, room = ROWS_ON_STACK(), ROOM_ON_STACK()
    for j in range(N * LANES):
        x[j] = 0.0
    FIND(t, t, u, x, p, room)
    for j in range(N * LANES):
        u[j] += x[j]
    for lane in range(LANES):
        LEVEL(TIME(t, p, lane), GIVEN(u, lane), WRITTEN(v, lane), PARAMS(p, lane))
    return 0.0


def compile_keeping(functions: Straight, layout: Layout, is_leap: bool, is_checked: bool = False) -> Lanes:
    """Compile the function of a block that keeps the constraints: a step of EIG-3, or else the projection."""
    options, size = options_for(is_checked), layout.n * layout.lanes
    names = {**layout.names(), "ROOM": view(functions.room, layout.lanes)}
    names |= {"ROWS_ON_STACK": _on_stack(size), "ROOM_ON_STACK": _on_stack(functions.room * layout.lanes)}
    for name in ("stand", "approach", "level"):
        names[name.upper()] = inlined(getattr(functions, name).py_func, options)
    names["FIND"] = inlined(bound(find, names), options)
    if is_leap:
        forces = bound(vector_own_step if layout.has_own_step else vector, names)
        names["FORCES"] = inlined(bound(forces, {"FUNCTION": inlined(functions.forces.py_func, options)}), options)
        return compile_block(bound(leap, names), VECTOR.leap.args, options)
    return compile_block(bound(project, names), VECTOR.apply.args, options)


def _on_stack(count: int) -> Any:
    """Return a compiled ``array()`` of floats on the stack, which do not overlap with others."""

    @intrinsic
    def array(typingctx):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            size, stride = context.get_constant(intp, count), context.get_constant(intp, 8)
            return array_over(context, builder, vector_type, floats_on_stack(builder, count), size, stride)

        return vector_type(), codegen

    return array
