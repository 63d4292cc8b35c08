"""Work-precision pictures, and how every benchmark saves its pictures.

Functions that draw return a figure. They import matplotlib when they are called, since it is an optional dependency.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from eig3.drawing import NO_PICTURES
from eig3.options import Files

from .article_runs import MeasuredTable
from .options import ARTICLE_METHODS
from .reach import front
from .reference import METRICS
from .rivals import RIVALS
from .sweep import WorkPrecisionSet
from .tolerances import TOLERANCES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours of EIG-4 to EIG-13; their marker is the grade.
_FAMILY = ("440154", "482878", "3e4a89", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5a01e", "d0b400")
#: Colour and marker of each method and rival in every picture.
STYLE = {
    "eig3": ("C3", "o"),
    "cd": ("C0", "s"),
    "cd newton": ("C0", "s"),
    "cd fixed-point": ("C9", "D"),
    "rk2": ("C1", "v"),
    "rk3": ("C5", "<"),
    "rk4": ("C4", ">"),
    "ab2": ("C2", "^"),
    "ab3": ("C8", "p"),
    **{f"eig{grade}": (f"#{color}", f"${grade}$") for grade, color in enumerate(_FAMILY, 4)},
    "rk5": ("C6", "P"),
    "rk8": ("k", "X"),
    "bm6": ("C0", "d"),
    "eig3 tolerances": ("C3", "H"),
    "rk5 tolerances": ("C6", "H"),
    "rk8 tolerances": ("k", "H"),
    "scipy dop853": ("0.1", "x"),
    "scipy rk45": ("0.35", "x"),
    "scipy lsoda": ("0.6", "x"),
    "heyoka": ("C1", "*"),
    "cyrk dop853": ("0.2", "+"),
    "cyrk vern8": ("0.5", "+"),
}
_BLOWN_UP = 1e3  # a larger error means instability, and would compress the rest of the picture


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def is_possible() -> bool:
    """Whether matplotlib is installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        return False
    return True


def draw(figures: Mapping[str, Callable[[], Figure]], files: Files, *, dpi: int = 130) -> str:
    """Save each figure under its name; return what to add to the list of written files."""
    if not is_possible():
        return NO_PICTURES
    for name, figure in figures.items():
        drawn = figure()
        with files.writing(name) as path:
            drawn.savefig(path, dpi=dpi)
    return ""


def article_table(result: MeasuredTable) -> Figure:
    """Error against time in logarithms, one line for each method; the points of EIG-3 show their steps."""
    figure = new_figure(7.5, 5.2)
    axes = figure.subplots()
    outside = []
    for method in dict.fromkeys(cell.method for cell in result.cells):
        cells = [cell for cell in result.cells if cell.method == method]
        shown = [cell for cell in cells if cell.error < _BLOWN_UP]
        outside += [f"{cell.label} h = {cell.h:g} ({cell.error:.1e})" for cell in cells if cell not in shown]
        color, marker = STYLE[method]
        times, errors = [cell.mean for cell in shown], [cell.error for cell in shown]
        axes.loglog(times, errors, color=color, marker=marker, label=cells[0].label, alpha=0.85)
    for cell in (cell for cell in result.cells if cell.method == "eig3" and cell.error < _BLOWN_UP):
        axes.annotate(
            f"h = {cell.h:g} s",
            (cell.mean, cell.error),
            xytext=(9, 6),
            textcoords="offset points",
            fontsize=8,
            color="C3",
            bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )
    axes.margins(x=0.17)
    axes.set_xlabel("time in the kernel (s), mean of the runs")
    axes.set_ylabel(f"error: {result.table.metric}")
    axes.set_title(f"Table {result.table.number}: {result.table.title}", fontsize=11)
    axes.grid(which="major", alpha=0.35)
    axes.legend()
    if outside:
        axes.text(0.02, 0.02, "unstable, not shown: " + ", ".join(outside), transform=axes.transAxes, fontsize=8)
    return figure


def work_precision(result: WorkPrecisionSet) -> Figure:
    """Error against time and against evaluations in logarithms; crosses at the top edge mark unstable runs.

    The methods and rivals on the Pareto front, the methods of the article and heyoka have colours; the rest is grey.
    """
    metrics = result.metrics
    figure = new_figure(12.5, 4.9 * len(metrics) + 0.4)
    grid = figure.subplots(len(metrics), 2, sharey="row", squeeze=False)
    for (by_time, by_evaluations), metric in zip(grid, metrics, strict=True):
        shown = {point.method for point in front(result, metric)} | {"heyoka"}
        shown |= {method for method in result.methods if method.partition(" ")[0] in ARTICLE_METHODS}
        for method, label in result.methods.items():
            _work_precision_lines(by_time, by_evaluations, result, method, label if method in shown else "", metric)
        by_time.set_ylabel(f"{metric} error\n{textwrap.fill(METRICS[metric], 50)}")
        by_time.set_xlabel("time (s), median")
        by_evaluations.set_xlabel("evaluations of the right-hand side (crosses at the top: unstable runs)")
        for axes in (by_time, by_evaluations):
            axes.grid(which="major", alpha=0.35)
        by_time.plot([], [], color="0.75", linewidth=0.6, label="the others (dashed: rivals; dash-dotted: tolerances)")
        # the lower left corner of the right picture is empty: no run is both cheap and accurate
        by_evaluations.legend(*by_time.get_legend_handles_labels(), loc="lower left", fontsize=7)
    figure.suptitle(f"What accuracy costs: {result.title}", fontsize=12)
    return figure


def _work_precision_lines(
    by_time: Any, by_evaluations: Any, result: WorkPrecisionSet, method: str, label: str, metric: str
) -> None:
    """The lines of one method; they are thin and grey without a label."""
    color, marker = STYLE[method]
    style = {"color": color, "marker": marker, "markersize": 5.5, "alpha": 0.85, "label": label}
    if not label:
        style = {"color": "0.75", "linewidth": 0.6, "marker": marker, "markersize": 2.5, "zorder": 1}
    style["linestyle"] = "--" if method in RIVALS else "-." if method in TOLERANCES else "-"
    points = [p for p in result.of(method) if p.stable and metric in p.errors and p.errors[metric] > 0]
    if points:
        by_time.loglog([p.time for p in points], [p.errors[metric] for p in points], **style)
    counted = [(p.evaluations, p.errors[metric]) for p in points if p.evaluations]
    if counted:
        by_evaluations.loglog(*zip(*counted, strict=True), **style)
    unstable = [p.evaluations for p in result.of(method) if not p.stable and p.evaluations]
    if unstable and label:
        edge = by_evaluations.get_xaxis_transform()
        by_evaluations.plot(
            unstable, [0.985] * len(unstable), transform=edge, color=color, marker="x", linestyle="none"
        )
