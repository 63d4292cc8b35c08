"""Work-precision pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from .paper import Result

_STYLE = {
    "eig3": ("C3", "o"),
    "cd": ("C0", "s"),
    "cd fixed-point": ("C9", "D"),
    "ab2": ("C2", "^"),
    "rk2": ("C1", "v"),
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
        color, marker = _STYLE[method]
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
