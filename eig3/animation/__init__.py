"""Animations: films of runs, and the views that they show."""

from .curves import Curves, Oscillator, Portrait
from .film import Film
from .mechanism import Magnified, Mechanism, in_plane
from .profile import Profile
from .shapes import coils

__all__ = ["Curves", "Film", "Magnified", "Mechanism", "Oscillator", "Portrait", "Profile", "coils", "in_plane"]
