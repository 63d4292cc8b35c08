"""The weighted residuals of a fit, as functions of the parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..functions.checks import check_params
from ..functions.guard import BadStartError
from ..functions.records import check_left_out, left_out_of
from ..problem import Problem
from ..result.solution import Solution
from ..run.accuracy import LEAST
from ..run.chunks import IntegrationError
from ..run.fixed_run import divide
from ..run.variable_run import RATIO
from .data import Series
from .places import Place, said


class Model:
    """The difference between a model and the data.

    The options are h or rtol, method and others, as for `Problem.prepare`. `size` is the size of all weighted values
    together.
    """

    def __init__(
        self, problem: Problem, places: Sequence[Place], series: Sequence[Series], options: dict[str, Any]
    ) -> None:
        self.places, self.series, self.n_runs = places, series, 0
        self._problem, self._options = problem, options
        times = np.unique(np.concatenate([each.t for each in series]))
        self._run = problem.prepare(invariants={}, t_eval=times, **options)
        self._span, self._n_times = (problem.t_span[0], float(times[-1])), len(times)
        self._start = dict(zip(("u0", "v0"), map(np.array, problem.start), strict=True))
        self._start["params"] = np.array(check_params(problem.params))
        arrays = {**self._start, "z0": self._start["v0"]}
        self._entries = [(arrays[place.field], place.offset(problem)) for place in places]
        fitted = np.zeros(self._start["params"].size)
        fitted[[i for array, i in self._entries if array is self._start["params"]]] = 1.0
        check_left_out(left_out_of(problem.rhs), fitted)
        self._rows = [np.searchsorted(times, each.t) for each in series]
        values = np.concatenate([each.values for each in series])
        self._has_value = ~np.isnan(values)
        self._values = values[self._has_value]
        self._sigma = np.concatenate([each.sigma for each in series])[self._has_value]
        with np.errstate(over="ignore"):
            self.size = float(np.linalg.norm(self._values / self._sigma)) or 1.0
        if not np.isfinite(self.size):
            raise ValueError("data must have squares with a finite sum: take a larger unit for data and problem.")
        self._failure: Callable[[], Exception] | None = None

    def __len__(self) -> int:
        """The number of residuals: missing values have no residual."""
        return len(self._values)

    def run(self, x: np.ndarray) -> Solution:
        """Run with the values x, shape (p,), up to the last time of the data."""
        self.n_runs += 1
        for (array, index), value in zip(self._entries, x.tolist(), strict=True):
            array.flat[index] = value
        u0, v0 = (array if array.ndim else float(array) for array in (self._start["u0"], self._start["v0"]))
        params = self._start["params"]
        if self._run.rules:
            u0, v0 = self._run.rules.starts(np.size(self._problem.u0), self._span, u0, v0, params)
        return self._run.member(self._span, u0, v0, params, None)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return (model - data) / sigma; infinite if the run fails, after which SciPy tries a shorter step."""
        try:
            solution = self.run(x)
        except BadStartError as error:
            return self._failed(partial(ValueError, f"The run with {said(self.places, x)} fails: {error}"))
        if len(solution.t) < self._n_times:
            return self._failed(partial(self._ended, x.copy(), solution))
        found = [each.of(solution)[rows] for each, rows in zip(self.series, self._rows, strict=True)]
        with np.errstate(over="ignore", invalid="ignore"):
            residuals = (np.concatenate(found)[self._has_value] - self._values) / self._sigma
            if not np.isfinite(residuals @ residuals):
                return self._failed(partial(self._not_finite, x.copy(), found))
        return residuals

    def errors_of_steps(self, x: np.ndarray, residuals: np.ndarray) -> np.ndarray:
        """Estimate by how much the steps change the residuals at x, from a run with other steps; NaN if it fails.

        The run has half the step, or tolerances ten times smaller, or larger where smaller ones are not possible.
        """
        rtol, atol = self._options["rtol"], self._options["atol"]
        if rtol is None:
            ratio, power = 0.5, self._run.method.order
            others: dict[str, Any] = {"h": ratio * divide(*self._span, self._options["h"])[1]}
        else:
            ratio, power = (1 / RATIO if rtol >= LEAST else RATIO), 1
            others = {"rtol": ratio * rtol, "atol": None if atol is None else np.multiply(ratio, atol)}
        other = Model(self._problem, self.places, self.series, self._options | others)
        with np.errstate(invalid="ignore"):
            change = (residuals - other.residuals(x)) / (1 - ratio**power)
        return np.where(np.isfinite(change), change, np.nan)

    def raise_failure(self) -> None:
        """Raise the error of the last run that failed, if one did."""
        if self._failure:
            raise self._failure() from None

    def spread(self) -> float:
        """Return the standard deviation of the weighted data about the mean of each series; NaN for single values."""
        present = [(each, ~np.isnan(each.values)) for each in self.series]
        parts = [(x := each.values[mask]) - x.mean() for each, mask in present if mask.any()]
        freedom = len(self) - len(parts)
        return float(np.linalg.norm(np.concatenate(parts) / self._sigma) / np.sqrt(freedom)) if freedom else np.nan

    def by_series(self, residuals: np.ndarray) -> dict[str, np.ndarray]:
        """Return data minus model for each series, with NaN for missing values."""
        found = np.full(len(self._has_value), np.nan)
        found[self._has_value] = -residuals * self._sigma
        ends = np.cumsum([len(each.t) for each in self.series])[:-1]
        return {each.name: part for each, part in zip(self.series, np.split(found, ends), strict=True)}

    def _failed(self, failure: Callable[[], Exception]) -> np.ndarray:
        self._failure = failure
        return np.full(len(self), np.inf)

    def _ended(self, x: np.ndarray, solution: Solution) -> Exception:
        """Return the error of a run that ended before the last time of the data; `explain` names a shorter step."""
        message = f"The run with {said(self.places, x)} fails: {solution.explain()}"
        return IntegrationError(dataclasses.replace(solution, message=message))

    def _not_finite(self, x: np.ndarray, found: Sequence[np.ndarray]) -> Exception:
        for each, values in zip(self.series, found, strict=True):
            if not np.isfinite(values).all():
                return ValueError(f"{each.name} must be finite, but is not with {said(self.places, x)}.")
        return ValueError(f"The run with {said(self.places, x)} is too far from the data: give other first values.")
