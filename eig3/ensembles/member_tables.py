"""Parameters of members as a table: a DataFrame with a row a member, or a list with the named parameters of each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..functions.callbacks import names_read
from ..functions.checks import reals, shown
from ..functions.named import Parameters, has_names


class Table(dict[str, np.ndarray]):
    """The values of each parameter by its name, with a first axis of members."""


def is_table(params: Any, rhs: Any) -> bool:
    """Whether parameters are a table. A function of the array p takes the rows of the others as arrays."""
    if _is_frame(params):
        return bool(names_read(rhs))
    if not _is_list(params) or not any(map(has_names, params)):
        return False
    return not all(isinstance(each, tuple | Parameters) for each in params) or bool(names_read(rhs))


def table_of(params: Any) -> Table | None:
    """Return a table by its columns; None for other parameters.

    Raises
    ------
    TypeError, ValueError
        If a member has other names than the first one, a value is missing or not a number, or there is no member.
    """
    if _is_frame(params):
        columns = {name: params[name] for name in params.columns}
        if not len(params):
            raise ValueError("params must hold at least one member, but the table has no rows.")
    elif _is_list(params) and any(map(has_names, params)):
        columns = _columns_of(params)
    else:
        return None
    return Table({name: _values(name, column) for name, column in columns.items()})


def _is_frame(params: Any) -> bool:
    """Whether this is a DataFrame, of pandas or of another package."""
    return hasattr(params, "columns") and not has_names(params)


def _is_list(params: Any) -> bool:
    return isinstance(params, list | tuple) and not has_names(params)


def _columns_of(members: Any) -> dict[str, list]:
    rows = []
    for i, member in enumerate(members):
        if not has_names(member):
            raise TypeError(
                f"params[{i}] must be a dictionary or a NamedTuple as the other members, not {shown(member)}."
            )
        rows.append(member._asdict() if hasattr(member, "_asdict") else member)
        if rows[i].keys() != rows[0].keys():
            first, other = (", ".join(map(str, row)) or "none" for row in (rows[0], rows[i]))
            raise ValueError(
                f"params must have the same names in all members, but they are {first} in params[0] and {other} in "
                f"params[{i}]: give each member a value of each."
            )
    return {name: [row[name] for row in rows] for name in rows[0]}


def _values(name: Any, column: Any) -> np.ndarray:
    """Return the values of a parameter in all members."""
    try:
        values = np.asarray(column)
        values = np.array([*values]) if values.dtype == object else values  # the cells are arrays, or not numbers
    except ValueError:
        raise ValueError(
            f"params must have values of {name} of the same shape in all members: resample records to the same times, "
            "add zeros at their ends, or take an ensemble for each shape."
        ) from None
    if values.dtype.kind not in "buif":
        raise TypeError(f"params must have numbers in {name}, not {shown(values)}: leave out what is not a parameter.")
    is_missing = np.isnan(reals(values, name)).reshape(len(values), -1).any(axis=1)
    if is_missing.any():
        raise ValueError(
            f"params has no value of {name} in row {int(np.argmax(is_missing))}: fill it in, or drop the row."
        )
    return values
