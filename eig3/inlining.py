"""Kernels with a right-hand side inlined. Each is compiled once in a process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

from .callbacks import check_callback, compile_for_own_arrays
from .kernels.protocol import Form

# The references are weak, so that a program that makes many functions does not keep all of them in memory.
_inlined: WeakKeyDictionary[Any, dict[tuple, tuple[Any, Callable]]] = WeakKeyDictionary()


def inlined(make: Callable, key: tuple, form: Form, rhs: Any, jacobian: Any = None) -> Callable:
    """Return the kernel that ``make()`` compiles for a right-hand side; `key` tells it from the other kernels."""
    compiled = check_callback(rhs, "rhs", form).compiled
    known = _inlined.setdefault(rhs, {})
    key = (*key, form.name, jacobian)
    if key not in known or known[key][0] is not compiled:  # the user may have compiled rhs anew
        for function, kind in ((rhs, "rhs"), (jacobian, "jacobian")):
            if function is not None:
                compile_for_own_arrays(function, kind, form)
        known[key] = compiled, make()
    return known[key][1]
