"""Jitted functions of the user: the decorator that compiles them, and the checks before a kernel calls them."""

from __future__ import annotations

import dis
import functools
import inspect
import operator
import types
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np

from ..kernels.compile.cache import keep_on_disk
from ..kernels.compile.captured import Captured, helpers_first, names_in
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.jit import OPTIONS, compiled
from ..kernels.compile.numba_internals import (
    WITHOUT_RUNTIME,
    Jitted,
    address_of,
    bare_jit,
    compile_results,
    gist,
    is_write_to_readonly,
    options_of,
    return_type,
)
from ..kernels.protocol import SCALAR, VECTOR, Form
from .companions import mark, remembered

__all__ = ["Callback", "check_callback", "jit", "reads_time", "reads_velocity"]


def jit(function: Callable | None = None, **options: Any) -> Any:
    """Compile a function with ``numba.njit`` and the compiler options of the kernels.

    The compiler may fuse multiply-adds, a division by zero gives infinity, powers such as ``x ** 1.5`` become square
    roots, and the function releases the GIL. A right-hand side decorated with plain ``numba.njit`` works too, but some
    are slower.

    Parameters
    ----------
    function : function
        The function to compile. Without it, ``jit(**options)`` returns a decorator.
    **options
        Options of ``numba.njit``, which replace the options of the kernels. The compiled function is cached on the disk
        unless ``cache=False``. If the folder is not writable, or is writable by other users, each process compiles the
        function, with a warning.

    Returns
    -------
    Numba dispatcher, or a decorator

    Notes
    -----
    Numba compiles a global variable as a constant. If its value has changed when the next run begins, the function is
    compiled again, which takes some tenths of a second: pass values that change often as parameters. The key of the
    cache is the code of the function, the code of the functions that it calls, and the values of global and closure
    variables. A function that calls itself or uses other objects, such as an `enum`, is compiled in each process. Numba
    does not check indices unless the environment variable NUMBA_BOUNDSCHECK is 1 when Python starts.

    A run compiles the function for other compiled functions. The first call from Python compiles it once more, as
    ``function.for_python``, which also has the code of these calls for Numba's ``inspect_llvm`` and ``inspect_asm``.
    """
    if function is None:
        return functools.partial(jit, **options)
    options = {**OPTIONS, **options}
    if options.pop("cache", True):
        return bare_jit(function, keep_on_disk, **options)
    return bare_jit(function, **options)


def without_runtime(function: Callable) -> Any:
    """Compile a function of the library that allocates no memory: it needs no reference counting, and is inlined."""
    return jit(function, forceinline=True, **WITHOUT_RUNTIME)


@dataclass(frozen=True, eq=False)
class Callback:
    """A function of the user, compiled for the fixed signature of its kind.

    Attributes
    ----------
    address : int
        The address of its machine code. A kernel in pointer mode calls the function at this address.
    kind : (str, Form)
        The attribute of the form that is its signature, and the form.
    compiled : Numba's compile result
        Keeps the machine code alive.
    function : function
        The plain Python function, with the globals that were compiled. A later assignment does not change it.
    reads_velocity : bool
        False if the function certainly does not read its third argument, v.
    reads_time : bool
        False if the function certainly does not read its first argument, t.
    captured : tuple of Captured
        The global and closure values that were compiled into the function and into the functions that it calls.
    quiet : (int, int)
        For an event of a large family, the address of `quiet_together`, and its number in the family; otherwise zeros.
    pace : dict
        Measured seconds per step of the kernels that called it, by kernel and number of degrees of freedom.
    """

    address: int
    kind: tuple[str, Form]
    compiled: Any
    function: Callable
    reads_velocity: bool
    reads_time: bool
    captured: tuple[Captured, ...]
    quiet: tuple[int, int] = (0, 0)
    pace: dict[tuple, float] = field(default_factory=dict)

    @functools.cached_property
    def call(self) -> Callable:
        """Calls the function from Python. The types of the arguments must match the signature; they are not checked."""
        kind, form = self.kind
        return functools.partial(form.caller(kind), self.address)


