"""Solutions as tables of pandas and as datasets of xarray."""

from __future__ import annotations

import collections
import importlib
from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from ..functions.checks import distinct
from .labels import Labels

_OF_EXTREMES = "minimum", "time of minimum", "maximum", "time of maximum", "peak"
_LONGEST = 24  # values of a parameter with columns: a record of the ground has none
_PLAIN = Labels(units="")  # of degrees of freedom without names

Column = tuple[str, np.ndarray, str]  # its name, its values and its unit


def to_pandas(solution: Any) -> Any:
    """Return a `Solution` as a DataFrame, as `Solution.to_pandas` describes."""
    pandas = _module("pandas")
    frame = _frame(columns_of(solution), pandas.Index(solution.t, name="t"))
    frame.attrs.update(_attributes(solution))
    return frame


def occurrences_to_pandas(found: Any, **keys: np.ndarray) -> Any:
    """Return the occurrences of an event as a DataFrame, after the columns `keys`."""
    return _frame([*((name, x, "") for name, x in keys.items()), *columns_of(found), *columns_of(found, "_after")])


def to_xarray(solution: Any) -> Any:
    """Return a `Solution` as a Dataset, as `Solution.to_xarray` describes."""
    return _dataset(solution, ("t",), {"t": solution.t}, {}, _attributes(solution))


def ensemble_to_pandas(solution: Any) -> Any:
    """Return an `EnsembleSolution` as a DataFrame, as `EnsembleSolution.to_pandas` describes."""
    table = solution._table()
    frame = _frame([("member", table.member, ""), ("t", table.t, ""), *columns_of(table)])
    frame.attrs.update(method=repr(solution.method))
    return frame


def ensemble_summary(solution: Any) -> Any:
    """Return a DataFrame with a row for each member, as `EnsembleSolution.summary` describes."""
    pandas = _module("pandas")
    index = pandas.Index(solution.first + np.arange(len(solution)), name="member")
    columns = distinct(_of_members(solution))
    frame = pandas.DataFrame(_parameters_beside(solution, columns) | columns, index=index)
    frame.attrs.update(method=repr(solution.method))
    return frame


