"""The layout of named parameters in the array p of a kernel, and the binding of functions that read them.

From a function that reads p by names, `Layout.bind` makes a function that a kernel can call. It passes views of p, at
no cost. The sizes of arrays are stored before the values: a function is compiled for the names and the kinds of the
values, and not for their sizes.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import numpy as np

from ..kernels.compile.numba_internals import Jitted, part_of_array
from ..kernels.compile.source import define
from .callbacks import PLACE_OF_P, attributes_of, jit, name_in_source, reads_attributes_only
from .companions import remembered
from .events import Event
from .quantities import EnergyLessWork
from .sparse import Sparse

_MOST_NAMES = 8  # in an error


class Kind(NamedTuple):
    """The kind of a parameter.

    Attributes
    ----------
    is_whole : bool
        Whether its values are integers.
    ndim : int
        The number of axes; -1 for a sparse matrix, and -2 for a sparse matrix of blocks.
    """

    is_whole: bool
    ndim: int

    @property
    def n_sizes(self) -> int:
        """The number of sizes before the values: rows, columns, entries and block size of a sparse matrix."""
        return 2 - self.ndim if self.ndim < 0 else self.ndim

    @property
    def text(self) -> str:
        """The kind in a word."""
        if self.ndim < 0:
            return "sparse" if self == SPARSE else "blocks"
        return f"{'whole' if self.is_whole else 'real'}{self.ndim or ''}"


def _part(dtype: Any) -> Any:
    """Return the function of Python for `part_of_array`."""

    def part(p: np.ndarray, begin: int, sizes: tuple[int, ...]) -> np.ndarray:
        numbers = p[begin:].view(dtype)[: math.prod(sizes)]
        return numbers if len(sizes) == 1 else numbers.reshape(sizes)

    return part


_TYPES = {"real_part": "float64", "whole_part": "int64", "index_part": "int32"}
#: The functions that compiled functions call to read a part of an array.
PARTS = {name: part_of_array(dtype) for name, dtype in _TYPES.items()}
_PARTS_IN_PYTHON = {name: _part(dtype) for name, dtype in _TYPES.items()}

MOST_AXES = 2
SPARSE, BLOCKS = (Kind(is_whole=False, ndim=ndim) for ndim in (-1, -2))
_KINDS = [SPARSE, BLOCKS, *(Kind(is_whole, ndim) for is_whole in (False, True) for ndim in range(MOST_AXES + 1))]


@dataclasses.dataclass(frozen=True)
class Layout:
    """The names and kinds of parameters."""

    names: tuple[str, ...]
    kinds: tuple[Kind, ...]

    @functools.cached_property
    def text(self) -> str:
        """The layout in one line, such as "k=real, tags=whole1, K=sparse", with the number of axes."""
        return ", ".join(f"{name}={kind.text}" for name, kind in zip(self.names, self.kinds, strict=True))

    @classmethod
    def of_text(cls, text: str) -> Layout:
        """Return the layout of a text.

        Raises
        ------
        ValueError
            If the text is not from a layout.
        """
        pairs = [entry.split("=") for entry in text.split(", ")]
        known = {kind.text: kind for kind in _KINDS}
        if not all(len(pair) == 2 and pair[0].isidentifier() and pair[1] in known for pair in pairs):
            raise ValueError("the names of the parameters are damaged.")
        return cls(tuple(name for name, _ in pairs), tuple(known[kind] for _, kind in pairs))

    @property
    def n_sizes(self) -> int:
        """The number of sizes before the values."""
        return sum(kind.n_sizes for kind in self.kinds)

    def places(self, values: Mapping[str, Any]) -> dict[str, slice]:
        """Return the slice of the values of each parameter in the array p."""
        begin, found = self.n_sizes, {}
        for name, kind in zip(self.names, self.kinds, strict=True):
            value = values[name]
            count = sum(map(len, _parts(value))) if kind.ndim < 0 else np.size(value)
            found[name] = slice(begin, begin + count)
            begin += count
        return found

    def flat(self, values: Mapping[str, Any]) -> np.ndarray:
        """Return the array p of the kernels."""
        sizes: list[float] = []
        parts: list[np.ndarray] = []
        for name, kind in zip(self.names, self.kinds, strict=True):
            value = values[name]
            if kind.ndim < 0:
                sizes += [*value.shape, len(value.data), *([value.edge] if kind == BLOCKS else [])]
                parts += _parts(value)
            else:
                sizes += value.shape
                is_array = kind.is_whole and kind.ndim > 0
                parts.append(_bits(value.ravel()) if is_array else np.atleast_1d(value).ravel())
        return np.concatenate([np.array(sizes, dtype=np.float64), *parts], dtype=np.float64)

    def names_of(self, p: np.ndarray) -> list[str]:
        """Return the name of each entry of an array p of the kernels, with a number within arrays; sizes have none."""
        found = [""] * len(p)
        for name, places in self.places(self.read(p)._asdict()).items():
            count = places.stop - places.start
            found[places] = [name] if count == 1 else [f"{name}[{i}]" for i in range(count)]
        return found

    def read(self, p: np.ndarray) -> Any:
        """Return the parameters in an array p of the kernels as a named tuple, as functions get them."""
        return self._reader()(p)

    @functools.lru_cache(64)  # noqa: B019  a layout is small
    def _reader(self) -> Callable[[np.ndarray], Any]:
        text = "\n    ".join(["def read(p):", *self._views("p", self.names), f"return {self._tuple(self.names)}", ""])
        return define(text, "named", self._globals(self.names) | _PARTS_IN_PYTHON)["read"]

    def bind(self, function: Any, place: int = PLACE_OF_P) -> Any:
        """Return a jitted function of the array p that calls `function` with the named parameters.

        p is the argument at a `place`.

        It is the same object at each call. A function that is bound to another layout, such as the rhs of a problem, is
        bound anew. Objects that are not jitted functions are returned unchanged.

        Raises
        ------
        TypeError
            If the function reads a name that no parameter has, or is an event of a problem whose layout differs.
        """
        if isinstance(function, EnergyLessWork):
            return function._replace(energy=self.bind(function.energy))
        if isinstance(function, tuple):  # an output and its number of values
            return (self.bind(function[0]), *function[1:])
        if isinstance(function, Event):
            return dataclasses.replace(function, g=self.bind(function.g), apply=self.bind(function.apply))
        own = bound_layout(function)
        if not isinstance(function, Jitted) or own == self or (own is None and hasattr(function, "callback")):
            return function
        if hasattr(function, "callback"):  # a member of a `Family`
            raise TypeError(
                "params must have the names and kinds of the problem of these events, in the same order: give "
                "problem.params._replace(...)."
            )
        if own:
            return self.bind(function.py_func.inner, place)
        known = remembered(function, "in_layouts")
        if self not in known:
            known[self] = self._bound(function, place)
        return known[self]

    def bind_in_lanes(self, function: Any, values: Mapping[str, Any], own: Sequence[str]) -> Callable:
        """Return a Python function of the pair of arrays p that calls `function` with the named parameters.

        `values` are the parameters of a member: all members have the same sizes. The second array has the parameters
        `own`, with a value for each member. The first array has all.
        """
        key = self, tuple(own), tuple(np.shape(values[name]) for name in own)
        known = remembered(function, "in_lanes")
        if key not in known:
            read, first = self._read(function, PLACE_OF_P), 0
            lines = ["shared, own = {p}", *self._views("shared", read)]
            for name in own:
                k, shape = self.names.index(name), np.shape(values[name])
                sizes = "".join(f"{size}, " for size in shape)
                lines.append(
                    f"value_{k} = real_part(own, {first}, ({sizes}))" if shape else f"value_{k} = own[{first}]"
                )
                first += math.prod(shape)
            known[key] = self._calling(function, PLACE_OF_P, lines, read)
            known[key].inner = function
        return known[key]

    def bind_all(self, functions: Any) -> Any:
        """Return a dictionary of bound functions; other objects are returned unchanged."""
        if not isinstance(functions, Mapping):
            return functions
        return {name: self.bind(function) for name, function in functions.items()}

    def bind_method(self, method: Any) -> Any:
        """Return a method whose jacobian is bound, if it has one."""
        jacobian = getattr(method, "jacobian", None)
        return method if jacobian is None else dataclasses.replace(method, jacobian=self.bind(jacobian))

    def _bound(self, function: Any, place: int) -> Any:
        arguments = list(inspect.signature(function.py_func).parameters)
        if len(arguments) <= place:
            return function  # a later check names the arguments that it must have
        p = arguments[place]
        for name in attributes_of(function, place):
            if name not in self.names:
                raise unknown_name(f"{function.__name__} reads {p}.{name}, but params has", name, self.names)
        read = self._read(function, place)
        defined = self._calling(function, place, self._views(p, read), read)
        defined.__wrapped__ = function.py_func  # checks and errors then show the arguments of the user
        defined.inner, defined.layout = function, self  # these are pickled with the Python function
        return jit(defined)

    def _read(self, function: Any, place: int) -> tuple[str, ...]:
        """Return the names of the parameters that a function gets: those that it reads, to compile in less time."""
        if not reads_attributes_only(function, place):
            return self.names
        read = attributes_of(function, place)
        return tuple(name for name in self.names if name in read)

    def _calling(self, function: Any, place: int, lines: Sequence[str], read: Sequence[str]) -> Any:
        """Return a Python function that calls `function` with parameters that `lines` have read from {p}."""
        arguments = list(inspect.signature(function.py_func).parameters)
        given = [*arguments[:place], self._tuple(read), *arguments[place + 1 :]]
        name, p = name_in_source(function), arguments[place]
        head = f"def {name}({', '.join(arguments)}):"
        text = "\n    ".join([head, *lines, f"return inner_function({', '.join(given)})", ""]).replace("{p}", p)
        names = {**self._globals(read), **PARTS, "inner_function": function, "__name__": function.py_func.__module__}
        return define(text, "named", names)[name]

    def _tuple(self, read: Sequence[str]) -> str:
        """Return the text of the named tuple of the values of some parameters."""
        return f"Named({', '.join(f'value_{self.names.index(name)}' for name in read)})"

    def _globals(self, read: Sequence[str]) -> dict[str, Any]:
        """Return the globals of the lines that read some parameters from p."""
        return {"Named": _tuple_of(tuple(read)), "Sparse": Sparse}

    def _views(self, p: str, read: Sequence[str]) -> list[str]:
        """Return the lines that read some parameters from p, the k-th one as value_k: its sizes, and its place."""
        lines, size, end = [f"begin_0 = {self.n_sizes}"], 0, 0
        for k, kind in enumerate(self.kinds):
            lines += [f"size_{k}_{i} = int({p}[{size + i}])" for i in range(kind.n_sizes)]
            size += kind.n_sizes
            if kind.ndim < 0:
                edge = f"size_{k}_3" if kind == BLOCKS else "1"
                lines.append(f"indices_{k} = begin_{k} + size_{k}_2 * {edge} * {edge}")
                lines.append(f"indptr_{k} = indices_{k} + (size_{k}_2 + 1) // 2")
                lines.append(f"begin_{k + 1} = indptr_{k} + size_{k}_0 // {edge} + 1")
            else:
                count = " * ".join(f"size_{k}_{i}" for i in range(kind.ndim)) or "1"
                lines.append(f"begin_{k + 1} = begin_{k} + {count}")
            if self.names[k] in read:
                lines += self._values(k, kind, p)
                end = len(lines)
        return lines[:end]

    def _values(self, k: int, kind: Kind, p: str) -> list[str]:
        """Return the lines that read a parameter from p as value_k."""
        if kind.ndim == 0:
            return [f"value_{k} = {f'int({p}[begin_{k}])' if kind.is_whole else f'{p}[begin_{k}]'}"]
        if kind.ndim < 0:
            sizes = f"size_{k}_2, size_{k}_3, size_{k}_3" if kind == BLOCKS else f"size_{k}_2,"
            parts = (
                f"real_part({p}, begin_{k}, ({sizes}))",
                f"index_part({p}, indices_{k}, (size_{k}_2,))",
                f"whole_part({p}, indptr_{k}, (begin_{k + 1} - indptr_{k},))",
            )
            return [f"value_{k} = Sparse({', '.join(parts)}, (size_{k}_0, size_{k}_1))"]
        sizes = "".join(f"size_{k}_{i}, " for i in range(kind.ndim))
        return [f"value_{k} = {'whole' if kind.is_whole else 'real'}_part({p}, begin_{k}, ({sizes}))"]


def bound_layout(function: Any) -> Layout | None:
    """Return the layout to which a function is bound, or None."""
    return getattr(getattr(function, "py_func", None), "layout", None)


def unknown_name(
    said: str, name: str, names: Sequence[str], error: Callable[[str], Exception] = TypeError
) -> Exception:
    """Return the error for an unknown name, with similar names, or otherwise the first names."""
    near = get_close_matches(name, names, cutoff=0.5) or [*names]
    others = [f"one of {len(near) - _MOST_NAMES} others"] * (len(near) > _MOST_NAMES)
    return error(f"{said} no {name}: did you mean {' or '.join([*near[:_MOST_NAMES], *others])}?")


@functools.cache
def _tuple_of(names: tuple[str, ...]) -> Any:
    """Return the class of the tuple that functions get: the same class for the same names, which Numba requires."""
    return namedtuple("Parameters", names)


def _parts(matrix: Sparse) -> list[np.ndarray]:
    """Return the arrays of a sparse matrix as float64. One number stores two column indices, for speed."""
    columns = np.zeros(matrix.indices.size + matrix.indices.size % 2, dtype=np.int32)
    columns[: matrix.indices.size] = matrix.indices
    return [matrix.data.ravel(), columns.view(np.float64), _bits(matrix.indptr)]


def _bits(whole: np.ndarray) -> np.ndarray:
    """Return integers of 64 bits as float64 with the same bits."""
    return np.ascontiguousarray(whole, dtype=np.int64).view(np.float64)
