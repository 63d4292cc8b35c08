"""Families of callbacks: functions that differ only in one number, and are compiled once."""

from __future__ import annotations

import functools
import inspect
from typing import Any

import numba

from ..kernels.compile.captured import helpers_first
from ..kernels.compile.interrupt import DeferredInterrupt
from ..kernels.compile.jit import bound, compiled
from ..kernels.compile.numba_internals import Jitted, address_of, addresses_of_members
from ..kernels.loops.zeros import quiet_together
from ..kernels.protocol import Form
from .callbacks import Callback, compile_present, is_present, jit, reads_time, reads_velocity

LEAST_TOGETHER = 8  # members of a family that are looked at together: for fewer, the function is not worth compiling


class Family:
    """The members of a function ``f(k, t, u, v, p)``: for each k a callback ``f_k(t, u, v, p)``.

    A kernel calls f with the number k of the member as a float: a family of any size needs one compilation.

    Parameters
    ----------
    function : jitted function
        f.
    count : int
        The number of members.
    values : jitted function, optional
        ``values(t, u, v, p, out)`` writes the values of all members: lanes evaluate them together.

    Attributes
    ----------
    members : list of jitted functions
        They can also be called from Python and from compiled functions. Only such a call compiles them.
    """

    def __init__(self, function: Jitted, count: int, values: Any = None) -> None:
        self._function, self._values = function, values
        self._count = count
        self._callbacks: dict[tuple[str, str], list[Callback]] = {}
        self._libraries: list[Any] = []  # keep the machine code of the members alive
        self.members = [self._member(k) for k in range(count)]

    def _member(self, k: int) -> Any:
        function = self._function

        @functools.wraps(function.py_func)
        def member(t, u, v, p):  # type: ignore[no-untyped-def]
            return function(float(k), t, u, v, p)

        vars(member).pop("inner", None)  # a member calls the bound function, in kernels' form
        member.reads_z = True  # type: ignore[attr-defined]
        if self._values is not None:
            member.family = self._values, self._count, k  # type: ignore[attr-defined]
        whole = inspect.signature(function.py_func)
        member.__signature__ = whole.replace(parameters=list(whole.parameters.values())[1:])  # type: ignore[attr-defined]
        jitted = jit(member)
        jitted.callback = functools.partial(self._callback, k)
        jitted.origin = _member, (self, k)
        return jitted

    def __reduce__(self) -> tuple:
        return Family, (self._function, self._count, self._values)

    def _callback(self, k: int, kind: str, form: Form, name: str) -> Callback:
        """Return the member k for the fixed signature of a kind of callback, as `check_callback` does."""
        key = kind, form.name
        if key not in self._callbacks or not is_present(self._callbacks[key][k], self._function):
            with DeferredInterrupt():
                self._callbacks[key] = self._compiled(kind, form, name)
        return self._callbacks[key][k]

    def _compiled(self, kind: str, form: Form, name: str) -> list[Callback]:
        function, arguments = self._function, (numba.float64, *getattr(form, kind).args)
        result = compile_present(function, arguments, kind, name, "(k, t, u, v, p)")
        addresses, library = addresses_of_members(result, len(self.members))
        self._libraries.append(library)
        captured = tuple(captured for _, captured in helpers_first(function))
        quiet = self._quiet(form) if kind == "event" and len(addresses) >= LEAST_TOGETHER else 0
        return [
            Callback(
                address,
                (kind, form),
                result,
                member.py_func,
                reads_velocity(member),
                reads_time(member),
                captured,
                (quiet, k),
            )
            for k, (address, member) in enumerate(zip(addresses, self.members, strict=True))
        ]

    def _quiet(self, form: Form) -> int:
        """Compile the function that looks at several members together, and return its address."""
        function = jit(self._function.py_func, cache=False, forceinline=True)  # what members share leaves the loop
        result = compiled(jit(bound(quiet_together, {"FUNCTION": function})), form.quiet.args)
        self._libraries.append(result)
        return address_of(result)


def _member(family: Family, k: int) -> Jitted:
    return family.members[k]
