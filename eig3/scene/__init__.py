"""Models of masses, rigid bodies, joints, contacts and meshes, compiled to problems that contain only their effects.

Users work with the classes in `scene`, `description` and `bodies`. `effect`, `cell`, `frictional_contact` and
`body_torque` have the base classes of effects, and `constraint` has the base class of constraints. `placed` connects an
effect to its points, and `assembly` groups the effects that share a loop. A text module writes the loops of each group
and stores its parameters in the array p: `group_text`, `links_text`, `mesh_text`, `pair_force_text` and `grains_text`;
`constraint_text` and `bodies_text` write the code of constraints and rigid bodies. `source` collects the source, and
`codegen` arranges it in functions and compiles them. `constraint_system` checks the constraints, and `constraint_table`
stores them for the kernels. `mesh` finds edges and surfaces of meshes. `fields` checks the names of the fields of an
effect, and `names` makes the names in the source. `bonds` finds the pairs that a `pair_force`, a force between near
points, excludes. `joint_law` puts a link into a joint of bodies. `reading` makes scenes from files, and `force_chains`
finds the contacts in files for ParaView.
"""

from .bodies import RigidBody
from .description import Points
from .mesh import edges, hinges
from .scene import Scene

__all__ = ["Points", "RigidBody", "Scene", "edges", "hinges"]
