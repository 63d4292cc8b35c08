"""A view of a field over space: the displacements of a row of masses against their positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .film import Film
from .shapes import limits


@dataclass(frozen=True, eq=False)
class Profile:
    """The displacements of a row of masses against their positions, with the displacements at the start.

    Attributes
    ----------
    places : ndarray, shape (n,)
    label : str
        The name of the quantity in `places`, with its unit.
    unit : str
        Unit of the displacements.
    """

    places: np.ndarray
    label: str
    unit: str = "m"

    def __call__(self, figure: Any, film: Film) -> Callable[[int], None]:
        axes = figure.add_subplot()
        axes.set(xlabel=self.label, ylabel=f"displacement ({self.unit})", ylim=limits(film.u))
        axes.set_xlim(self.places[0], self.places[-1])
        axes.plot(self.places, film.u[0], color="0.75", linewidth=1, label="start")
        (line,) = axes.plot(self.places, film.u[0], color="C0", linewidth=1.5)

        def show(i: int) -> None:
            line.set_ydata(film.u[i])

        return show
