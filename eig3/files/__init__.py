"""Files of other programs: runs as trajectories and meshes, and scenes from the data of atoms and meshes."""

from .export import export

__all__ = ["export"]
