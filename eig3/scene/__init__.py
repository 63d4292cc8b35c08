"""Scenes: masses and the effects that act on them, as a problem whose compiled code holds nothing else.

`scene` is what a user builds, `effect` what an effect is, `assembly` puts effects in order, `packing` their parameters,
and `codegen` writes and compiles the code.
"""

from .scene import Points, Scene

__all__ = ["Points", "Scene"]
