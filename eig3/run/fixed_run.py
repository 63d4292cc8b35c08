"""A run with a fixed step."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from ..diagnosis.coarseness import coarse_events, coarseness, links_of, long_ways
from ..diagnosis.divergence import Divergence, find_blow_up, find_divergence
from ..diagnosis.heat import heat
from ..functions.checks import check_count, check_resolution, check_time
from ..functions.guard import guarded
from ..functions.records import skips
from ..kernels.protocol import FAILED, SCALAR
from ..methods import EIG
from ..result.error_estimate import Companion, ErrorEstimate, clear_estimate, estimate
from ..result.memory import check_disk, check_history, n_rows
from ..result.solution import Solution, Status, whole_rows
from ..result.storage import Place, going_on
from ..stability import alternating_limit
from ..stepping.march import Cancel
from ..stepping.observer import check_times, further_times
from ..stepping.run_options import NEVER
from ..stepping.stepper import Stepper
from ..stepping.system import System
from ..stepping.threads import side_by_side
from .chunks import Run, compared
from .growth import Growth
from .instability import has_grown, instability
from .progress import check_progress
from .saved_rows import SavedRows

_LARGEST_GRADE = 7  # with a higher grade of EIG and a force that reads the velocity, a note advises against it


class FixedRun(Run):
    """A run of `n_steps` steps up to `t_end`, from which t0 + n h may differ by round-off.

    `save_every` is as the user has given it. The other arguments are the same as for `Run`.
    """

    stepper: Stepper

    def __init__(
        self,
        stepper: Stepper,
        n_steps: int,
        t_end: float,
        save_every: int | None,
        times: np.ndarray | None,
        place: Place | None = None,
        progress: bool = False,
        history: SavedRows | None = None,
    ) -> None:
        self.n_steps, self.t_end, self.save_every = n_steps, t_end, save_every
        self.growth = Growth(stepper, n_steps)
        self._n_times = 0  # rows in files whose times are written
        every = NEVER if times is not None else stride(save_every, n_steps)
        super().__init__(stepper, every, times, place, progress, history)

    @classmethod
    def restored(cls, solution: Solution, system: System) -> FixedRun:
        state = solution._state or {}
        n_steps, t_end = check_count(state["n_steps"], "n_steps"), float(state["t_end"])
        u0, v0 = state["start"]
        with going_on():
            times = check_times(state["times"], state["t0"], t_end)
            stepper = Stepper.of(system, state["t0"], state["h"], u0, v0, guarded(state["params"]), times)
            stepper.load(state["stepper"])
            if stepper.look:
                stepper.look.recall(solution.events)
            t, u, v = whole_rows(solution, stepper.n)
            count = stepper.n_wanted if times is not None else stepper.index // stride(state["save_every"], n_steps) + 1
            if len(t) < count:
                raise ValueError(f"{len(t)} states are too few.")
            rows = {"t": t, "u": u, "v": v}
            run = cls.ended(stepper, n_steps, t_end, state["save_every"], times, rows, solution.outputs)
            run.growth.restore(state["growth"], stepper)
        return run

    @classmethod
    def ended(
        cls,
        stepper: Stepper,
        n_steps: int,
        t_end: float,
        save_every: int | None,
        times: np.ndarray | None,
        rows: dict[str, np.ndarray],
        outputs: dict[str, np.ndarray],
    ) -> FixedRun:
        """Return a run that a stepper has taken to its end, with its rows."""
        run = cls(stepper, n_steps, t_end, save_every, times, history=_EMPTY)
        run.saved, run.saved_outputs = rows, outputs
        run._judge_event()
        return run

    def extended(self, t_end: float, progress: bool, save_to: str | PathLike[str] | None, t_eval: Any) -> FixedRun:
        check_progress(progress)
        n_steps = steps_until(self.stepper, t_end)
        times = further_times(self.times, t_eval, self.stepper.t, t_end)
        self.close()
        place = self._place(save_to)
        stepper = self.stepper.fork()
        run = FixedRun(stepper, n_steps, t_end, self.save_every, times, place, progress)
        run.growth = self.growth.extended(n_steps, stepper.index)
        return run.begin(self, stepper.n_wanted if times is not None else stepper.index // run.every + 1)

    def error_of(self, solution: Solution, coarser: float | None, cancel: Cancel | None) -> ErrorEstimate:
        """Compare first with twice and four times the step, which takes less than the run itself."""
        if coarser is not None and (twice := self._companion(solution, 2, cancel)):
            return estimate(solution, twice, None, coarser)
        tasks = partial(self._companion, solution, 2), partial(self._companion, solution, 1)
        twice, four_times = side_by_side(*tasks, self.stepper.system, solution.kernel_seconds / 2, cancel)
        if twice and four_times and (error := clear_estimate(solution, twice, four_times)):
            return error
        two_thirds = self.n_steps % 2 == 0 and (self.times is not None or self.every % 2 == 0)
        fine = self._companion(solution, 6 if two_thirds else 8, cancel)
        assert fine
        return estimate(solution, fine, twice)

    def _companion(self, solution: Solution, steps: int, cancel: Cancel | None) -> Companion | None:
        """Return the run with `steps` steps in place of four steps; None if no state is at the same time."""
        stepper, n_steps = self.stepper, self.n_steps * steps // 4
        if not n_steps:
            return None
        h, t_end, every = stepper.h * 4 / steps, self.t_end, None
        is_whole = n_steps * 4 == self.n_steps * steps
        if self.save_every is not None:
            every = stride(self.save_every, self.n_steps) * steps
            every //= math.gcd(every, 4)  # with a remainder, the companion does not have all of the states
            t_end = t_end if is_whole else stepper.t0 + n_steps * h
        elif not is_whole:  # a little longer steps lead to the end too
            h = (t_end - stepper.t0) / n_steps
        times = None if self.times is None else self.times[self.times <= t_end]
        found = compared(self._repeated(h, n_steps, t_end, every, times).begin, cancel)
        companion = Companion.at_same_steps(solution, found, h / stepper.h)
        return companion if len(companion.rows) > 1 or found.status is not Status.COMPLETED else None

    def _repeated(self, h: float, n_steps: int, t_end: float, every: int | None, times: np.ndarray | None) -> FixedRun:
        """Return a run from the same start, which has not begun."""
        stepper = self.stepper
        other = Stepper.of(stepper.system, stepper.t0, h, *stepper.start, guarded(stepper.p), times)
        run = FixedRun(other, n_steps, t_end, every, times)
        run.growth.may_be_motion = self.is_suspect
        return run

    def with_states(self, count: int) -> FixedRun:
        times = None if self.times is None else np.linspace(self.stepper.t0, self.t_end, count)
        return self._repeated(self.stepper.h, self.n_steps, self.t_end, max(1, self.n_steps // count), times)

    def state(self) -> dict[str, Any]:
        return super().state() | {
            "h": self.stepper.h,
            "t_end": self.t_end,
            "n_steps": self.n_steps,
            "save_every": self.save_every,
            "stepper": self.stepper.kept(),
            "growth": self.growth.kept(),
        }

    def _empty_history(self) -> SavedRows:
        stepper, place = self.stepper, self.place
        n_steps, every = (self.n_steps, self.every) if self.times is None else (len(self.times) - 1, 1)
        functions = stepper.system.functions
        if place is None:
            check_history(n_steps, every, stepper.n, functions.n_outputs)
        else:
            check_disk(place.directory, n_steps, every, stepper.n, functions.n_outputs)
        state, directory = () if stepper.form is SCALAR else (stepper.n,), place.directory if place else None
        return SavedRows(state, functions.shapes, n_rows(n_steps, every), directory, has_times=False, has_steps=False)

    def _left(self) -> int:
        # The state in the middle of the run shows the size of a motion that starts at rest.
        half = self.n_steps // 2
        end = half if self.growth.needs_half and self.stepper.index < half else self.n_steps
        return end - self.stepper.index

    def _judge(self, first: int) -> None:
        stepper = self.stepper
        if not stepper.is_finite:
            self._end_diverged()
        elif stepper.ended == FAILED:
            self._end_unsolved()
        elif not self._judge_event() and stepper.index == self.n_steps:
            self.is_done = True
        self.growth.see(self.stepper, first)

    def _end_diverged(self) -> None:
        """End the run at its last finite state."""
        n_wanted, divergence = self.stepper.n_wanted, find_divergence(self.stepper, self.t_end)
        self.stepper = stepper = divergence.last
        self._end(Status.DIVERGED, divergence.message, divergence.explain)
        if self.times is None:
            self.history.row = stepper.index // self.every + 1
        else:  # the dense output of the last step may not be finite
            rows = self.history.rows(stepper.n)
            finite = np.isfinite(rows.u[:n_wanted] + rows.v[:n_wanted]).all(axis=1)
            self.history.row = int(np.argmin([*finite, False]))

    def _end_unsolved(self) -> None:
        stepper = self.stepper
        if not math.isfinite(stepper.residual):
            divergence = Divergence(stepper, stepper.failed_degree, stepper.before(), self.t_end)
            self._end(Status.DIVERGED, divergence.message, divergence.explain)
            return
        remedies = ["a smaller h", "more max_iterations", "a larger tol"]
        if not stepper.running.formulas.matrix:
            remedies.append("solver='newton'")
        self._end(
            Status.NOT_CONVERGED,
            f"{stepper.method.label}'s solve for the velocity did not converge at t = {stepper.t + stepper.h:g}, where "
            f"its residual is {stepper.residual:.3g}; {', '.join(remedies[:-1])} or {remedies[-1]} may help.",
        )

    @property
    def is_suspect(self) -> bool:
        return self.status is Status.COMPLETED and self.growth.suspect is not None

    def judge_growth(self) -> None:
        """Change the status to DIVERGED if the motion stayed finite, but grew because of its step."""
        suspect = self.growth.suspect
        if not self.growth.may_be_motion:
            self._end(Status.DIVERGED, "The motion grew, unlike with the other steps.")
        elif blow_up := suspect and find_blow_up(self.stepper, suspect):
            self._end(Status.DIVERGED, blow_up.message, blow_up.explain)

    def _complete(self) -> None:
        stepper, history = self.stepper, self.history
        if self.times is not None:
            if self.status is not Status.DIVERGED:
                if stepper.look and (stepper.index == self.n_steps or stepper.is_over):
                    t = stepper.t if stepper.is_over else self.t_end
                    stepper.look.finish(stepper, t)
                history.row = stepper.n_wanted
        else:
            if stepper.index % self.every or stepper.is_within_step:
                self._write_present(stepper.h)
            elif stepper.is_over:  # the resets at the end of a step are in the last row
                history.row -= 1
                self._write_present(stepper.h)
        self._write_times()

    def _keep(self) -> None:
        self._write_times()
        super()._keep()

    def _write_times(self) -> None:
        """Write the times of the rows in files."""
        if self.history.files:
            first, count = self._n_times, self.history.count
            new = self._grid(count, first) if self.times is None else self.times[first:count]
            self.history.arrays["t"][first:count] = new
            self._n_times = max(0, count - 1)  # the last time may be the end of the run

    def _fields(self) -> dict[str, Any]:
        return {"h": self.stepper.h}

    def _grid(self, count: int, first: int = 0) -> np.ndarray:
        stepper = self.stepper
        end = self.t_end if stepper.index == self.n_steps else stepper.t
        return grid(stepper.t0, stepper.h, self.every, count, stepper.index, end, first)

    def _notes(self) -> list[str]:
        stepper = self.stepper
        notes = self._invariant_notes("take a smaller h, or a method that is stable for this system")
        if self.status is Status.COMPLETED:
            notes += filter(None, (self._coarseness(), *self._contacts(), self._instability(), heat(stepper)))
        running, span = stepper.running, (stepper.t0, stepper.t)
        notes += filter(None, [skips(stepper.system.rhs, stepper.p, span, stepper.h, running.evaluations)])
        if isinstance(running, EIG) and running.grade > _LARGEST_GRADE and not running.ignores_velocity:
            notes.append(
                f"{running.label} predicts the velocity from {running.grade - 2} accelerations: with damping its limit "
                f"is short (omega h = {alternating_limit(running.grade, 0.1):.3g} at xi = 0.1); take RK8 or a grade of "
                "5 to 7."
            )
        return notes

    def _coarseness(self) -> str:
        """Describe a step that is too long for the motion. A reset is a jump of the motion, not a turn."""
        stepper = self.stepper
        if any(event.apply for event in stepper.system.events.values()):
            return ""
        has_all = self.every == 1 and self.saved is not None
        return coarseness(stepper, self.saved["u"][: stepper.index + 1] if has_all and self.saved else None)

    def _contacts(self) -> Iterator[str]:
        """Describe a step that is too long for the contacts of links and points."""
        stepper, h = self.stepper, np.array([self.stepper.h])
        links, look = links_of(stepper.system.events), stepper.look
        if links and look:
            yield coarse_events(h, look.occurrences(), links)
        if cutoffs := stepper.system.cutoffs:
            yield long_ways(h, cutoffs.speeds(stepper.start[1], stepper.v), cutoffs.least(stepper.p))

    def _instability(self) -> str:
        """Describe a step that is unstable at the start of a system with first-order unknowns, or of one that grew.

        A spring force that is such an unknown acts as a force of the velocity: with EIG-3, AB2 and RK2, an undamped
        oscillation then grows slowly with every step, as with gyroscopic forces.
        """
        stepper = self.stepper
        given = stepper.index, stepper.sizes, stepper.middle_sizes or stepper.first_sizes[:2]
        may_grow = stepper.system.first_order.is_read or has_grown(stepper.system, *given)
        return instability(stepper, stepper.index) if may_grow else ""

    def _total(self) -> tuple[int, str]:
        return self.n_steps - self.stepper.index, "step"

    def _progress(self) -> int:
        return self.stepper.index


# The history of a loaded run, whose saved states are in the solution.
_EMPTY = SavedRows((), {}, 0, has_times=False, has_steps=False)


def grid(t0: float, h: float, every: int, count: int, index: int, t_end: float, first: int = 0) -> np.ndarray:
    """Return the times of the rows from `first` to `count` of a run that has reached step `index`, at t_end."""
    t = np.empty(count - first)
    whole = t[: min(count, index // every + 1) - first]  # the last row may be off the grid
    whole[:] = np.arange(first, first + len(whole))
    whole *= every
    whole *= h
    whole += t0
    if (count - 1) * every >= index:  # the last row is the present state
        t[-1] = t_end
    return t


def stride(save_every: int | None, n_steps: int) -> int:
    """Return the number of steps from one saved state to the next."""
    return n_steps if save_every is None else min(save_every, n_steps)


def steps_until(stepper: Stepper, t_end: float) -> int:
    """Return the number of steps from the state of a stepper to t_end."""
    t_end, t0, h = check_time(t_end, "t_end"), stepper.t0, stepper.h
    check_resolution(h, t0, t_end)
    n_steps = max(stepper.index + 1, round((t_end - t0) / h))
    nearest = t0 + n_steps * h
    if abs(nearest - t_end) > 1e-12 * n_steps * h + 2 * np.spacing(max(abs(t0), abs(t_end))):
        raise ValueError(
            f"t_end must be a whole number of steps h = {h!r} after the end of the run at t = {stepper.t!r}, not "
            f"{t_end!r}; take t_end={nearest!r}."
        )
    return n_steps


def divide(t0: float, t1: float, h: float) -> tuple[int, float]:
    """Return the number of steps of at most `h` from t0 to t1, and the length of these steps."""
    span = t1 - t0
    ratio = span / h
    if not ratio < 2**53:
        raise ValueError(
            f"h must be at least {span / 2**53:.3g} for this t_span, so that steps can be counted, not {h}."
        )
    # If h divides the span except for round-off, also of its ends, one more step must not be added.
    nearest = round(ratio)
    is_whole = math.isclose(ratio, nearest, rel_tol=1e-12, abs_tol=math.ulp(max(abs(t0), abs(t1))) / h)
    n_steps = max(1, nearest if is_whole else math.ceil(ratio))
    return n_steps, span / n_steps
