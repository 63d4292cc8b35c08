"""First-order unknowns z of a system u'' = f(t, u, v, z), z' = g(t, u, v, z).

Kernels have second-order unknowns only. They get z as the velocities of further degrees of freedom after the n of u.
The accelerations of these are z'. Their displacements, the integrals of z, have no use.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.numba_internals import Jitted
from ..kernels.compile.source import define
from ..kernels.protocol import SCALAR, VECTOR, Form
from .callbacks import WITH_Z, jit, name_in_source, takes
from .checks import check_names, reals, shown
from .companions import remembered
from .events import Event
from .quantities import EnergyLessWork

UNNAMED = "z"  # the name of unknowns that the user gave no names
_RHS = "(t, u, v, z, p, a, dz), writing a and dz"


class FirstOrder(NamedTuple):
    """The names and shapes of first-order unknowns.

    Attributes
    ----------
    names : tuple of str
    shapes : tuple of tuple of int
        The shape of the values of each name: () or (k,).
    is_read : bool
        Whether the right-hand side reads z. Otherwise z are integrals that do not affect the motion, and the functions
        of the run are in the form of the kernels.
    """

    names: tuple[str, ...] = ()
    shapes: tuple[tuple[int, ...], ...] = ()
    is_read: bool = False

    def __bool__(self) -> bool:
        return bool(self.names)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return sum(map(math.prod, self.shapes))

    def begin(self, name: str) -> int:
        """Return the place of the first value of a name among all unknowns."""
        return sum(map(math.prod, self.shapes[: self.names.index(name)]))

    def separated(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return u and v of the degrees of freedom of the user, and z by name, from states of a kernel."""
        n, found = u.shape[-1] - self.size, {}
        begin = n
        for name, shape in zip(self.names, self.shapes, strict=True):
            end = begin + math.prod(shape)
            found[name] = v[..., begin:end] if shape else v[..., begin]
            begin = end
        return u[..., :n], v[..., :n], found

    def joined(self, z: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return arrays by name as one array, whose last axis has all unknowns; other axes are broadcast."""
        parts = [np.asarray(z[name]) if shape else np.asarray(z[name])[..., None] for name, shape in self._items()]
        axes = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
        return np.concatenate([np.broadcast_to(part, (*axes, part.shape[-1])) for part in parts], axis=-1)

    def named(self, z: np.ndarray) -> dict[str, Any]:
        """Return the unknowns of one array by name: floats and arrays."""
        found = self.separated(z, z)[2]
        return {name: float(x) if x.ndim == 0 else x.copy() for name, x in found.items()}

    def start(self, u0: Any, v0: Any, z0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return u0 and v0 of a kernel, for one run, or with a first axis of members."""
        return _beside(u0, np.zeros(self.size)), _beside(v0, z0)

    def again(self, z0: Any) -> np.ndarray:
        """Check new values of z0, for one run or with a first axis of members, and return them in one array.

        Raises
        ------
        TypeError, ValueError
            If a name or a shape differs from the first values.
        """
        given = z0 if isinstance(z0, Mapping) else {UNNAMED: z0}
        if set(given) != set(self.names):
            raise TypeError(f"z0 must have the names {', '.join(self.names)}, and not be {shown(z0)}.")
        arrays = {name: _checked(given[name], _said(name, z0)) for name in self.names}
        for name, shape in self._items():
            if arrays[name].shape[arrays[name].ndim - len(shape) :] != shape:
                raise ValueError(
                    f"{_said(name, z0)} must have the shape {shape}, as at first, not {arrays[name].shape}."
                )
        return self.joined(arrays)

    def _items(self) -> Any:
        return zip(self.names, self.shapes, strict=True)

    def bind(self, function: Any, n_after: int = 0) -> Any:
        """Return a function of the states of a kernel that calls a function of u, v and z, or of u and v alone.

        It is the same object at each call. Functions in the form of the kernels, and objects that are not jitted
        functions, are returned unchanged, but an `Event` and an output with its number of values are bound. `n_after`
        is the number of arguments after p.
        """
        if not self.is_read:
            return function
        if isinstance(function, EnergyLessWork):
            return function._replace(energy=self.bind(function.energy))
        if isinstance(function, tuple):
            return (self.bind(function[0], 1), *function[1:])
        if isinstance(function, Event):
            return dataclasses.replace(function, g=self.bind(function.g), apply=self.bind(function.apply))
        if not isinstance(function, Jitted) or is_bound(function) or hasattr(function, "callback"):
            return function
        if not any(takes(function.py_func, 4 + has_z + n_after) for has_z in (0, 1)):
            return function  # a later check names the arguments that it must have
        reads_z = takes(function.py_func, 5 + n_after)
        known = remembered(function, "bound")
        key = self.size, n_after
        if key not in known:
            known[key] = self._bound(function, reads_z)
        return known[key]

    def bind_all(self, functions: Any) -> Any:
        """Return a dictionary of bound functions; other objects are returned unchanged."""
        if not isinstance(functions, Mapping):
            return functions
        return {name: self.bind(function) for name, function in functions.items()}

    def bind_rhs(self, rhs: Any) -> Any:
        """Return a right-hand side for kernels; one in the form of the kernels is returned unchanged."""
        return self.bind(rhs, 2)

    def _bound(self, function: Any, reads_z: bool) -> Any:
        """Return a function of (t, u, v, p, ...) that calls `function`."""
        arguments = list(inspect.signature(function.py_func).parameters)
        t, u, v, *rest = arguments
        z, (p, *after) = ([rest[0]], rest[1:]) if reads_z else ([], rest)
        is_rhs = len(after) == 2
        outer = [t, u, v, p, *after[:1]]
        given = [t, f"{u}[:n_own]", f"{v}[:n_own]", *(f"{v}[n_own:]" for _ in z), p, *after]
        if is_rhs:
            given[-2:] = f"{after[0]}[:n_own]", f"{after[0]}[n_own:]"
        name = name_in_source(function)
        text = (
            f"def {name}({', '.join(outer)}):\n"
            f"    n_own = {u}.size - {self.size}\n"
            f"    return inner_function({', '.join(given)})\n"
        )
        names = {"inner_function": function, "__name__": function.py_func.__module__}
        defined = define(text, "unknowns", names)[name]
        defined.inner, defined.reads_z = function, reads_z  # these are pickled with the Python function
        return jit(defined)


NONE = FirstOrder()
_WITHOUT = NONE, np.empty(0)


def check_z0(rhs: Any, z0: Any, form: Form | None = None, *, of_members: bool = False) -> tuple[FirstOrder, np.ndarray]:
    """Return the first-order unknowns of a right-hand side, and their first values in one array.

    With rhs in the form ``f(t, u, v, z, p, a, dz)``, z are unknowns; in the form of the kernels, they are integrals.
    `form` is the form of u0 and v0. With `of_members`, arrays have values of members: an array without names has a last
    axis of unknowns, and an array with a name has the values of one unknown.

    Raises
    ------
    TypeError, ValueError
        If z0 is not valid.
    """
    if z0 is None:
        return _WITHOUT
    reads_z = _reads_z(rhs)
    if not reads_z and not takes(getattr(rhs, "py_func", rhs), len(VECTOR.rhs.args)):
        raise TypeError(f"with z0, rhs must have the form {_RHS}.")
    if form is SCALAR:
        raise ValueError("with z0, u0 and v0 must be arrays: write u0=[u0] and v0=[v0] for one degree of freedom.")
    given = z0 if isinstance(z0, Mapping) else {UNNAMED: z0}
    check_names(given, "z0")
    if not given:
        raise ValueError("z0 must have at least one first-order unknown; leave it out for none.")
    has_names, arrays = isinstance(z0, Mapping), {name: _checked(x, _said(name, z0)) for name, x in given.items()}
    shapes = []
    for name, x in arrays.items():
        most = 2 if of_members and not has_names else 1
        if x.ndim > most:
            wanted = "a number or a one-dimensional array" if most == 1 else "a number, or of the shape (k,) or (m, k)"
            raise ValueError(f"{_said(name, z0)} must be {wanted}, not of the shape {x.shape}.")
        shapes.append(() if x.ndim == 0 or (of_members and has_names) else x.shape[-1:])
    record = FirstOrder(tuple(arrays), tuple(shapes), reads_z)
    return record, record.joined(arrays)


def is_bound(function: Any) -> bool:
    """Whether a function is bound to first-order unknowns, and perhaps then to the names of parameters."""
    inner = getattr(function, "py_func", None)
    while inner is not None:
        if hasattr(inner, "reads_z"):
            return True
        inner = getattr(getattr(inner, "inner", None), "py_func", None)
    return False


def flat(z: Mapping[str, np.ndarray], m: int) -> np.ndarray:
    """Return the unknowns of m states by name as one array, shape (m, k)."""
    return np.column_stack([np.empty((m, 0)), *(x.reshape(m, math.prod(x.shape[1:])) for x in z.values())])


def _reads_z(rhs: Any) -> bool:
    """Whether a right-hand side has the form with z, or is bound to z."""
    function = getattr(rhs, "py_func", rhs)
    return is_bound(rhs) or (callable(function) and takes(function, WITH_Z))


def _checked(values: ArrayLike, said: str) -> np.ndarray:
    array = reals(values, said)
    if array.size == 0:
        raise ValueError(f"{said} must hold at least one value, but it is empty.")
    if not np.isfinite(array).all():
        raise ValueError(f"{said} must be finite, but it holds {array[~np.isfinite(array)].flat[0]}.")
    return array


def _said(name: str, z0: Any) -> str:
    return f"z0[{name!r}]" if isinstance(z0, Mapping) else "z0"


def _beside(x: Any, z: np.ndarray) -> np.ndarray:
    """Return x and z side by side, for one run, or with a first axis of members."""
    x = np.asarray(x)
    axes = np.broadcast_shapes(x.shape[:-1], z.shape[:-1])
    return np.concatenate([np.broadcast_to(part, (*axes, part.shape[-1])) for part in (x, z)], axis=-1)
