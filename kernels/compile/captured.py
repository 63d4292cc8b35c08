"""The values from outside a jitted function that Numba compiles into it: globals, and variables of outer functions.

Numba reads them once, when it compiles the function. A later assignment changes what Python would compute, but not the
compiled code. So these values are kept, and compared with the values at a later time.
"""

from __future__ import annotations

import dis
import hashlib
import operator
import random
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import lru_cache, partial
from types import CellType, CodeType, ModuleType
from typing import Any

import numpy as np

from .numba_internals import Jitted

_PACKAGE = __name__.partition(".")[0] + "."
_PLAIN = bool, int, float, complex, str, bytes, type(None), np.generic


class Captured:
    """The captured values of one function, as they are now.

    It may call the jitted `functions`. `values` are the numbers, texts and arrays by name, without the values of this
    package's functions, which do not change. `random` is the name under which it reaches random numbers; empty for
    none.
    """

    def __init__(self, function: Any) -> None:
        plain = getattr(function, "py_func", function)
        self.functions: list[Jitted] = []
        self.values: dict[str, Any] = {}
        self.random = ""
        self._reads: list[Callable[[], Any]] = []
        self._objects: list[Any] = []
        is_ours = _is_ours(plain)
        for name, read in places(plain):
            value = read()
            self.functions += [x for x in (value if isinstance(value, tuple) else (value,)) if isinstance(x, Jitted)]
            if not self.random and _is_random(value):
                self.random = name
            if not is_ours:
                if is_plain(value):
                    value = self.values[name] = deepcopy(value)
                self._reads.append(read)
                self._objects.append(value)

    def differs(self) -> bool:
        """Return whether one of the values, functions, modules and other objects is another one now."""
        now = [read() for read in self._reads]
        return not (all(map(operator.is_, now, self._objects)) or all(map(_is_same, now, self._objects)))


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
    code, namespace = function.__code__, function.__globals__
    cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
    outer = [(name, partial(_content, cell)) for name, cell in cells]
    names, seen = [*dict.fromkeys(names_in(code))], set[ModuleType]()
    modules = [namespace[name] for name in names if isinstance(namespace.get(name), ModuleType)]
    # To read the code takes time: of ours, only where an attribute such as math.log has the name of a variable too.
    is_clear = _is_ours(function) and not any(hasattr(m, name) for m in modules for name in names if name in namespace)
    variables = names if is_clear else _globals(code)
    outer += [(name, partial(namespace.get, name)) for name in variables if name in namespace]
    for name, read in outer:
        yield name, read
        yield from _places_in(read(), name, names, seen)


def _places_in(module: Any, name: str, names: list[str], seen: set[ModuleType]) -> Iterator[tuple[str, Any]]:
    """Yield the places in a module, and in the modules in it, that have the names of attributes in a function."""
    if not isinstance(module, ModuleType) or module in seen:
        return
    seen.add(module)
    for attribute in names:
        if attribute in vars(module):
            yield f"{name}.{attribute}", partial(vars(module).get, attribute)
            yield from _places_in(vars(module)[attribute], f"{name}.{attribute}", names, seen)


@lru_cache(1024)  # to read the code takes a tenth of a millisecond
def _globals(code: CodeType) -> tuple[str, ...]:
    """Return the names of global variables. Attributes, such as p.k, may have the names of other variables."""
    found = [i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL"]
    found += (name for inner in code.co_consts if isinstance(inner, CodeType) for name in _globals(inner))
    return tuple(dict.fromkeys(found))


def names_in(code: CodeType) -> Iterator[str]:
    """Yield the names of global variables and of attributes."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from names_in(constant)


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
    if isinstance(then, np.ndarray | np.void):
        has_type = type(now) is type(then) and now.dtype == then.dtype and now.shape == then.shape
        return has_type and _is_same_in_memory(now, then)
    if now is then:
        return True
    if type(now) is not type(then) or not is_plain(then):
        return False
    if isinstance(then, tuple):
        return len(now) == len(then) and all(map(_is_same, now, then))
    return bool(now == then or (now != now and then != then))


def _is_same_in_memory(now: Any, then: Any) -> bool:
    """Compare the bytes of two arrays, or two records, of one type and shape, so that NaN is the same as NaN."""
    if not (now.flags.c_contiguous and then.flags.c_contiguous) or now.dtype.itemsize != 8 or not now.ndim:
        return now.tobytes() == then.tobytes()
    return np.array_equal(now.view(np.int64), then.view(np.int64))


def captured_text(value: Any) -> str:
    """Return a text that differs for other values."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"{getattr(value, '_fields', '')}({', '.join(map(captured_text, value))})"
    return f"{type(value).__name__} {value!r}"
