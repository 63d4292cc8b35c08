"""Draw a run on a matplotlib figure: panels against time at the right, other pictures at the left.

Every function draws on a given figure, and this module does not import matplotlib.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .result.labels import Labels, with_unit
from .result.solution import Solution

_AGAINST_TIME = "against time"  # label of the axes of panels against time
_LINES = 6  # largest number of degrees of freedom in one panel
_FEW = 40  # a line through fewer states also has dots
_MANY, _PERIODS = 80, 25  # if a run has more than 80 periods, only the first 25 are shown
_GROWTH = 5.0  # larger states, relative to the size of the motion, belong to the growth
_BLOW_UP = 1e3  # a run with less growth is drawn to its end
_TAIL = 8  # least number of visible states of the growth


def time_panel(figure: Any, ylabel: str) -> Any:
    """Add a panel against time below the others, with a shared time axis.

    Returns
    -------
    matplotlib.axes.Axes
    """
    above = time_panels(figure)
    axes = figure.add_subplot(label=_AGAINST_TIME, sharex=above[0] if above else None)
    axes.margins(x=0)
    axes.set(xlabel="t (s)", ylabel=ylabel)
    for panel in above:
        panel.set_xlabel("")
        panel.tick_params(labelbottom=False)
    _arrange(figure)
    return axes


def time_panels(figure: Any) -> list[Any]:
    """Return the axes of the panels against time, the highest first."""
    return [axes for axes in figure.axes if axes.get_label() == _AGAINST_TIME]


def picture(figure: Any, **options: Any) -> Any:
    """Add a picture at the left of the panels against time; `options` go to ``figure.add_subplot``.

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = figure.add_subplot(**options)
    _arrange(figure)
    return axes


def pictures(figure: Any) -> list[Any]:
    """Return the axes of the other pictures, the highest first."""
    return [axes for axes in figure.axes if axes.get_label() != _AGAINST_TIME]


def _arrange(figure: Any) -> None:
    columns = [column for column in (pictures(figure), time_panels(figure)) if column]
    widths = [1 / len(column) if column == pictures(figure) else 1 for column in columns]
    for column, cell in zip(columns, figure.add_gridspec(1, len(columns), width_ratios=widths), strict=True):
        for axes, place in zip(column, cell.subgridspec(len(column), 1), strict=True):
            axes.set_subplotspec(place)


def legend(axes: Any) -> None:
    """Put the legend outside of the axes: at the right of a panel against time, above a picture."""
    if axes.get_label() == _AGAINST_TIME:
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    else:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)


def lines(axes: Any, t: np.ndarray, values: np.ndarray, names: Sequence[str] = ()) -> None:
    """Draw each column of `values`, shape (m,) or (m, n), against time, with a legend if there are names."""
    axes.plot(t, values, linewidth=0.8, marker="." if len(t) < _FEW else "", label=names or None)
    if names:
        legend(axes)


def frame(figure: Any, solution: Solution, view: Any, row: int, note: str = "") -> tuple[Any, np.ndarray]:
    """Draw a frame at rest and in a saved state, with the displacements of its view.

    Returns
    -------
    matplotlib.axes.Axes, ndarray
        The axes, and the places of the nodes in this state.
    """
    axes = picture(figure, aspect="equal")
    shapes = view.places(solution.t[[0, row]], solution.u[[0, row]] * np.array([[0.0], [1.0]]))
    for shape, color, name in zip(shapes, ("0.7", "C0"), ("at rest", f"t = {solution.t[row]:.2f} s"), strict=True):
        for k, (i, j) in enumerate(view.links):
            axes.plot(*shape[[i, j]].T, color=color, linewidth=1.2, label="" if k else name)
    axes.set(xlabel=f"{view.note}{note}\nx (m)", ylabel="height (m)")
    legend(axes)
    return axes, shapes[1]


def oscillator(figure: Any, solution: Solution, units: tuple[str, str] = ("m", "m/s")) -> None:
    """Draw a single degree of freedom: the phase portrait, and the displacement and the velocity against time.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    solution : Solution
        A run with u and v of shape (m,).
    units : (str, str)
        Units of displacement and velocity.
    """
    u_label, v_label = f"displacement u ({units[0]})", f"velocity v ({units[1]})"
    portrait = picture(figure)
    portrait.set(xlabel=u_label, ylabel=v_label)
    portrait.locator_params(axis="x", nbins=5)  # long labels of small displacements would touch
    path(portrait, solution.u, solution.v, "C0", "phase portrait")
    legend(portrait)
    for values, label in ((solution.u, u_label), (solution.v, v_label)):
        lines(time_panel(figure, label), solution.t, values)
    first_periods(figure, solution, solution.v)


def first_periods(figure: Any, solution: Solution, v: np.ndarray) -> None:
    """Limit the time axis to the first periods of the velocity v, shape (m,), if all periods would be a solid band."""
    turns = np.flatnonzero(np.diff(np.signbit(v)))
    if len(turns) > 2 * _MANY and solution.success:  # the end of a failed run must stay visible
        highest = time_panels(figure)[0]
        highest.set_xlim(solution.t[0], solution.t[turns[2 * _PERIODS]])
        highest.set_title(f"the first {_PERIODS} of {len(turns) / 2:.0f} periods", fontsize="medium")


def path(axes: Any, x: np.ndarray, y: np.ndarray, color: str, name: str) -> None:
    """Draw a path in a plane, with a dot at its start."""
    start = None if axes.lines else "start"  # one entry in the legend for all paths of a picture
    axes.plot(x, y, color=color, linewidth=0.6, marker="." if len(x) < _FEW else "", label=name)
    axes.plot(x[0], y[0], color=color, marker="o", linestyle="none", label=start)


