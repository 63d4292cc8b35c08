"""Names and units of degrees of freedom and of the values of outputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace


def with_unit(text: str, unit: str) -> str:
    """Return a text with a unit in brackets, if the unit is known."""
    return f"{text} ({unit})" if unit else text


@dataclass(frozen=True)
class Labels:
    """Names and units of the degrees of freedom of a problem.

    Attributes
    ----------
    names : tuple of str
        The name of each degree of freedom, such as "x0"; empty if they have no names.
    units : str or tuple of str
        Unit of all displacements, or of each displacement; "-" for a dimensionless number, "" if it is not known.
    layout : str
        The layout of named parameters, as `Layout.text`.
    columns : tuple of (str, tuple of str)
        Each output whose values have names, and these names.
    output_units : tuple of (str, str or tuple of str)
        Each output whose unit is known, and the unit of all its values, or of each value.
    time : str
        The unit of the time: "s", or "-" for a dimensionless number.
    """

    names: tuple[str, ...] = ()
    units: str | tuple[str, ...] = "m"
    layout: str = ""
    columns: tuple[tuple[str, tuple[str, ...]], ...] = ()
    output_units: tuple[tuple[str, str | tuple[str, ...]], ...] = ()
    time: str = "s"

    @classmethod
    def of(cls, labels: Labels | None, columns: tuple[tuple[str, tuple[str, ...]], ...]) -> Labels | None:
        """Return the labels of a problem, if there are any, with the names of values of outputs."""
        return replace(labels or cls(units=""), columns=columns) if columns else labels

    def values(self, output: str, k: int) -> Sequence[str | int]:
        """Return the names of the k values of an output, or their numbers."""
        return dict(self.columns).get(output, range(k))

    def name(self, letter: str, i: int) -> str:
        """Return the name of "u" or "v" in the degree of freedom i: x0 and v_x0, or u0 and v0 without names."""
        if not self.names:
            return f"{letter}{i}"
        return self.names[i] if letter == "u" else f"{letter}_{self.names[i]}"

    def place(self, i: int) -> str:
        """Return the degree of freedom i in words, with its name if it has one."""
        return f"degree of freedom {i}" + (f" ({self.names[i]})" if i < len(self.names) else "")

    def unit(self, letter: str, i: int = 0) -> str:
        """Return the unit of "u" or "v" in the degree of freedom i."""
        unit = self.units if isinstance(self.units, str) else self.units[i]
        if letter == "u" or not unit or unit == self.time == "-":
            return unit
        return f"{'1' if unit == '-' else unit}/s"

    @property
    def second(self) -> str:
        """What follows a number of seconds: " s", or nothing for a dimensionless time."""
        return "" if self.time == "-" else f" {self.time}"

    def output_unit(self, output: str, i: int = 0) -> str:
        """Return the unit of the value i of an output, if it is known."""
        unit = dict(self.output_units).get(output, "")
        if isinstance(unit, str):
            return unit
        return unit[i] if i < len(unit) else ""

    def unit_of_values(self, output: str, places: Iterable[int]) -> str:
        """Return the unit of some values of an output, such as "N", or "N or N m"."""
        return " or ".join(filter(None, dict.fromkeys(self.output_unit(output, i) for i in places)))
