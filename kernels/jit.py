"""Compiler options and the fixed signatures: the only place that knows either.

A kernel is compiled in one of two modes. In pointer mode the right-hand side is an argument of a first-class function
type, so that one compiled kernel, kept on disk, serves every right-hand side. In inline mode the same Python function
is specialised for one right-hand side, which LLVM then inlines: the fastest loop, compiled anew in every process.
"""

import functools
import pathlib
import types
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.types import Array, FunctionType, Tuple, UniTuple, float64, int64, none

# "contract" lets LLVM fuse a*b + c; "nsz" ignores the sign of zero. Full fastmath would delete tests for NaN and
# infinity. The NumPy error model makes 1/0 infinite: Python's raises, and its check keeps loops from being vectorised.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}

# Without NRT no reference count is touched. Counting the array arguments around a call through a pointer, which LLVM
# cannot prune, triples the time of a step; and an exception leaks every reference a kernel holds, whole histories. It
# makes allocation a compile error, and forbids to return an array to a function that does count.
_KERNEL_OPTIONS: dict[str, Any] = {"_nrt": False, **OPTIONS}

#: The decorator of what kernels are built of.
element = numba.njit(forceinline=True, **_KERNEL_OPTIONS)

_vector, _matrix = Array(float64, 1, "C"), Array(float64, 2, "C")
_given = Array(float64, 1, "C", readonly=True)  # what a callback may only read: to write it does not compile


@dataclass(frozen=True)
class Form:
    """The types of one form of right-hand side: one degree of freedom, or n."""

    name: str
    rhs: Any
    jacobian: Any
    invariant: Any
    state: Any
    rows: Any


SCALAR = Form(
    name="scalar",
    rhs=float64(float64, float64, float64, _given),
    jacobian=float64(float64, float64, float64, _given),
    invariant=float64(float64, float64, float64, _given),
    state=_vector,
    rows=_vector,
)
VECTOR = Form(
    name="vector",
    rhs=none(float64, _given, _given, _given, _vector),
    jacobian=none(float64, _given, _given, _given, _matrix),
    invariant=float64(float64, _given, _given, _given),
    state=_matrix,
    rows=_matrix,
)


@functools.cache
def pointer_kernel(function: Callable, form: Form, takes_jacobian: bool = False) -> Any:
    """Compile a method's kernel, or load it from disk, with its callbacks as function pointers.

    The kernel is called as ``kernel(rhs, [jacobian,] state, settings, tally, run)``, with ``run = (h, t0, p, first,
    count, every, u_rows, v_rows)``, and returns how many of the `count` steps it took.
    """
    callbacks = [FunctionType(form.rhs)] + [FunctionType(form.jacobian)] * takes_jacobian
    run = Tuple((float64, float64, _vector, int64, int64, int64, form.rows, form.rows))
    return _compile(function, int64(*callbacks, form.state, _vector, _vector, run))


@functools.cache
def inline_kernel(function: Callable) -> Any:
    """The same kernel, specialised for each right-hand side it is called with."""
    return numba.njit(**_KERNEL_OPTIONS)(function)


@functools.cache
def invariant_kernel(function: Callable, form: Form) -> Any:
    """Compile the loop along an invariant, called as ``kernel(invariant, t0, h, p, first, u_rows, v_rows)``."""
    arguments = float64, float64, _vector, int64, form.rows, form.rows
    return _compile(function, UniTuple(float64, 2)(FunctionType(form.invariant), *arguments))


def _compile(function: Callable, signature: Any) -> Any:
    # Numba's cache notices a change of the file a kernel is in, but not of the files that it calls into; a name that
    # holds a fingerprint of them all does.
    named = types.FunctionType(function.__code__, function.__globals__, function.__name__)
    named.__module__ = function.__module__
    named.__qualname__ = f"{function.__name__}_{_fingerprint()}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)  # first-class functions, since 2019
        return cached(named, signature, **_KERNEL_OPTIONS)


def cached(function: Callable, signature: Any = None, **options: Any) -> Any:
    """Compile with the disk cache, or without where there is no place for it, and where indices are to be checked.

    Numba's cache does not tell checked code from unchecked: each would be loaded for the other.
    """
    options = options or OPTIONS
    try:
        return numba.njit(signature, cache=not numba.config.BOUNDSCHECK, **options)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(signature, **options)(function)


@functools.cache
def _fingerprint() -> str:
    checksum = 0
    for path in sorted(pathlib.Path(__file__).parent.glob("*.py")):
        checksum = zlib.crc32(path.read_bytes(), checksum)
    return f"{checksum:08x}"
