"""Compiler options, and compilation with the cache on disk.

A kernel is compiled in one of two modes. In pointer mode, the kernel gets the address of the right-hand side. One
compiled kernel, which is stored on disk, then works for every right-hand side. In inline mode, the same Python function
is compiled for one right-hand side, which LLVM inlines. This gives the fastest loop, but every process compiles it
again.
"""

import contextlib
import types
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core.errors import NumbaExperimentalFeatureWarning

# "contract" allows LLVM to fuse a*b + c; "nsz" allows it to ignore the sign of zero. Full fastmath would remove the
# tests for NaN and infinity. With the error model of NumPy, 1/0 is infinite. Python's error model raises an exception,
# and the check for it prevents vectorised loops.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}

# NRT is Numba's runtime, which counts references to arrays. Kernels do without it for two reasons. LLVM cannot remove
# the counting of the array arguments around a call through a pointer, and this counting triples the time of a step.
# And an exception would leak every array to which the kernel holds a reference, such as a whole history. Without NRT,
# an allocation does not compile, and a kernel must not return an array to code that counts references.
KERNEL_OPTIONS: dict[str, Any] = {"_nrt": False, **OPTIONS}

#: The decorator for the functions that are inlined into a kernel.
element = numba.njit(forceinline=True, **KERNEL_OPTIONS)


def compile_kernel(
    template: Callable, names: dict[str, Any], signature: Any, label: str, sources: tuple[str, ...] = ()
) -> Any:
    """Compile a template for a signature, or load it from the disk.

    Parameters
    ----------
    template : function
        A plain Python function in a file.
    names : dict
        Globals that the template uses besides those of its own file.
    signature : Numba signature
    label : str
        Text that distinguishes this kernel from others with the same template.
    sources : tuple of str
        Paths of files outside this folder that define some of the names.

    Returns
    -------
    Numba dispatcher

    Notes
    -----
    Numba's cache detects a change of the template's file, but not of the files whose functions the template calls. The
    name of the kernel therefore contains the label and a checksum of all these files.
    """
    function = bound(template, names)
    function.__qualname__ = f"{template.__name__}_{label}_{fingerprint(sources)}"
    with quiet():
        return cached(function, signature, **KERNEL_OPTIONS)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warning that first-class functions are experimental in Numba, as they have been since 2019."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        yield


def bound(template: Callable, names: dict[str, Any]) -> types.FunctionType:
    """Return a copy of a function whose globals also contain `names`."""
    function = types.FunctionType(template.__code__, {**template.__globals__, **names}, template.__name__)
    function.__module__ = template.__module__
    return function


def cached(function: Callable, signature: Any = None, **options: Any) -> Any:
    """Compile with the disk cache.

    The cache is not used if no folder can be written, or if indices are checked: Numba's cache does not distinguish
    checked code from unchecked code, and would load one in place of the other.
    """
    options = options or OPTIONS
    try:
        return numba.njit(signature, cache=not numba.config.BOUNDSCHECK, **options)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(signature, **options)(function)


def fingerprint(sources: tuple[str, ...] = ()) -> str:
    """Return a checksum of the source files of all kernels and of the files `sources`."""
    checksum = 0
    for path in [*sorted(Path(__file__).parent.glob("*.py")), *map(Path, sources)]:
        checksum = zlib.crc32(path.read_bytes(), checksum)
    return f"{checksum:08x}"
