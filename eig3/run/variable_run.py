"""A run with tolerances."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from ..diagnosis.coarseness import limited_ways
from ..diagnosis.singular_position import AT_SINGULAR, AT_WHOLE_TURN, is_at_whole_turn, is_singular
from ..diagnosis.stiffness import MANY_STEPS, STATES, VERY_MANY_STEPS, stiffness, vibration
from ..functions.checks import check_count, check_time, reals
from ..functions.guard import guarded
from ..kernels.protocol import AT_END, BEFORE_END, FULL, SCALAR, TOO_SMALL
from ..result.error_estimate import Companion, ErrorEstimate, estimate
from ..result.labels import Labels
from ..result.solution import Solution, Status, whole_rows
from ..result.storage import going_on
from ..stepping.march import Cancel
from ..stepping.observer import check_times, further_times
from ..stepping.run_options import NEVER
from ..stepping.system import System
from ..stepping.threads import side_by_side
from ..stepping.tolerances import LEAST_RTOL, Tolerances
from ..stepping.variable_stepper import VariableStepper
from . import short
from .chunks import Run, Stop, compared
from .growth import OVERFLOWING
from .progress import check_progress
from .saved_rows import FIRST_ROWS, SavedRows

_NO_BOUND = (
    "rtol does not bound the errors of the springs between grains, whose order in the step is low, and their estimate "
    "may be several times too small: give h in place of rtol, with check=True."
)
_NAMED = 5  # degrees of freedom that a note names
_LONGER = 4  # a run counts as short if it takes at most this many times as long as the last run
_LEAST_PACE = 1e-10  # seconds per step; a coarse clock may measure 0
RATIO = 10.0  # ratio of the tolerances of the runs that show the error,
_LARGEST_RTOL = 0.5  # and the largest rtol of these runs


class VariableRun(Run):
    """A run with tolerances. The arguments are the same as for `Run`."""

    stepper: VariableStepper

    @classmethod
    def restored(cls, solution: Solution, system: System) -> VariableRun:
        state = solution._state or {}
        with going_on():
            tolerances = Tolerances(**state["tolerances"])
            span = state["t0"], float(state["t_end"])
            times = check_times(state["times"], *span)
            u0, v0 = state["start"]
            stepper = VariableStepper(system, span, u0, v0, guarded(state["params"]), tolerances, times)
            if reals(tolerances.atol, "atol").shape != (2, stepper.n):
                raise ValueError("atol has another shape.")
            stepper.load(state["stepper"])
            if stepper.look:
                stepper.look.recall(solution.events, state["events"])
            t, u, v = whole_rows(solution, stepper.n)
            count = check_count(state["rows"], "rows") if times is None else stepper.n_wanted
            if count > len(t):
                raise ValueError(f"{len(t)} states are too few.")
        every, rows = check_count(state["every"], "save_every"), {"t": t, "steps": np.asarray(solution.steps)}
        stepper.rows_before_end = count
        return cls.ended(stepper, every, times, rows | {"u": u, "v": v}, solution.outputs)

    @classmethod
    def ended(
        cls,
        stepper: VariableStepper,
        every: int,
        times: np.ndarray | None,
        rows: dict[str, np.ndarray],
        outputs: dict[str, np.ndarray],
    ) -> VariableRun:
        """Return a run that a stepper has taken to its end, with its rows."""
        run = cls(stepper, every, times)
        run.saved, run.saved_outputs = rows, outputs
        if stepper.rows_before_end is None:
            stepper.rows_before_end = len(rows["u"]) - (stepper.index % every > 0)
        run._judge_event()
        return run

    def extended(self, t_end: float, progress: bool, save_to: str | PathLike[str] | None, t_eval: Any) -> VariableRun:
        """Return an independent run to a later end, bitwise as one run over the whole span."""
        check_progress(progress)
        t_end = check_time(t_end, "t_end")
        self.close()
        assert self.saved is not None
        end = max([self.stepper.t, *self.saved["t"][-1:].tolist()])  # a loaded stepper may be before the end
        if not t_end > end:
            raise ValueError(f"t_end must be after the end of the run at t = {end!r}, not {t_end!r}.")
        times = further_times(self.times, t_eval, end, t_end)
        place = self._place(save_to)
        if self.stepper.follows_span:
            stepper = self.stepper.restarted(t_end, times)
            return VariableRun(stepper, self.every, times, place, progress).begin()
        stepper = self.stepper.before_end()
        stepper.t_end = t_end
        run = VariableRun(stepper, self.every, times, place, progress)
        return run.begin(self, self._rows_kept() if times is None else stepper.n_wanted)

    def error_of(self, solution: Solution, coarser: float | None, cancel: Cancel | None) -> ErrorEstimate:
        if coarser is not None:
            return estimate(solution, self._companion(solution, 1 / RATIO, cancel), None, coarser)
        fine, *coarse = (
            partial(self._companion, solution, ratio) for ratio in companion_ratios(self.stepper.tolerances)
        )
        if not coarse:
            return estimate(solution, fine(cancel), None)
        both = side_by_side(fine, coarse[0], self.stepper.system, solution.kernel_seconds, cancel)
        return estimate(solution, *both)

    def _companion(self, solution: Solution, ratio: float, cancel: Cancel | None) -> Companion:
        """Return the run with other tolerances."""
        stepper, tolerances = self.stepper, companion_tolerances(self.stepper.tolerances, ratio)
        system, times = stepper.system, self.times
        if times is None and self._compares_at_times:
            system, times = system.at_times, np.unique(solution.t)  # a state before and one after a reset have one time
        found = None
        with contextlib.suppress(Exception):  # a `Run` raises it again
            found = None if cancel else short_with_tolerances(self._start(system, tolerances, times), 1, times)
        if found is None:
            found = compared(VariableRun(self._start(system, tolerances, times), 1, times).begin, cancel)
        if times is None:
            return Companion.between_steps(solution, found, ratio)
        return Companion.at_same_times(solution, found, ratio)

    def _start(self, system: System, tolerances: Tolerances, times: np.ndarray | None) -> VariableStepper:
        """Return a stepper at the start of this run."""
        stepper = self.stepper
        start = *stepper.start, guarded(stepper.p)
        return VariableStepper(system, (stepper.t0, stepper.t_end), *start, tolerances, times)

    def with_states(self, count: int) -> VariableRun:
        stepper = self.stepper
        times = None if self.times is None else np.linspace(stepper.t0, stepper.t_end, count)
        start = self._start(stepper.system, stepper.tolerances, times)
        return VariableRun(start, max(1, stepper.index // count), times)

    @property
    def _compares_at_times(self) -> bool:
        """Whether compared runs save the states at the times of this run, and are not interpolated between their steps.

        This gives the errors of outputs and of first-order unknowns too. Without these, and without events and
        invariants, it would only compile another kernel for a method that has a continuous extension.
        """
        stepper = self.stepper
        has_extension = stepper.kernel.formulas.dense_evaluations and not stepper.system.history
        return bool(stepper.system.looks or stepper.system.first_order.names or not has_extension)

    def state(self) -> dict[str, Any]:
        stepper = self.stepper.before_end()
        found = stepper.look.occurrences() if stepper.look else {}
        return super().state() | {
            "params": stepper.p,
            "t_end": stepper.t_end,
            "tolerances": stepper.tolerances._asdict(),
            "every": self.every,
            "rows": self._rows_kept(),
            "stepper": stepper.kept(),
            "events": {name: len(occurrences) for name, occurrences in found.items()},
        }

    @property
    def between(self) -> Any:
        """The function of `Solution.at`, if it has one, for a run whose states are all saved; None for other runs."""
        return self.stepper.states_between if self.every == 1 and self.times is None else None

    def _empty_history(self) -> SavedRows:
        stepper, times = self.stepper, self.times
        state, directory = () if stepper.form is SCALAR else (stepper.n,), self.place.directory if self.place else None
        rows, shapes = FIRST_ROWS if times is None else len(times), stepper.system.functions.shapes
        return SavedRows(state, shapes, rows, directory, has_times=times is None, has_steps=True)

    def _left(self) -> int:
        stepper = self.stepper
        left = stepper.tolerances.max_steps - stepper.index
        if not left:
            self._end(
                Status.TOO_MANY_STEPS,
                f"The run took max_steps = {stepper.index} steps up to t = {stepper.t:g}; take a larger max_steps, or "
                "larger tolerances.",
            )
        return left

    def _judge(self, first: int) -> None:
        """Find out from the kernel's outcome whether the run continues."""
        stepper = self.stepper
        ended = stepper.ended
        if ended == AT_END or stepper.t >= stepper.t_end:
            self.is_done = True
        elif ended == BEFORE_END:
            stepper.shorten(self.history.count)
        elif ended == FULL and self.times is None:
            self.history.make_room()
            self._refer()
        elif ended == TOO_SMALL:
            self._end_too_small()
        else:
            self._judge_event()

    def _end_too_small(self) -> None:
        stepper, t = self.stepper, self.stepper.t
        if np.abs(stepper.state[:2]).max() > OVERFLOWING:
            message = f"The motion grew beyond {OVERFLOWING:g} at t = {t:g}, where it is singular"
            self._end(Status.DIVERGED, f"{message}; no step is short enough to continue.", self._explained)
            return
        relative = "; if hardly anything has moved so far, rtol needs atol too" * stepper.tolerances.is_relative
        why = (
            f"{AT_SINGULAR}: begin after it, or change the mechanism so that it does not come there."
            if is_singular(stepper, stepper.h)
            else f"{AT_WHOLE_TURN}."
            if is_at_whole_turn(stepper.system.labels, stepper.u, stepper.v, stepper.h)
            else ": the motion may be singular there, rhs may jump or be NaN, or rtol and atol may be too small"
            f"{relative}."
        )
        message = f"The tolerances need a step below the resolution of t at t = {t:g}{why}"
        self._end(Status.STEP_TOO_SMALL, message, self._explained)

    def _explained(self) -> str:
        """Describe the value of rhs at the end of the run."""
        stepper = self.stepper
        for t in (stepper.t, float(np.nextafter(stepper.t, np.inf))):
            try:
                a = np.atleast_1d(stepper.acceleration(t, stepper.u, stepper.v))
            except Exception as error:  # rhs may fail there
                return f"{self.message} rhs raises {type(error).__name__} at t = {t:g}."
            if not np.isfinite(a).all():
                bad = int(np.argmin(np.isfinite(a)))
                place = (stepper.system.labels or Labels()).place(bad)
                return f"{self.message} rhs gives {a[bad]} for {place} at t = {t:g}."
        sizes = np.abs(stepper.state[:3]).max(axis=1)
        return (
            f"{self.message} rhs is finite there: the largest |u| is {sizes[0]:.3g}, the largest |v| {sizes[1]:.3g}, "
            f"and the largest |a| {sizes[2]:.3g}, after steps of {stepper.mean_step:.3g} on average."
        )

    def _complete(self) -> None:
        """Save the last state."""
        stepper, history = self.stepper, self.history
        stepper.rows_before_end = self._rows_kept()  # without the last state, which a longer run may not save
        if self.times is not None:
            if stepper.look and (stepper.is_over or stepper.t >= stepper.t_end):
                stepper.look.finish(stepper, stepper.t)
            history.row = stepper.n_wanted
            if history.files:
                history.arrays["t"][: history.row] = self.times[: history.row]
            return
        last = history.last_row()
        same = last["t"] == stepper.t and (last["u"] == stepper.u).all() and (last["v"] == stepper.v).all()
        if not same:
            self._write_present(stepper.h)

    def march(self, stop: Stop) -> None:
        """Run to the end, and note the number of steps, and the rows that the next run may need."""
        super().march(stop)
        stepper, rows = self.stepper, self.history.count
        stepper.system.last_sizes[stepper.tolerances.rtol] = stepper.index, rows + rows // 4 + 16

    def _rows_kept(self) -> int:
        """Return the number of rows up to the state from which a longer run continues."""
        rows = self.stepper.rows_before_end
        return self.history.count if rows is None else rows

    def _keep(self) -> None:
        history = self.history
        if self.times is not None and history.files:
            history.arrays["t"][: history.row] = self.times[: history.row]
        super()._keep()

    def _fields(self) -> dict[str, Any]:
        stepper = self.stepper
        return {"h": stepper.mean_step, "n_rejected": stepper.n_rejected, "_between": self.between}

    def _notes(self) -> list[str]:
        stepper = self.stepper
        notes = self._invariant_notes("take a smaller rtol, or a fixed step with a method that keeps it")
        tiny = stepper.tiny if stepper.n > 1 else []
        if tiny:
            which = ", ".join(tiny[:_NAMED]) + (", ..." if len(tiny) > _NAMED else "")
            notes.append(
                f"The motion of {which} is so small relative to the largest motion that the error of a step may be a "
                "tenth of it or more. Give atol, or a smaller rtol, if it matters."
            )
        step, end = stepper.silence
        if step:
            notes.append(
                f"The acceleration was zero up to t = {end:.4g}, and rhs reads t: the steps were held short, but a "
                f"load that acts for less than {step:.2g} there may have been jumped over; h_max sets the longest step."
            )
        if stepper.index >= VERY_MANY_STEPS and (held := stepper.held):
            notes.append(limited_ways(held))
        notes += [_NO_BOUND] * bool(stepper.system.history)
        stiff = self._stiffness()
        return [*notes, stiff] if stiff else notes

    def _stiffness(self) -> str:
        """Describe what limits the steps in place of the tolerance; empty if the run is short, or nothing does."""
        stepper = self.stepper
        may_be_stiff = stepper.index >= MANY_STEPS and stepper.system.callback.reads_velocity
        may_vibrate = stepper.index >= VERY_MANY_STEPS and stepper.n > 1
        if stepper.system.history or not (may_be_stiff or may_vibrate):
            return ""
        given = stepper.running, stepper.evaluator(), [*self._states_of_steps()]
        return (may_be_stiff and stiffness(*given, "rtol")) or (may_vibrate and vibration(*given)) or ""

    def _states_of_steps(self) -> Iterator[tuple[float, Any, Any, float]]:
        """Return some states with their steps, at equal numbers of steps, and the last state after a whole step."""
        assert self.saved is not None
        rows, scalar = self.saved, self.stepper.form is SCALAR
        steps = rows["steps"][1:]
        taken = np.cumsum(np.ones(len(steps)) if self.times is None else 1 / steps)
        for share in np.linspace(0, 1, STATES, endpoint=False)[1:] if len(steps) > 1 else ():
            i = 1 + int(np.searchsorted(taken, share * taken[-1]))
            yield rows["t"][i], *(x[i].item() if scalar else x[i] for x in (rows["u"], rows["v"])), rows["steps"][i]
        last = self.stepper.before_end()
        yield last.t, last.u, last.v, last.h

    def _total(self) -> tuple[int, str]:
        return 100 - self._progress(), "%"

    def _progress(self) -> int:
        stepper = self.stepper
        return round(100 * (stepper.t - stepper.t0) / (stepper.t_end - stepper.t0))


