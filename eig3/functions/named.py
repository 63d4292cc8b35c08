"""Named parameters: numbers, arrays and sparse matrices, which functions read as ``p.k``, ``p.K.data``, ..."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .checks import reals, shown
from .layout import BLOCKS, MOST_AXES, SPARSE, Kind, Layout, bound_layout, unknown_name
from .sparse import Sparse, has_blocks, is_of_scipy

_MOST_COLUMNS = 2**31  # the indices of columns have 32 bits
WITHOUT_NAMES = np.ndarray, tuple, list, float, int  # a NamedTuple is of another type


class Parameters:
    """Immutable named parameters.

    ``p.k`` and ``p["k"]`` are the parameter k. `numpy.asarray` gives the array that kernels get. `Problem.params` has
    this type if the parameters have names. A function decorated with `eig3.jit` takes them in a call from Python.

    Parameters
    ----------
    values : NamedTuple, or mapping of str
        Numbers, integers, arrays of numbers with one or two axes, and sparse matrices of SciPy.

    Raises
    ------
    TypeError, ValueError
        If a name or a value is not valid.
    """

    __slots__ = ("_flat", "_known", "_values", "layout")

    def __init__(self, values: Any) -> None:
        given = values._asdict() if hasattr(values, "_asdict") else values
        found, kinds = {}, []
        for name, value in given.items():
            _check_name(name)
            found[name], kind = _converted(value, f"params[{name!r}]")
            kinds.append(kind)
        object.__setattr__(self, "_values", found)
        object.__setattr__(self, "layout", Layout(tuple(found), tuple(kinds)))
        object.__setattr__(self, "_flat", self.layout.flat(found))
        object.__setattr__(self, "_known", ())  # see `records.longest_step`
        self._flat.flags.writeable = False

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self._flat, dtype=dtype)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self[name]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"parameters cannot be changed: take params._replace({name}=...).")

    def __getitem__(self, name: str) -> Any:
        if name not in self._values:
            raise unknown_name("params has", name, self.layout.names, AttributeError)
        return self._values[name]

    def __iter__(self) -> Any:
        raise TypeError("parameters with names have no order: read params._asdict().")

    def _asdict(self) -> dict[str, Any]:
        return dict(self._values)

    def _as_argument_of(self, function: Any) -> Any:
        """Return what a function gets in a run: the array if it is bound to a layout, otherwise a named tuple."""
        return self._flat if bound_layout(function) else self.layout.read(self._flat)

    def _replace(self, **changes: Any) -> Parameters:
        """Return parameters with some values replaced, of the same kinds."""
        for name in changes:
            if name not in self._values:
                raise unknown_name("params has", name, self.layout.names)
        return in_layout(self.layout, {**self._values, **changes})

    def __eq__(self, other: object) -> bool:
        same = isinstance(other, Parameters) and self.layout == other.layout
        return same and self._flat.tobytes() == other._flat.tobytes()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((self.layout, self._flat.tobytes()))

    def __reduce__(self) -> tuple:
        return Parameters, (self._values,)

    def __repr__(self) -> str:
        return f"Parameters({', '.join(f'{name}={_brief(value)}' for name, value in self._values.items())})"


def has_names(params: Any) -> bool:
    """Whether parameters have names."""
    if type(params) in WITHOUT_NAMES:  # `isinstance` takes a microsecond
        return False
    return isinstance(params, (Parameters, Mapping)) or (isinstance(params, tuple) and hasattr(params, "_fields"))


def named(params: Any) -> Any:
    """Return `Parameters` for named parameters; return other parameters unchanged."""
    if not has_names(params) or isinstance(params, Parameters):
        return params
    return () if isinstance(params, Mapping) and not params else Parameters(params)


def in_layout(layout: Layout | None, params: Any) -> Any:
    """Return parameters for functions that are bound to a layout; None for functions of the array p.

    Raises
    ------
    TypeError, ValueError
        If the names or kinds differ from the layout.
    """
    params = named(params)
    if isinstance(params, Parameters) and params.layout == layout:
        return params
    if layout is None:
        if isinstance(params, Parameters):
            raise TypeError(
                f"params has the names {', '.join(params.layout.names)}, but the run was prepared for an array: give "
                "params, or an example of them, to eig3.prepare too."
            )
        return params
    if not isinstance(params, Parameters):
        raise TypeError(f"params must have the names {', '.join(layout.names)}, and not be {shown(params)}.")
    for name in (*params.layout.names, *layout.names):
        if name not in layout.names:
            raise unknown_name("params has", name, layout.names, TypeError)
        if name not in params.layout.names:
            given = params.layout.names[0]
            raise TypeError(
                f"params must have {name} too: its names are {', '.join(layout.names)}. To change some values only, "
                f"give all by _replace, such as problem.params._replace({given}=...)."
            )
    values = {name: params[name] for name in layout.names}
    for name, kind in zip(layout.names, layout.kinds, strict=True):
        own = params.layout.kinds[params.layout.names.index(name)]
        if own == kind._replace(is_whole=True) and not kind.is_whole:
            values[name] = np.asarray(values[name], dtype=np.float64)  # 1 for 1.0
        elif own != kind:
            hint = "; write 1.0 at first for a number that may be whole" if own == kind._replace(is_whole=False) else ""
            raise TypeError(f"params[{name!r}] must be {_described(kind)}, as at first, not {_described(own)}{hint}.")
    return Parameters(values)


def _converted(value: Any, what: str) -> tuple[Any, Kind]:
    """Return a value of a parameter in the form that `Layout` takes, and its kind."""
    if is_of_scipy(value):
        rows = (value.tobsr if has_blocks(value) else value.tocsr)(copy=True)
        rows.sum_duplicates()
        n_rows, n_columns = map(int, rows.shape)
        if n_columns > _MOST_COLUMNS:
            raise ValueError(f"{what} must have at most 2^31 columns, not {n_columns}.")
        indices, indptr = rows.indices.astype(np.int32), rows.indptr.astype(np.int64)
        value = Sparse(reals(rows.data, f"{what}.data"), indices, indptr, (n_rows, n_columns))
    if isinstance(value, Sparse):
        return value, SPARSE if value.edge == 1 else BLOCKS
    array = np.asarray(value)
    is_whole = array.dtype.kind in "bui"
    array = np.array(array, dtype=np.int64, order="C") if is_whole else reals(value, what)
    if array.ndim > MOST_AXES:
        raise ValueError(f"{what} must have at most {MOST_AXES} axes, not the shape {array.shape}.")
    kind = Kind(is_whole, array.ndim)
    if kind == Kind(is_whole=True, ndim=0) and abs(int(array)) >= 2**53:
        raise ValueError(f"{what} must be an integer below 2^53, not {int(array)}.")
    array.flags.writeable = False
    return (array[()] if array.ndim == 0 else array), kind


def _check_name(name: Any) -> None:
    if not isinstance(name, str) or not name.isidentifier() or name.startswith("_"):
        raise TypeError(f"the names in params must be names of Python without _ in front, not {shown(name)}.")


def _described(kind: Kind) -> str:
    if kind.ndim < 0:
        return "a sparse matrix" if kind == SPARSE else "a sparse matrix of blocks"
    values = "integer" if kind.is_whole else "number"
    article = "an" if kind.is_whole else "a"
    return f"{article} {values}" if kind.ndim == 0 else f"an array of {values}s with {kind.ndim} axes"


def _brief(value: Any) -> str:
    if isinstance(value, Sparse):
        return f"<sparse {value.shape[0]} x {value.shape[1]}, {value.data.size} entries>"
    if np.ndim(value) and np.size(value) > 8:
        return f"<array {' x '.join(map(str, np.shape(value)))}>"
    return repr(value.tolist() if hasattr(value, "tolist") else value)
