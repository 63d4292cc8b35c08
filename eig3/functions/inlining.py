"""Kernels with a right-hand side and the quantities of a run inlined. Each is compiled once in a process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numba

from ..kernels.compile.numba_internals import WITH_ROOTS, options_of
from ..kernels.protocol import Form
from .callbacks import check_callback, compile_for_own_arrays
from .companions import remembered
from .quantities import Quantity


def inlined(
    make: Callable, key: tuple, form: Form, rhs: Any, jacobian: Any = None, quantities: Sequence[Quantity] = ()
) -> Callable:
    """Return the kernel that ``make(rhs, jacobian, quantities=...)`` compiles.

    `key` identifies the kernel among the kernels of rhs. `make` gets a pair of a function and its number of values for
    each quantity; the number is 0 for a function that returns its only value.
    """
    asked = [(rhs, "rhs"), *([(jacobian, "jacobian")] if jacobian else [])]
    asked += [(quantity.function, quantity.kind) for quantity in quantities]
    functions = tuple(_as_compiled(function, kind, form) for function, kind in asked)
    known = remembered(rhs, "kernels")
    key = (*key, form.name, *(function for function, _ in asked[1:]))
    if key not in known or known[key][0] != functions:
        for function, (_, kind) in zip(functions, asked, strict=True):
            compile_for_own_arrays(function, kind, form)
        others = iter(functions[1:])
        jacobian = next(others) if jacobian else None
        widths = (quantity.width if quantity.shape else 0 for quantity in quantities)
        known[key] = functions, make(functions[0], jacobian, quantities=tuple(zip(others, widths, strict=True)))
    return known[key][1]


def _as_compiled(function: Any, kind: str, form: Form) -> Any:
    """Return a jitted function that inlines the function compiled by `check_callback`.

    Numba caches each part of a kernel by the types of its arguments, and a recompiled function keeps its type. A copy
    of the function has another type.
    """
    compiled = check_callback(function, kind, form).compiled
    known = remembered(function, "inlined")
    before, present = known.get((kind, form.name), (compiled, function))
    if before is not compiled:
        present = numba.jit(**options_of(function), **WITH_ROOTS)(function.py_func)
    known[kind, form.name] = compiled, present
    return present
