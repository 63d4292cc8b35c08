"""Scenes: masses and the effects on them. A scene is compiled to a problem with code for exactly these effects.

`scene`, `description` and `bodies` have the classes that a user works with, `effect`, `cell`, `grain_contact` and
`body_torque` the base classes of effects, and `constraint` that of constraints. `constraint_set` checks the constraints
of a scene, and `constraint_table` arranges them for the kernels. `mesh` finds edges and surfaces of meshes. `assembly`
groups the effects, `packing` arranges their parameters in one array, and `codegen` writes and compiles the code, with a
file for the text of each kind, such as `mesh_text` for the loops over cells. `fields` checks the names of an effect's
fields, and `names` makes the names in the code.
"""

from .bodies import RigidBody
from .description import Points
from .mesh import edges, hinges
from .scene import Scene

__all__ = ["Points", "RigidBody", "Scene", "edges", "hinges"]
