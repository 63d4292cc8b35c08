"""Structures given by their matrices, M u'' + C u' + K u = f, or built from nodes and members."""

try:
    import scipy  # noqa: F401
except ImportError as error:
    raise ImportError("structures need SciPy: pip install 'eig3[structures]'.") from error

from .damping import Modal, Rayleigh
from .frame import Frame
from .frame_members import Section
from .linear import linear
from .modal import modal_solution
from .modes import Modes
from .responses import (
    absolute_motion,
    base_shear,
    ground_motion,
    link_ductility,
    link_forces,
    link_stretches,
    storey_drifts,
)
from .structure import Structure

__all__ = [
    "Frame",
    "Modal",
    "Modes",
    "Rayleigh",
    "Section",
    "Structure",
    "absolute_motion",
    "base_shear",
    "ground_motion",
    "linear",
    "link_ductility",
    "link_forces",
    "link_stretches",
    "modal_solution",
    "storey_drifts",
]
