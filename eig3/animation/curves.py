"""Views of degrees of freedom against time, with moving marks: for oscillators and problems without geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..result.labels import Labels, with_unit
from .film import Film
from .shapes import coils, limits

_MOST = 10  # degrees of freedom in one picture, and colours of matplotlib
_TRAIL = 1.5  # seconds of the film


@dataclass(frozen=True, eq=False)
class Curves:
    """The degrees of freedom against time; of many, some from the first to the last.

    Attributes
    ----------
    labels : Labels
        The names and units of the degrees of freedom.
    """

    labels: Labels

    def __call__(self, figure: Any, film: Film) -> Callable[[int], None]:
        if film.u.ndim == 1:
            return Portrait((self.labels.unit("u", 0), self.labels.unit("v", 0)))(figure, film)
        n = film.u.shape[1]
        shown = np.unique(np.linspace(0, n - 1, min(_MOST, n)).round().astype(int))
        units = {self.labels.unit("u", j) for j in shown}
        axes = figure.add_subplot()
        axes.set_ylabel(with_unit("displacement", " or ".join(sorted(units - {""}))))
        names = [self.labels.name("u", j) for j in shown]
        curves = film.path(lambda t, u: u[:, shown])
        move = _against_time(axes, film, curves, film.u[:, shown], names)
        if n > len(shown):
            axes.get_legend().set_title(f"{len(shown)} of {n}")
        return move


@dataclass(frozen=True, eq=False)
class Portrait:
    """One degree of freedom: the phase portrait, and the displacement against time.

    Attributes
    ----------
    units : (str, str)
        Units of displacement and velocity.
    """

    units: tuple[str, str] = ("m", "m/s")

    def __call__(self, figure: Any, film: Film) -> Callable[[int], None]:
        left, right = figure.subplots(1, 2)
        u, v = film.solution._interpolated(film.times)
        unit, of_v = self.units
        left.set(xlabel=with_unit("u", unit), ylabel=with_unit("velocity", of_v), xlim=limits(u), ylim=limits(v))
        right.set_ylabel(with_unit("displacement u", unit))
        (before,) = left.plot([], [], color="C0", linewidth=0.6, alpha=0.5)
        (trail,) = left.plot([], [], color="C0", linewidth=1.5)
        (mark,) = left.plot([], [], "C0o", markersize=6)
        move = _against_time(right, film, u[:, None], film.u[:, None], [])

        def show(i: int) -> None:
            for line, seconds in ((before, np.inf), (trail, _TRAIL)):
                rows = film.rows(i, seconds)
                line.set_data(u[rows], v[rows])
            mark.set_data(film.u[i : i + 1], film.v[i : i + 1])
            move(i)

        return show


@dataclass(frozen=True, eq=False)
class Oscillator:
    """A mass that moves vertically, next to its displacement against time.

    Attributes
    ----------
    on : {"spring", "floor"}
        The support of the mass: a spring from which it hangs, or a floor at 0 on which it falls.
    unit : str
        Unit of the displacement.
    """

    on: Literal["spring", "floor"] = "spring"
    unit: str = "m"

    def __call__(self, figure: Any, film: Film) -> Callable[[int], None]:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1, 3))
        path = film.path()
        low, high = limits(path)
        high += (0.35 if self.on == "spring" else 0.1) * (high - low)  # space for the spring or the ball
        left.set(xlim=(-1, 1), ylim=(low, high), xticks=[], ylabel=f"displacement u ({self.unit})")
        move = _against_time(right, film, path[:, None], film.u[:, None], [])
        right.set_ylim(low, high)
        (level,) = left.plot([], [], color="0.6", linewidth=0.8, linestyle="--")
        (reach,) = right.plot([], [], color="0.6", linewidth=0.8, linestyle="--")
        (spring,) = left.plot([], [], color="0.35", linewidth=1.2)
        if self.on == "spring":
            left.axhline(high, color="k", linewidth=4)
            (mass,) = left.plot([], [], "C0s", markersize=16)
        else:
            left.axhspan(low, 0, color="0.85")
            left.axhline(0, color="0.35", linewidth=1)
            (mass,) = left.plot([], [], color="C0", marker=_standing_ball(), markersize=56, linestyle="none")

        def show(i: int) -> None:
            u = film.u[i]
            mass.set_data([0], [u])
            level.set_data([0, 1], [u, u])
            reach.set_data(film.t[[0, i]] / film.clock[0], [u, u])
            if self.on == "spring":
                spring.set_data(*coils(np.array([[0.0, high]]), np.array([[0.0, u]]), 0.5)[0].T)
            move(i)

        return show


def _standing_ball() -> Any:
    """Return a round marker whose lowest point is at the marked point."""
    from matplotlib.path import Path

    return Path.circle((0, 1), 1)


def _against_time(axes: Any, film: Film, curves: np.ndarray, marks: np.ndarray, names: list[str]) -> Any:
    """Draw curves, shape (times, k), up to the time of a frame, with marks, shape (frames, k), at this time."""
    scale, unit = film.clock
    t, times = film.times / scale, film.t / scale
    axes.set(xlabel=f"t ({unit or '-'})", xlim=(t[0], t[-1]), ylim=limits(curves))
    axes.plot(t, curves, color="0.85", linewidth=0.8)
    lines = axes.plot(t, curves, linewidth=1.2)
    dots = [axes.plot([], [], "o", color=line.get_color(), markersize=6, zorder=3, clip_on=False)[0] for line in lines]
    for line, name in zip(lines, names, strict=False):
        line.set_label(name)
    if names:
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))

    def show(i: int) -> None:
        rows = film.rows(i)
        for j, (line, dot) in enumerate(zip(lines, dots, strict=True)):
            line.set_data(t[rows], curves[rows, j])
            dot.set_data(times[i : i + 1], marks[i : i + 1, j])

    return show
