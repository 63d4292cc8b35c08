"""The columns of runs and of ensembles: the values of each run, and of each saved state of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..functions.extremes import Extremes
from .status import Status

ONE, DEGREES, ANY = "one", "degrees", "any"


class Column(NamedTuple):
    """A field of a solution. In an ensemble, its array has the members on its first axis.

    Attributes
    ----------
    name : str
    kind : type
        Type of each value.
    shape : str
        The number of values: ONE; one for each of the DEGREES of freedom, without an axis in the scalar form; or ANY
        number, without an axis if the quantity has one value.
    of_states : bool
        Whether each saved state has a value, and not only each run. A directory of `save_to` has such columns in files.
    by_name : bool
        Whether the field is a dict with the values of several quantities.
    """

    name: str
    kind: type = float
    shape: str = ONE
    of_states: bool = False
    by_name: bool = False


COLUMNS = (
    Column("t", of_states=True),
    Column("u", shape=DEGREES, of_states=True),
    Column("v", shape=DEGREES, of_states=True),
    Column("steps", of_states=True),
    Column("outputs", shape=ANY, of_states=True, by_name=True),
    Column("z", shape=ANY, of_states=True, by_name=True),
    Column("h"),
    Column("n_steps", int),
    Column("n_rhs", int),
    Column("n_iterations", int),
    Column("n_rejected", int),
    Column("n_invariants", int),
    Column("status", Status),
    Column("message", str),
    Column("drift", by_name=True),
    Column("extremes", Extremes, shape=ANY, by_name=True),
)
OF_STATES = [column.name for column in COLUMNS if column.of_states]
OF_RUNS = [column.name for column in COLUMNS if not column.of_states]
ROWS = [column.name for column in COLUMNS if column.of_states and not column.by_name]


def each(function: Callable[..., Any], value: Any, *others: Any) -> Any:
    """Apply a function to the arrays of a column together with the arrays of other columns; a column may be None."""
    if value is None:
        return None
    if isinstance(value, Extremes):
        return Extremes(*(each(function, *parts) for parts in zip(value, *others, strict=True)))
    if isinstance(value, dict):
        return {name: each(function, x, *(other[name] for other in others)) for name, x in value.items()}
    return function(value, *others)
