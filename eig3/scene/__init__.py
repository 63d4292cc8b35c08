"""Scenes: masses and the effects on them. A scene is compiled to a problem with code for exactly these effects.

`scene`, `description` and `bodies` have the classes that a user works with, `effect`, `cell`, `frictional_contact` and
`body_torque` the base classes of effects, and `constraint` that of constraints. An effect is `placed` on points, and
`assembly` groups those that share a loop. For each group there is a block, which puts its parameters into the array p
and writes its loops: see `group_text`, `links_text`, `mesh_text`, `pair_force_text` and `grains_text`. What constraints
and rigid bodies need is in `constraint_text` and `bodies_text`. `source` is what is written, and `codegen` orders it to
functions and compiles them. `constraint_system` checks the constraints of a scene, and `constraint_table` arranges them
for the kernels. `mesh` finds edges and surfaces of meshes. `fields` checks the names of an effect's fields, and `names`
makes the names in the code. `bonds` finds the pairs that a force between near points, a `pair_force`, leaves out.
"""

from .bodies import RigidBody
from .description import Points
from .mesh import edges, hinges
from .scene import Scene

__all__ = ["Points", "RigidBody", "Scene", "edges", "hinges"]
