"""The picture of a fit: the data with the fitted motion, and the residuals below them."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..result.labels import with_unit
from ..result.solution import Solution
from .data import Series

_WIDTH = 90  # characters of a line of the title


def save(
    path: Path,
    title: str,
    series: Sequence[Series],
    residuals: Mapping[str, np.ndarray],
    run: Solution,
    units: Mapping[str, str],
) -> Path:
    """Write the picture of a fit; its title has the fitted parameters, and a unit is empty if it is not known."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("the picture of a fit needs matplotlib: pip install 'eig3[plot]'.") from None
    figure = Figure(figsize=(8.5, 3.6 * len(series) + 0.6), layout="constrained")
    panels = figure.subplots(
        2 * len(series), sharex=True, squeeze=False, gridspec_kw={"height_ratios": [2.2, 1] * len(series)}
    )[:, 0]
    for i, each in enumerate(series):
        _motion(panels[2 * i], each, run.t, each.of(run), units[each.name])
        _residuals(panels[2 * i + 1], each, residuals[each.name], units[each.name])
    panels[-1].set_xlabel(with_unit("t", run.labels.time if run.labels else "s"))
    figure.align_ylabels()
    figure.suptitle(textwrap.fill(title.replace("+-", "\N{PLUS-MINUS SIGN}"), _WIDTH), fontsize=10, parse_math=False)
    figure.savefig(path, dpi=130)
    return path


def _motion(axes: Any, series: Series, t: np.ndarray, curve: np.ndarray, unit: str) -> None:
    axes.plot(series.t, series.values, ".", color="0.55", markersize=4, label="data")
    axes.plot(t, curve, color="C0", linewidth=1.1, label="fit")
    axes.set_ylabel(with_unit(series.name, unit))
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    axes.margins(x=0.01)
    axes.grid(alpha=0.35)


def _residuals(axes: Any, series: Series, residuals: np.ndarray, unit: str) -> None:
    axes.axhline(0, color="C0", linewidth=1)
    axes.plot(series.t, residuals, ".", color="0.35", markersize=3)
    most = 1.15 * np.nanmax(np.abs(residuals)) or 1.0
    axes.set(ylabel=with_unit("data - fit", unit), ylim=(-most, most))
    axes.grid(alpha=0.35)
