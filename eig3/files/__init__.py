"""Files of other programs: runs as trajectories and meshes, and the data of atoms, meshes and mechanisms."""

from .export import export

__all__ = ["export"]
