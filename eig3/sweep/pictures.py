"""The picture of a parameter study: curves, maps, or histograms of a random sample."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..result.labels import with_unit
from ..result.solution import Status
from .measures import Measure
from .study import Study

_CURVES = 5  # up to this number of values of an axis, a curve for each value; with more values, a map
_FEW = 60  # a curve through fewer members also has dots
_MOST_BINS = 40
_QUANTILES = {"5 %": (0.05, "--"), "median": (0.5, "-"), "95 %": (0.95, "--")}  # their lines in a histogram
_MANY = 1000  # with more members, the dots are small
_SCATTERED = 20_000  # largest number of members drawn as dots


def draw(figure: Any, study: Study) -> None:
    """Draw a study on an empty matplotlib figure."""
    rows = len(study.measures)
    if study.seed is not None:
        _samples(figure, study)
        figure.set_size_inches(3.6 * (1 + len(study.axes)) + 0.5, 2.8 * rows + 0.7)
    elif min(study.shape) <= _CURVES or len(study.shape) == 1:
        _curves(figure, study)
        figure.set_size_inches(8.5, 2.9 * rows + 0.7)
    else:
        _maps(figure, study)
        figure.set_size_inches(7.5, 5.2 * rows + 0.7)
    _title(figure, study)


def _title(figure: Any, study: Study) -> None:
    second = study.problem.labels.second
    title = f"{study.problem.name}, {study.method.label}, h = {study.h:.3g}{second}"
    if study.after is not None:
        title += f", from t = {study.after:g}{second} on"
    diverged = np.count_nonzero(study.status == Status.DIVERGED)
    if diverged:
        title += f"\n{diverged} of {len(study)} members diverged"
    figure.suptitle(title, parse_math=False)


def _label(study: Study, name: str) -> str:
    return with_unit(name, study.parameters.unit(name, study.problem))


def _scale(study: Study, name: str) -> str:
    return "log" if next(axis for axis in study.axes if axis.name == name).is_log else "linear"


def _curves(figure: Any, study: Study) -> None:
    """Draw each measure against one axis, with a curve for each value of the other axis, if any."""
    grids = {name: column.reshape(study.shape) for name, column in study.columns.items()}
    along = int(np.argmax(study.shape))  # the axis of the abscissa
    name, *others = [study.axes[along].name, *(axis.name for axis in study.axes if axis is not study.axes[along])]
    x = np.moveaxis(grids[name], along, -1).reshape(-1, study.shape[along])
    panels = figure.subplots(len(study.measures), sharex=True, squeeze=False)[:, 0]
    for axes, measure in zip(panels, study.measures, strict=True):
        y = np.moveaxis(study.values[str(measure)].reshape(study.shape), along, -1).reshape(x.shape)
        for row in range(len(x)):
            label = f"{others[0]} = {np.moveaxis(grids[others[0]], along, -1)[row, 0]:.6g}" if others else None
            style = "--" if row % 2 else "-"  # curves may coincide
            axes.plot(x[row], y[row], style, linewidth=1.2, marker="." if x.shape[1] < _FEW else "", label=label)
        missing = ~np.isfinite(y)
        if missing.any():
            edge = axes.get_xaxis_transform()
            axes.plot(x[missing], np.full(missing.sum(), 0.02), "x", color="C3", transform=edge, label="no result")
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
        axes.set(ylabel=measure.label(study.problem), xscale=_scale(study, name))
        axes.grid(alpha=0.35)
        axes.margins(x=0.01)
    panels[-1].set_xlabel(_label(study, name))


def _maps(figure: Any, study: Study) -> None:
    """Draw a map of each measure over both axes; members without a result are grey."""
    first, second = (axis.name for axis in study.axes)
    x, y = (study.columns[name].reshape(study.shape) for name in (first, second))
    panels = figure.subplots(len(study.measures), squeeze=False)[:, 0]
    for axes, measure in zip(panels, study.measures, strict=True):
        values = np.ma.masked_invalid(study.values[str(measure)].reshape(study.shape))
        image = axes.pcolormesh(x, y, values, shading="nearest", rasterized=True, **_colours(values))
        axes.set_facecolor("0.8")
        axes.set(xscale=_scale(study, first), yscale=_scale(study, second))
        axes.set(xlabel=_label(study, first), ylabel=_label(study, second))
        figure.colorbar(image, ax=axes, label=measure.label(study.problem))
        if np.ma.is_masked(values):
            axes.set_title("grey: no result", fontsize="medium")


def _colours(values: np.ma.MaskedArray) -> dict[str, Any]:
    """Return the options of a map: colours that differ by sign if the values have both signs."""
    if values.count() and values.min() < 0 < values.max():
        size = float(np.abs(values).max())
        return {"cmap": "RdBu_r", "vmin": -size, "vmax": size}
    return {"cmap": "viridis"}


def _samples(figure: Any, study: Study) -> None:
    """Draw a histogram of each measure, with quantiles, and the measure against each swept parameter."""
    panels = figure.subplots(len(study.measures), 1 + len(study.axes), squeeze=False, sharey="row")
    for row, measure in zip(panels, study.measures, strict=True):
        values = study.values[str(measure)]
        _histogram(row[0], values[np.isfinite(values)], measure, study)
        for axes, axis in zip(row[1:], study.axes, strict=True):
            size = 5.0 if len(study) < _MANY else 2.0
            x, y = study.columns[axis.name][:_SCATTERED], values[:_SCATTERED]
            axes.plot(x, y, ".", markersize=size, alpha=0.6, mew=0)
            axes.set(xlabel=_label(study, axis.name), xscale=_scale(study, axis.name))
            axes.grid(alpha=0.35)


def _histogram(axes: Any, values: np.ndarray, measure: Measure, study: Study) -> None:
    axes.set(xlabel="members", ylabel=measure.label(study.problem))
    if not values.size:
        return
    bins = min(_MOST_BINS, math.ceil(values.size**0.5))
    axes.hist(values, bins=bins, orientation="horizontal", color="C0", alpha=0.7)
    axes.locator_params(axis="x", nbins=4)  # counts of members are long numbers
    quantiles = np.quantile(values, [share for share, _ in _QUANTILES.values()])
    for value, (_, style) in zip(quantiles, _QUANTILES.values(), strict=True):
        axes.axhline(value, color="C3", linewidth=1, linestyle=style)
    numbers = ", ".join(f"{value:.3g}" for value in quantiles)
    axes.set_title(f"{', '.join(_QUANTILES)}:\n{numbers}", fontsize="small")
