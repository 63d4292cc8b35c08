"""The result of a run: its history, its status and its cost."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals
from ..functions.events import Occurrences
from ..functions.extremes import Extremes
from ..kernels.compile.interrupt import with_solution
from ..methods import Method
from . import frames, storage
from .columns import separated
from .interpolation import Knots
from .labels import Labels
from .resolution import Resolution
from .soundness import check_run
from .status import Status

_TOO_FAR = 1e-2  # the relative error from which on states are too far apart to be interpolated

_NO_STATES = "the run ended before the first time of t_eval"

#: Looks for the reason why a run failed, and describes it.
Reason = Callable[[], str]
#: The fields that a copy, a pickle and a file do not keep.
TRANSIENT = ("reason", "_accelerations", "_extend", "_between", "_knots", "_whole", "_later")


@dataclass(repr=False, eq=False)
class Solution:
    """The history of a run, its status and its cost.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Times of the saved states.
    u, v : ndarray, shape (m,) or (m, n)
        Displacements and velocities of the saved states. With `save_to`, t, u and v are maps of files, of the type
        `numpy.memmap`, that can only be read.
    h : float
        The step of the run. It is the requested step, or a shorter one if that does not divide the span. With
        tolerances, it is the mean of the steps.
    n_steps : int
        Number of steps taken.
    n_rhs : int
        Number of evaluations of the right-hand side, including the one at the start.
    n_iterations : int
        Number of iterations of an implicit method's solver.
    status : Status
        How the run ended.
    message : str
        A sentence about how the run ended. `explain` finds out more.
    drift : dict of str to float
        For each invariant e, the maximum of |e_n - e_0| over the ends of `n_invariants` steps and the events; NaN if e
        became NaN.
    extremes : dict of str to Extremes
        For each invariant and each output, its minimum `low` and its maximum `high`, and their times `t_low` and
        `t_high`; NaN, and the time of the first NaN, if it became NaN. With a fixed step, they are those over the ends
        of all steps; with tolerances, those of the motion, also within the steps. See `eig3.Extremes`.
    kernel_seconds : float
        Time in the kernel, s, without compilation and without the evaluation of invariants and outputs.
    method : Method
        The method as it was requested.
    notes : tuple of str
        Sentences about what the user should know of the run, such as that an invariant grows steadily, that the solver
        of an implicit method was changed, or that the method has a short limit with a force that reads the velocity.
    quadratures : dict of str to ndarray, shape (m,)
        Integrals over time that the problem follows, at the saved times, such as "work" in J.
    events : dict of str to Occurrences
        The occurrences of each event: `t`, `u`, `v`, and `u_after`, `v_after`.
    outputs : dict of str to ndarray, shape (m,) or (m, k)
        The values of each output at the saved states.
    n_rejected : int
        Number of steps that were repeated with a shorter step, because their error was beyond the tolerances.
    n_invariants : int
        Number of steps after which the invariants were evaluated: all, unless `invariants_every` says otherwise. For
        the energy of a problem it is about every hundredth.
    steps : ndarray, shape (m,), or None
        With tolerances, the length of the step that led to each saved state, or that contains its time, and 0 for the
        first state. None for a fixed step.
    labels : Labels or None
        Names and units of the degrees of freedom, in a run of a problem.
    reason : callable or None
        The function that `explain` calls; None if nothing more can be found out.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    h: float
    n_steps: int
    n_rhs: int
    n_iterations: int
    status: Status
    message: str
    kernel_seconds: float
    method: Method
    drift: dict[str, float] = field(default_factory=dict)
    extremes: dict[str, Extremes] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default_factory=tuple)
    quadratures: dict[str, np.ndarray] = field(default_factory=dict)
    events: dict[str, Occurrences] = field(default_factory=dict)
    outputs: dict[str, np.ndarray] = field(default_factory=dict)
    n_rejected: int = 0
    n_invariants: int = 0
    steps: np.ndarray | None = None
    labels: Labels | None = None
    reason: Reason | None = None
    _accelerations: functools.partial[np.ndarray] | None = None  # of the right-hand side and its parameters
    _extend: Callable[..., Any] | None = None  # returns the run at its end, which can go on, and is checked
    _between: Callable[..., tuple[np.ndarray, np.ndarray]] | None = None
    _explanation: str = ""
    _resume: Any = None  # the state from which the run can go on, or a function that returns it
    _a: np.ndarray | None = field(default=None, init=False)
    _a_jumps: np.ndarray | None = field(default=None, init=False)  # before all jumps, then after all jumps
    _knots: tuple[Knots, Resolution] | None = field(default=None, init=False)
    _later: Any = field(default=None, init=False)  # functions that find fields when they are read, by name
    _whole: tuple[np.ndarray, np.ndarray] | None = field(default=None, init=False)  # u and v before `_separate`

    @classmethod
    def _of(cls, fields: dict[str, Any], later: dict[str, Callable[[], Any]]) -> Solution:
        """Return a solution with some fields, and functions that find others when they are read; the rest is empty."""
        solution = object.__new__(cls)
        fields["_later"] = later
        solution.__dict__ = fields
        return solution

    def __getattr__(self, name: str) -> Any:
        find = (self._later or {}).get(name) or _EMPTY.get(name)
        if find is None:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        vars(self)[name] = value = find()
        return value

    def _kept(self) -> dict[str, Any]:
        """The fields that a copy keeps, with those that were not read yet."""
        return {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.name not in TRANSIENT}

    def explain(self, *, check: bool = False) -> str:
        """Find out why a run diverged, or how large its error is.

        The explanation compares h with the critical step, and names a shorter step with which the run stays bounded,
        if there is one. To find it, the first call repeats the run with shorter steps. This may take two or three
        times as long as the run, or some tenths of a second for a short run. Later calls return the same text.

        Parameters
        ----------
        check : bool
            Whether to estimate the error of u too, if the run did what it should. The run is repeated twice for this:
            with half and a quarter of its step, which takes six times as long as the run, and shows its order too; or
            with tolerances ten and a hundred times smaller.

        Returns
        -------
        str
            The explanation; if the run did not diverge, `message` and `notes`. A copied or unpickled solution no longer
            has the right-hand side: it returns the explanation only if it was found before the copy.

        Raises
        ------
        ValueError
            If there is nothing to repeat the run with, or the method adds random numbers.
        """
        if check and self.success:
            if self._extend is None:
                raise ValueError(
                    "check needs the run: this solution was copied, pickled or loaded without rhs, or is a member "
                    "of an ensemble; integrate again, and check the solution that integrate returns."
                )
            return f"{self.explain()} {self._extend().check(self)}"
        if self.reason is not None:
            self._explanation = self._explanation or self.reason()
        return self._explanation or " ".join([self.message, *self.notes])

    @property
    def success(self) -> bool:
        """Whether the run did what it should: its status is COMPLETED or TERMINATED."""
        return self.status in (Status.COMPLETED, Status.TERMINATED)

    @property
    def can_go_on(self) -> bool:
        """Whether `extend` accepts the status: COMPLETED or INTERRUPTED."""
        return self.status in (Status.COMPLETED, Status.INTERRUPTED)

    @property
    def a(self) -> np.ndarray | None:
        """The accelerations f(t, u, v) at the saved states, in an array of the shape of u.

        They are evaluated on first access, and `n_rhs` does not count this. A copied, unpickled or loaded solution has
        those that were found when it was copied or saved. None if no right-hand side is known. An exception in the
        right-hand side is raised.
        """
        if self._a is None and self._accelerations is not None:
            self._a, self._a_jumps = np.split(self._accelerations(*self._states()), [len(self.t)])
        return self._a

    @property
    def _params(self) -> np.ndarray | None:
        """The parameters of the run, in the array that kernels get; None if no right-hand side is known."""
        return None if self._accelerations is None else self._accelerations.args[1]

    def at(self, t: ArrayLike) -> tuple[Any, Any]:
        """Interpolate between the saved states, to the order of the method or better.

        Parameters
        ----------
        t : float or array_like
            Times between the first and the last saved state.

        Returns
        -------
        u, v : float or ndarray
            Displacement and velocity, of shape ``t.shape`` or ``t.shape + (n,)``. v is the derivative of the polynomial
            for u. At the time of a jump of the state, such as an impact, they are those after the jump.

        Raises
        ------
        ValueError
            If a time is outside the span, or is NaN, or if no state was saved.

        Warns
        -----
        UserWarning
            If the saved states around a time are too far apart: the error of the interpolation is there more than a
            hundredth of the motion of a degree of freedom, as it is with less than two or three states in a period, or
            across a contact that lies between two states. `eig3.result.resolution` says how the error is estimated.
            There is no warning about a run that saves every step.

        Notes
        -----
        The Hermite polynomial of an interval goes through u, v and the accelerations at its two ends: its errors are of
        the orders 6 in u and 5 in v, in the time between saved states. For a method of an order above 5, it also goes
        through those at the next one to three saved states, so that neither u nor v loses an order. No polynomial
        reaches across a jump.

        After a run by RK8 with tolerances, and with every state saved, the states are those of its continuous extension
        instead. It is not kept in a file, a copy or a pickle.

        The accelerations are `a`. Where they are not known or not finite, a cubic polynomial goes through u and v: its
        errors are of the orders 4 and 3.
        """
        times = reals(t, "t")
        if times.size and not len(self.t):
            raise ValueError(
                f"the solution has no states: {_NO_STATES}; take earlier times in t_eval, or leave it out."
            )
        if times.size and not (self.t[0] <= times.min() and times.max() <= self.t[-1]):
            raise ValueError(f"t must lie within the span of the solution, {self.t[0]:g} to {self.t[-1]:g}.")
        self._warn_of_distant_states(times.ravel())
        return self._interpolated(times)

    def _interpolated(self, times: np.ndarray) -> tuple[Any, Any]:
        if self._between is not None and len(self.t) > 1:
            u, v = self._between(self.t, self.u, self.v, times.ravel())
            return u.reshape(times.shape + self.u.shape[1:])[()], v.reshape(times.shape + self.v.shape[1:])[()]
        return self._interpolation[0].at(times, self._knots_of_a_polynomial)

    @property
    def _interpolation(self) -> tuple[Knots, Resolution]:
        """The states to interpolate between, and the errors of this."""
        if self._knots is None:
            knots = self._all_knots()
            # no method of this object: with a circle of references, its arrays would stay until Python looks for them
            steps = functools.partial(_steps_to, self.t, self.h, self.steps)
            self._knots = knots, Resolution(knots, self._knots_of_a_polynomial, self._accelerations, steps)
        return self._knots

    @property
    def _knots_of_a_polynomial(self) -> int:
        """n knots give u to the order 3 n, and v to the order 3 n - 1."""
        return max(2, -(-(self.method.order + 1) // 3))

    def _errors(self, times: np.ndarray) -> np.ndarray:
        """Return the errors of the interpolation around these times, see `Resolution.errors`."""
        if len(self.t) < 2 or self._between is not None:
            return np.zeros((2, len(times)))
        return self._interpolation[1].errors(times)

    def _warn_of_distant_states(self, times: np.ndarray) -> None:
        error = self._errors(times)[0]
        if (error > _TOO_FAR).any():
            t = times[np.argmax(error)]
            warnings.warn(
                f"the saved states around t = {t:g} are too far apart to interpolate between them, with an error of "
                f"the order of {100 * error.max():.2g} % of the motion: integrate with save_every=1 or a smaller "
                "save_every, or give the times that you want as t_eval.",
                UserWarning,
                stacklevel=3,
            )

    def extend(
        self,
        t_end: float,
        *,
        save_to: str | PathLike[str] | None = None,
        progress: bool = False,
        raise_on_failure: bool = False,
        cancel: Any = None,
        t_eval: ArrayLike | None = None,
    ) -> Solution:
        """Continue the run to a later time, with the same bits as one run over the whole span.

        Parameters
        ----------
        t_end : float
            The new end. With a fixed step, it is a whole number of steps h after the end of the run.
        save_to, progress, raise_on_failure, cancel
            As for `eig3.integrate`. `save_to` is a directory for the whole history, which without it is in memory.
        t_eval : array_like, optional
            For a run with `t_eval`: further times, after the end of the run, at which the states are saved.

        Returns
        -------
        Solution
            The run over the whole span; this one does not change. t, u and v have the same bits as those of a run with
            the same h or tolerances, and `save_every` counts from the first state on: the last state of this solution
            is not in the new one if it was saved only because it was the last. `drift`, `extremes`, `outputs` and the
            counts are those of the whole span too. With tolerances, a run whose steps follow from the length of its
            span is taken again: one from rest over less than a unit of time, or over less than its first step.

        Raises
        ------
        ValueError
            If t_end is not a whole number of steps after the end; the error names the nearest time that is. Also if the
            run failed or raised an exception, or if this solution has no right-hand side: a copy and a pickle have
            none, and `eig3.load` needs it as an argument. A run that was INTERRUPTED by Ctrl-C or `cancel`, or whose
            process was killed, can go on. Also if `save_to` is missing, and the files of the run have states of more
            than 2^27 bytes (134 MB).
        IntegrationError, KeyboardInterrupt, MemoryError, OSError
            As for `eig3.integrate`.
        """
        if not self.can_go_on:
            raise ValueError(
                f"a run with the status {self.status.name} cannot be extended; integrate from a state before its end."
            )
        if self._extend is None and self._resume is not None:
            raise ValueError(
                "this solution was loaded without its right-hand side: load it with eig3.load(path, rhs=...) or with "
                "problem.load(path), and extend that."
            )
        if self._extend is None:
            raise ValueError(
                "this solution cannot be extended: it was copied or pickled, is a member of an ensemble, "
                "or ended with an exception; extend the solution that integrate returned, or integrate from its end."
            )
        options = {"progress": progress, "raise_on_failure": raise_on_failure, "cancel": cancel}
        return self._extend().extend(t_end, save_to=save_to, t_eval=t_eval, **options)

    @property
    def _state(self) -> dict[str, Any] | None:
        """The state from which the run can go on, made of numbers, texts and arrays; None if it cannot."""
        return self._resume() if callable(self._resume) else self._resume

    def _separate(self, names: Sequence[str]) -> None:
        """Move the last degrees of freedom, whose velocities are quadratures with these names, to `quadratures`."""
        self._whole = self.u, self.v
        self.u, self.v, self.quadratures = separated(*self._whole, names)
        n = self.u.shape[1]
        self.events = {name: occurrences.of(slice(n)) for name, occurrences in self.events.items()}

    def _states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return t, u and v of the saved states, then of those before the jumps, then of those after the jumps."""
        jumps = [jumps for jumps in (o.jumps for o in self.events.values()) if len(jumps)]
        if not jumps:
            return self.t, self.u, self.v
        t = np.concatenate([self.t] + 2 * [jump.t for jump in jumps])
        u = np.concatenate([self.u, *(jump.u for jump in jumps), *(jump.u_after for jump in jumps)])
        v = np.concatenate([self.v, *(jump.v for jump in jumps), *(jump.v_after for jump in jumps)])
        return t, u, v

    def _all_knots(self) -> Knots:
        """Return the saved states with those before and after each jump, in the order of time."""
        t, u, v = self._states()
        m = len(self.t)
        if len(t) == m:
            return Knots(t, u, v, self._known_accelerations(t, u, v, None))
        jumps = t[m : (m + len(t)) // 2]
        saved = np.searchsorted(self.t, jumps, side="right") - np.searchsorted(self.t, jumps, side="left")
        # A jump replaces the state that was saved at its time. If there are two such states, they are the jump.
        is_knot = ~np.isin(t, jumps[saved == 1])
        is_knot[m:] = np.tile((saved < 2) & (self.t[0] <= jumps) & (jumps <= self.t[-1]), 2)
        order = np.argsort(t, kind="stable")
        order = order[is_knot[order]]
        t, u, v = t[order], u[order], v[order]
        return Knots(t, u, v, self._known_accelerations(t, u, v, order))

    def _known_accelerations(
        self, t: np.ndarray, u: np.ndarray, v: np.ndarray, order: np.ndarray | None
    ) -> Callable[[np.ndarray], np.ndarray] | None:
        """Return the function of `Knots` for these states, which are `_states` in another order, if there is one."""
        if self._a is not None:
            a = self._a if order is None else np.concatenate([self._a, self._a_jumps])[order]
            return a.__getitem__
        evaluate = self._accelerations
        if evaluate is None:
            return None

        def accelerations(rows: np.ndarray) -> np.ndarray:
            return evaluate(t[rows], u[rows], v[rows])

        return accelerations

    @with_solution
    def save(self, path: str | PathLike[str]) -> Path:
        """Write the solution to a file of NumPy arrays, which `eig3.load` reads.

        Parameters
        ----------
        path : str or path
            The file. ".npz" is added if it does not end with this. A file of this name is replaced at the moment when
            the new one is complete.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        OSError
            If the file cannot be written. What was there before is still there.
        TypeError
            If a value is neither a number, a text nor an array of them.

        Notes
        -----
        The accelerations `a` are saved too, unless the right-hand side raises an exception there, and so is what
        `explain` has found, and the state from which the run can go on. Functions are not: the right-hand side, and the
        jacobian of the method. ``np.load`` reads the arrays without eig3.
        """
        return storage.write(storage.RUN, self.__getstate__() | {"_resume": self._state}, storage.file(path))

    def to_pandas(self) -> Any:
        """Return the saved states as a `pandas.DataFrame`, with a row for each of them.

        Returns
        -------
        pandas.DataFrame
            The index is t. The columns are the displacements u0, u1, ... and the velocities v0, v1, ..., or x0 and v_x0
            where the degree of freedom has the name x0, then the outputs and the quadratures. ``attrs["units"]`` has
            the units by column, where they are known. Other `attrs` are status, message, method and h.

        Raises
        ------
        ImportError
            If pandas is not installed.
        ValueError
            If two columns have the same name.
        """
        return frames.to_pandas(self)

    def to_xarray(self) -> Any:
        """Return the saved states as an `xarray.Dataset`.

        Returns
        -------
        xarray.Dataset
            With the variables u and v, over the coordinate t and, in the vector form, the names of the degrees of
            freedom in the coordinate dof; then the outputs and the quadratures. u and v have the attribute units, one
            or a list, where they are known. The attributes of the dataset are status, message, method and h.

        Raises
        ------
        ImportError
            If xarray is not installed.
        ValueError
            If two variables have the same name.
        """
        return frames.to_xarray(self)

    def __getstate__(self) -> dict[str, Any]:
        # What refers to compiled code cannot be pickled. The accelerations are found before it is lost.
        with contextlib.suppress(Exception):  # rhs may fail at a state at which the method does not evaluate it
            _ = self.a
        return self._kept() | {"_resume": None if callable(self._resume) else self._resume}

    def __repr__(self) -> str:
        per_step = 1e9 * self.kernel_seconds / self.n_steps if self.n_steps else 0.0
        dof = "1 degree" if self.u.ndim == 1 else f"{self.u.shape[1]} degree{'s' * (self.u.shape[1] > 1)}"
        steps = f"{self.n_steps} steps of {'h' if self.steps is None else 'mean h'} = {self.h:.6g}"
        steps += f" and {self.n_rejected} rejected ones" * (self.n_rejected > 0)
        saved = f"t = {self.t[0]:g} to {self.t[-1]:g}" if len(self.t) else _NO_STATES
        lines = [
            f"Solution by {self.method!r}: {self.status.value}",
            f"  {dof} of freedom, {saved}, {steps}, {len(self.t)} states saved",
            f"  {self.n_rhs} evaluations{f', {self.n_iterations} iterations' * (self.n_iterations > 0)}, "
            f"{self.kernel_seconds:.3g} s in the kernel ({per_step:.3g} ns a step)",
        ]
        some = f" (at {self.n_invariants:,} of {self.n_steps:,} steps)" * (self.n_invariants < self.n_steps)
        lines += [f"  drift of {name}: {value:.4g}{some}" for name, value in self.drift.items()]
        lines += [f"  {self.message}"] * (not self.success)
        lines += [f"  Note: {note}" for note in self.notes]
        return "\n".join(lines)


#: The functions that make the value of a field which nobody gave.
_EMPTY = {each.name: each.default_factory for each in dataclasses.fields(Solution) if callable(each.default_factory)}


def _loaded(fields: dict[str, Any]) -> Solution:
    """Return the solution with the fields of a file."""
    check_run(fields)
    return Solution._of(fields, {})


storage.KINDS[storage.RUN] = _loaded


def whole_rows(solution: Solution, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, u and v of the saved states with all n degrees of freedom, also those of quadratures.

    A file of `Solution.save` has the velocities of quadratures only: the displacements, which nothing reads, are NaN.
    """
    u, v = solution._whole or (solution.u, solution.v)
    if solution._whole is None and solution.quadratures:
        v = np.column_stack([v, *solution.quadratures.values()])
        u = np.column_stack([u, np.full((len(u), len(solution.quadratures)), np.nan)])
    if (u.shape[1] if u.ndim == 2 else 1) != n:
        raise ValueError(f"the states have {u.shape[1:]} degrees of freedom and not {n}.")
    return solution.t, u, v


def _steps_to(saved: np.ndarray, h: float, steps: np.ndarray | None, t: np.ndarray) -> np.ndarray:
    """Return the length of the step that led to each of the times t, from the steps to the saved times."""
    if steps is None:
        return np.full(len(t), h)
    return steps[np.minimum(np.searchsorted(saved, t), len(saved) - 1)]
