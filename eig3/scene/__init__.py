"""Scenes: masses and the effects on them. A scene is compiled to a problem with code for exactly these effects.

`scene` has the classes that a user works with, `effect` and `cell` the base classes of effects, and `constraint` that
of constraints. `bodies` has rigid bodies, `held` checks the constraints of a scene, and `constraint_table` arranges
them for the kernels. `mesh` finds edges and surfaces of meshes. `assembly` groups the effects, `packing` arranges their
parameters in one array, and `codegen` writes and compiles the code, with a file for the text of each kind, such as
`mesh_text` for the loops over cells. `fields` checks the names of an effect's fields, and `names` makes the names in
the code.
"""

from .bodies import RigidBody
from .mesh import edges, hinges
from .scene import Points, Scene

__all__ = ["Points", "RigidBody", "Scene", "edges", "hinges"]
