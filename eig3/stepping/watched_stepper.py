"""A run with a fixed step that looks for events, and for times at which the state is wanted, within its steps."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.inlining import inlined
from ..kernels.loops.events import NOT_A_NUMBER, NOT_FINITE, RESET, RESTING
from ..kernels.loops.variable import GOING
from ..kernels.loops.watched import FAILED, inline_watched_kernel, watched_kernel, work_rows
from ..kernels.protocol import ENDED_BY, EVENT_VALUES, EVENTS, TIME, WITHIN, Run
from ..methods import Method
from ..result.growing import Rows
from .stepper import Stepper
from .watching import Watching, not_a_number


class WatchedStepper(Stepper):
    """A `Stepper` with events, and with times at which the state is wanted.

    Parameters
    ----------
    rhs, u0, v0, h, t0, params, method, inline
        As for `Stepper`.
    t_end : float
        The end of the run.
    events, t_eval
        As for `eig3.integrate`.

    Attributes
    ----------
    ended : int
        How the last call of the kernel ended.
    """

    def __init__(
        self,
        rhs: Any,
        u0: ArrayLike,
        v0: ArrayLike,
        *,
        t_end: float,
        events: Any,
        t_eval: ArrayLike | None,
        **options: Any,
    ) -> None:
        self.ended, self._t_end, self._options = GOING, t_end, options
        super().__init__(rhs, u0, v0, **options)
        span = self.t0, t_end
        self.watching = Watching(events, t_eval, self.form, self.start, span, self.params, work_rows(self.method.order))
        self._tally = np.zeros(EVENTS + EVENT_VALUES * len(self.watching.events))
        self.watching.begin(self._tally, self.t0, *self.start)
        self._before = self._position()
        self._n_found = 0

    @property
    def is_over(self) -> bool:
        """Whether an event ended the run."""
        return RESET < self.ended <= RESTING

    @property
    def is_within_step(self) -> bool:
        return self.is_over and self.t > super().t

    @property
    def t(self) -> float:
        """The time reached: t0 + index h, or that of the event which ended the run."""
        return float(self._tally[TIME]) if self.is_over else super().t

    @property
    def ended_by(self) -> str:
        """The name of the event that ended the run."""
        return self.watching.name(int(self._tally[ENDED_BY]))

    @property
    def has_begun_step(self) -> bool:
        return bool(self._tally[WITHIN] == 1)

    def wanted_rows(self) -> Rows | None:
        """Return the states at the wanted times so far; None if no times were given."""
        return self.watching.rows(self._tally)

    def finish(self) -> None:
        """Write the state at the end of the run at the wanted times that differ from it by round-off only.

        The run has reached the end of its span, from which t0 + n h may differ by round-off, or an event ended it.
        """
        self.watching.finish(self._tally, self.t if self.is_over else self._t_end, self.h, self.u, self.v)

    def restarted(self, h: float) -> WatchedStepper:
        """Return a new stepper at t0, u0 and v0, with the step h and the same events."""
        options = {**self._options, "h": h}
        return WatchedStepper(
            self._rhs, *self.start, t_end=self._t_end, events=self.watching.events, t_eval=None, **options
        )

    def fork(self) -> WatchedStepper:
        other: Any = super().fork()
        other.watching = self.watching.fork()
        return other

    __copy__ = fork

    def extended(self, t_end: float) -> WatchedStepper:
        watching = self.watching.extended(self.t0, t_end)
        other = self.fork()
        other._t_end, other.watching = t_end, watching
        return other

    def restore(self, kept: Mapping[str, Any]) -> None:
        super().restore(kept)
        self.watching.restore(self._tally)
        self._before = self._position()

    def _compiled(self, running: Method, jacobian: Any) -> Any:
        formulas, order, form = self._formulas, self.method.order, self.form
        if not self.inline:
            return watched_kernel(formulas, order, form, jacobian is not None)
        make = partial(inline_watched_kernel, formulas, order, form)
        return inlined(make, (formulas, "watched"), form, self._rhs, running.jacobian)

    def _call(self, run: Run) -> tuple[int, bool]:
        watch = self.watching.watch
        done, self.ended = self._kernel(self._callbacks, self._state, self._settings, self._tally, run, watch)
        self.watching.collect(self._tally)
        if self.ended in (NOT_A_NUMBER, NOT_FINITE):
            raise not_a_number(self, float(self._tally[TIME]))
        return done, self.ended == FAILED

    def _save(self) -> None:
        super()._save()
        self._n_found = self.watching.n_found

    def _go_back(self) -> None:
        super()._go_back()
        self.watching.forget_from(self._n_found)
        self.ended = GOING
