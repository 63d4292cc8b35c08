"""A link of any law that breaks."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..scene.effect import RATE, Arrays, Columns, Link, arguments, distance
from ..scene.of_law import OfLaw, call_of, calling, has_state
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

    def check_points(self, masses: Arrays, positions: Arrays, columns: Columns) -> None:
        super().check_points(masses, positions, columns)
        self.check_whole(columns, distance(positions))

    def check_whole(self, columns: Columns, stretches: np.ndarray) -> None:
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
    law, has_energy = dict(inner), "max_energy" in limits
    broken, *others = [f"state[{k}]" for k in range(size)] if size > 1 else ["state"]
    of_law = others[has_energy:]
    state = of_law[0] if len(of_law) == 1 else f"({', '.join(of_law)})"
    calls = {name: call_of(name, f, state) for name, f in inner}
    pulls = [name for name in ("tension", "force_density") if name in law]
    force = " + ".join(calls[name] + " * r" * (name == "force_density") for name in pulls)
    lines = {name: [f"return (1 - {broken}) * {calls[name]}"] for name in (*pulls, "potential") if name in law}
    values = {"max_force": f"({force})", "max_energy": others[0] if has_energy else ""}
    parts = [f"{values.get(name, '(r - rest_length)' if has_rest else 'r')} / {name} - 1" for name in limits]
    most = f"max({', '.join(parts)})" if len(parts) > 1 else parts[0]
    lines["event"] = [f"return {most} if {broken} == 0 else -1.0"]
    lines["state_after"] = [f"return {', '.join(['1.0', *others])}"]
    if has_energy or RATE in law:  # the rates of the energy and of the state of the law, which are 0 after the break
        rates = ["0.0", *[f"is_whole * rate * ({force})"] * has_energy]
        lines[RATE] = [f"is_whole = 1 - {broken}"]
        if RATE in law:
            lines[RATE].append(f"law_rates = {calls[RATE]}")
            count = len(of_law)
            rates += ["is_whole * law_rates"] if count == 1 else [f"is_whole * law_rates[{k}]" for k in range(count)]
        lines[RATE].append(f"return {', '.join(rates)}")
    known = {"t", "r", "rate", "state", "rest_length", *limits, *(x for f in law.values() for x in arguments(f))}
    return calling(law, lines, known, "breaking", {"__name__": __name__})
