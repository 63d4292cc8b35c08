"""Structures given by their matrices, M u'' + C u' + K u = f, or built from members."""

from .damping import Modal, Rayleigh
from .linear import linear
from .modal import modal_solution
from .responses import absolute_motion, base_shear, ground_motion, storey_drifts

__all__ = [
    "Modal",
    "Rayleigh",
    "absolute_motion",
    "base_shear",
    "ground_motion",
    "linear",
    "modal_solution",
    "storey_drifts",
]