_ARGUMENTS = {
    ("rhs", SCALAR): "(t, u, v, p) -> a",
    ("rhs", VECTOR): "(t, u, v, p, a), writing a",
    ("jacobian", SCALAR): "(t, u, v, p) -> df/dv",
    ("jacobian", VECTOR): "(t, u, v, p, J), writing J",
    ("apply", SCALAR): "(t, u, v, p) -> (u, v)",
    ("apply", VECTOR): "(t, u, v, p), writing u and v",
    ("output", SCALAR): "(t, u, v, p, out), writing out",
    ("output", VECTOR): "(t, u, v, p, out), writing out",
}
_INVARIANT_ARGUMENTS = "(t, u, v, p) -> float"

PLACE_OF_V, PLACE_OF_P = 2, 3  # among the arguments of a function
WITH_Z = 7  # arguments of a right-hand side with first-order unknowns


def check_callback(function: Any, kind: str, form: Form, name: str | None = None) -> Callback:
    """Compile a function that the user passed for the fixed signature of its kind, which is an attribute of `Form`.

    `name` is the name of the argument in error messages; the default is `kind`. The result is the same object at each
    call, until the user recompiles the function, or assigns another value to a variable that was compiled into it: the
    function is then compiled with the new value.

    Raises
    ------
    TypeError
        If `function` is not decorated, has other arguments or another return type, or does not compile.
    ValueError
        If the function draws random numbers.
    """
    if isinstance(function, Jitted):
        if hasattr(function, "callback"):  # a member of a `Family`
            return function.callback(kind, form, name or kind)
        known = vars(function).get("_eig3_callbacks", {}).get((kind, form.name))
        if known is not None and is_present(known, function):
            return known
    with DeferredInterrupt():
        result = _compile(function, kind, form, name or kind)
    captured = tuple(captured for _, captured in helpers_first(function))
    reads = reads_velocity(function), reads_time(function)
    present = with_present_globals(function.py_func)
    callback = Callback(address_of(result), (kind, form), result, present, *reads, captured)
    remembered(function, "callbacks")[kind, form.name] = callback
    return callback


def is_present(known: Callback, function: Jitted) -> bool:
    """Return whether the function and the global and closure values in it are still as they were compiled."""
    # The user may have recompiled the function.
    results = dict.values(compile_results(function))
    is_compiled = any(map(functools.partial(operator.is_, known.compiled), results))
    return is_compiled and not any(map(Captured.differs, known.captured))


def _refuse_random(function: Jitted, name: str) -> None:
    found = next((captured.random for _, captured in helpers_first(function) if captured.random), "")
    if found:
        raise ValueError(
            f"{name} draws random numbers ({found}), and runs could not be repeated: draw them before the run, and "
            "pass them in params."
        )


def _renew(function: Jitted) -> None:
    """Recompile a function and the functions that it calls if values that were compiled into them have changed."""
    renewed: list[Jitted] = []
    for each, captured in helpers_first(function):
        before = vars(each).get("_eig3_captured")  # when it was compiled
        # Code that was compiled before this check may contain any values.
        is_old = before.differs() if before else bool(captured.values)
        if compile_results(each) and (is_old or any(helper in renewed for helper in captured.functions)):
            each.recompile()
            renewed.append(each)
        vars(each)["_eig3_captured"] = captured


def with_present_globals(f: Any) -> Callable:
    """Return a copy of a Python function whose globals do not change.

    The bindings to named parameters and to first-order unknowns are inlined in the copy, which can then run in lanes.
    """
    names = "__name__", "__builtins__", *names_in(f.__code__)  # the others, such as large arrays, may be freed
    present = {name: f.__globals__[name] for name in names if name in f.__globals__}
    copy = types.FunctionType(f.__code__, present, f.__name__, f.__defaults__, f.__closure__)
    if hasattr(f, "inner"):
        inner = with_present_globals(f.inner.py_func)
        copy.__globals__["inner_function"] = numba.jit(inner, **{**options_of(f.inner), "inline": "always"})
    copy.__kwdefaults__, copy.__module__ = f.__kwdefaults__, f.__module__
    return copy


