"""Work-precision pictures."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from . import precision as precision_set
from .rivals import RIVALS

if TYPE_CHECKING:
    from .paper import Result

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
    "scipy dop853": ("0.1", "x"),
    "scipy rk45": ("0.35", "x"),
    "scipy lsoda": ("0.6", "x"),
    "heyoka": ("k", "*"),
    "cyrk dop853": ("0.2", "+"),
    "cyrk vern8": ("0.5", "+"),
}
_BLOWN_UP = 1e3  # an error above this is instability, and would squeeze the rest of the picture


def work_precision(result: Result, path: Path) -> None:
    """Error against time, log-log, a line for each method; each point tells its step."""
    figure = Figure(figsize=(7.5, 5.2), layout="constrained")
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
    figure.savefig(path, dpi=130)


def precision(result: precision_set.Result, path: Path) -> None:
    """Error against time and against evaluations, log-log; what is unstable stands on the upper edge."""
    metrics = result.metrics
    figure = Figure(figsize=(12.5, 4.9 * len(metrics) + 0.4), layout="constrained")
    grid = figure.subplots(len(metrics), 2, sharey="row", squeeze=False)
    for row, metric in zip(grid, metrics, strict=True):
        for method, label in result.methods.items():
            color, marker = STYLE[method]
            dashes = "--" if method in RIVALS else "-"
            points = [p for p in result.of(method) if p.stable and metric in p.errors and p.errors[metric] > 0]
            errors = [p.errors[metric] for p in points]
            style = {"color": color, "marker": marker, "linestyle": dashes, "markersize": 5, "alpha": 0.85}
            if points:
                row[0].loglog([p.time for p in points], errors, label=label, **style)
            counted = [(p.evaluations, p.errors[metric]) for p in points if p.evaluations]
            if counted:
                row[1].loglog(*zip(*counted, strict=True), label=label, **style)
            unstable = [p.evaluations for p in result.of(method) if not p.stable and p.evaluations]
            if unstable:
                edge = row[1].get_xaxis_transform()
                row[1].plot(
                    unstable, [0.985] * len(unstable), transform=edge, color=color, marker="x", linestyle="none"
                )
        row[0].set_ylabel(f"{metric} error\n{textwrap.fill(precision_set.METRICS[metric], 50)}")
        row[0].set_xlabel("time (s), median")
        row[1].set_xlabel("evaluations of the right-hand side (crosses at the top: unstable runs)")
        for axes in row:
            axes.grid(which="major", alpha=0.35)
        # where few runs are: nothing cheap is accurate, and the left picture is full
        row[1].legend(*row[0].get_legend_handles_labels(), loc="lower left", fontsize=7)
    figure.suptitle(f"What accuracy costs: {result.case.title}", fontsize=12)
    figure.savefig(path, dpi=110)
