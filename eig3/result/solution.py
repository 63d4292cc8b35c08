"""The result of a run: its history, its status and its cost."""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals
from ..functions.extremes import Extremes
from ..functions.first_order import FirstOrder, flat
from ..kernels.compile.interrupt import keeping, with_solution
from ..keywords import with_suggestions
from ..methods import Method
from ..notebook import of_repr
from . import frames, storage
from .error_estimate import ErrorEstimate
from .interpolation import Knots
from .labels import Labels
from .occurrences import Occurrences, labelled
from .resampling import resampled
from .resolution import Resolution
from .soundness import check_run
from .status import Status

_TOO_FAR = 1e-2  # with a larger relative error, the states are too far apart to be interpolated

_NO_STATES = "the run ended before the first time of t_eval"

#: A function that finds the reason why a run failed, and describes it.
Reason = Callable[[], str]
#: The fields that a copy, a pickle and a file do not keep.
TRANSIENT = "reason", "_accelerations", "_extend", "_between", "_knots", "_whole", "_reads_z", "_later"


@dataclass(repr=False, eq=False)
class Solution:
    """The history of a run, its status and its cost.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Times of the saved states.
    u, v : ndarray, shape (m,) or (m, n)
        Displacements and velocities of the saved states. With `save_to`, t, u and v are a read-only `numpy.memmap`.
    h : float
        The step of the run. It is the requested step, or a shorter one if that does not divide the span. With
        tolerances, it is the mean of the steps.
    n_steps : int
        Number of steps taken.
    n_rhs : int
        Number of evaluations of the right-hand side, including the evaluation at the start.
    n_iterations : int
        Number of iterations of an implicit method's solver.
    status : Status
        How the run ended.
    message : str
        A sentence about how the run ended. `explain` finds the reason.
    drift : dict of str to float
        For each invariant e, the maximum of |e_n - e_0| over the ends of `n_invariants` steps and the events; NaN if e
        became NaN.
    extremes : dict of str to Extremes
        For each invariant and each output, its minimum `low` and its maximum `high`, and their times `t_low` and
        `t_high`; NaN, and the time of the first NaN, if it became NaN. With a fixed step, they are taken over the ends
        of all steps; with tolerances, also within the steps. See `eig3.Extremes`.
    kernel_seconds : float
        Time in the kernel, s, without compilation and without the evaluation of invariants and outputs.
    method : Method
        The method as it was requested.
    notes : tuple of str
        Sentences that the user should read, such as that an invariant grows steadily, that the solver of an implicit
        method was changed, or that the method has a short limit with a force that reads the velocity.
    z : dict of str to ndarray, shape (m,) or (m, k)
        The first-order unknowns at the saved times, by the names of z0; the name is "z" if z0 has no names.
    events : dict of str to Occurrences
        The occurrences of each event: `t`, `u`, `v`, and `u_after`, `v_after`.
    outputs : dict of str to ndarray, shape (m,) or (m, k)
        The values of each output at the saved states.
    n_rejected : int
        Number of steps that were repeated with a shorter step, because their error exceeded the tolerances.
    n_invariants : int
        Number of steps after which the invariants were evaluated: see the option `invariants_every`.
    steps : ndarray, shape (m,), or None
        With tolerances, the length of the step that led to each saved state, or that contains its time, and 0 for the
        first state. None for a fixed step.
    labels : Labels or None
        Names and units of the degrees of freedom, in a run of a problem.
    error : ErrorEstimate or None
        The errors of a run with ``check=True``, or after `check`; None too if the run failed or `cancel` was set.
    reason : callable or None
        The function that `explain` calls; None if there is nothing to explain.
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
    z: dict[str, np.ndarray] = field(default_factory=dict)
    events: dict[str, Occurrences] = field(default_factory=dict)
    outputs: dict[str, np.ndarray] = field(default_factory=dict)
    n_rejected: int = 0
    n_invariants: int = 0
    steps: np.ndarray | None = None
    labels: Labels | None = None
    error: ErrorEstimate | None = None
    reason: Reason | None = None
    _accelerations: partial[np.ndarray] | None = None  # of the right-hand side and its parameters
    _extend: Callable[..., Any] | None = None  # returns the checked run at its end, which can continue
    _between: Callable[..., tuple[np.ndarray, np.ndarray]] | None = None
    _explanation: str = ""
    _resume: Any = None  # the state from which the run can continue, or a function that returns it
    _whole: tuple[np.ndarray, np.ndarray] | None = None  # u and v before `_separate`; a copy interpolates with them
    _reads_z: bool = False  # whether the accelerations depend on z
    _a: np.ndarray | None = field(default=None, init=False)
    _a_jumps: np.ndarray | None = field(default=None, init=False)  # before all jumps, then after all jumps
    _knots: tuple[Knots, Resolution] | None = field(default=None, init=False)
    _later: Any = field(default=None, init=False)  # functions that compute fields when they are read, by name

    @classmethod
    def _of(cls, fields: dict[str, Any], later: dict[str, Callable[[], Any]]) -> Solution:
        """Return a solution with some fields, and functions that compute others on access; the rest is empty."""
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
        """The fields that a copy keeps, including fields that were not read yet."""
        return {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.name not in TRANSIENT}

    def check(self, *, cancel: Any = None) -> ErrorEstimate | None:
        """Estimate the errors of a successful run, by the same run with other steps.

        Parameters
        ----------
        cancel : threading.Event, optional
            Set it in another thread to end the further runs.

        Returns
        -------
        ErrorEstimate or None
            It is `error` of this solution from now on. `print` of the solution shows it. None if a further run was
            interrupted by `cancel`.

        Raises
        ------
        ValueError
            If the run cannot be repeated or was not successful, or the method adds random numbers.
        MemoryError
            If the error, which needs the memory of four histories, does not fit.
        KeyboardInterrupt
            After Ctrl-C. Its attribute `solution` is this solution. Other exceptions have the same attribute.

        Notes
        -----
        With a fixed step, the run is repeated with twice and four times its step, which takes 0.75 of its time. If
        these runs do not show the order of the method, it is also repeated with two thirds or half of its step. With
        tolerances, it is repeated with a tenth of them and with ten times these.

        Source: Richardson extrapolation; Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.4.
        """
        if self._extend is None:
            raise ValueError(
                "check needs the run: this solution was copied, pickled or loaded without rhs, or is a member "
                "of an ensemble; integrate again, and check the solution that integrate returns."
            )
        if not self.success:
            raise ValueError(f"check needs a successful run, and this one has the status {self.status.value}.")
        with keeping(self):
            self.error = self._extend().error(self, cancel)
        return self.error

    @property
    def order(self) -> float | None:
        """The order that the run shows, if it has been checked."""
        return None if self.error is None else self.error.order

    @property
    def reliable_until(self) -> float | None:
        """The last saved time at which a digit of u is right; None if it is the end, or the run is not checked."""
        return None if self.error is None else self.error.reliable_until

    def explain(self) -> str:
        """Find out why a run diverged.

        The explanation compares h with the critical step, and names a shorter step with which the run stays bounded,
        if there is one. To find it, the first call repeats the run with shorter steps. This may take two or three
        times as long as the run, or some tenths of a second for a short run. Later calls return the same text.

        Returns
        -------
        str
            The explanation; if the run did not diverge, `message` and `notes`. A copied or unpickled solution has no
            right-hand side: it returns only an explanation that was found before the copy.
        """
        if self.reason is not None:
            self._explanation = self._explanation or self.reason()
        return self._explanation or " ".join([self.message, *self.notes])

    @property
    def success(self) -> bool:
        """Whether the status is COMPLETED or TERMINATED."""
        return self.status in (Status.COMPLETED, Status.TERMINATED)

    @property
    def can_go_on(self) -> bool:
        """Whether `extend` accepts the status: COMPLETED or INTERRUPTED."""
        return self.status in (Status.COMPLETED, Status.INTERRUPTED)

    @property
    def a(self) -> np.ndarray | None:
        """The accelerations f(t, u, v) at the saved states, in an array of the shape of u.

        They are evaluated on first access, and `n_rhs` does not count this. A copied, unpickled or loaded solution has
        the accelerations that were found when it was copied or saved. None without a right-hand side. An exception in
        the right-hand side is raised.
        """
        evaluate = self._evaluate
        if self._a is None and evaluate is not None:
            self._a, self._a_jumps = np.split(evaluate(*self._states()), [len(self.t)])
        return self._a

    @property
    def _evaluate(self) -> Callable[..., np.ndarray] | None:
        """The accelerations as a function of t, u, v and z, an array of shape (states, k)."""
        return (
            None if self._accelerations is None else partial(_accelerations_with_z, self._accelerations, self._reads_z)
        )

    @property
    def _params(self) -> np.ndarray | None:
        """The parameters of the run, in the array that kernels get; None without a right-hand side."""
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
            for u. At the time of a jump of the state, such as an impact, the values after the jump.

        Raises
        ------
        ValueError
            If a time is outside the span, or is NaN, or if no state was saved.

        Warns
        -----
        UserWarning
            If the saved states around a time are too far apart: the interpolation error exceeds a hundredth of the
            motion of a degree of freedom, as with less than two or three states in a period, or with a contact between
            two states. `eig3.result.resolution` describes the estimate. There is no warning about a run that saves
            every step.

        Notes
        -----
        The Hermite polynomial of an interval matches u, v and the accelerations at its two ends: its errors are of the
        orders 6 in u and 5 in v, in the time between saved states. For a method of an order above 5, it also matches
        the next one to three saved states, and neither u nor v loses an order. No polynomial spans a jump.

        After a run by RK8 with tolerances, and with every state saved, `at` evaluates its continuous
        extension instead. A file, a copy or a pickle does not keep it.

        The accelerations are `a`. Where they are not known or not finite, a cubic polynomial matches u and v: its
        errors are of the orders 4 and 3.
        """
        times = self._within_span(t)
        self._warn_of_distant_states(times.ravel())
        return self._interpolated(times)

    def z_at(self, t: ArrayLike) -> dict[str, Any]:
        """Interpolate the first-order unknowns between the saved states.

        Parameters
        ----------
        t : float or array_like
            Times between the first and the last saved state.

        Returns
        -------
        dict of str to float or ndarray
            Each value has the shape ``t.shape``, or ``t.shape + (k,)``.

        Raises
        ------
        ValueError
            If a time is outside the span, or is NaN, or if no state was saved.

        Notes
        -----
        Polynomials match the values at the six nearest saved times, and do not span a jump of the state: the errors are
        of the order 6 in the time between saved states. After a run by RK8 with tolerances, and with every state saved,
        they come from its continuous extension instead.
        """
        times = self._within_span(t)
        if self._between is not None and self._whole and len(self.t) > 1:
            values = self._between(self.t, *self._whole, times.ravel())[1][:, self.u.shape[1] :]
        else:
            values = resampled(*self._rows_of_z(), times.ravel())
        place, found = 0, {}
        for name, x in self.z.items():
            width = x[:1].size
            found[name] = values[:, place : place + width].reshape(times.shape + x.shape[1:])[()]
            place += width
        return found

    def _check_states(self) -> None:
        """Refuse a solution without states."""
        if not len(self.t):
            raise ValueError(
                f"the solution has no states: {_NO_STATES}; take earlier times in t_eval, or leave it out."
            )

    def _within_span(self, t: ArrayLike) -> np.ndarray:
        """Return checked times."""
        times = reals(t, "t")
        if times.size:
            self._check_states()
        if times.size and not (self.t[0] <= times.min() and times.max() <= self.t[-1]):
            raise ValueError(f"t must lie within the span of the solution, {self.t[0]:g} to {self.t[-1]:g}.")
        return times

    def _interpolated(self, times: np.ndarray) -> tuple[Any, Any]:
        if self._between is not None and len(self.t) > 1:
            states = self._between(self.t, *((self._reads_z and self._whole) or (self.u, self.v)), times.ravel())
            shape = self.u.shape[1:]
            u, v = (x[:, : shape[0]] if shape else x for x in states)
            return u.reshape(times.shape + shape)[()], v.reshape(times.shape + shape)[()]
        return self._interpolation[0].at(times, self._knots_of_a_polynomial)

    @property
    def _interpolation(self) -> tuple[Knots, Resolution]:
        """The states for the interpolation, and its errors."""
        if self._knots is None:
            knots = self._all_knots()
            # not a method of this object: with a reference cycle, its arrays would stay until the garbage collector
            # runs
            steps = partial(_steps_to, self.t, self.h, self.steps)
            evaluate = self._accelerations
            if evaluate and self._reads_z:
                evaluate = partial(_with_interpolated_z, evaluate, *self._rows_of_z())
            self._knots = knots, Resolution(knots, self._knots_of_a_polynomial, evaluate, steps)
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

    @with_suggestions()
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
        """Continue the run to a later time, bitwise as one run over the whole span.

        For another method or step, run ``problem.with_(u0=solution.u[-1], v0=solution.v[-1], t_span=...)``.

        Parameters
        ----------
        t_end : float
            The new end. With a fixed step, it is a whole number of steps h after the end of the run.
        save_to, progress, raise_on_failure, cancel
            As for `eig3.integrate`. `save_to` is a directory for the whole history; by default the history is in
            memory.
        t_eval : array_like, optional
            For a run with `t_eval`: further times, after the end of the run, at which the states are saved.

        Returns
        -------
        Solution
            The run over the whole span; this solution does not change. t, u and v are bitwise the same as in one run
            with the same h or tolerances. `save_every` counts from the first state: the last state of this solution is
            not in the new solution if it was saved only as the last state. `drift`, `extremes`, `outputs` and the
            counts cover the whole span. With tolerances, a run whose steps depend on the length of its span is
            repeated: a run from rest over less than a unit of time, or over less than its first step.

        Raises
        ------
        ValueError
            If t_end is not a whole number of steps after the end; the error names the nearest valid time. If the run
            failed or raised an exception, or if this solution has no right-hand side: a copy and a pickle have none,
            and `eig3.load` needs it as an argument. A run that was INTERRUPTED by Ctrl-C or `cancel`, or whose process
            was killed, can continue. If `save_to` is missing, and the files of the run have states of more than 2^27
            bytes (134 MB).
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
        """The state from which the run can continue, in numbers, texts and arrays; None if it cannot."""
        return self._resume() if callable(self._resume) else self._resume

    def _separate(self, unknowns: FirstOrder) -> None:
        """Move first-order unknowns, which are the velocities of the last degrees of freedom, to `z`."""
        self._whole, self._reads_z = (self.u, self.v), unknowns.is_read
        self.u, self.v, self.z = unknowns.separated(*self._whole)
        self.events = {name: occurrences.separated(unknowns) for name, occurrences in self.events.items()}

    def _first(self, count: int) -> Solution:
        """Return the first states of the run."""
        z = {name: x[:count] for name, x in self.z.items()}
        whole = self._whole and (self._whole[0][:count], self._whole[1][:count])
        return dataclasses.replace(self, t=self.t[:count], u=self.u[:count], v=self.v[:count], z=z, _whole=whole)

    def _states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return t, u, v and z of the saved states, then before the jumps, then after the jumps."""
        jumps = [jumps for jumps in (o.jumps for o in self.events.values()) if len(jumps)]
        if not jumps:
            return self.t, self.u, self.v, flat(self.z, len(self.t))
        t = np.concatenate([self.t] + 2 * [jump.t for jump in jumps])
        u = np.concatenate([self.u, *(jump.u for jump in jumps), *(jump.u_after for jump in jumps)])
        v = np.concatenate([self.v, *(jump.v for jump in jumps), *(jump.v_after for jump in jumps)])
        z = [flat(self.z, len(self.t)), *(flat(jump.z, len(jump)) for jump in jumps)]
        return t, u, v, np.concatenate([*z, *(flat(jump.z_after, len(jump)) for jump in jumps)])

    def _all_knots(self) -> Knots:
        """Return the saved states and the states before and after each jump, in the order of time."""
        order, (t, u, v, z) = self._order(), self._states()
        if order is not None:
            t, u, v, z = t[order], u[order], v[order], z[order]
        return Knots(t, u, v, self._known_accelerations(t, u, v, z, order))

    def _rows_of_z(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the times of all knots, and all z there, of the shape (knots, k)."""
        order, (t, _, _, z) = self._order(), self._states()
        return (t, z) if order is None else (t[order], z[order])

    def _order(self) -> np.ndarray | None:
        """Return the places of the knots among the rows of `_states`, in the order of time; None without jumps."""
        t, m = self._states()[0], len(self.t)
        if len(t) == m:
            return None
        jumps = t[m : (m + len(t)) // 2]
        saved = np.searchsorted(self.t, jumps, side="right") - np.searchsorted(self.t, jumps, side="left")
        # A jump replaces the state that was saved at its time. Two states at the same time are a jump.
        is_knot = ~np.isin(t, jumps[saved == 1])
        is_knot[m:] = np.tile((saved < 2) & (self.t[0] <= jumps) & (jumps <= self.t[-1]), 2)
        order = np.argsort(t, kind="stable")
        return order[is_knot[order]]

    def _known_accelerations(
        self, t: np.ndarray, u: np.ndarray, v: np.ndarray, z: np.ndarray, order: np.ndarray | None
    ) -> Callable[[np.ndarray], np.ndarray] | None:
        """Return the accelerations as a function for `Knots`, for `_states` in another order, if they are known."""
        if self._a is not None:
            a = self._a if order is None else np.concatenate([self._a, self._a_jumps])[order]
            return a.__getitem__
        evaluate = self._evaluate
        if evaluate is None:
            return None

        def accelerations(rows: np.ndarray) -> np.ndarray:
            return evaluate(t[rows], u[rows], v[rows], z[rows])

        return accelerations

    @with_solution
    def save(self, path: str | PathLike[str]) -> Path:
        """Write the solution to a file of NumPy arrays, which `eig3.load` reads.

        Parameters
        ----------
        path : str or path
            The file. ".npz" is added if it does not end with this. An existing file is replaced when the new file is
            complete.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        OSError
            If the file cannot be written. An existing file is then unchanged.
        TypeError
            If a value is not a number, a text or an array of numbers or texts.

        Notes
        -----
        The file also has the accelerations `a`, unless the right-hand side raises an exception, the result of
        `explain`, and the state from which the run can continue. It does not have functions: the right-hand side, and
        the jacobian of the method. ``np.load`` reads the arrays without eig3.
        """
        return storage.write(storage.RUN, self.__getstate__() | {"_resume": self._state}, storage.file(path))

    def to_pandas(self) -> Any:
        """Return the saved states as a `pandas.DataFrame`, with a row for each state.

        Returns
        -------
        pandas.DataFrame
            The index is t. The columns are the displacements u0, u1, ... and the velocities v0, v1, ..., or x0 and v_x0
            if the degree of freedom has the name x0, then the outputs and z. ``attrs["units"]`` has the
            known units by column. Other `attrs` are status, message, method and h.

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
            freedom in the coordinate dof; then the outputs and z. Where the units are known, u and v have the
            attribute units or, if they differ, the coordinates unit_of_u and unit_of_v over dof. The attributes of
            the dataset are status, message, method and h.

        Raises
        ------
        ImportError
            If xarray is not installed.
        ValueError
            If two variables have the same name.
        """
        return frames.to_xarray(self)

    def __getstate__(self) -> dict[str, Any]:
        # References to compiled code cannot be pickled. The accelerations are computed before they are lost.
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
        lines += drifts(self)
        lines += [f"  {self.message}"] * (not self.success)
        lines += [f"  {self.error}"] * (self.error is not None)
        lines += [f"  Note: {note}" for note in (*self.notes, *(self.error.notes if self.error else ()))]
        return "\n".join(lines)

    _repr_html_ = of_repr


def drifts(solution: Any, most: str = "") -> list[str]:
    """Return a line with the drift of each invariant of a solution, or after the word `most` its largest in members."""
    evaluated, total = int(np.sum(solution.n_invariants)), int(np.sum(solution.n_steps))
    some = f" (at {evaluated:,} of {total:,} steps)" * (evaluated < total)
    word = "change" if solution.method.is_stochastic else "drift"  # a thermostat does not keep the energy
    return [f"  {word} of {name}: {most}{np.max(value):.4g}{some}" for name, value in solution.drift.items()]


#: The functions that compute the default values of fields.
_EMPTY = {each.name: each.default_factory for each in dataclasses.fields(Solution) if callable(each.default_factory)}


def _loaded(fields: dict[str, Any]) -> Solution:
    """Return the solution with the fields of a file."""
    check_run(fields)
    return Solution._of(fields | {"events": labelled(fields["events"], fields["labels"])}, {})


storage.KINDS[storage.RUN] = _loaded


def whole_rows(solution: Solution, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, u and v of the saved states with all n degrees of freedom of a kernel, including first-order unknowns.

    A file of `Solution.save` lacks the integrals of these, which are not used: they are NaN.
    """
    u, v = solution._whole or (solution.u, solution.v)
    if solution._whole is None and solution.z:
        u, v = _with_z(u, v, flat(solution.z, len(v)), np.nan)
    if (u.shape[1] if u.ndim == 2 else 1) != n:
        raise ValueError(f"the states have {u.shape[1:]} degrees of freedom and not {n}.")
    return solution.t, u, v


def _accelerations_with_z(
    evaluate: Callable[..., np.ndarray], reads_z: bool, t: np.ndarray, u: np.ndarray, v: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return the accelerations at states with z."""
    return evaluate(t, *_with_z(u, v, z, 0.0))[:, : u.shape[1]] if reads_z else evaluate(t, u, v)


def _with_interpolated_z(
    evaluate: Callable[..., np.ndarray], knots: np.ndarray, z: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Return the accelerations at states between knots."""
    return _accelerations_with_z(evaluate, True, t, u, v, resampled(knots, z, t))


def _with_z(u: np.ndarray, v: np.ndarray, z: np.ndarray, integral: float) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v with further degrees of freedom, whose velocities are z."""
    v = np.column_stack([v, z])
    return np.column_stack([u, np.full((len(u), v.shape[1] - u.shape[1]), integral)]), v


def _steps_to(saved: np.ndarray, h: float, steps: np.ndarray | None, t: np.ndarray) -> np.ndarray:
    """Return the length of the step that led to each of the times t, from the steps to the saved times."""
    if steps is None:
        return np.full(len(t), h)
    return steps[np.minimum(np.searchsorted(saved, t), len(saved) - 1)]
