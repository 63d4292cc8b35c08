"""`fit`: identify parameters and initial values of a problem from measured data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals, shown
from ..functions.layout import unknown_name
from ..functions.quantities import check_functions
from ..kernels.compile.interrupt import with_solution
from ..keywords import with_suggestions
from ..methods import Method
from ..notebook import of_repr
from ..problem import Problem
from .data import Series, check_data
from .estimates import correlation, covariance, early_note, far_note, is_doubtful, loose_note, steps_note
from .model import Model
from .picture import save
from .places import Place, changed, check_places, sizes

_TOLERANCE = 1e-10  # relative, for the sum of squares and for the parameters
_NO_GRADIENT = float(np.finfo(np.float64).eps)  # SciPy divides by zero if the gradient is zero at the start
_LONG = 0.25  # the longest step of a difference with tolerances, relative to the size of a parameter
_CLEAR = 10.0  # least change of the residuals over such a step, relative to their errors by the steps of the run
_TINY = 1e-6  # a scatter, relative to the size of the data, that round-off and the end of the search explain
_DIGITS = 16  # most digits of a value in texts
_AT_BOUND = 1e-6  # largest distance from a bound, relative to its size, of a parameter that the data push towards it
_ENDS = {
    0: "The fit did not converge within the largest number of runs: give better first values, or bounds.",
    1: "The fit ended, because the sum of squares does not decrease any more.",
    2: "The fit ended, because the parameters do not change any more.",
    3: "The fit ended, because the sum of squares does not decrease any more.",
    4: "The fit ended, because neither the sum of squares nor the parameters change any more.",
}


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Fitted parameters, and how well the data determine them.

    Attributes
    ----------
    values, errors : dict of str to float
        The parameters and their standard errors, by name. An error is NaN for a parameter at a bound, and infinite if
        the data do not determine the parameter.
    step_errors : dict of str to float
        By how much the time steps of the runs shift each parameter, estimated to the first order; NaN for a parameter
        that is held or not determined.
    covariance, correlation : ndarray, shape (p, p)
        The matrices of the parameters, in the order of `values`.
    residuals : dict of str to ndarray
        Data minus model, for each series of the data; NaN for a missing value.
    scatter : float
        The standard deviation of the residuals: without sigma in the unit of the data, with sigma in multiples of
        sigma. The latter is near 1 if sigma and the model are right.
    at_bound : tuple of str
        The parameters that ended at a bound or have equal bounds.
    problem : Problem
        The problem with the fitted parameters.
    success : bool
        Whether the search ended by itself, with residuals that are not larger than the spread of the data.
    status : int
        The status of SciPy's least_squares.
    message : str
        Sentences about the status, and about values that are not reliable.
    notes : tuple of str
        The notes of the run with the fitted parameters, as in `Solution.notes`.
    n_runs : int
        Number of runs.
    """

    values: dict[str, float]
    errors: dict[str, float]
    step_errors: dict[str, float]
    covariance: np.ndarray
    correlation: np.ndarray
    residuals: dict[str, np.ndarray]
    scatter: float
    at_bound: tuple[str, ...]
    problem: Problem
    success: bool
    status: int
    message: str
    notes: tuple[str, ...]
    n_runs: int
    _series: list[Series]
    _options: dict[str, Any]

    def plot(self, path: str | PathLike[str], *, units: Mapping[str, str] | None = None) -> Path:
        """Write a picture of the data, the fitted motion and the residuals.

        Parameters
        ----------
        path : str or path
            The file, whose suffix sets the format, such as ".png" or ".svg".
        units : dict of str to str
            Units of outputs and z by name, such as ``{"force": "N"}``. The problem has the units of u and v, and may
            have units of outputs.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        title = ", ".join(_with_error(name, value, self.errors[name]) for name, value in self.values.items())
        given = {each.name: _unit(self.problem, each) for each in self._series} | dict(units or {})
        run = self.problem.integrate(t_end=max(each.t.max() for each in self._series), **self._options)
        return save(Path(path), title, self._series, self.residuals, run, given)

    def __repr__(self) -> str:
        n_data = sum(np.count_nonzero(~np.isnan(x)) for x in self.residuals.values())
        lines = [f"Fit of {len(self.values)} parameters to {n_data} values, with {self.n_runs} runs:"]
        for name, value in self.values.items():
            by_steps = f"; error of the steps {self.step_errors[name]:.1g}" if name not in self.at_bound else ""
            lines.append(f"  {_with_error(name, value, self.errors[name])}{by_steps}")
        lines += [f"  scatter of the residuals: {self.scatter:.4g}", f"  {self.message}"]
        return "\n".join([*lines, *(f"  Note: {note}" for note in self.notes)])

    _repr_html_ = of_repr


@with_solution
@with_suggestions()
def fit(
    problem: Problem,
    data: Any,
    parameters: str | Iterable[str] | Mapping[str, float],
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    *,
    h: float | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    method: str | Method | None = None,
    outputs: Mapping[str, Any] | None = None,
    sigma: Any = None,
) -> Fit:
    """Identify parameters and initial values of a problem from data, by least squares.

    SciPy's ``least_squares`` (trust-region reflective) minimises the sum of ``((data - model) / sigma)**2`` over
    prepared runs, with ``t_eval`` at the times of the data. The page eig3/fitting/README.md has an example.

    Parameters
    ----------
    problem : Problem
        The runs end at the last time of the data.
    data : (times, values); or dict of str to (times, values); or pandas.Series or pandas.DataFrame
        Values of u, of shape (m,), or (m, n) for n degrees of freedom. Or time series by name, each with separate
        times: "u" or "v" with one degree of freedom, "u0", "v1" or the problem's names with several, outputs and
        z. In a pandas table, the index has the times, and the columns have these names. NaN marks a missing
        value.
    parameters : str or sequence of str; or dict of str to float
        Names as for `eig3.sensitivities`. The first values come from the dictionary, or from the problem.
    bounds : dict of str to (low, high)
        Bounds by name; None or infinite for no bound on a side. No run has values beyond them. Two equal bounds fix a
        parameter.
    h, rtol, atol, method, outputs
        As for `Problem.integrate`.
    sigma : float or array_like; or dict of str to float or array_like
        Standard deviation of the noise in the data, for all values or for each value. Without it, the standard errors
        come from the scatter of the residuals; data with several names need it.

    Returns
    -------
    Fit

    Raises
    ------
    TypeError, ValueError
        An argument is not valid; these errors are raised before anything runs. Or the motion or the acceleration with
        the first values is not finite.
    ImportError
        SciPy is not installed.
    IntegrationError
        The run with the first values, or a run for the derivatives, diverges. The error names the values and, if one
        was found, a step h with which the run does not diverge.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` is the interrupted run or ensemble; None between two runs.
    """
    places, outputs = check_places(problem, parameters), problem.unknowns.bind_all(outputs)
    series = check_data(problem, data, check_functions(None, outputs).shapes, sigma)
    problem = _first(problem, places, parameters)
    low, high = _check_bounds(problem, places, bounds or {})
    _check_times(problem, series)
    options: dict[str, Any] = {"h": h, "rtol": rtol, "atol": atol, "method": method, "outputs": outputs}
    model = Model(problem, places, series, options)
    n_free = np.count_nonzero(low < high)
    if len(model) < n_free + (sigma is None):
        least = f"at least {n_free + (sigma is None)} values for {n_free} parameters"
        raise ValueError(f"data must hold {least}{' and their scatter' * (sigma is None)}, not {len(model)}.")
    return _found(model, problem, (low, high), options, has_sigma=sigma is not None)


def _minimise(
    model: Model, first: np.ndarray, lengths: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], rtol: float | None
) -> Any:
    """Return SciPy's result, with all parameters in x, and J for the free parameters, scaled by their sizes.

    With a fixed step, SciPy's short differences give J. With tolerances, the steps of a run change with the parameters,
    and the states jump by about their errors: the differences are as long as the residuals need to change by more.
    """
    least_squares, (low, high) = _least_squares(), bounds
    free = low < high
    ends = low[free] / lengths[free], high[free] / lengths[free]

    def values(q: np.ndarray) -> np.ndarray:
        x = first.copy()
        x[free] = np.clip(q * lengths[free], low[free], high[free])  # a product may exceed a bound by its last bit
        return x

    last: dict[bytes, np.ndarray] = {}

    def residuals(q: np.ndarray) -> np.ndarray:
        """Return residuals of the size 1, from q of the size 1; SciPy asks twice in a row at some q."""
        if q.tobytes() not in last:
            last.clear()
            last[q.tobytes()] = model.residuals(values(q)) / model.size
        return last[q.tobytes()]

    jump, steps = 0.0, np.full(free.sum(), np.sqrt(rtol or 0.0))  # the steps grow until the residuals change by more
    if rtol is not None:
        of_steps = model.errors_of_steps(first, residuals(first[free] / lengths[free]) * model.size)
        jump = float(np.linalg.norm(np.nan_to_num(of_steps))) / model.size

    def derivatives(q: np.ndarray) -> np.ndarray:
        here, columns = residuals(q), []
        for i in range(len(q)):
            while True:
                there = q.copy()
                above, below = ends[1][i] - q[i], q[i] - ends[0][i]
                there[i] += min(steps[i], above) if above >= min(steps[i], below) else -min(steps[i], below)
                change = residuals(there) - here
                if np.linalg.norm(change) >= _CLEAR * jump or steps[i] >= _LONG:
                    break
                steps[i] *= 4
            columns.append(change / (there[i] - q[i]))
        return np.column_stack(columns)

    jac = "2-point" if rtol is None else derivatives
    limits = {"ftol": _TOLERANCE, "xtol": _TOLERANCE, "gtol": _NO_GRADIENT}
    try:
        with np.errstate(invalid="ignore"):  # from infinite residuals
            result = least_squares(residuals, first[free] / lengths[free], jac, bounds=ends, **limits)
            if rtol is None and is_doubtful(result.jac):
                result.jac = least_squares(residuals, result.x, jac="3-point", bounds=ends, max_nfev=1).jac
    except ValueError:  # from infinite residuals near a point
        model.raise_failure()
        raise
    result.x, result.fun, result.jac = values(result.x), result.fun * model.size, result.jac * model.size
    return result


def _found(
    model: Model,
    problem: Problem,
    bounds: tuple[np.ndarray, np.ndarray],
    options: dict[str, Any],
    *,
    has_sigma: bool,
) -> Fit:
    first, (low, high) = np.array([place.value(problem) for place in model.places]), bounds
    if not np.isfinite(model.residuals(first)).all():
        model.raise_failure()
    spans = np.where(np.isfinite(high - low) & (low < high), high - low, 1.0)
    lengths = sizes(problem, model.places, lambda: model.run(first), spans)
    result = _minimise(model, first, lengths, bounds, options["rtol"])
    is_free = low < high
    jacobian = np.zeros((len(model), len(first)))
    jacobian[:, is_free] = result.jac
    x, is_bound = _at_bounds(result.x, jacobian.T @ result.fun, lengths, bounds)
    residuals, notes = (result.fun if (x == result.x).all() else model.residuals(x)), model.run(x).notes
    freedom = len(residuals) - np.count_nonzero(~is_bound)
    scatter = float(np.sqrt(residuals @ residuals / freedom)) if freedom else np.nan
    matrix, is_loose = covariance(jacobian, lengths, ~is_bound, 1.0 if has_sigma else scatter**2)
    names, errors = [place.name for place in model.places], np.sqrt(np.diag(matrix))
    shifts, is_known = np.full(len(x), np.nan), ~is_bound & ~is_loose
    least = 1.0 if has_sigma else _TINY * model.size / np.sqrt(len(model))
    of_steps, far = model.errors_of_steps(x, residuals), far_note(scatter, model.spread(), least)
    shifts[is_known] = np.abs(np.linalg.pinv(jacobian[:, is_known]) @ of_steps)
    shifts *= lengths
    return Fit(
        values=dict(zip(names, x.tolist(), strict=True)),
        errors=dict(zip(names, errors.tolist(), strict=True)),
        step_errors=dict(zip(names, shifts.tolist(), strict=True)),
        covariance=matrix,
        correlation=correlation(matrix),
        residuals=model.by_series(residuals),
        scatter=scatter,
        at_bound=tuple(name for name, each in zip(names, is_bound, strict=True) if each),
        problem=changed(problem, model.places, x),
        success=bool(result.success) and not far,
        status=int(result.status),
        message=_ENDS[result.status]
        + far
        + early_note(jacobian[:, is_known], residuals, of_steps) * (result.status > 0)
        + steps_note(names, shifts, errors)
        + loose_note(names, is_loose, jacobian),
        notes=notes,
        n_runs=model.n_runs,
        _series=list(model.series),
        _options=options,
    )


def _least_squares() -> Any:
    try:
        from scipy.optimize import least_squares
    except ImportError as error:
        raise ImportError("a fit needs SciPy: pip install 'eig3[fitting]'.") from error
    return least_squares


def _at_bounds(
    x: np.ndarray, gradient: np.ndarray, lengths: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters, with the exact value of a bound if they are at it, and a mask of these parameters."""
    low, high = bounds
    is_low = ((x - low <= _AT_BOUND * lengths) & (gradient > 0)) | (low == high)
    is_high = (high - x <= _AT_BOUND * lengths) & (gradient < 0)
    return np.where(is_low, low, np.where(is_high, high, x)), is_low | is_high


def _first(problem: Problem, places: Sequence[Place], parameters: Any) -> Problem:
    """Return the problem with the first values of the parameters."""
    if not isinstance(parameters, Mapping):
        return problem
    values = [reals(value, f"parameters[{name!r}]") for name, value in parameters.items()]
    for name, value in zip(parameters, values, strict=True):
        if value.ndim or not np.isfinite(value):
            raise ValueError(f"parameters[{name!r}] must be a finite first value, not {shown(parameters[name])}.")
    return changed(problem, places, np.array(values))


def _check_bounds(problem: Problem, places: Sequence[Place], bounds: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest values of the parameters."""
    if not isinstance(bounds, Mapping):
        raise TypeError(f"bounds must be a dictionary such as {{'k': (0, 10)}}, not {shown(bounds)}.")
    names = [place.name for place in places]
    low, high = np.full(len(places), -np.inf), np.full(len(places), np.inf)
    for name, pair in bounds.items():
        if name not in names:
            raise unknown_name("bounds must have names of parameters, which have", str(name), names, ValueError)
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise TypeError(f"bounds[{name!r}] must be a pair (low, high), not {shown(pair)}.")
        i = names.index(name)
        ends = zip(pair, (-np.inf, np.inf), strict=True)
        low[i], high[i] = reals([free if end is None else end for end, free in ends], f"bounds[{name!r}]")
        value = places[i].value(problem)
        if not low[i] <= high[i]:
            raise ValueError(f"bounds[{name!r}] must be (low, high) with low <= high, not {shown(pair)}.")
        if not low[i] <= value <= high[i]:
            raise ValueError(
                f"bounds[{name!r}] = ({low[i]:g}, {high[i]:g}) must contain the first value {value:g}: give another, "
                f"such as parameters={{{name!r}: {_inside(low[i], high[i]):g}, ...}}."
            )
    if (low == high).all():
        raise ValueError("bounds must leave one parameter free, but the two bounds of each are equal.")
    return low, high


def _inside(low: float, high: float) -> float:
    if np.isfinite(low) and np.isfinite(high):
        return (low + high) / 2
    return low + abs(low) + 1 if np.isfinite(low) else high - abs(high) - 1


def _check_times(problem: Problem, series: Sequence[Series]) -> None:
    """Refuse data that are not within the span of the problem."""
    begin, end = problem.t_span
    first, last = min(each.t.min() for each in series), max(each.t.max() for each in series)
    if first < begin or last > end:
        raise ValueError(
            f"data must have times within the problem's t_span = ({begin:g}, {end:g}), not {first:g} to {last:g}: give "
            "problem.with_(t_span=...)."
        )
    if last == begin:
        raise ValueError(f"data must have a time after the start of the run at t = {begin:g}.")


def _unit(problem: Problem, series: Series) -> str:
    """Return the unit of a series; empty if it is not known."""
    if series.group in ("u", "v"):
        return problem.unit(series.group, series.column or 0)
    return problem.labels.output_unit(series.key, series.column or 0) if series.group == "outputs" else ""


def _with_error(name: str, value: float, error: float) -> str:
    """Return a value with its significant digits, such as "k = 4.003 +- 0.012"."""
    if np.isnan(error):
        return f"{name} = {value:.6g} (held)"
    if not 0 < error < np.inf:
        return f"{name} = {value:.6g} +- {error:g}"
    digits = int(np.floor(np.log10(max(abs(value), error)))) - int(np.floor(np.log10(error)))
    return f"{name} = {value:#.{min(digits + 2, _DIGITS)}g} +- {error:#.2g}"
