"""What each member of an ensemble does, beside its start, its parameters and its step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..functions.checks import check_count
from ..functions.events import Event
from ..functions.quantities import Functions
from ..kernels.protocol import Form
from ..methods import Method
from ..result.labels import Labels
from ..result.memory import n_rows
from ..run.prepare import Prepared
from ..stepping.march import NEVER
from ..stepping.watching import check_times
from .members import Members


@dataclass(frozen=True)
class Options:
    """The options of the run of each member, as `eig3.integrate` has them.

    Attributes
    ----------
    method : Method
    functions : Functions
        The invariants and outputs.
    events : dict of str to Event
    save_every : int or None
    t_eval : ndarray or None
    rtol, atol, h_max, first_step, max_steps
        `rtol` is None for fixed steps.
    integrals : tuple of str
        The last degrees of freedom are integrals with these names.
    labels : Labels or None
    """

    method: Method
    functions: Functions
    events: Mapping[str, Event]
    save_every: int | None = None
    t_eval: np.ndarray | None = None
    rtol: float | None = None
    atol: Any = None
    h_max: float | None = None
    first_step: float | None = None
    max_steps: int | None = None
    integrals: tuple[str, ...] = ()
    labels: Labels | None = None

    @property
    def has_tolerances(self) -> bool:
        return self.rtol is not None

    @property
    def has_own_times(self) -> bool:
        """Whether members may be saved at times that only their runs tell."""
        return self.t_eval is None and (self.has_tolerances or any(event.terminal for event in self.events.values()))

    @property
    def every(self) -> int:
        """A state is saved after so many steps."""
        return NEVER if self.save_every is None or self.t_eval is not None else self.save_every

    def rows(self, members: Members) -> int:
        """Return the number of states to save of a member; with tolerances, there may be more."""
        if self.t_eval is not None:
            return len(self.t_eval)
        return 2 if self.has_tolerances else n_rows(int(members.n_steps.max()), self.every)

    def prepared(self, rhs: Any, form: Form, h: float | None, **changes: Any) -> Prepared:
        """Return the prepared run of a member with the step h, which is None with tolerances."""
        return Prepared(rhs, form, **{**self._given(h), **changes})

    def _given(self, h: float | None) -> dict[str, Any]:
        names = "method", "events", "t_eval", "rtol", "atol", "h_max", "first_step", "max_steps", "integrals"
        given = {name: getattr(self, name) for name in names}
        every = self.save_every if self.t_eval is None else None
        return given | self.functions._asdict() | {"h": h, "save_every": every}


_NAMES = [each.name for each in fields(Options)]


def check_options(rhs: Any, form: Form, t_span: tuple[float, float], h: float | None, **given: Any) -> Options:
    """Return the options, after the checks of a single run.

    Raises
    ------
    TypeError, ValueError
        If an option is not valid, or two exclude each other.
    """
    prepared = Prepared(rhs, form, h=h, **given)
    own: dict[str, Any] = {name: prepared.options.get(name) for name in _NAMES}
    own |= {"method": prepared.method, "events": prepared.system.events, "functions": prepared.system.functions}
    own["t_eval"] = check_times(own["t_eval"], *t_span)
    own["save_every"] = None if own["save_every"] is None else check_count(own["save_every"], "save_every")
    return Options(**own)
