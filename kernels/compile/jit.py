"""Compiler options, and compilation with the cache on disk.

A kernel is compiled in one of two modes. In pointer mode, the kernel gets the address of the right-hand side. One
compiled kernel, which is stored on disk, then works for every right-hand side. In inline mode, the same Python function
is compiled for one right-hand side, which LLVM inlines. This gives the fastest loop, which is found
on the disk as long as that function stays the same.
"""

import functools
import inspect
import types
from collections.abc import Callable
from typing import Any

import numba
from numba.extending import intrinsic

from .cache import check_cache, keep_on_disk
from .content import content, fingerprint
from .interrupt import DeferredInterrupt
from .notice import announced
from .numba_internals import (
    WITH_ROOTS,
    WITHOUT_C_WRAPPER,
    WITHOUT_RUNTIME,
    WITHOUT_WRAPPERS,
    CompiledFunction,
    address_of,
    address_of_symbol,
    call_without_checks,
    code_of,
    compile_for,
    compile_results,
    define_symbol,
    jitted_of,
    linked_jit,
    return_type,
)
from .source import define

if numba.config.DISABLE_JIT:
    raise ImportError("eig3 runs compiled code only: unset NUMBA_DISABLE_JIT, which turns Numba's compiler off.")

# "contract" allows LLVM to fuse a*b + c; "nsz" allows it to ignore the sign of zero. Full fastmath would remove the
# tests for NaN and infinity. With the error model of NumPy, 1/0 is infinite. Python's error model raises an exception,
# and the check for it prevents vectorised loops.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}, **WITH_ROOTS}

# Numba's runtime counts references to arrays. Kernels do without it for two reasons. LLVM cannot remove the counting of
# the array arguments around a call through a pointer, and this counting triples the time of a step. And an exception
# would leak every array to which the kernel holds a reference, such as a whole history. Without the runtime, an
# allocation does not compile, and a kernel must not return an array to code that counts references.
KERNEL_OPTIONS: dict[str, Any] = {**WITHOUT_RUNTIME, **OPTIONS}


def element(function: Callable) -> Any:
    """Decorate a function that is inlined into a kernel or into a scene."""
    return linked_jit(function, keep_on_disk, forceinline=True, **KERNEL_OPTIONS)


def outlined(function: Callable) -> Any:
    """Decorate a function of a kernel that is called rarely, and is not inlined: the kernel compiles in less time.

    The option is explicit: without it, Numba takes the option of the function that calls it first.
    """
    return linked_jit(function, keep_on_disk, forceinline=False, **KERNEL_OPTIONS)


def called(function: Any) -> Any:
    """Return a function that calls an element and is not inlined. The element is compiled once for both uses."""
    return outlined(lambda *arguments: function(*arguments))


def compiled(function: Any, arguments: tuple, what: str = "") -> Any:
    """Compile a jitted function for types of arguments, or load it from the disk, and return Numba's compile result.

    Every compilation of the library goes through this function: Ctrl-C waits until it is done, and if it lasts, `what`
    says what is compiled. The default is the name of the function.
    """
    results = compile_results(function)
    if arguments in results:
        return results[arguments]
    with DeferredInterrupt(), announced(what or f"the function {function.__name__}"):
        check_cache(function)
        compile_for(function, arguments)
        return results[arguments]


def type_returned(function: Any, arguments: tuple) -> Any:
    """Return the type that a jitted function returns for types of arguments."""
    return return_type(compiled(code_of(function), arguments))


def compile_kernel(template: Callable, names: dict[str, Any], signature: Any, label: str = "") -> Any:
    """Compile a template for a signature, and return the compiled function without the checks of its arguments.

    The template is a plain Python function in a file of this folder, and `names` are globals that it uses besides the
    globals of its file. `label` tells the kernel from others with the same template, for which it is found on the disk.
    All names must then come from this folder, of which a checksum is in the name of the file. Without a label, the
    kernel is found by its content.
    """
    return call_without_checks(_compiled(template, names, signature, label, WITHOUT_C_WRAPPER))


def _compiled(
    template: Callable, names: dict[str, Any], signature: Any, label: str, wrappers: dict[str, bool] = WITHOUT_WRAPPERS
) -> Any:
    function = bound(template, names)
    function.__qualname__ = f"{template.__name__}_{label}_{fingerprint()}"
    kernel = numba.njit(**KERNEL_OPTIONS, **wrappers)(function)
    name = f"{template.__module__}.{function.__qualname__}"
    what = f"the kernel {label}, which is kept on the disk" if label else "a kernel for this right-hand side"
    return compiled(keep_on_disk(kernel, name if label else ""), signature.args, what)


