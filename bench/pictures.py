"""Work-precision pictures, and how every benchmark saves its pictures.

Functions that draw return a figure. They import matplotlib when they are called, since it is an optional dependency.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from eig3.command_line import NO_PICTURES, Files

from .article_runs import MeasuredTable
from .choices import ARTICLE_METHODS
from .matrix import AT_MOST, Matrix, abbreviated, in_units, lead, power
from .modes import MODES
from .reach import Contest, front
from .reference import METRICS
from .rivals import RIVALS
from .styles import style_of
from .sweep import WorkPrecisionSet
from .tolerances import TOLERANCES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    import matplotlib as mpl

    for name, figure in figures.items():
        # SVG has text, not outlines, and is the same each time: without a date, and with names that are not random.
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}), files.writing(name) as path:
            figure().savefig(path, dpi=dpi, metadata={"Date": None} if path.suffix == ".svg" else None)
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
        style = style_of(method)
        seconds, errors = [cell.mean for cell in shown], [cell.error for cell in shown]
        axes.loglog(seconds, errors, color=style.color, marker=style.marker, label=cells[0].label, alpha=0.85)
    for cell in (cell for cell in result.cells if cell.method == "eig3" and cell.error < _BLOWN_UP):
        axes.annotate(
            f"h = {cell.h:g} s",
            (cell.mean, cell.error),
            xytext=(9, 6),
            textcoords="offset points",
            fontsize=8,
            color=style_of("eig3").color,
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
    figure = new_figure(13.5, 4.9 * len(metrics) + 0.4)
    grid = figure.subplots(len(metrics), 2, sharey="row", squeeze=False)
    for (by_time, by_evaluations), metric in zip(grid, metrics, strict=True):
        shown = {point.method for point in front(result, metric)} | {"heyoka"}
        shown |= {method for method in result.methods if method.partition(" ")[0] in ARTICLE_METHODS}
        for method, name in result.methods.items():
            label = _plain(name) if method in shown else ""
            _work_precision_lines(by_time, by_evaluations, result, method, label, metric)
        by_time.set_ylabel(f"{metric} error\n{textwrap.fill(METRICS[metric], 50)}")
        by_time.set_xlabel("time (s), median")
        by_evaluations.set_xlabel("evaluations of the right-hand side (crosses at the top: unstable runs)")
        for axes in (by_time, by_evaluations):
            axes.grid(which="major", alpha=0.35)
        by_time.plot(
            [], [], color="0.75", linewidth=0.6, label="the others (dashed:\nrivals; dash-dotted:\ntolerances)"
        )
        # outside, where it hides no run
        by_evaluations.legend(*by_time.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(1, 1), fontsize=8)
    figure.suptitle(f"What accuracy costs: {result.title}", fontsize=12, parse_math=False)
    return figure


def matrix(shown: Matrix) -> Figure:
    """The fastest to reach each accuracy on each problem, its time, and how far ahead it is."""
    columns, rows = len(shown.targets), len(shown.rows)
    figure = new_figure(2.4 + 1.05 * columns, 1.0 + 0.52 * rows)
    axes = figure.subplots()
    for i, row in enumerate(shown.rows):
        for j, target in enumerate(shown.targets):
            _matrix_cell(axes, i, j, row.at(target))
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    axes.set_xticks(range(columns), [power(target) for target in shown.targets])
    axes.set_yticks(range(rows), [textwrap.fill(row.title, 26) for row in shown.rows], parse_math=False)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_xlabel(
        "In each cell: the fastest, its time, and how many times as long the next method of eig3 takes, and the best "
        f"rival.\nError: {METRICS[shown.metric]}. Time: {MODES[shown.mode].words}. Hatched: a rival is the fastest. "
        f"{AT_MOST}: or less.",
        fontsize=9,
    )
    figure.suptitle("What accuracy costs: the fastest way to an error of ...", fontsize=12)
    return figure


def _matrix_cell(axes: Any, i: int, j: int, contest: Contest | None) -> None:
    if contest is None or contest.fastest is None:
        words = "" if contest is None else "-" if contest.is_claimed else "unknown"
        axes.text(j, i, words, ha="center", va="center", fontsize=8, color="0.5")
        return
    first, color = contest.fastest, style_of(contest.fastest.method).color
    box = ([j - 0.48, j + 0.48], i - 0.46, i + 0.46)
    axes.fill_between(*box, color=color, alpha=0.22, linewidth=0)
    if first.is_rival:
        axes.fill_between(*box, facecolor="none", edgecolor=color, alpha=0.3, linewidth=0.8, hatch="////")
    following = (contest.next_own, contest.next_rival)
    leads = "  ".join(lead(first, one) if one else "-" for one in following)
    lines = (
        (-0.26, _plain(abbreviated(first.label)), 8.5, color),
        (0.02, f"{AT_MOST * first.at_most}{in_units(first.seconds)}", 8, "k"),
        (0.29, leads, 7, "0.35"),
    )
    for down, words, size, ink in lines:
        weight = "bold" if ink == color else "normal"
        axes.text(j, i + down, words, ha="center", va="center", fontsize=size, color=ink, fontweight=weight)


def _plain(label: str) -> str:
    """A label that matplotlib shows as it is: between two dollar signs it would read a formula."""
    return label.replace("$", r"\$")


def _work_precision_lines(
    by_time: Any, by_evaluations: Any, result: WorkPrecisionSet, method: str, label: str, metric: str
) -> None:
    """The lines of one method; they are thin and grey without a label."""
    drawn = style_of(method)
    style: dict[str, Any] = {"color": drawn.color, "marker": drawn.marker, "markersize": 5.5, "label": label}
    if not label:
        style |= {"color": "0.75", "linewidth": 0.6, "markersize": 2.5, "zorder": 1}
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
            unstable, [0.985] * len(unstable), transform=edge, color=drawn.color, marker="x", linestyle="none"
        )
