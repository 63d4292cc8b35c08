"""Parameters with names for the members of an ensemble."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import check_callback, form_of
from ..functions.checks import shown
from ..functions.companions import remembered
from ..functions.guard import is_finite_at_start
from ..functions.layout import MOST_AXES, unknown_name
from ..functions.named import Parameters, has_names, in_layout
from ..functions.sparse import Sparse, is_of_scipy
from ..kernels.protocol import SCALAR, Form
from .member_tables import Table, table_of

_SIZES = (
    "params must have arrays of the same sizes for all members: resample records to the same times, add zeros at their "
    "ends, or take an ensemble for each size."
)


class OfMembers(NamedTuple):
    """Named parameters of members.

    Attributes
    ----------
    flat : ndarray, shape (m, k) or (1, k)
        The array p of each member, or of all members.
    own : tuple of str
        The names of the parameters with a value for each member.
    """

    flat: np.ndarray
    own: tuple[str, ...]


def of_members(changes: Any, base: Parameters) -> OfMembers:
    """Return the parameters of members, with changes of `base`, which has the unchanged values and the kinds.

    The changes are a mapping of new values, for all members or with a first axis of members; or the parameters of each
    member; or a table with a value for each member, as for `table_of`.

    Raises
    ------
    TypeError, ValueError
        If a name, a shape or a number of members is wrong.
    """
    layout = base.layout
    if isinstance(changes, list) and changes and all(map(_has_matrix, changes)):
        changes = [base._replace(**each) for each in changes]
    if _has_parameters_each(changes):
        rows = [np.asarray(in_layout(layout, each)) for each in changes]
        if any(row.size != rows[0].size for row in rows):
            raise ValueError(_SIZES)
        return OfMembers(np.array(rows), layout.names)
    table = changes if isinstance(changes, Table) else table_of(changes)
    given = _as_dict(changes) if table is None else table
    each: dict[str, np.ndarray] = {}
    shared = base._asdict()
    for name, value in given.items():
        if name not in layout.names:
            raise unknown_name("params has", name, layout.names)
        kind = layout.kinds[layout.names.index(name)]
        try:
            ndim = np.ndim(value)
        except ValueError:  # a list of arrays with different sizes
            raise ValueError(_SIZES) from None
        if table is not None or (kind.ndim >= 0 and ndim == kind.ndim + 1):
            each[name] = np.asarray(value)
        elif kind.ndim < 0 and isinstance(value, list | tuple | np.ndarray) and ndim != 2:
            raise ValueError(
                f"params[{name!r}] must be one sparse matrix for all members: for a matrix for each member, give "
                f"params=[{{{name!r}: ...}}, {{{name!r}: ...}}]."
            )
        else:
            shared[name] = value
    m = _common_length(each)
    first = in_layout(layout, {**shared, **{name: value[0] for name, value in each.items()}})
    flat, places = np.tile(np.asarray(first), (m, 1)), layout.places(first._asdict())
    for name, value in each.items():
        kind = layout.kinds[layout.names.index(name)]
        dtype = np.int64 if kind.is_whole and kind.ndim else np.float64
        flat[:, places[name]] = np.ascontiguousarray(value, dtype=dtype).reshape(m, -1).view(np.float64)
    return OfMembers(flat, tuple(each))


def split(rhs: Any, params: Any, t0: float, u0: ArrayLike, v0: ArrayLike, h: ArrayLike) -> tuple[OfMembers, Parameters]:
    """Return the parameters of the members, and the parameters of the first member.

    An array whose first axis has the length of the ensemble has a value for each member, and so has a table.

    Raises
    ------
    TypeError, ValueError
        As for `of_members`, and if the number of members is not clear, or if rhs could also take such an array as a
        whole.
    """
    if _has_parameters_each(params):
        return of_members(params, params[0]), params[0]
    table = table_of(params)
    if table is not None:
        base = Parameters({name: values[0] for name, values in table.items()})
        return of_members(table, base), base
    form = form_of(rhs)
    given, inner = _as_dict(params), 0 if form is SCALAR else 1
    axes = (np.shape(u0)[: np.ndim(u0) - inner], np.shape(v0)[: np.ndim(v0) - inner], np.shape(h))
    fixed = {axis[0] for axis in axes if axis} - {1}
    if len(fixed) > 1:
        raise ValueError(f"u0, v0 and h have first axes of different lengths, {fixed}, but these are the members.")
    dense = {name: value for name, value in given.items() if not (isinstance(value, Sparse) or is_of_scipy(value))}
    arrays = {name: len(value) for name, value in dense.items() if np.ndim(value)}
    counts = fixed or set(arrays.values())
    if len(counts) > 1:
        lengths = ", ".join(f"{name} {length}" for name, length in arrays.items())
        raise ValueError(
            f"params has arrays of different lengths ({lengths}): give u0 with a first axis of members, which says how "
            "many there are."
        )
    _refuse_none(counts)
    each = {name: value for name, value in given.items() if arrays.get(name) in counts}
    base = Parameters({name: np.asarray(value)[0] if name in each else value for name, value in given.items()})
    for name, value in each.items():
        may_be_shared = np.ndim(value) <= MOST_AXES and (fixed or len(each) > 1)
        if may_be_shared and _takes(rhs, form, {**base._asdict(), name: value}, t0, u0, v0):
            m = len(value)
            raise ValueError(
                f"params has an array {name} of the length {m} for {m} members, and rhs can also take it as a whole: "
                f"write {name}[:, None] for one value a member, or np.array([{name}] * {m}) for this array in all "
                "members."
            )
    return of_members(each, base), base


def _has_matrix(member: Any) -> bool:
    """Return whether the parameters of a member, in a dictionary, have a sparse matrix."""
    return isinstance(member, Mapping) and any(map(is_of_scipy, member.values()))


def _takes(rhs: Any, form: Form, params: Mapping[str, Any], t0: float, *starts: ArrayLike) -> bool:
    """Return whether a right-hand side compiles for parameters of these kinds, and is finite at the first start."""
    given = Parameters(params)
    bound, inner = given.layout.bind(rhs), 0 if form is SCALAR else 1
    refused = remembered(bound, "refused")
    if form.name in refused:
        return False
    try:
        callback = check_callback(bound, "rhs", form)
    except TypeError:
        refused[form.name] = True
        return False
    try:
        states = (np.asarray(x, dtype=np.float64) for x in starts)
        u, v = (x[0] if x.ndim > inner else x for x in states)
        return is_finite_at_start(callback, form, t0, u, v, np.asarray(given))
    except Exception:  # rhs raises it, or the initial values do not match
        return False


def with_lengths(error: TypeError, params: Any, m: int) -> TypeError:
    """Return the error of a function that does not compile; it names arrays with another length than the ensemble.

    Each member gets such an array as a whole, where the function may expect a number.
    """
    if isinstance(params, OfMembers) or not has_names(params) or "array(" not in str(error):
        return error
    shapes = {name: np.shape(value) for name, value in _as_dict(params).items()}
    others = {name: shape[0] for name, shape in shapes.items() if shape and shape[0] != m}
    if not others:
        return error
    said = ", ".join(f"params[{name!r}] has the length {length}" for name, length in others.items())
    text = str(error).rstrip(".")
    return TypeError(f"{text}: {said}, but there are {m} members; give {m} values, one for each member.")


def _has_parameters_each(params: Any) -> bool:
    return isinstance(params, list | tuple) and bool(params) and all(isinstance(each, Parameters) for each in params)


def _as_dict(params: Any) -> Mapping[str, Any]:
    if isinstance(params, Mapping):
        return params
    if hasattr(params, "_asdict"):
        return params._asdict()
    raise TypeError(f"params must be a dictionary of the parameters that change, not {shown(params)}.")


def _common_length(each: Mapping[str, np.ndarray]) -> int:
    """Return the number of members."""
    lengths = {name: len(value) for name, value in each.items()}
    if len(set(lengths.values())) > 1:
        words = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ValueError(f"params has values for different numbers of members: {words}.")
    _refuse_none(lengths.values())
    return next(iter(lengths.values()), 1)


def _refuse_none(counts: Collection[int]) -> None:
    if 0 in counts:
        raise ValueError("params must hold at least one member, but an array is empty.")
