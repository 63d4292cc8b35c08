"""Kernels with a right-hand side inlined. Each is compiled once in a process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import numba

from ..kernels.compile.numba_internals import options_of
from ..kernels.protocol import Form
from .callbacks import check_callback, compile_for_own_arrays

# The references are weak, so that a program that makes many functions does not keep all of them in memory.
_inlined: WeakKeyDictionary[Any, dict[tuple, tuple[tuple, Callable]]] = WeakKeyDictionary()
_present: WeakKeyDictionary[Any, dict[tuple[str, str], tuple[Any, Any]]] = WeakKeyDictionary()


def inlined(make: Callable, key: tuple, form: Form, rhs: Any, *jacobian: Any) -> Callable:
    """Return the kernel that ``make(rhs, *jacobian)`` compiles; `key` tells it from the other kernels of rhs."""
    functions = _as_compiled(rhs, "rhs", form), *(each and _as_compiled(each, "jacobian", form) for each in jacobian)
    known = _inlined.setdefault(rhs, {})
    key = (*key, form.name, *jacobian)
    if key not in known or known[key][0] != functions:
        for function, kind in zip(functions, ("rhs", "jacobian"), strict=False):
            if function is not None:
                compile_for_own_arrays(function, kind, form)
        known[key] = functions, make(*functions)
    return known[key][1]


def _as_compiled(function: Any, kind: str, form: Form) -> Any:
    """Return a jitted function that inlines what `check_callback` has compiled.

    Numba keeps each element of a kernel for the types of its arguments, and the type of a jitted function stays the
    same when the function is compiled anew. A copy of the function has a type of its own.
    """
    compiled = check_callback(function, kind, form).compiled
    known = _present.setdefault(function, {})
    before, present = known.get((kind, form.name), (compiled, function))
    if before is not compiled:
        present = numba.jit(**options_of(function))(function.py_func)
    known[kind, form.name] = compiled, present
    return present
