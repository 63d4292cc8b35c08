"""The base class of effects on cells: several points together, such as an angle, a triangle or a tetrahedron."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, ClassVar

import numba
import numpy as np
from numba.types import unliteral

from ..kernels.compile.jit import type_returned
from .effect import REAL, Effect, arguments
from .fields import check_fields

_MOST_LISTED = 10  # cells in an error
ORIENT = "exchange two corners of each, as mesh.oriented() of scikit-fem does"  # the remedy for inverted cells


class Cell(Effect):
    """An effect on cells, each of which has the same number of points.

    The general form has ``forces``, which returns a tuple with a force for each point of the cell, and may have
    ``potential``, an energy. They take the positions x and the velocities v of the points, each a tuple of tuples, the
    time t, and fields; see `Body` for `vectors`, `arrays` and `nonnegative`. Supports bear the forces on fixed points::

        @dataclass(frozen=True, eq=False)
        class Pressure(Cell):
            pressure: float  # Pa

            takes = (2,)
            dimensions = (2,)

            @staticmethod
            @eig3.jit
            def forces(x, pressure):
                f = pressure / 2 * (x[1][1] - x[0][1]), pressure / 2 * (x[0][0] - x[1][0])
                return f, f

    A kind of cell, such as `Angle` or `Tetrahedron`, computes one value of the points, its `variable`. An effect of
    this kind has a function `conjugate`, the derivative of its potential with respect to the variable, and the kind
    computes the forces. The kind has three compiled functions:

    - ``value(x, ...)`` returns the variable;
    - ``rate(x, v, ...)`` returns the rate of the variable, which effects take as the argument `rate`;
    - ``forces(x, conjugate, ...)`` returns the forces: minus the derivative of the variable with respect to each point,
      times the conjugate.

    Attributes
    ----------
    takes : (int,)
        The number of points of a cell.
    variable, conjugate : str
        The names of the variable and of the function of the effect; empty for the general form.
    shape : dict of str to int
        The columns that `shape_columns` computes from the positions at rest, with their numbers of components; 0 for a
        scalar.
    extent : str
        The column that multiplies the potential, such as the volume of a cell; empty if the potential is not
        multiplied.
    """

    variable: ClassVar[str] = ""
    conjugate: ClassVar[str] = ""
    shape: ClassVar[dict[str, int]] = {}
    extent: ClassVar[str] = ""

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"forces": ("t", "x", "v"), "potential": ("x",)}
    needs: ClassVar[tuple[str, ...]] = ("forces",)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        check_fields(cls, Cell)

    def refuse_cells(self, wrong: np.ndarray, what: str, remedy: str) -> None:
        """Raise a ValueError that lists the wrong cells, if any are, as in "Bending is flat in cells 3, 5: move"."""
        if wrong.any():
            numbers = np.flatnonzero(wrong).tolist()
            listed = ", ".join(map(str, numbers[:_MOST_LISTED]))
            more = f" and {len(numbers) - _MOST_LISTED} more" * (len(numbers) > _MOST_LISTED)
            raise ValueError(f"{self.title} {what} in cell{'s' * (len(numbers) > 1)} {listed}{more}: {remedy}.")

    def _argument_types(self, name: str, dimension: int) -> dict[str, Any]:
        given = super()._argument_types(name, dimension)
        points = numba.types.UniTuple(numba.types.UniTuple(numba.float64, dimension), self.takes[0])
        sizes = {column: size for column, size in self.shape.items() if size}
        given |= {"x": points, "v": points}
        given |= {column: numba.types.UniTuple(numba.float64, size) for column, size in sizes.items()}
        if self.variable and name != "value":
            value = self.functions()["value"]
            types = tuple(given.get(argument, numba.float64) for argument in arguments(value))
            found = unliteral(type_returned(value, types))
            given |= dict.fromkeys((self.variable, "rate", self.conjugate), found)
        return given

    def _check_returned(self, name: str, returned: Any, dimension: int) -> None:
        points = ((0,) * dimension,) * self.takes[0]
        of_variable = _form(self._argument_types(name, dimension).get(self.conjugate, returned))
        wanted = {"potential": 0, "forces": points}.get(name, of_variable)
        if _form(returned) != wanted:
            form = "a number" if wanted == 0 else f"a tuple of the form {wanted} here, with numbers in place of 0"
            raise TypeError(f"{name} of {self.title} must return {form}, not {unliteral(returned)}.")


def offers_of(variable: str, conjugate: str, shape: Iterable[str] = (), read: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the functions of a kind of cell, and the arguments that they can take.

    Parameters
    ----------
    variable, conjugate : str
    shape : iterable of str
        The columns of the rest shape, which the functions of the kind can take.
    read : tuple of str
        The columns of the rest shape that the functions of an effect can take.
    """
    return {
        conjugate: ("t", variable, "rate", *read),
        "potential": (variable, *read),
        "value": ("x", *shape),
        "rate": ("x", "v", *shape),
        "forces": ("x", conjugate, *shape),
    }


def same_points(numbers: Sequence[np.ndarray]) -> bool:
    """Return whether a link or cell contains a point twice."""
    return any((a == b).any() for a, b in combinations(numbers, 2))


def _form(kind: Any) -> Any:
    """Return the nesting of a type of tuples, with 0 for each number, and None for any other type."""
    kind = unliteral(kind)
    if isinstance(kind, numba.types.BaseTuple):
        return tuple(_form(part) for part in kind)
    return 0 if isinstance(kind, REAL) else None
