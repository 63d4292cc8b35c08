"""Names and units of degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Labels:
    """Names and units of the degrees of freedom of a problem.

    Attributes
    ----------
    names : tuple of str
        The name of each degree of freedom, such as "x0"; empty if they have no names.
    units : str or tuple of str
        Unit of all displacements, or of each displacement; "-" for a dimensionless number.
    layout : str
        The layout of named parameters, as `Layout.text`.
    """

    names: tuple[str, ...] = ()
    units: str | tuple[str, ...] = "m"
    layout: str = ""

    def name(self, letter: str, i: int) -> str:
        """Return the name of "u" or "v" in the degree of freedom i: x0 and v_x0, or u0 and v0 without names."""
        if not self.names:
            return f"{letter}{i}"
        return self.names[i] if letter == "u" else f"{letter}_{self.names[i]}"

    def unit(self, letter: str, i: int = 0) -> str:
        """Return the unit of "u" or "v" in the degree of freedom i."""
        unit = self.units if isinstance(self.units, str) else self.units[i]
        return unit if letter == "u" else f"{unit.replace('-', '1')}/s"
