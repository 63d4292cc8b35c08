"""Draw a film frame by frame, with a clock, and write it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .. import drawing
from ..functions.checks import check_time
from ..result.solution import Solution
from .curves import Curves
from .film import RATE, Film
from .geometry import geometry
from .look import Look
from .redraw import Redraw
from .second_process import with_second_process
from .writers import COLORS, MANY_COLORS, WRITERS, check_writer, kind_of, write_film

#: A function that draws the static parts on a matplotlib figure, and returns a function that shows frame i of the film.
View = Callable[[Any, Film], Callable[[int], None]]

_SIZE = 4.8, 3.6  # inches
_DPI = 100


def animate(
    view: View,
    solution: Solution,
    path: str | PathLike[str],
    *,
    name: str = "",
    look: Mapping[str, Any] | None = None,
    has_seconds: bool = True,
    t_end: float | None = None,
) -> Path:
    """Write an animation of a run, as `Problem.animate` describes it.

    `look` has the limits, the camera and the color that the user chose; None for what is not chosen. With
    `has_seconds`, the time is in seconds; without it, it has no unit. `t_end` is the end of the run, if `solution` is
    only its beginning.
    """
    path = Path(path)
    kind = kind_of(path)
    if kind not in WRITERS:
        raise ValueError(f"path must end with {' or '.join('.' + name for name in WRITERS)}, not {path.name!r}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder: create {str(path.parent)!r} first.")
    check_writer(kind)
    if t_end is not None and not check_time(t_end, "t_end") >= solution.t[-1]:
        raise ValueError(
            f"t_end must be the end of the whole run, at or after t = {solution.t[-1]:g} where the solution ends, not "
            f"{t_end!r}."
        )
    has_many = (isinstance(view, Curves) and solution.u.ndim > 1) or (look or {}).get("color") is not None
    view = _with_look(view, name, solution, look or {})
    import matplotlib as mpl
    from PIL import Image

    film = Film.of(drawing.before_growth(solution), has_seconds=has_seconds)
    count = len(film.t)
    with (
        mpl.rc_context({"font.size": 9, "axes.titlesize": 9}),
        with_second_process(partial(_redraw, view, film, solution, t_end), count) as draw,
    ):
        write_film(path, lambda i: Image.fromarray(draw(i)), count, RATE, MANY_COLORS if has_many else COLORS)
    return path


def _with_look(view: View, name: str, solution: Solution, look: Mapping[str, Any]) -> View:
    """Return the view, or if the user chose a look, the mechanism in it with this look."""
    if all(x is None for x in look.values()):
        return view
    mechanism = geometry(view, name, "leave out limits, camera and color for a film of")
    return partial(mechanism, look=Look.of(mechanism, solution, **look))


def _redraw(view: View, film: Film, solution: Solution, t_end: float | None) -> Redraw:
    """Return what draws the frames of a film."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    show = stage(figure, view, film, solution, t_end)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # all frames have the layout of the first frame
    return Redraw(figure, show, len(film.t) - 1)


def stage(figure: Any, view: View, film: Film, solution: Solution, t_end: float | None = None) -> Callable[[int], None]:
    """Draw the first frame of a film of `solution` with its captions; return the function that shows frame i.

    `t_end` is the end of the run, if `solution` is only its beginning.
    """
    move = view(figure, film)
    scale, unit = film.clock
    digits = max(0, int(np.ceil(-np.log10((film.t[1] - film.t[0]) / scale))))
    left, right = {"x": 0.02, "ha": "left"}, {"x": 0.98, "ha": "right"}
    lines = captions(film, solution, solution.t[-1] if t_end is None else t_end)
    # An empty title reserves the space of the captions in the layout.
    figure.suptitle(" \n" * (len(lines) - 1) + " ", fontsize=10)
    clock = figure.text(**left, y=0.985, s="", va="top", fontsize=11)
    figure.text(**right, y=0.985, s="\n".join(lines), va="top", color="0.35" if solution.success else "C3")

    def show(i: int) -> None:
        move(i)
        clock.set_text(f"t = {film.t[i] / scale:.{digits}f} {unit}".rstrip())

    show(0)
    return show


def captions(film: Film, solution: Solution, t_end: float) -> list[str]:
    """Return captions: the speed of the film, and the part of the run up to `t_end` if it does not show all."""
    (scale, unit), factor = film.clock, film.speed
    if not unit:
        lines = [f"{factor:g} units of time a second"]
    elif factor == 1:
        lines = ["real time"]
    else:
        lines = [f"sped up {factor:g} times" if factor > 1 else f"slowed {1 / factor:g} times"]
    if not solution.success:
        lines.append(f"{solution.status.value}, shown up to t = {film.t[-1] / scale:.3g} {unit}".rstrip())
    elif film.t[-1] < t_end:
        lines.append(f"the first {(film.t[-1] - film.t[0]) / scale:.3g} {unit}".rstrip())
    return lines