def plane(
    figure: Any,
    paths: Mapping[str, Sequence[np.ndarray]],
    labels: tuple[str, str] = ("x (m)", "y (m)"),
    fixed: str = "",
    aspect: str = "equal",
) -> Any:
    """Add a picture of paths in a plane, each (x, y) by its name; `fixed` is the name of the body at the origin.

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = picture(figure, aspect=aspect)
    for k, (name, (x, y)) in enumerate(paths.items()):
        path(axes, x, y, f"C{k}", name)
    if fixed:
        axes.plot(0, 0, "k^", label=fixed)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    legend(axes)
    return axes


def histories(figure: Any, solution: Solution, names: Sequence[str] = (), units: tuple[str, str] | None = None) -> None:
    """Draw the displacements and the velocities of the first degrees of freedom against time.

    Degrees of freedom with different units have different panels.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    solution : Solution
    names : sequence of str
        Names of the degrees of freedom; by default the names in the problem, or u0, u1, ...
    units : (str, str), optional
        Units of displacement and velocity; by default the units in the problem.
    """
    labels = solution.labels or Labels()
    u, v = (x.reshape(len(solution.t), -1)[:, :_LINES] for x in (solution.u, solution.v))
    for i, (letter, what, values) in enumerate((("u", "displacement", u), ("v", "velocity", v))):
        columns: dict[str, list[int]] = {}
        for j in range(values.shape[1]):
            columns.setdefault(units[i] if units else labels.unit(letter, j), []).append(j)
        for unit, chosen in columns.items():
            if names:
                shown = [names[j] for j in chosen]
            else:
                shown = [labels.name(letter, j) if labels.names else f"$u_{{{j}}}$" for j in chosen]
            lines(time_panel(figure, with_unit(what, unit)), solution.t, values[:, chosen], shown)


def field(figure: Any, solution: Solution, places: np.ndarray, label: str, units: tuple[str, str]) -> None:
    """Draw the displacement and the velocity of a row of masses over space and time.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    solution : Solution
        A run with u and v of shape (m, n).
    places : ndarray, shape (n,)
        Positions of the masses, in ascending order.
    label : str
        The name of the quantity in `places`, with its unit.
    units : (str, str)
        Units of displacement and velocity.
    """
    t, middle = solution.t, (places[1:] + places[:-1]) / 2
    # The edges of the cells. The last time step may be shorter than the others, and a single state also needs a width.
    times = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, [max(t[-1], t[0] + solution.h)]])
    edges = np.concatenate([[2 * places[0] - middle[0]], middle, [2 * places[-1] - middle[-1]]])
    for values, name, unit in ((solution.u, "displacement", units[0]), (solution.v, "velocity", units[1])):
        size = np.abs(values).max() or 1.0
        axes = time_panel(figure, label)
        image = axes.pcolorfast(times, edges, values.T, cmap="RdBu_r", vmin=-size, vmax=size)
        # As a child of the panel, the colour bar does not change the width of the panel.
        bar = axes.inset_axes((1.02, 0, 0.02, 1))
        bar.figure.colorbar(image, cax=bar, label=f"{name} ({unit})")


def before_growth(solution: Solution) -> Solution:
    """Return the states before the growth if the run blew up, and the whole solution otherwise.

    A picture of a whole run that blew up would show only its last few steps, in which the state grows up to 1e308.
    """
    if solution.success:
        return solution
    n = max(2, min(_motion(solution.u), _motion(solution.v)))  # a line needs two states
    return solution._first(n)


def _motion(values: np.ndarray) -> int:
    """Return the number of states before the growth.

    These states are at most `_GROWTH` times as large as the size that lasts longest. An instability grows by a constant
    factor per step, and does not stay near any size for long, but the motion before it does.
    """
    size = np.maximum.accumulate(_sizes(values))
    level, begin = np.unique(size, return_index=True)
    level, begin = level[level > 0], begin[level > 0]
    if not len(level):
        return len(size)
    logarithm = np.log(level)
    lasts = np.interp(logarithm + np.log(_GROWTH), logarithm, begin) - begin
    # Take the first size that lasts about as long as the size that lasts longest. If the run grows from its start, all
    # sizes last equally long.
    scale = level[np.argmax(lasts >= 0.75 * lasts.max())]
    return int(np.searchsorted(size / scale, _GROWTH, side="right")) if size[-1] / scale > _BLOW_UP else len(size)


def _sizes(values: np.ndarray) -> np.ndarray:
    return np.abs(values).reshape(len(values), -1).max(axis=1)


def growth(figure: Any, solution: Solution, n: int) -> None:
    """Add a panel with a logarithmic scale that shows how a run grows after its first n states."""
    axes = time_panel(figure, "size / size before\nthe growth (-)")
    axes.set_yscale("log", nonpositive="mask")
    axes.set_ylim(1e-3, 1e12)  # matplotlib cannot place ticks near 1e308
    end = n + max(_TAIL, n // 4)
    with np.errstate(over="ignore"):
        sizes = [x[:end] / (x[:n].max() or 1.0) for x in map(_sizes, (solution.u, solution.v))]
    lines(axes, solution.t[:end], np.column_stack(sizes), ["displacement", "velocity"])


def mark(figure: Any, t: float, name: str) -> None:
    """Draw a line at time t across all panels against time; `name` is the event there."""
    panels = time_panels(figure)
    for axes in panels:
        axes.axvline(t, color="C3", linestyle="--", linewidth=1)
    if panels:
        above = {"xycoords": ("data", "axes fraction"), "xytext": (0, 3), "textcoords": "offset points"}
        panels[0].annotate(name, (t, 1), color="C3", ha="center", **above)