def short_with_tolerances(stepper: VariableStepper, every: int, times: np.ndarray | None) -> Solution | None:
    """Run in one call of the kernel, as `short.at_once`; return None if the run is long, or may not complete."""
    system, tolerances = stepper.system, stepper.tolerances
    steps, rows = system.last_sizes.get(tolerances.rtol, (0, 0))
    if times is not None:
        every, rows = NEVER, len(times)
    pace = system.pace.get(stepper.kernel.pace_key)
    if pace is None or not steps or steps * pace > short.MOST_SECONDS or rows * stepper.n > short.MOST_VALUES:
        return None
    seconds = max(short.TRIED_SECONDS, _LONGER * steps * pace)
    steps = min(tolerances.max_steps, int(min(seconds, short.MOST_SECONDS) / max(pace, _LEAST_PACE)))
    return short.at_once(stepper, steps, stepper.t_end, every, rows, times, VariableRun, (every, times))


def companion_ratios(given: Tolerances) -> tuple[float, ...]:
    """Return the tolerances of the compared runs, as ratios to the tolerances of a run; the smaller come first.

    Near round-off no run has a smaller error: a run with larger tolerances then differs by at least the error.
    """
    if given.rtol < RATIO * LEAST_RTOL:
        return (RATIO,)
    return (1 / RATIO, RATIO) if given.rtol * RATIO <= _LARGEST_RTOL else (1 / RATIO,)


def companion_tolerances(given: Tolerances, ratio: float) -> Tolerances:
    """Return the tolerances of a run that is compared with a run."""
    rtol = min(max(LEAST_RTOL, given.rtol * ratio), _LARGEST_RTOL)
    return given._replace(rtol=rtol, atol=given.atol * ratio, max_steps=NEVER)