def _of_members(solution: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the values of each column of a summary, without the parameters."""
    yield "status", np.array([status.value for status in solution.status])
    for name in ("h", "n_steps", "n_rhs"):
        yield name, getattr(solution, name)
    for name, drift in solution.drift.items():
        yield f"drift of {name}", drift
    yield from _events(solution)
    for name, found in solution.extremes.items():
        values = (found.low, found.t_low, found.high, found.t_high, found.peak)
        for what, column in zip(_OF_EXTREMES, values, strict=True):
            yield from _named(solution, name, column, f"{what} of ")
    table = solution._table()
    members = solution.first + np.arange(len(solution))
    first, end = (np.searchsorted(table.member, members, side=side) for side in ("left", "right"))
    has_states = first < end  # t_eval may begin after the end of a member
    for name, column, _ in (("t", table.t, ""), *columns_of(table)):
        last = np.full(len(members), np.nan)
        last[has_states] = column[end[has_states] - 1]
        yield name, last


def _events(solution: Any) -> Iterator[tuple[str, np.ndarray]]:
    for name, occurrences in solution.events.items():
        yield f"count of {name}", np.bincount(occurrences.member, minlength=len(solution))
        yield f"first {name}", occurrences.first


def _parameters_beside(solution: Any, columns: Collection[str]) -> dict[str, np.ndarray]:
    """Return the parameters that differ between members; a name that a column has, such as h, gets a prefix: p.h."""
    found = _varied_parameters(solution)
    return {f"p.{name}" if name in columns else name: values for name, values in found}


def _varied_parameters(solution: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the parameters that are not the same in all members, without long arrays."""
    p = solution.params
    if p.ndim == 1:
        return
    layout = solution._layout
    names = layout.names_of(p[0]) if layout else [f"p[{i}]" for i in range(p.shape[1])]
    whole = [name.partition("[")[0] for name in names]
    counts = collections.Counter(whole) if layout else {}
    kinds = dict(zip(layout.names, layout.kinds, strict=True)) if layout else {}
    bits = np.ascontiguousarray(p).view(np.int64)  # the values of arrays of integers, which may look like NaN in p
    for i in np.flatnonzero((bits != bits[:1]).any(axis=0)):
        if counts.get(whole[i], 0) <= _LONGEST:
            kind = kinds.get(whole[i])
            yield names[i], (bits if kind and kind.is_whole and kind.ndim else p)[:, i]


def ensemble_to_xarray(solution: Any) -> Any:
    """Return an `EnsembleSolution` as a Dataset, as `EnsembleSolution.to_xarray` describes."""
    has_one_time = not solution.t.strides[0]
    axes = ("member", "t" if has_one_time else "row")
    coordinates = {
        "member": solution.first + np.arange(len(solution)),
        "t": solution.t[0] if has_one_time else (axes, solution.t),
    }
    status = np.array([status.value for status in solution.status])
    of_members = {"h": solution.h, "n_steps": solution.n_steps, "status": status, **dict(_events(solution))}
    further = {name: ("member", values) for name, values in of_members.items()}
    dataset = _dataset(solution, axes, coordinates, further, {"method": repr(solution.method)})
    parameters = _parameters_beside(solution, [*dataset.variables, *dataset.dims])
    return dataset.assign_coords({name: ("member", values) for name, values in parameters.items()})


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ImportError(f"to_{name} needs {name}: pip install 'eig3[{name}]'.") from None


def _attributes(solution: Any) -> dict[str, Any]:
    method, status = repr(solution.method), solution.status.value
    return {"status": status, "message": solution.message, "method": method, "h": solution.h}


def _frame(columns: Iterable[Column], index: Any = None) -> Any:
    """Return a DataFrame of columns, with the known units by column in its attribute "units"."""
    named = [*columns]
    frame = _module("pandas").DataFrame(distinct((name, values) for name, values, _ in named), index=index)
    frame.attrs["units"] = {name: unit for name, _, unit in named if unit}
    return frame


def columns_of(states: Any, after: str = "") -> Iterator[Column]:
    """Yield each column of the states of a solution, or of occurrences before or "_after" the event."""
    labels = states.labels or _PLAIN
    for letter in "uv":
        for i, values in enumerate(np.atleast_2d(getattr(states, letter + after).T)):
            yield labels.name(letter, i) + after, values, labels.unit(letter, i)
    for name, values in (*getattr(states, "outputs", {}).items(), *getattr(states, "z" + after).items()):
        for i, (key, column) in enumerate(_named(states, name, values)):
            yield key + after, column, labels.output_unit(name, i)


def _named(states: Any, name: str, values: np.ndarray, what: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the columns of an output or of z: its name, with the name or the number of each of several values."""
    if values.ndim == 1:
        yield what + name, values
    else:
        labels = (states.labels or _PLAIN).values(name, values.shape[1])
        yield from ((f"{what}{name}[{label}]", column) for label, column in zip(labels, values.T, strict=True))


def _units(labels: Labels | None, n: int) -> dict[str, list[str]]:
    """Return the unit of "u" and "v" in each degree of freedom; an empty dict if the units are not known."""
    if not (labels and labels.units):
        return {}
    return {letter: [labels.unit(letter, i) for i in range(n)] for letter in "uv"}


def _dataset(
    solution: Any,
    axes: tuple[str, ...],
    coordinates: dict[str, Any],
    further: dict[str, Any],
    attributes: dict[str, Any],
) -> Any:
    """Return u, v, outputs and z over `axes`, and in the vector form over "dof", with `further` variables.

    Units that differ are a coordinate: as an attribute, NetCDF files of SciPy could not have them.
    """
    xarray = _module("xarray")
    has_degrees = solution.u.ndim > len(axes)
    n = solution.u.shape[-1] if has_degrees else 1
    labels = solution.labels or _PLAIN
    if has_degrees:
        coordinates["dof"] = list(labels.names) or np.arange(n)
    units = _units(solution.labels, n)
    common = {letter: {"units": of_all[0]} for letter, of_all in units.items() if len({*of_all}) == 1}
    coordinates |= {f"unit_of_{x}": ("dof", of_all) for x, of_all in units.items() if x not in common}
    dims = (*axes, "dof") if has_degrees else axes
    variables = [*((x, (dims, getattr(solution, x), common.get(x, {}))) for x in "uv"), *further.items()]
    for name, values in (*solution.outputs.items(), *solution.z.items()):
        has_one, component = values.ndim == len(axes), f"{name} component"
        of_all = [labels.output_unit(name, i) for i in range(1 if has_one else values.shape[-1])]
        attributes_of = {"units": of_all[0]} if of_all[0] and len({*of_all}) == 1 else {}
        if len({*of_all}) > 1:
            coordinates[f"unit_of_{name}"] = component, of_all
        variables.append((name, (axes if has_one else (*axes, component), values, attributes_of)))
    coordinates |= {f"{name} component": list(values) for name, values in labels.columns}
    dataset = xarray.Dataset(distinct([*coordinates.items(), *variables]), attrs=attributes)
    return dataset.set_coords([*coordinates])
