"""Measured data: time series of quantities of a run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..functions.checks import reals, shown
from ..functions.layout import unknown_name
from ..problem import Problem
from ..result.solution import Solution

_ACCELERATION = re.compile(r"a\d*|a_.+|acc(eleration)?s?")  # names that a user may give to an acceleration


@dataclass(frozen=True, eq=False)
class Series:
    """A time series of one quantity.

    Attributes
    ----------
    name : str
    t, values, sigma : ndarray, shape (m,)
        Times, measured values (NaN if missing), and standard deviations of their noise.
    group, key : str
        Where the quantity is in a `Solution`: "u" or "v", or the name among the outputs or in z.
    column : int or None
        The column of the quantity; None if there is only one column.
    """

    name: str
    t: np.ndarray
    values: np.ndarray
    sigma: np.ndarray
    group: str
    key: str = ""
    column: int | None = None

    def of(self, solution: Solution) -> np.ndarray:
        """Return the quantity at the saved times of a run."""
        values = getattr(solution, self.group)
        values = values[self.key] if self.key else values
        return values if self.column is None else values[..., self.column]


def check_data(problem: Problem, data: Any, outputs: Mapping[str, Any], sigma: Any) -> list[Series]:
    """Return the series of data.

    Raises
    ------
    TypeError, ValueError
        If data or sigma is not as `eig3.fit` describes, or the problem has no quantity of a name.
    """
    known = _quantities(problem, outputs)
    data = _of_pandas(data)
    if not isinstance(data, Mapping):
        return _series("u", data, "data", {"group": "u"}, np.shape(problem.u0), sigma)
    if not data:
        raise ValueError("data must hold at least one series, such as {'u0': (times, values)}, but it is empty.")
    for name in data:
        if name not in known and _ACCELERATION.fullmatch(str(name)) and not any(map(_ACCELERATION.fullmatch, known)):
            raise ValueError(
                "data must have names of quantities, and accelerations are none: give an output that calls rhs, such "
                f"as outputs={{{str(name)!r}: ...}}."
            )
        if name not in known:
            raise unknown_name("data must have names of quantities, but there is", str(name), [*known], ValueError)
    if sigma is None and len(data) > 1:
        raise ValueError(
            "sigma must say how the series of data are weighted: give the standard deviation of the noise of each, "
            f"such as {{{next(iter(data))!r}: 0.1, ...}}."
        )
    found = []
    for name, pair in data.items():
        place, shape = known[name]
        found += _series(name, pair, f"data[{name!r}]", place, shape, _sigma_of(sigma, name))
    return found


def _of_pandas(data: Any) -> Any:
    """Convert a pandas table to a pair or a dictionary of pairs, without importing pandas; return other data as is."""
    if not hasattr(data, "to_numpy") or not hasattr(data, "index"):
        return data
    if hasattr(data, "columns"):
        return {name: (data.index.to_numpy(), data[name].to_numpy()) for name in data.columns}
    pair = data.index.to_numpy(), data.to_numpy()
    return pair if data.name is None else {data.name: pair}


def _quantities(problem: Problem, outputs: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], tuple[int, ...]]]:
    """Return the place in a `Solution` and the shape of each quantity, by name; outputs take precedence."""
    n, is_number = np.size(problem.u0), np.ndim(problem.u0) == 0
    known: dict[str, tuple[dict[str, Any], tuple[int, ...]]] = {}
    for letter in "uv":
        places = [{"group": letter, "column": None if is_number else j} for j in range(n)]
        if n == 1:
            known[letter] = places[0], ()
        else:
            known |= {f"{letter}{j}": (place, ()) for j, place in enumerate(places)}
        known |= {problem.labels.name(letter, j): (places[j], ()) for j in range(n) if problem.names}
    known |= {name: ({"group": "z", "key": name}, np.shape(x)) for name, x in problem.z0.items()}
    for name, shape in outputs.items():
        known[name] = {"group": "outputs", "key": name}, shape
    return known


def _sigma_of(sigma: Any, name: str) -> Any:
    if not isinstance(sigma, Mapping):
        return sigma
    if name not in sigma:
        raise ValueError(f"sigma must have the standard deviation of {name} too, as data has it.")
    return sigma[name]


def _series(
    name: str, pair: Any, argument: str, place: dict[str, Any], shape: tuple[int, ...], sigma: Any
) -> list[Series]:
    """Return a series, or one for each column of the values, after a check of their shapes."""
    if hasattr(pair, "to_numpy") and hasattr(pair, "index"):  # a pandas Series, by its name or another name
        pair = pair.index.to_numpy(), pair.to_numpy()
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise TypeError(f"{argument} must be a pair (times, values), not {shown(pair)}.")
    t, values = (reals(x, f"the {what} of {argument}") for what, x in zip(("times", "values"), pair, strict=True))
    if t.ndim != 1 or not t.size or values.shape != (*t.shape, *shape):
        needed = "(m,)" if not shape else f"(m, {shape[0]})"
        raise ValueError(
            f"{argument} must have m times of shape (m,) and values of shape {needed}, not {t.shape} and "
            f"{values.shape}."
        )
    if not np.isfinite(t).all() or np.isinf(values).any() or np.isnan(values).all():
        raise ValueError(f"{argument} must have finite times and values; only missing values may be NaN.")
    weights = np.ones(values.shape) if sigma is None else _checked_sigma(sigma, values, name)
    if not shape:
        return [Series(name, t, values, weights, **place)]
    columns = range(shape[0])
    separator = "{}{}" if name == "u" else "{}[{}]"
    return [Series(separator.format(name, j), t, values[:, j], weights[:, j], **place, column=j) for j in columns]


def _checked_sigma(sigma: Any, values: np.ndarray, name: str) -> np.ndarray:
    given = reals(sigma, "sigma")
    try:
        weights = np.broadcast_to(given, values.shape)
    except ValueError:
        raise ValueError(
            f"sigma of {name} must be a number or have the shape {values.shape} of the values, not {given.shape}."
        ) from None
    present = weights[~np.isnan(values)]
    if not (np.isfinite(present).all() and (present > 0).all()):
        raise ValueError(f"sigma of {name} must be positive and finite.")
    return weights
