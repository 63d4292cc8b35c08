"""The problems that `eig3 run` and `eig3 plan` know by name."""

from __future__ import annotations

from collections.abc import Callable

from ..problem import Problem


def builder(name: str, command: str) -> Callable[..., Problem]:
    """The function of `eig3.problems` that builds a problem.

    Raises
    ------
    SystemExit
        If there is no problem of this name. The message lists the names.
    """
    from .. import problems

    if name not in problems.__all__:
        raise SystemExit(f"eig3 {command}: PROBLEM must be one of {', '.join(problems.__all__)}, not {name}.")
    return getattr(problems, name)
