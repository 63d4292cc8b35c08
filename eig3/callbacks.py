"""The user's compiled functions: the decorator for them, and the checks before a kernel sees one."""

import inspect
import re
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from .kernels.jit import OPTIONS, SCALAR, VECTOR, Form
from .kernels.jit import cached as cached_jit

__all__ = ["cached_jit", "check_callback", "compile_for_own_arrays", "gist", "jit", "read_only"]


def jit(function: Callable | None = None, **options: Any) -> Any:
    """Compile with ``numba.njit`` and the options of the kernels; other options of njit can be given.

    Multiply-adds are fused, a division by zero gives infinity, and the GIL is released. Right-hand sides decorated
    with plain ``numba.njit`` work too, some of them a little slower.

    As always with Numba, globals keep the value they had when the function was compiled, so that what may change
    belongs in the parameters; and an index out of bounds is not noticed, unless the environment variable
    NUMBA_BOUNDSCHECK is 1 when the program starts. A function cached with ``cache=True`` is then to be cached anew, in
    an empty NUMBA_CACHE_DIR: Numba would load the unchecked one.
    """
    options = {**OPTIONS, **options}
    return numba.njit(**options) if function is None else numba.njit(**options)(function)


_ARGUMENTS = {
    ("rhs", SCALAR): "(t, u, v, p) -> a",
    ("rhs", VECTOR): "(t, u, v, p, a), writing a",
    ("jacobian", SCALAR): "(t, u, v, p) -> df/dv",
    ("jacobian", VECTOR): "(t, u, v, p, J), writing J",
}
_INVARIANT_ARGUMENTS = "(t, u, v, p) -> float"


def check_callback(function: Any, kind: str, form: Form, name: str | None = None) -> Any:
    """Return `function` compiled for the fixed signature of its kind, or say in a sentence what is wrong with it.

    Parameters
    ----------
    function
        What the user gave.
    kind : {"rhs", "jacobian", "invariant"}
    form : Form
    name : str, optional
        What to call it in errors; `kind` if not given.

    Raises
    ------
    TypeError
    """
    name = name or kind
    wanted = _ARGUMENTS.get((kind, form), _INVARIANT_ARGUMENTS)
    signature = getattr(form, kind)
    if not isinstance(function, Dispatcher):
        if callable(function):
            raise TypeError(f"{name} must be compiled: decorate it with @eig3.jit or @numba.njit.")
        raise TypeError(
            f"{name} must be a function decorated with @eig3.jit or @numba.njit, not {type(function).__name__}."
        )
    _check_arguments(function.py_func, name, kind, form, wanted, len(signature.args))
    try:
        function.compile(signature.args)
        returned = function.overloads[signature.args].signature.return_type
    except Exception as error:  # Numba lets errors of Python's own through too
        if "readonly array" in str(error):
            raise TypeError(f"{name} must not write to u, v or p; it may only read them.") from error
        raise TypeError(f"{name} does not compile for the arguments {wanted}: {gist(error)}.") from error
    if returned != signature.return_type:
        raise TypeError(f"{name} must have the form {wanted}, but it returns {_described(returned)}.")
    return function


def compile_for_own_arrays(function: Any, kind: str, form: Form) -> None:
    """Compile a checked callback for the arrays of the loop that it is inlined in, which that loop may write.

    Compiled by the loop itself it could not allocate, as the loop cannot.
    """
    arguments = getattr(form, kind).args
    function.compile(tuple(x.copy(readonly=False) if isinstance(x, numba.types.Array) else x for x in arguments))


def read_only(x: Any) -> Any:
    """A view that compiled callbacks take as it is; a number stays what it is."""
    if np.ndim(x) == 0:
        return x
    view = x.view()
    view.flags.writeable = False
    return view


def _check_arguments(function: Callable, name: str, kind: str, form: Form, wanted: str, count: int) -> None:
    if _takes(function, count):
        _check_order(function, name, wanted)
        return
    other = SCALAR if form is VECTOR else VECTOR
    if kind == "rhs" and _takes(function, len(other.rhs.args)):
        u0, remedy = ("a number", "an array") if form is SCALAR else ("an array", "a number")
        raise TypeError(
            f"rhs has the {other.name} form {_ARGUMENTS[kind, other]}, but u0 is {u0}; give u0 as {remedy}, "
            f"or write rhs as {wanted}."
        )
    given = len(inspect.signature(function).parameters)
    raise TypeError(f"{name} takes {given} arguments, but must take {count}: {wanted}.")


def _check_order(function: Callable, name: str, wanted: str) -> None:
    """Refuse t, u, v or p in another's place: all but t are of one type, and the run would be silently wrong."""
    names = list(inspect.signature(function).parameters)[:4]
    if any(letter in names and names.index(letter) != place for place, letter in enumerate("tuvp")):
        raise TypeError(f"{name} names its first arguments {', '.join(names)}, but gets them as {wanted}.")


def _takes(function: Callable, count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    return True


def _described(returned: Any) -> str:
    if isinstance(returned, numba.types.NoneType):
        return "nothing"
    plain = numba.types.unliteral(returned)
    remedy = "; return float(...) of it, or 0.0 for 0" if isinstance(plain, numba.types.Number) else ""
    return f"{plain}{remedy}"


def gist(error: Exception) -> str:
    """Numba's reason without the pages around it, which stay in the chained exception."""
    text = str(error)
    if text == "compilation disabled":
        return "its decorator must not list signatures"
    missing = re.search(r">>> (.*)", text)
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("Failed in")]
    where = re.search(r'File "[^"]*", line \d+', text)
    reason = f"Numba cannot do {missing[1]}" if missing else (lines or [type(error).__name__])[0].rstrip(".")
    return f"{reason} ({where[0]})" if where else reason
