"""Compiler options, and compiling with the cache on disk.

A kernel is compiled in one of two modes. In pointer mode the right-hand side is an address: one compiled kernel, kept
on disk, serves every right-hand side. In inline mode the same Python function is specialised for one right-hand side,
which LLVM then inlines: the fastest loop, compiled anew in every process.
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

# "contract" lets LLVM fuse a*b + c; "nsz" ignores the sign of zero. Full fastmath would delete tests for NaN and
# infinity. The NumPy error model makes 1/0 infinite: Python's raises, and its check prevents vectorised loops.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}

# Without NRT a kernel counts no references. Counting the array arguments around a call through a pointer, which LLVM
# cannot remove, triples the time of a step; and an exception would leak every reference that the kernel holds, whole
# histories. Without NRT an allocation is a compile error, and no kernel can return an array to code that counts.
KERNEL_OPTIONS: dict[str, Any] = {"_nrt": False, **OPTIONS}

#: The decorator of the functions that kernels are built of.
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
        What distinguishes these names from others for the same template.
    sources : tuple of str
        Files outside this folder that the names come from.

    Notes
    -----
    Numba's cache notices a change of the template's file, but not of the files that it calls into. The name of the
    kernel therefore holds the label and a fingerprint of all these files.
    """
    function = bound(template, names)
    function.__qualname__ = f"{template.__name__}_{label}_{fingerprint(sources)}"
    with quiet():
        return cached(function, signature, **KERNEL_OPTIONS)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without the warning that first-class functions are experimental, which they have been since 2019."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        yield


def bound(template: Callable, names: dict[str, Any]) -> types.FunctionType:
    """A copy of a function that finds `names` among its globals."""
    function = types.FunctionType(template.__code__, {**template.__globals__, **names}, template.__name__)
    function.__module__ = template.__module__
    return function


def cached(function: Callable, signature: Any = None, **options: Any) -> Any:
    """Compile with the disk cache, or without it where no folder can be written and where indices are checked.

    Numba's cache does not distinguish checked code from unchecked code and would load one for the other.
    """
    options = options or OPTIONS
    try:
        return numba.njit(signature, cache=not numba.config.BOUNDSCHECK, **options)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(signature, **options)(function)


def fingerprint(sources: tuple[str, ...] = ()) -> str:
    """A checksum of the kernels' source files and of other files."""
    checksum = 0
    for path in [*sorted(Path(__file__).parent.glob("*.py")), *map(Path, sources)]:
        checksum = zlib.crc32(path.read_bytes(), checksum)
    return f"{checksum:08x}"
