"""Detect finite blow-ups: motions that grow by orders of magnitude. This needs no invariant."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any

from ..functions.guard import Sizes
from ..stepping.stepper import Stepper

STRANGE = 1e3  # beyond this multiple of its natural size, the motion may be unstable
BLOWN_UP = 1e4  # beyond this multiple of its natural size, a search for an instability is worth its time
OVERFLOWING = 1e100  # a motion of this size is suspect, whatever its natural size is


def natural_sizes(first: Sizes, span: Any) -> tuple[Any, Any]:
    """Return the natural sizes of u and v, from the sizes at the start and the length of the span.

    The natural size of v is the largest |v| at the start, plus the change of v that the acceleration at the start would
    cause over the whole span. The natural size of u is the largest |u| at the start, plus the change of u that the
    natural size of v would cause.
    """
    u, v, a = first
    v_natural = v + span * a
    return u + span * v_natural, v_natural


class Growth:
    """The size of the motion relative to its natural size, measured at intervals.

    See `natural_sizes`. If a motion starts at rest without acceleration, its natural size is its size in the
    middle of the span.

    Attributes
    ----------
    may_be_motion : bool
        Whether the motion itself may grow. If it does not with other steps, growth needs no search for its reason,
        which may take far longer than the run.
    """

    def __init__(self, stepper: Stepper, n_steps: int) -> None:
        self._h, self._first = stepper.h, stepper.first_sizes
        self._set_span(n_steps)
        if stepper.middle_sizes:
            self._natural = stepper.middle_sizes
        self._strange: Stepper | None = None
        self._size, self._is_overflowing, self.may_be_motion = 0.0, False, True

    def _set_span(self, n_steps: int) -> None:
        self._half = n_steps // 2
        self._natural = natural_sizes(self._first, n_steps * self._h)

    def extended(self, n_steps: int, index: int) -> Growth:
        """Return an independent observer for a run of more steps, of which `index` are taken."""
        other = copy(self)
        other._set_span(n_steps)
        if other.needs_half and other._half <= index:
            other._natural, other._half = self._natural, self._half
        return other

    def kept(self) -> dict[str, Any]:
        """Return the state of this observer, in numbers and arrays."""
        strange = None if self._strange is None else self._strange.kept()
        sizes = {"natural": self._natural, "half": self._half, "size": self._size}
        return {**sizes, "is_overflowing": self._is_overflowing, "strange": strange}

    def restore(self, kept: Mapping[str, Any], stepper: Stepper) -> None:
        """Restore the state `kept`; `stepper` is the stepper of the run."""
        u, v = kept["natural"]
        self._natural, self._half, self._size = (float(u), float(v)), int(kept["half"]), float(kept["size"])
        self._is_overflowing = bool(kept["is_overflowing"])
        if kept["strange"] is not None:
            self._strange = stepper.fork()
            self._strange.load(kept["strange"])

    @property
    def needs_half(self) -> bool:
        """Whether the size should be measured in the middle of the run."""
        return self._natural[1] == 0

    def see(self, stepper: Stepper, first: int) -> None:
        """Measure the size of the motion after the steps since step index `first`."""
        u, v = stepper.sizes
        if self._natural[1] == 0 and stepper.index >= self._half > first:
            self._natural = u, v
        u_natural, v_natural = self._natural
        self._size = max(u / u_natural if u_natural else 0.0, v / v_natural if v_natural else 0.0)
        self._is_overflowing = max(u, v) > OVERFLOWING
        if self._strange is None and (self._size > STRANGE or self._is_overflowing):
            self._strange = stepper.before()

    @property
    def suspect(self) -> Stepper | None:
        """A stepper at a state before the growth; None if the motion did not grow much."""
        return self._strange if self._size > BLOWN_UP or self._is_overflowing else None