def _compile(function: Any, kind: str, form: Form, name: str) -> Any:
    wanted = _ARGUMENTS.get((kind, form), _INVARIANT_ARGUMENTS)
    signature = getattr(form, kind)
    if not isinstance(function, Jitted):
        if callable(function):
            raise TypeError(f"{name} must be compiled: decorate it with @eig3.jit or @numba.njit.")
        raise TypeError(
            f"{name} must be a function decorated with @eig3.jit or @numba.njit, not {type(function).__name__}."
        )
    _check_form(function.py_func, name, kind, form, wanted, len(signature.args))
    result = compile_present(function, signature.args, kind, name, wanted)
    returned = return_type(result)
    if returned != signature.return_type:
        raise TypeError(f"{name} must have the form {wanted}, but it returns {_described(returned)}.")
    return result


def compile_present(function: Jitted, arguments: tuple, kind: str, name: str, wanted: str) -> Any:
    """Compile a function with the present global and closure values, and return Numba's compile result.

    Raises
    ------
    TypeError, ValueError
        As in `check_callback`. `name` and `wanted`, the form of the arguments, appear in the messages.
    """
    _refuse_random(function, name)
    try:
        _renew(function)
        return compiled(function, arguments)
    except Exception as error:  # Numba raises its own errors and plain Python errors
        if is_write_to_readonly(error):
            read = "p; it may only read it" if kind == "apply" else "u, v or p; it may only read them"
            raise TypeError(f"{name} must not write to {read}.") from error
        names = names_read(function)
        if names:
            example = ", ".join(f"{attribute!r}: 1.0" for attribute in dict.fromkeys(names))
            raise TypeError(
                f"{name} reads p.{names[0]}, but the parameters have no names: give params={{{example}}} or the like, "
                "to eig3.prepare too."
            ) from error
        layout = getattr(function.py_func, "layout", None)
        given = f"{wanted}, in which p has the names p.{', p.'.join(layout.names)}" if layout else wanted
        raise TypeError(f"{name} does not compile for the arguments {given}: {gist(error)}.") from error


def compile_for_own_arrays(function: Any, kind: str, form: Form) -> None:
    """Compile a checked callback for writable arrays, the type of the arrays in the loop into which it is inlined.

    Call this before the loop is compiled. The loop is compiled without memory management, and would compile the
    callback without it too. The callback could then not allocate arrays.
    """
    arguments = getattr(form, kind).args
    compiled(function, tuple(x.copy(readonly=False) if isinstance(x, numba.types.Array) else x for x in arguments))


def reads_velocity(function: Any) -> bool:
    """Return False if a right-hand side certainly does not read its third argument, v."""
    return _reads(function, PLACE_OF_V)


def reads_time(function: Any) -> bool:
    """Return False if a right-hand side certainly does not depend on its first argument, t.

    A function with a history reads the time since the last step.
    """
    return mark(function, "reads_time") is not False and _reads(function, 0)


def _reads(function: Any, place: int) -> bool:
    """Return False if a function certainly does not read the argument at a place.

    The test is that no instruction of its bytecode names the argument. Numba accesses a local variable only by an
    instruction that names the variable.
    """
    function = getattr(function, "py_func", function)
    while hasattr(function, "inner"):
        if hasattr(function, "reads_z") and place == PLACE_OF_V:  # first-order unknowns are velocities in a kernel
            return True
        function = function.inner.py_func
    code = function.__code__
    if code.co_argcount <= place:
        return True
    name = code.co_varnames[place]
    named = (i.argval if isinstance(i.argval, tuple) else (i.argval,) for i in dis.get_instructions(code))
    return name in code.co_cellvars or any(name in names for names in named)


def names_read(function: Any) -> list[str]:
    """Return the names of the parameters that a jitted function reads as attributes of p; none for another object."""
    if not isinstance(function, Jitted):
        return []
    return [attribute for attribute in attributes_of(function, PLACE_OF_P) if not hasattr(np.ndarray, attribute)]


def name_in_source(function: Any) -> str:
    """Return a name for a function in written source; a lambda expression has none."""
    return function.__name__ if function.__name__.isidentifier() else "unnamed"


