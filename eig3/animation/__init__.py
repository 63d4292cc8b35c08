"""Animations: films of runs, and the views that they show."""

from .curves import Curves, Oscillator, Portrait
from .film import Film
from .geometry import geometry, triangles
from .mechanism import Magnified, Mechanism, in_plane
from .profile import Profile
from .shapes import Solid, coils, wrapped

__all__ = [
    "Curves",
    "Film",
    "Magnified",
    "Mechanism",
    "Oscillator",
    "Portrait",
    "Profile",
    "Solid",
    "coils",
    "geometry",
    "in_plane",
    "triangles",
    "wrapped",
]