def called_by_symbol(template: Callable, names: dict[str, Any], signature: Any, label: str) -> Any:
    """Compile a function that many kernels call as `compile_kernel` does, and return an element that calls it.

    The code of the kernels contains only a symbol, which stands for its address: they compile in a part of the time.
    """
    function = _called_by_symbol(template, names, signature, label, f"{template.__name__}_{label}")
    function.py_func.made()  # a kernel that is loaded from the disk needs the symbol too
    return function


def of_library(signature: Any) -> Callable:
    """Decorate a function of a module that scenes call by its symbol, for the types of a signature.

    It is compiled when the first scene needs it, and rounds in one way for all.
    """
    return lambda function: _called_by_symbol(function, {}, signature, function.__name__, function.__name__)


def _called_by_symbol(function: Callable, names: dict[str, Any], signature: Any, label: str, symbol: str) -> Any:
    made = _made(lambda: _compiled(function, names, signature, label), symbol)
    name, given = function.__name__, ", ".join(inspect.signature(function).parameters)
    called = {"AT": function_at(signature), "ADDRESS": _address_of(made, symbol)}
    caller = define(f"def {name}({given}):\n    return AT(ADDRESS())({given})\n", name, called)[name]
    functools.update_wrapper(caller, function)
    caller.made = made
    return element(caller)


def address_of_code(function: Any) -> int:
    """Return the address of the code that an element from `called_by_symbol` calls."""
    return address_of(function.py_func.made()[1])


def _made(make: Callable, name: str) -> Callable:
    """Return a function that compiles another one once, and returns the symbol of its address."""

    @functools.cache
    def made() -> tuple[str, Any]:
        symbol, result = f"{name}_{fingerprint()}", make()
        define_symbol(symbol, address_of(result))
        return symbol, result  # the result keeps the machine code alive

    return made


def with_symbol(function: Any, signature: Any) -> Any:
    """Let `symbol_of` know a jitted function of a scene, for the types of a signature; return the function."""

    def made() -> tuple[str, Any]:
        result = compiled(function, signature.args)
        symbol = f"{function.__name__}_{content(function) or address_of(result)}"
        define_symbol(symbol, address_of(result))
        return symbol, result

    made.function = function  # type: ignore[attr-defined]
    function.py_func.made = made
    return function


def symbol_of(function: Any) -> str:
    """Return the symbol of the address of a function that `of_library` or `with_symbol` has returned."""
    return function.py_func.made()[0]


@intrinsic
def code_address(typingctx, function):  # type: ignore[no-untyped-def]
    """``code_address(function)`` is the address of a function of a scene that `with_symbol` has returned."""
    symbol = symbol_of(jitted_of(function))

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return address_of_symbol(context, builder, symbol)

    return numba.int64(function), codegen


def _address_of(made: Callable, name: str) -> Any:
    """Return a compiled function that returns the address of a function, which is made when it is needed first."""

    def address(typingctx):
        symbol, _ = made()

        def codegen(context, builder, signature, args):
            return address_of_symbol(context, builder, symbol)

        return numba.int64(), codegen

    address.content = f"the address of {name}"  # type: ignore[attr-defined]
    return intrinsic(address)


def function_at(signature: Any, call: Any = None) -> Any:
    """Return a compiled ``function(address)`` that converts the address of a compiled callback to the callback.

    With the element `call`, what calls the callback with some arguments calls ``call(..., callback)`` instead.

    An address is a plain integer. If a callback were passed as an object, each call of a kernel would take some ten
    microseconds more, because Numba would look up its address.
    """
    kind = CompiledFunction(signature, call)

    def function(typingctx, address):
        return kind(numba.int64), lambda context, builder, signature, args: args[0]

    function.content = str(kind)  # type: ignore[attr-defined]
    return intrinsic(function)


def bound(template: Callable, names: dict[str, Any]) -> types.FunctionType:
    """Return a copy of a function whose globals, and variables of outer functions, also have the values in `names`."""
    code, namespace = template.__code__, {**template.__globals__, **names}
    cells = zip(code.co_freevars, template.__closure__ or (), strict=True)
    closure = tuple(types.CellType(names[name]) if name in names else cell for name, cell in cells)
    function = types.FunctionType(code, namespace, template.__name__, template.__defaults__, closure)
    function.__module__ = template.__module__
    return function
