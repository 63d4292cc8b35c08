"""Write the minimum-image convention of a periodic box as lines of Python source.

In a box that shears, the images at y + y_side are displaced along x by image_shift at the time t, and move at
image_speed: A. W. Lees and S. F. Edwards, Journal of Physics C 5 (1972). Positions are unwrapped.
"""

from __future__ import annotations

from collections.abc import Iterator


class BoxText:
    """The periodic box of one scene in the source. Each method returns lines.

    Attributes
    ----------
    sides : dict of str to int
        The places in p of the sides of the periodic box, by periodic axis; `shear` is the place of the shear rate, or
        None.
    """

    def __init__(self, sides: dict[str, int], shear: int | None) -> None:
        self.sides, self._shear = sides, shear

    @property
    def shears(self) -> bool:
        """Whether the box shears."""
        return self._shear is not None

    def constants(self) -> Iterator[str]:
        """Read the sides, and the displacement and velocity of the images above."""
        for axis, place in self.sides.items():
            yield f"{axis}_side = p[{place}]"
            yield f"{axis}_inverse = 1 / {axis}_side"
        if self.shears:
            yield f"image_speed = p[{self._shear}] * y_side"
            yield "image_shift = image_speed * t"

    def nearest(self) -> Iterator[str]:
        """Replace the vector between two points by the vector between their nearest images: y before x."""
        for axis in reversed(self.sides):
            if self.shears and axis == "y":
                yield "turns = rint(dy * y_inverse)"
                yield "dy -= y_side * turns"
                yield "dx -= image_shift * turns"
            else:
                yield f"d{axis} -= {axis}_side * rint(d{axis} * {axis}_inverse)"

    def rate(self) -> Iterator[str]:
        """Replace the rate of the vector between two points by its rate between their nearest images."""
        if self.shears:
            yield "ex -= image_speed * turns"

    def power(self) -> Iterator[str]:
        """Add the power of the moving images through the force between two points."""
        if self.shears:
            yield "total -= fx * image_speed * turns"
