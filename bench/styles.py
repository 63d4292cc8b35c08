"""The colour, the marker and the sign of each method and rival, the same in every picture and on the page.

A method can be told by its marker alone: its family has a shape, in which stands a sign such as the grade of an EIG
method. The colours have the same lightness, so that they are readable on white and on black.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

#: The outlines of the shapes as SVG paths within a square from -1 to 1.
SHAPES = {
    "circle": "M1,0A1,1,0,1,1,-1,0A1,1,0,1,1,1,0Z",
    "square": "M-0.88,-0.88H0.88V0.88H-0.88Z",
    "diamond": "M0,-1.2L1.2,0L0,1.2L-1.2,0Z",
    "hexagon": "M-0.55,-0.95H0.55L1.1,0L0.55,0.95H-0.55L-1.1,0Z",
    "triangle": "M0,-1.25L1.2,0.85H-1.2Z",
    "pentagon": "M0,-1.1L1.05,-0.34L0.65,0.89H-0.65L-1.05,-0.34Z",
    "shield": "M-0.95,-0.9H0.95V0.2L0,1.15L-0.95,0.2Z",
    "tag": "M-1.1,-0.8H0.6L1.15,0L0.6,0.8H-1.1Z",
}


@dataclass(frozen=True)
class Style:
    """How a method is drawn.

    Attributes
    ----------
    color : str
        As #rrggbb.
    shape : str
        One of `SHAPES`.
    sign : str
        One or two characters in the shape.
    marker : str
        The marker in pictures of matplotlib.
    is_filled : bool
        Whether the shape is filled; rivals and methods with tolerances have outlines only.
    """

    color: str
    shape: str
    sign: str
    marker: str
    is_filled: bool = True


#: Colours of EIG-4 to EIG-13.
_FAMILY = ("6a78cd", "507fcd", "2d86c8", "008dbe", "0092b0", "00969f", "00988a", "009874", "2c965d", "539344")
_GREY = "#80868b"
#: By name, in the order of legends.
_STYLES = {
    "eig3": Style("#e23532", "circle", "3", "o"),
    **{f"eig{grade}": Style(f"#{color}", "circle", str(grade), f"${grade}$") for grade, color in enumerate(_FAMILY, 4)},
    "bm6": Style("#764be5", "hexagon", "6", "h"),
    "cd": Style("#a5682a", "diamond", "C", "D"),
    "cd newton": Style("#a5682a", "diamond", "N", "D"),
    "cd fixed-point": Style("#c08a4e", "diamond", "F", "d"),
    "rk2": Style("#c98a00", "square", "2", "v"),
    "rk3": Style("#c47a00", "square", "3", "<"),
    "rk4": Style("#bb6a00", "square", "4", ">"),
    "rk5": Style("#9e4dd0", "square", "5", "P"),
    "rk8": Style("#c63895", "square", "8", "X"),
    "rkn12": Style("#d1006b", "hexagon", "12", "d"),
    "ab2": Style("#918a21", "triangle", "2", "^"),
    "ab3": Style("#7d8f2a", "triangle", "3", "p"),
    "eig3 tolerances": Style("#e23532", "circle", "3", "H", is_filled=False),
    "rk5 tolerances": Style("#9e4dd0", "square", "5", "H", is_filled=False),
    "rk8 tolerances": Style("#c63895", "square", "8", "H", is_filled=False),
    "rkn12 tolerances": Style("#d1006b", "hexagon", "12", "h", is_filled=False),
    "scipy dop853": Style(_GREY, "shield", "D", "x", is_filled=False),
    "scipy rk45": Style(_GREY, "shield", "R", "1", is_filled=False),
    "scipy lsoda": Style(_GREY, "shield", "L", "2", is_filled=False),
    "cyrk dop853": Style("#6f7f96", "tag", "D", "+", is_filled=False),
    "cyrk vern8": Style("#6f7f96", "tag", "V", "3", is_filled=False),
    "diffrax tsit5": Style("#8a7f96", "tag", "T", "4", is_filled=False),
    "diffrax dopri8": Style("#8a7f96", "tag", "8", "|", is_filled=False),
    "verlet": Style("#8f8073", "tag", "H", "_", is_filled=False),
    "rebound ias15": Style("#4d8a8a", "pentagon", "I", "$I$", is_filled=False),
    "rebound whfast": Style("#4d8a8a", "pentagon", "W", "$W$", is_filled=False),
    "heyoka": Style("#b08600", "pentagon", "H", "*", is_filled=False),
}


def style_of(method: str) -> Style:
    """The style of a method or rival. A method without a style is grey, and its sign is its first two letters."""
    return _STYLES.get(method, Style(_GREY, "circle", method[:2], "."))


def in_order(methods: Iterable[str]) -> list[str]:
    """The names in the order of legends; those without a style of their own come last."""
    order = list(_STYLES)
    return sorted(methods, key=lambda method: order.index(method) if method in order else len(order))
