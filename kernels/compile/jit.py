"""Compiler options, and compilation with the cache on disk.

A kernel is compiled in one of two modes. In pointer mode, the kernel gets the address of the right-hand side. One
compiled kernel, which is stored on disk, then works for every right-hand side. In inline mode, the same Python function
is compiled for one right-hand side, which LLVM inlines. This gives the fastest loop, but every process compiles it
again.
"""

import types
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba.core import cgutils
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic

from .cache import check_cache, keep_on_disk
from .interrupt import DeferredInterrupt
from .notice import announced

if numba.config.DISABLE_JIT:
    raise ImportError("eig3 runs compiled code only: unset NUMBA_DISABLE_JIT, which turns Numba's compiler off.")

# "contract" allows LLVM to fuse a*b + c; "nsz" allows it to ignore the sign of zero. Full fastmath would remove the
# tests for NaN and infinity. With the error model of NumPy, 1/0 is infinite. Python's error model raises an exception,
# and the check for it prevents vectorised loops.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}

# NRT is Numba's runtime, which counts references to arrays. Kernels do without it for two reasons. LLVM cannot remove
# the counting of the array arguments around a call through a pointer, and this counting triples the time of a step.
# And an exception would leak every array to which the kernel holds a reference, such as a whole history. Without NRT,
# an allocation does not compile, and a kernel must not return an array to code that counts references.
KERNEL_OPTIONS: dict[str, Any] = {"_nrt": False, **OPTIONS}

_linked: list[Any] = []  # the functions that kernels call by a symbol


class _Element(CPUDispatcher):
    """A function without the wrapper for calls from Python. With one for each element, a kernel would take twice as
    long to compile. Without this class, a call from Python would end the process."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        name = self.py_func.__name__
        raise TypeError(f"{name} can be called by compiled functions only; from Python, call {name}.py_func.")


def element(function: Callable) -> Any:
    """Decorate a function that is inlined into a kernel."""
    return _element(function, forceinline=True)


def outlined(function: Callable) -> Any:
    """Decorate a function of a kernel that is called rarely, and is not inlined: the kernel compiles in less time."""
    return _element(function)


def _element(function: Callable, **options: Any) -> Any:
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **KERNEL_OPTIONS}
    compiled_later = numba.njit(**options)(function)
    compiled_later.__class__ = _Element
    return compiled_later


#: Like `element`, for functions that are called from Python too, such as those of effects.
callable_element = numba.njit(forceinline=True, **KERNEL_OPTIONS)


def compiled(function: Any, arguments: tuple, what: str = "") -> Any:
    """Compile a jitted function for types of arguments, or load it from the disk, and return Numba's compile result.

    Every compilation of the library goes through this function: Ctrl-C waits until it is done, and if it lasts, `what`
    says what is compiled. The default is the name of the function.
    """
    if arguments in function.overloads:
        return function.overloads[arguments]
    with DeferredInterrupt(), announced(what or f"the function {function.__name__}"):
        check_cache(function)
        function.compile(arguments)
        return function.overloads[arguments]


def compile_kernel(template: Callable, names: dict[str, Any], signature: Any, label: str = "") -> Any:
    """Compile a template for a signature, and return the compiled function without the checks of its arguments.

    Parameters
    ----------
    template : function
        A plain Python function in a file of this folder.
    names : dict
        Globals that the template uses besides those of its own file.
    signature : Numba signature
    label : str
        If it is not empty, the kernel is kept on the disk, and loaded from there. The label distinguishes it from other
        kernels with the same template. All `names` must come from this folder: the name of the kernel on the disk
        contains a checksum of the files of this folder, so that a kernel is compiled again after a change, but Numba
        cannot detect a change of other files.
    """
    return _compiled(template, names, signature, label).entry_point


def _compiled(template: Callable, names: dict[str, Any], signature: Any, label: str) -> Any:
    function = bound(template, names)
    function.__qualname__ = f"{template.__name__}_{label}_{_fingerprint()}"
    kernel = numba.njit(**KERNEL_OPTIONS)(function)
    what = f"the kernel {label}, which is kept on the disk" if label else "a kernel for this right-hand side"
    return compiled(keep_on_disk(kernel) if label else kernel, signature.args, what)


def linked(template: Callable, names: dict[str, Any], signature: Any, label: str) -> Any:
    """Compile a function that many kernels call as `compile_kernel` does, and return an element that calls it.

    The code of the kernels contains only a symbol, which stands for its address: they compile in a part of the time.
    """
    result = _compiled(template, names, signature, label)
    symbol = f"{template.__name__}_{label}_{_fingerprint()}"
    llvm.add_symbol(symbol, result.library.get_pointer_to_function(result.fndesc.llvm_func_name))
    _linked.append(result)  # keeps the machine code alive

    @intrinsic
    def address(typingctx):
        def codegen(context, builder, signature, args):
            function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.VoidType(), []), symbol)
            return builder.ptrtoint(function, ir.IntType(64))

        return numba.int64(), codegen

    at = function_at(signature)
    return element(lambda *arguments: at(address())(*arguments))


def function_at(signature: Any) -> Any:
    """Return a compiled ``function(address)`` that converts the address of a compiled callback to the callback.

    An address is a plain integer. If a callback were passed as an object, each call of a kernel would take some ten
    microseconds more, because Numba would look up its address.
    """
    kind = numba.types.FunctionType(signature)

    @intrinsic
    def function(typingctx, address):
        def codegen(context, builder, signature, args):
            value = cgutils.create_struct_proxy(kind)(context, builder)
            value.jit_addr = builder.inttoptr(args[0], value.jit_addr.type)
            return value._getvalue()

        return kind(numba.int64), codegen

    return function


def bound(template: Callable, names: dict[str, Any]) -> types.FunctionType:
    """Return a copy of a function whose globals also contain `names`."""
    function = types.FunctionType(template.__code__, {**template.__globals__, **names}, template.__name__)
    function.__module__ = template.__module__
    return function


def _fingerprint() -> str:
    """Return a checksum of the source files of all kernels."""
    checksum = 0
    for path in sorted(Path(__file__).parent.parent.rglob("*.py")):
        checksum = zlib.crc32(path.read_bytes(), checksum)
    return f"{checksum:08x}"
