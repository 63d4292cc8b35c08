"""Write what a periodic box does to the way between two points and to its rate, as lines of Python source.

In a box that shears, the images further up by y_side are moved along x by image_shift at the time t, at image_speed, as
those of A. W. Lees and S. F. Edwards, Journal of Physics C 5 (1972), but for positions that do not jump.
"""

from __future__ import annotations

from collections.abc import Iterator


class BoxText:
    """The periodic box of one scene in the source. Each method returns lines.

    Attributes
    ----------
    sides : dict of str to int
        The places in p of the sides of the periodic box, by the axes that have one; `shear` is that of the rate at
        which it shears, or None.
    """

    def __init__(self, sides: dict[str, int], shear: int | None) -> None:
        self.sides, self._shear = sides, shear

    @property
    def shears(self) -> bool:
        """Whether the box shears."""
        return self._shear is not None

    def constants(self) -> Iterator[str]:
        """Read the sides, and how far and how fast the images above have moved."""
        for axis, place in self.sides.items():
            yield f"{axis}_side = p[{place}]"
            yield f"{axis}_inverse = 1 / {axis}_side"
        if self.shears:
            yield f"image_speed = p[{self._shear}] * y_side"
            yield "image_shift = image_speed * t"

    def nearest(self) -> Iterator[str]:
        """Change the way between two points to that between their nearest images: y before x."""
        for axis in reversed(self.sides):
            if self.shears and axis == "y":
                yield "turns = rint(dy * y_inverse)"
                yield "dy -= y_side * turns"
                yield "dx -= image_shift * turns"
            else:
                yield f"d{axis} -= {axis}_side * rint(d{axis} * {axis}_inverse)"

    def rate(self) -> Iterator[str]:
        """Change the rate of the way between two points to that between their nearest images."""
        if self.shears:
            yield "ex -= image_speed * turns"

    def power(self) -> Iterator[str]:
        """Add the power with which the images above pull through the force between two points."""
        if self.shears:
            yield "total -= fx * image_speed * turns"
