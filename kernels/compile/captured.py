"""The values from outside a jitted function that Numba compiles into it: globals, and variables of outer functions.

Numba reads them once, when it compiles the function. A later assignment changes what Python would compute, but not the
compiled code. So these values are kept, and compared with the values at a later time.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Callable, Iterator
from functools import partial
from types import CellType, CodeType, ModuleType
from typing import Any

import numpy as np

from .numba_internals import Jitted

_PACKAGE = __name__.partition(".")[0] + "."
_PLAIN = bool, int, float, complex, str, np.generic


class Captured:
    """The captured values of one function, as they are now.

    Attributes
    ----------
    functions : list of jitted functions
        Those that the function may call.
    values : dict of str to value
        The numbers, texts and arrays, by name, without the values of this package's functions, which do not change.
    random : str
        The name under which the function reaches random numbers; empty if it reaches none.
    """

    def __init__(self, function: Any) -> None:
        plain = getattr(function, "py_func", function)
        self.functions: list[Jitted] = []
        self.values: dict[str, Any] = {}
        self.random = ""
        self._compared: list[tuple[Callable[[], Any], Any]] = []
        is_ours = _is_ours(plain)
        for name, read in places(plain):
            value = read()
            if isinstance(value, Jitted):
                self.functions.append(value)
            elif is_plain(value) and not is_ours:
                value = self.values[name] = value.copy() if isinstance(value, np.ndarray) else value
            elif _is_random(value):
                self.random = name
            if not is_ours and (isinstance(value, Jitted) or name in self.values):
                self._compared.append((read, value))

    def differs(self) -> bool:
        """Return whether one of the values is another one now."""
        return any(not _is_same(read(), value) for read, value in self._compared)


def helpers_first(function: Any) -> list[tuple[Any, Captured]]:
    """Return a jitted function and all that it may call, each after those that it may call, with what they capture."""
    found: dict[Any, Captured] = {}
    seen: set[Any] = set()

    def visit(each: Any) -> None:
        if each not in seen:
            seen.add(each)
            captured = Captured(each)
            for helper in captured.functions:
                visit(helper)
            found[each] = captured

    visit(function)
    return list(found.items())


def _is_ours(function: Any) -> bool:
    return (function.__module__ or "").startswith(_PACKAGE)


def places(function: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield the names in a function that are not its own, and a function that reads the value."""
    names = dict.fromkeys(_names(function.__code__))
    namespace = function.__globals__
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, partial(_content, cell)
    for name in names:
        if name in namespace:
            yield name, partial(namespace.get, name)
            if isinstance(module := namespace[name], ModuleType):
                for attribute in names:
                    if attribute in vars(module):
                        yield f"{name}.{attribute}", partial(vars(module).get, attribute)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _content(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # the outer function has not assigned it yet
        return None


def is_plain(value: Any) -> bool:
    return isinstance(value, (*_PLAIN, np.ndarray)) or (isinstance(value, tuple) and all(map(is_plain, value)))


def _is_random(value: Any) -> bool:
    return (
        value in (np.random, random)
        if isinstance(value, ModuleType)
        else isinstance(getattr(value, "__self__", None), np.random.RandomState | np.random.Generator | random.Random)
    )


def _is_same(now: Any, then: Any) -> bool:
    if isinstance(then, np.ndarray):
        has_type = type(now) is type(then) and now.dtype == then.dtype and now.shape == then.shape
        return has_type and _is_same_in_memory(now, then)
    if now is then:
        return True
    if type(now) is not type(then) or not is_plain(then):
        return False
    if isinstance(then, tuple):
        return len(now) == len(then) and all(map(_is_same, now, then))
    return bool(now == then or (now != now and then != then))


def _is_same_in_memory(now: np.ndarray, then: np.ndarray) -> bool:
    """Compare the bytes of two arrays of one type and shape, so that NaN is the same as NaN."""
    if not (now.flags.c_contiguous and then.flags.c_contiguous) or now.dtype.itemsize != 8 or not now.ndim:
        return now.tobytes() == then.tobytes()
    return np.array_equal(now.view(np.int64), then.view(np.int64))


def captured_text(value: Any) -> str:
    """Return a text that differs for other values."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"({', '.join(map(captured_text, value))})"
    return f"{type(value).__name__} {value!r}"