def attributes_of(function: Any, place: int) -> list[str]:
    """Return the attributes that the bytecode of a function reads of its argument at a place."""
    code, place = _code_that_reads(function, place)
    found: list[str] = []
    variable, last = code.co_varnames[place] if place < code.co_argcount else "", None
    for instruction in dis.get_instructions(code):
        if instruction.opname in ("LOAD_ATTR", "LOAD_METHOD") and last == variable:
            found.append(instruction.argval)
        if instruction.opname not in ("CACHE", "EXTENDED_ARG"):
            names = instruction.argval if isinstance(instruction.argval, tuple) else (instruction.argval,)
            last = names[-1] if "LOAD_FAST" in instruction.opname or "LOAD_DEREF" in instruction.opname else None
    return found


def reads_attributes_only(function: Any, place: int) -> bool:
    """Return False if a function may use its argument at a place in another way than by reading attributes."""
    code, place = _code_that_reads(function, place)
    variable, uses = code.co_varnames[place], 0
    for instruction in dis.get_instructions(code):
        names = instruction.argval if isinstance(instruction.argval, tuple) else (instruction.argval,)
        uses += names.count(variable) if "FAST" in instruction.opname else 0
    return variable not in code.co_cellvars and uses == len(attributes_of(function, place))


def _code_that_reads(function: Any, place: int) -> tuple[types.CodeType, int]:
    """Return the code that reads an argument of a function, and the place there, without bindings to unknowns z."""
    function = getattr(function, "py_func", function)
    if hasattr(function, "reads_z") and hasattr(function, "inner"):
        function, place = function.inner.py_func, place + function.reads_z
    return function.__code__, place


def _check_form(function: Callable, name: str, kind: str, form: Form, wanted: str, count: int) -> None:
    other = SCALAR if form is VECTOR else VECTOR
    is_other = kind == "rhs" and not takes(function, count)
    if is_other and takes(function, len(other.rhs.args)):
        u0, remedy = ("a number", "an array") if form is SCALAR else ("an array", "a number")
        raise TypeError(
            f"rhs has the {other.name} form {_ARGUMENTS[kind, other]}, but u0 is {u0}; give u0 as {remedy}, "
            f"or write rhs as {wanted}."
        )
    if is_other and takes(function, WITH_Z):
        raise TypeError(
            "rhs has first-order unknowns z: give their first values as z0, to eig3.integrate, prepare, ensemble or "
            "Problem."
        )
    check_arguments(function, name, wanted, count)


def check_arguments(function: Callable, name: str, wanted: str, count: int) -> None:
    """Refuse another number of arguments, and t, u, v or p in another order.

    No other check detects the order, because u, v and p may have the same type.
    """
    names = list(inspect.signature(function).parameters)
    if not takes(function, count):
        raise TypeError(f"{name} takes {len(names)} arguments, but must take {count}: {wanted}.")
    if any(letter in names[:4] and names.index(letter) != place for place, letter in enumerate("tuvp")):
        raise TypeError(f"{name} takes {', '.join(names[:4])} as its first arguments, but must have the form {wanted}.")


def takes(function: Callable, count: int) -> bool:
    """Return whether a function can be called with `count` arguments."""
    if type(function) is types.FunctionType and not (function.__defaults__ or hasattr(function, "__wrapped__")):
        code = function.__code__
        if not (code.co_kwonlyargcount or code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS)):
            return code.co_argcount == count  # inspect.signature takes a hundred times as long
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    return True


def form_of(rhs: Any) -> Form:
    """Return the form of a right-hand side, from the number of its arguments."""
    function = getattr(rhs, "py_func", rhs)
    if not callable(function) or takes(function, len(SCALAR.rhs.args)):
        return SCALAR  # if rhs is not a function, a later check raises the error
    return VECTOR if any(takes(function, count) for count in (len(VECTOR.rhs.args), WITH_Z)) else SCALAR


def _described(returned: Any) -> str:
    if isinstance(returned, numba.types.NoneType):
        return "nothing"
    plain = numba.types.unliteral(returned)
    remedy = "; return float(...) of it, or 0.0 for 0" if isinstance(plain, numba.types.Number) else ""
    return f"{plain}{remedy}"
