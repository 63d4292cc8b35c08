"""What machine code depends on: the code of a jitted function and of those that it may call, and their values.

Compiled code is kept on the disk under a digest of this. So a function of a notebook, of a scene or within another
function is found there too, and one whose helper has changed in another file is not.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import sys
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np

from .captured import captured_text, helpers_first, is_plain, places
from .numba_internals import Jitted, options_of

# Of other types, such as those that Numba makes of a user's class, the module and the name do not tell the content.
_NAMED = type, FunctionType, BuiltinFunctionType, type(np.dot)
_PACKAGE = f"{__name__.partition('.')[0]}."
_ROOTS = "numpy", "numba", "math", "cmath", "builtins", "operator"  # modules of fixed content: their versions tell it


def content(function: Any, *, is_named: bool = True) -> str:
    """Return a digest of what a jitted function consists of; empty if it uses something whose content is unknown.

    With `is_named`, which the symbols of machine code need, the names of the function and of its module belong to it.
    """
    digest, numbers = hashlib.sha256(), dict[Any, int]()
    for each, _ in helpers_first(function):
        part = _own_content(each, numbers, is_named)
        if not part:
            return ""
        numbers[each] = len(numbers)
        digest.update(f"{part}\n\n".encode())
    return digest.hexdigest()[:32]


def _own_content(function: Any, numbers: Mapping[Any, int], is_named: bool) -> str:
    """Return the content of a function, with the numbers of those that it calls; empty if it is unknown."""
    plain = function.py_func
    if (plain.__module__ or "").startswith(_PACKAGE):  # the module of a pickled problem may not be imported yet
        importlib.import_module(plain.__module__)
    if plain.__module__ not in sys.modules or not is_plain(plain.__defaults__ or ()):
        return ""
    name = f"{plain.__module__}.{plain.__qualname__}" if is_named else ""
    parts = [f"{name}{captured_text(plain.__defaults__ or ())}"]
    parts += [*_code(plain.__code__), _canonical(options_of(function))]
    for name, read in places(plain):
        value = read()
        if isinstance(value, Jitted):  # one that calls itself has no number yet: Numba cannot load its machine code
            text = f"function {numbers[value]}" if value in numbers else ""
        else:
            text = _value(value)
        if not text:
            return ""
        parts.append(f"{name}={text}")
    return "\n".join(parts)


def _code(code: CodeType) -> Iterator[str]:
    """Yield what the bytecode of a function consists of, without where its source is."""
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_argcount, code.co_flags
    yield f"{code.co_code.hex()} {names}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield _canonical(constant)


def _canonical(value: Any) -> str:
    """Return a text of a constant or of options, which is the same in each process: a set has an order here."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(sorted(f'{key}: {_canonical(x)}' for key, x in value.items()))}}}"
    if isinstance(value, set | frozenset):
        return f"{{{', '.join(sorted(map(_canonical, value)))}}}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_canonical, value))})"
    return repr(value)


def _value(value: Any) -> str:
    """Return a text that differs for other values from outside; empty if there is none."""
    if is_plain(value):
        return captured_text(value)
    if isinstance(value, numba.types.Type):
        return str(value)
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
        return f"{value.__name__}{value._fields}"
    if isinstance(value, np.ufunc):
        return f"ufunc {value.__name__}"
    module = getattr(value, "__module__", None) or ""
    if type(value) in _NAMED and module.partition(".")[0] in _ROOTS:
        return f"{module}.{value.__name__}"
    return _of_library(value)


def _of_library(value: Any) -> str:
    """Return the content of an intrinsic of this package, or of a Python function with an overload in its module."""
    defined = getattr(value, "_defn", value)
    if defined is not value and hasattr(defined, "content"):
        return str(defined.content)
    module, name = getattr(defined, "__module__", None) or "", getattr(defined, "__name__", "")
    if not module.startswith(_PACKAGE):
        return ""
    known = getattr(sys.modules[module], name, None)
    code = getattr(getattr(known, "_defn", known), "__code__", None)  # an intrinsic that was pickled is another object
    is_ours = known is value or (code is not None and code == getattr(defined, "__code__", None))
    return f"{module}.{name} {_checksum(module)}" if is_ours else ""


@functools.cache
def _checksum(module: str) -> int:
    return zlib.crc32(Path(str(sys.modules[module].__file__)).read_bytes())


@functools.cache  # a kernel and the symbols in it must have the same, also if a file changes while the process runs
def fingerprint() -> str:
    """Return a checksum of the source files of all kernels."""
    checksum = 0
    for path in sorted(Path(__file__).parent.parent.rglob("*.py")):
        checksum = zlib.crc32(path.read_bytes(), checksum)
    return f"{checksum:08x}"
