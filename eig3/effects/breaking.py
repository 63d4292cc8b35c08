"""A link of any law that breaks."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import jit
from ..kernels.compile.source import Writer, define
from ..scene.effect import RATE, Link, arguments, distance
from ..scene.of_law import OfLaw, has_state
from ..scene.placed import Placed

_LIMITS = "max_stretch", "min_stretch", "max_force", "max_energy"


@dataclass(frozen=True, eq=False)
class Breaking(OfLaw, Link):
    """A link of another law that breaks at a stretch, a force or an energy: a bond, a brace, a cohesive zone.

    Formula: the tension of law until r - rest_length reaches max_stretch or falls to min_stretch, the tension reaches
    max_force, or the energy that the link has absorbed reaches max_energy, whichever is first; and 0 from then on. r is
    the distance of the ends, and rest_length a parameter of the law, or 0.

    The break is an event: ``solution.events["breaking 0"]`` has its time. The first number of the state
    is 0 while the link is whole and 1 after, the next one is the energy, if it has a limit, and the state of the law
    follows.

    Parameters
    ----------
    law : Link
        Its tension, N, acts until the break. It has no event, as `ElasticPlastic` has; `BoucWen` yields without one.
    max_stretch : float or array_like, optional
        Above 0, m; rad in a joint. A critical strain s of a bond is a stretch of s rest_length.
    min_stretch : float or array_like, optional
        Below 0, m.
    max_force : float or array_like, optional
        The largest tension, N.
    max_energy : float or array_like, optional
        The work on the link, elastic and dissipated, J.

    Raises
    ------
    TypeError, ValueError
        For no limit, a limit of a wrong sign, an unsuitable law, or a link that would be broken at the start.

    Notes
    -----
    Other codes: ``uniaxialMaterial MinMax`` of OpenSees. LAMMPS: ``fix bond/break`` with Rmax = rest_length +
    max_stretch, and ``pair_style peri`` with s00 = max_stretch / rest_length. Here the time is found within a step.

    Not included: healing, and a loss of stiffness before the break.
    """

    law: Any
    max_stretch: ArrayLike | None = None
    min_stretch: ArrayLike | None = None
    max_force: ArrayLike | None = None
    max_energy: ArrayLike | None = None

    crossing = 1
    at_start = "law must be whole at the start"
    source = "the law, up to a limit"

    def __post_init__(self) -> None:
        self.check_law()
        for name in ("event", "rate_after"):
            if name in self.law.functions():
                raise TypeError(f"law of Breaking must have no event, as {self.law.title} has: take one without.")
        if not self._limits():
            raise TypeError(f"Breaking must have a limit: give {', '.join(_LIMITS[:-1])} or {_LIMITS[-1]}.")
        super().__post_init__()
        for name in self._limits():
            sign, wanted = (-1, "negative") if name == "min_stretch" else (1, "positive")
            self.require(sign * self._reals(name) > 0, f"{name} must be {wanted}")

    def check_points(
        self, masses: list[np.ndarray], positions: list[np.ndarray], columns: dict[str, np.ndarray]
    ) -> None:
        super().check_points(masses, positions, columns)
        self.check_whole(columns, distance(positions))

    def check_whole(self, columns: dict[str, np.ndarray], stretches: np.ndarray) -> None:
        """Refuse links that have reached a limit at the start, for their r."""
        placed = Placed(self, columns)
        for k, r in enumerate(stretches.tolist()):
            if not placed.call("event", k, {"t": 0.0, "r": r, "rate": 0.0}) < 0:
                raise ValueError(f"{self.title} is broken at the start: link {k} has reached a limit.")

    @property
    def cutoff_field(self) -> str:  # type: ignore[override]
        return str(self.law.cutoff_field)

    @property
    def picture(self) -> str:  # type: ignore[override]
        return str(self.law.picture) if RATE in self.functions() else "string"  # films read u, and thus no rates

    @property
    def ductility(self) -> Any:  # type: ignore[override]
        return self.law.ductility

    @property
    def state_size(self) -> int:  # type: ignore[override]
        return 1 + (self.max_energy is not None) + super().state_size * has_state(self.law.functions())

    def functions(self) -> dict[str, Any]:
        inner = tuple(self.law.functions().items())
        return dict(_breaking(inner, self.state_size, self._limits(), "rest_length" in self.law.parameters()))

    def _limits(self) -> tuple[str, ...]:
        return tuple(name for name in _LIMITS if getattr(self, name) is not None)


@functools.lru_cache(256)
def _breaking(inner: tuple[tuple[str, Any], ...], size: int, limits: tuple[str, ...], has_rest: bool) -> Any:
    """Return the functions that call a law. The same law gives the same functions, so scenes share their code."""
    text = _Text(dict(inner), size, limits, has_rest)
    defined = define(text.source(), "breaking", {"__name__": __name__, **{f"law_{name}": f for name, f in inner}})
    return tuple((name, jit(defined[name])) for name in text.names)


class _Text(Writer):
    """Writes the functions."""

    def __init__(self, inner: dict[str, Any], size: int, limits: tuple[str, ...], has_rest: bool) -> None:
        super().__init__()
        self._inner, self._limits, self._has_energy = inner, limits, "max_energy" in limits
        self._entries = [f"state[{k}]" for k in range(size)] if size > 1 else ["state"]
        self._of_law = self._entries[1 + self._has_energy :]
        self._stretch = "(r - rest_length)" if has_rest else "r"
        self._pulls = [name for name in ("tension", "force_density") if name in inner]
        self._force = " + ".join(self._call(name) + " * r" * (name == "force_density") for name in self._pulls)
        self.names: list[str] = []

    def source(self) -> str:
        broken = self._entries[0]
        for name in (*self._pulls, "potential"):
            if name in self._inner:
                self._write(name, f"return (1 - {broken}) * {self._call(name)}")
        values = {"max_force": f"({self._force})", "max_energy": self._entries[self._has_energy]}
        parts = [f"{values.get(name, self._stretch)} / {name} - 1" for name in self._limits]
        most = f"max({', '.join(parts)})" if len(parts) > 1 else parts[0]
        self._write("event", f"return {most} if {broken} == 0 else -1.0")
        self._write("state_after", f"return {', '.join(['1.0', *self._entries[1:]])}")
        if self._has_energy or RATE in self._inner:
            self._rates()
        return str(self)

    def _rates(self) -> None:
        """Write the rates of the energy and of the state of the law, which are 0 after the break."""
        rates, lines = ["0.0"], [f"is_whole = 1 - {self._entries[0]}"]
        if self._has_energy:
            rates.append(f"is_whole * rate * ({self._force})")
        if RATE in self._inner:
            lines.append(f"law_rates = {self._call(RATE)}")
            count = len(self._of_law)
            rates += ["is_whole * law_rates"] if count == 1 else [f"is_whole * law_rates[{k}]" for k in range(count)]
        self._write(RATE, *lines, f"return {', '.join(rates)}")

    def _call(self, name: str) -> str:
        state = self._of_law[0] if len(self._of_law) == 1 else f"({', '.join(self._of_law)})"
        return f"law_{name}({', '.join(state if x == 'state' else x for x in arguments(self._inner[name]))})"

    def _write(self, name: str, *lines: str) -> None:
        """Write a function; its arguments are those names in its lines that it can take."""
        known = {
            "t",
            "r",
            "rate",
            "state",
            "rest_length",
            *self._limits,
            *(x for f in self._inner.values() for x in arguments(f)),
        }
        words = dict.fromkeys(re.findall(r"\w+", " ".join(lines)))
        with self.block(f"def {name}({', '.join(word for word in words if word in known)})"):
            self.line(*lines)
        self.names.append(name)
