"""Scenes: masses and the effects on them. A scene is compiled to a problem with code for exactly these effects.

`scene` has the classes that a user works with and `effect` the base classes of effects. `assembly` groups the effects,
`packing` arranges their parameters in one array, and `codegen` writes and compiles the code. `fields` checks the names
of an effect's fields, and `names` makes the names in the code.
"""

from .scene import Points, Scene

__all__ = ["Points", "Scene"]
