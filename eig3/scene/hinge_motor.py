"""A motor in the hinge between two bodies, whose torque depends on the time, the angle and its rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from .effect import Link, arguments


@dataclass(frozen=True, eq=False)
class HingeMotor(Link):
    """The law of a motor, for a `HingeLaw`. It has a torque in the direction of the angle in place of a tension."""

    torque: Callable

    offers: ClassVar[dict[str, tuple[str, ...]]] = {"torque": ("t", "angle", "rate")}
    needs = ("torque",)
    source = "prescribed by the user"

    def __post_init__(self) -> None:
        if not hasattr(self.torque, "py_func") or arguments(self.torque) not in (("t",), ("t", "angle", "rate")):
            raise TypeError(
                "torque of Motor must be a jitted function of t, or of t, angle and rate, with these names."
            )
        self._compile("torque", self.torque, 1)
        super().__post_init__()

    @property
    def title(self) -> str:
        return "Motor"
