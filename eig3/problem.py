"""Second-order initial value problems, with energy, exact solution and source if these are known."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .animation import Curves
from .animation.animate import View, animate
from .diagnosis.critical import CriticalStep, critical_step, of_encounters, with_encounters
from .ensembles.ensemble import ensemble
from .ensembles.named_members import of_members
from .ensembles.solution import EnsembleSolution
from .functions.callbacks import check_callback, reads_velocity
from .functions.checks import check_h, check_method, check_params, check_span, check_state, reals, shown
from .functions.events import EffectEvent, Event, check_events
from .functions.first_order import NONE, FirstOrder, check_z0
from .functions.guard import guarded
from .functions.layout import Layout
from .functions.named import Parameters, has_names, in_layout, named
from .functions.quantities import EnergyLessWork
from .functions.records import check_left_out, check_size, left_out_of, longest_step, records_of
from .geometry import Geometry
from .kernels.protocol import SCALAR, VECTOR
from .keywords import suggestion, with_suggestions
from .methods import Method
from .notebook import brief, facts
from .result import storage
from .result.labels import Labels
from .result.occurrences import labelled
from .result.solution import Solution
from .run.accuracy import check_goal, reach, refuse_without_accuracy
from .run.integration import integrate
from .run.loading import with_functions
from .run.prepare import Prepared
from .stepping.run_options import run_options
from .stepping.stepper import Stepper

if TYPE_CHECKING:
    from typing import Self  # since Python 3.11

    from .view import Page

#: A function that draws the response on a matplotlib figure.
Draw = Callable[[Any, Solution], None]

_SHOWN = ("rhs", "u0", "v0", "z0", "params", "t_span", "energy", "exact", "events", "outputs", "h", "source", "note")
_START = ("u0", "v0", "z0", "params")
_FIELDS = (*_START, "t_span")  # which the methods take from the problem
_OF_AN_ACCURACY = ("accuracy", "scale", "max_seconds")
_OF_A_CALL = ("check", "progress", "raise_on_failure", "cancel", "save_to")  # the options of a single run
_ENERGY_EVERY = 100  # steps: the energy then usually costs less than 5 % of a run


@dataclass(frozen=True)
class UnknownMotion:
    """A placeholder for an unknown exact motion: false in a condition; a call raises an error with the reason.

    Parameters
    ----------
    why : str
        A sentence with the reason.
    """

    why: str

    def __bool__(self) -> bool:
        return False

    def __call__(self, t: ArrayLike) -> Any:
        raise ValueError(self.why)

    def again(self, params: Any, u0: Any, v0: Any, t0: float) -> UnknownMotion:
        """Return the placeholder for the motion from other initial values."""
        return self


@with_suggestions()
@dataclass(frozen=True, eq=False)
class Problem:
    """A second-order initial value problem u'' = f(t, u, u'), with its energy and exact solution if they are known.

    With first-order unknowns z, it is u'' = f(t, u, u', z) with z' = g(t, u, u', z).

    Attributes
    ----------
    name : str
    rhs : jitted function
        The acceleration, in one of the forms that `eig3.integrate` takes.
    u0, v0 : float or array_like, shape (n,)
        Displacement and velocity at ``t_span[0]``; the attributes are floats, or copies of arrays.
    params : array_like; or NamedTuple or dict
        The parameters p of rhs, energy and events; the attribute is a copy. Functions read named parameters as ``p.k``,
        and the attribute is then of the type `eig3.Parameters`.
    t_span : (float, float)
    energy : jitted function, optional
        ``energy(t, u, v, p) -> float``, constant along the exact solution. `integrate` evaluates it as the invariant
        "energy", after about every hundredth step. If a scene or a structure follows the work, it is the energy minus
        the work, also as an output: `energy_of` has the energy alone.
    energy_unit : str
        Unit of the energy, "J" or, if rhs is divided by the mass, "J/kg"; with "-", the time is dimensionless too.
    units : str or tuple of str
        Unit of all displacements, or of each displacement; "-" for a dimensionless number.
    names : tuple of str
        The name of each degree of freedom, such as "x0"; empty if they have no names.
    exact : callable, optional
        ``exact(t) -> (u, v)`` for an array of times; None, or another false value, if it is not known.
    continuum : callable, optional
        ``continuum(t) -> (u, v)`` of the continuous body that a lumped problem approximates, at the masses.
    source, note : str
        The source of the problem in the literature; for the problem of a scene, a list of the content of the scene.
    h : float, optional
        A suggested step for a first run, which resolves the motion.
    draw : callable, optional
        ``draw(figure, solution)`` draws the response on a matplotlib figure, with the panels of `eig3.drawing`.
    z0 : float or array_like, shape (k,); or dict of str to these
        First-order unknowns at ``t_span[0]``; the attribute is a dictionary. With rhs in the form ``f(t, u, v, p, a)``,
        they are integrals over time, such as the work, as quadratures in SUNDIALS: rhs is called with further degrees
        of freedom after the n of u0, and their accelerations are the integrands. Their velocities are then the
        integrals, and energy may read them. rhs and energy must also accept u and v without these degrees of freedom.
    events : dict of str to Event
        Events of the motion by name, such as the impacts of a ball.
    view : callable, optional
        The view for `animate`: ``view(figure, film)`` draws the static parts on a matplotlib figure, and returns
        ``show(i)``, which shows frame i of the `eig3.animation.Film`. `eig3.animation` has views such as `Mechanism`.
    outputs, output_units : dict
        Outputs that `integrate` takes, such as reactions, and known units, as {"moments": "N m"}, or of each value.
    encounters : callable, optional
        For `critical_step`: ``encounters(t, u, v, span)`` returns the squared frequencies and damping rates of possible
        collisions from a state, or None if unknown. Scenes with contacts or pair potentials have it.
    masses : array_like, shape (n,), optional
        The mass of each degree of freedom, for `Langevin`; infinite for a degree of freedom without noise.
    geometry : Geometry, optional
        The points, links, cells and bodies, for `export`. Scenes and frames have it.
    """

    name: str
    rhs: Any
    u0: Any
    v0: Any
    params: Any
    t_span: tuple[float, float]
    energy: Any = None
    exact: Callable | None = None
    continuum: Callable | None = None
    source: str = ""
    note: str = ""
    h: float | None = None
    draw: Draw | None = None
    energy_unit: str = "J"
    units: str | tuple[str, ...] = "m"
    names: tuple[str, ...] = ()
    z0: Any = None
    events: Mapping[str, Event] = field(default_factory=dict)
    view: View | None = None
    outputs: Mapping[str, Any] = field(default_factory=dict)
    encounters: Callable | None = None
    masses: ArrayLike | None = None
    geometry: Geometry | None = None
    output_units: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    unknowns: FirstOrder = field(default=NONE, init=False, repr=False)  # the names and shapes of z0

    def __post_init__(self) -> None:
        u0, v0, form = check_state(self.u0, self.v0)
        own: dict[str, Any]  # independent of later changes by the caller
        own = {"u0": u0, "v0": v0, "t_span": check_span(self.t_span)}
        own |= {"h": None if self.h is None else check_h(self.h), "outputs": dict(self.outputs)}
        self._check_degrees(np.size(u0))
        given = self.output_units
        if not (isinstance(given, Mapping) and all(map(_are_units, given.values()))):
            raise TypeError(f"output_units must be a dictionary such as {{'force': 'N'}}, not {shown(given)}.")
        unknowns, z = check_z0(self.rhs, self.z0 or None if isinstance(self.z0, Mapping) else self.z0, form)
        own |= {"z0": unknowns.named(z), "unknowns": unknowns}
        own |= {"rhs": unknowns.bind_rhs(self.rhs), "energy": unknowns.bind(self.energy)}
        own["events"] = unknowns.bind_all(check_events(self.events))
        params = named(self.params)
        own["params"] = params if isinstance(params, Parameters) else copy(params)
        if isinstance(params, Parameters):
            bind = params.layout.bind
            own |= {"rhs": bind(own["rhs"]), "energy": bind(own["energy"])}
            own["events"] = params.layout.bind_all(own["events"])
            longest_step(records_of(own["rhs"]), params, np.size(u0))  # checks the parameters
        for name, value in own.items():
            object.__setattr__(self, name, value)  # the dataclass is frozen
        self._refuse_moving_states(v0)

    @cached_property
    def _longest_step(self) -> float:
        """The longest step that jumps over no load of a record."""
        return longest_step(records_of(self.rhs), self.params, np.size(self.u0))

    @property
    def _layout(self) -> Layout | None:
        """The names of the parameters, if they have any."""
        return getattr(self.params, "layout", None)

    def with_(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, such as ``problem.with_(u0=[0.1, 0.0], t_span=(0, 20))``.

        Parameters
        ----------
        **changes
            New values of attributes. u0, v0, z0 and params keep their shapes and names. A dictionary for z0 or params
            has the values that change. rhs cannot be changed.

        Returns
        -------
        Problem
            If u0, v0, z0, params or the start of t_span change, `continuum` is removed, and `exact` is recomputed for a
            problem of `eig3.linear`, and otherwise unknown. If params change, `draw`, `view`, `geometry` and
            `encounters` are removed, because they may contain constants of the problem. Fields given in `changes` are
            kept.

        Raises
        ------
        TypeError, ValueError
            If a field is unknown, or a value is not valid for it.
        """
        names = [each.name for each in fields(self) if each.init and each.name != "rhs"]
        for name in changes:
            if name not in names and self._layout and name in self._layout.names:
                raise TypeError(f"{name} is a parameter: give params={{{name!r}: ...}} to with_.")
            if name not in names:
                raise TypeError(f"with_ can change {', '.join(names)}, but not {name}{suggestion(name, names)}")
        new = {name: self._checked(name, value) for name, value in changes.items()}
        changed = {name for name in _START if name in new and not _are_equal(new[name], getattr(self, name))}
        if "t_span" in new and new["t_span"][0] != self.t_span[0]:
            changed.add("t_span")
        dropped = ["continuum"] * bool(changed) + ["draw", "view", "geometry", "encounters"] * ("params" in changed)
        copied: dict[str, Any] = {**dict.fromkeys(dropped), **new}
        if changed and self.exact is not None:
            copied.setdefault("exact", self._exact_again(new))
        return replace(self, **copied)

    def _exact_again(self, new: Mapping[str, Any]) -> Callable:
        """Return the exact motion with some fields changed, or a placeholder with the reason why it is not known."""
        again = getattr(self.exact, "again", None)
        if again is None:
            return UnknownMotion(
                f"the exact motion of {self.name} is known for its own start and parameters, and this copy has others: "
                "give the motion of the copy to with_ as exact."
            )
        params, u0, v0, t_span = (new.get(name, getattr(self, name)) for name in ("params", "u0", "v0", "t_span"))
        return again(params, u0, v0, t_span[0])

    @with_suggestions(integrate, fields=_FIELDS)
    def integrate(
        self, *, h: float | None = None, method: str | Method | None = None, t_end: float | None = None, **options: Any
    ) -> Solution:
        """Integrate the problem, with a fixed step or with tolerances.

        Parameters
        ----------
        h, method
            As for `eig3.integrate`. Give h, or rtol or accuracy among the other options.
        t_end : float, optional
            The end of the run; ``t_span[1]`` if not given.
        **options
            Other options of `eig3.integrate`, such as rtol and t_eval. `invariants` replaces the energy, which is
            evaluated after about every hundredth step without `invariants_every`; `events` replaces the events of the
            problem, but for the events of effects, which stay in the problem: ``events={}`` leaves these out too. If z0
            are integrals, functions in `invariants` and `outputs` get u and v with further degrees of freedom for
            these.

        Returns
        -------
        Solution
        """
        _refuse_fields(options, "integrate")
        of_call = {name: options.pop(name) for name in _OF_A_CALL if name in options}
        span = self.t_span if t_end is None else (self.t_span[0], t_end)
        accuracy, *further = (options.pop(name, None) for name in _OF_AN_ACCURACY)
        options |= {"h": h, "method": method}
        if accuracy is not None:
            goal = check_goal(accuracy, *further)
            return reach(goal, self.rhs, self.prepare, options, (span,), of_call, self._longest_step)
        refuse_without_accuracy(**dict(zip(_OF_AN_ACCURACY[1:], further, strict=True)))
        return self.prepare(**options)(span, **of_call)

    @with_suggestions(run_options, fields=_FIELDS)
    def prepare(self, **options: Any) -> Prepared:
        """Prepare runs of the problem, as `eig3.prepare` does.

        Parameters
        ----------
        **options
            Options of `eig3.prepare`. `invariants` and `events` are as for `integrate`.

        Returns
        -------
        Prepared
            In a call, the defaults of t_span, u0, v0, z0 and params come from the problem.
        """
        options = self._with_own(options, "prepare")
        options["invariants"] = self._balanced(options["invariants"])
        form = SCALAR if np.ndim(self.u0) == 0 else VECTOR
        start = self.t_span, self.u0, self.v0, self.params
        z = self.unknowns.joined(self.z0) if self.z0 else None
        return Prepared(self.rhs, form, run_options(self._layout, **options), start, z, self._longest_step)

    def load(
        self,
        path: str | PathLike[str],
        *,
        outputs: Mapping[str, Any] | None = None,
        jacobian: Any = None,
        **options: Any,
    ) -> Any:
        """Read a run of this problem, which `extend` can then continue.

        Parameters
        ----------
        path, outputs, jacobian
            As for `eig3.load`.
        **options
            `events` and `invariants`, if they differ from the problem.

        Returns
        -------
        Solution or EnsembleSolution
            With the parameters of the run.

        Raises
        ------
        OSError, TypeError, ValueError
            As for `eig3.load`, and if the run does not belong to this problem.
        """
        found = storage.load(path)
        if isinstance(found, EnsembleSolution):
            if found._with_functions:
                options = self._own_functions(found, options)
            return found.with_functions(self.rhs, outputs=outputs, jacobian=jacobian, **options)
        n = 1 if found.u.ndim == 1 else found.u.shape[1]
        if (n, tuple(found.z)) != (np.size(self.u0), tuple(self.z0)):
            raise ValueError(f"{path} has a run with {n} degrees of freedom, which is not one of {self.name}.")
        options = self._own_functions(found, options)
        options["invariants"] = self._balanced(options.get("invariants"))
        labels = Labels.of(self.labels, found.labels.columns if found.labels else ())
        options |= {"labels": labels, "first_order": self.unknowns}
        solution = with_functions(found, self.rhs, outputs=outputs, jacobian=jacobian, **options)
        solution.labels, solution.events = labels, labelled(solution.events, labels)
        return solution

    def _own_functions(self, found: Solution | EnsembleSolution, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the functions `given` to a loaded run, or the energy and the events of this problem if it has them."""
        own: dict[str, Any] = {}
        if self.energy is not None and "energy" in found.drift:
            own["invariants"] = {"energy": self.energy}
        if found.events:
            own["events"] = self.events
        own |= given
        return own | {"events": self._with_effects(own["events"], found.events)} if "events" in own else own

    @with_suggestions(ensemble, fields=_FIELDS)
    def ensemble(
        self,
        *,
        h: ArrayLike | None = None,
        u0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        z0: Any = None,
        params: Any = None,
        t_end: float | None = None,
        **options: Any,
    ) -> Any:
        """Integrate many variants of the problem at once.

        Parameters
        ----------
        h : float or array_like, optional
            As for `eig3.ensemble`.
        u0, v0, z0, params : array_like, optional
            Values for each member, along a first axis. The defaults come from the problem, for all members. With named
            parameters, params is a dictionary of the parameters that change, a DataFrame of these with a row for each
            member, or a list of dictionaries, NamedTuples or `eig3.Parameters`. z0 is a
            dictionary of the first-order unknowns that change, if these have names.
        t_end : float, optional
            The end of the run; ``t_span[1]`` if not given.
        **options
            Other options of `eig3.ensemble`. `invariants` and `events` are as for `integrate`.

        Returns
        -------
        EnsembleSolution

        Raises
        ------
        ValueError
            If u0 or v0 has a wrong shape, and as for `eig3.ensemble`.
        """
        options = self._with_own(options, "ensemble")
        start = [old if new is None else new for old, new in ((self.u0, u0), (self.v0, v0))]
        self._refuse_moving_states(start[1])
        span = self.t_span[0], self.t_span[1] if t_end is None else t_end
        if self._layout:
            params = of_members({} if params is None else params, self.params)
        elif params is not None:
            self._refuse_names(params)
            check_size(self.rhs, params, np.size(self.params))
        else:
            params = check_params(self.params)
            given: Any = (self.u0, u0), (self.v0, v0), (0.0, 0.0 if h is None else h)
            if any(np.ndim(x) > np.ndim(own) and np.shape(x)[0] == params.size > 1 for own, x in given):
                params = params[None]  # shared, even if there are as many parameters as members
        if z0 is not None and not self.z0:
            raise TypeError(f"{self.name} has no first-order unknowns: leave out z0.")
        if self.z0:
            n = np.size(self.u0)
            for name, x in zip(("u0", "v0"), start, strict=True):
                if np.shape(x)[-1:] != (n,):
                    raise ValueError(
                        f"{name} must have the shape ({n},) or (m, {n}) in {self.name}, not {np.shape(x)}."
                    )
            first = self.unknowns.again(self._with_z0({} if z0 is None else z0))
            start = [*self.unknowns.start(start[0], start[1], first)]
        return ensemble(self.rhs, span, *start, h=h, params=params, **options)

    @with_suggestions(Stepper.__init__, fields=_FIELDS)
    def stepper(self, *, h: float, method: str | Method = "eig3", inline: bool = False, **options: Any) -> Stepper:
        """Return a `Stepper` at the start of the problem, without integrals over time.

        Raises
        ------
        ValueError
            If an event changes or ends the motion, or rhs reads first-order unknowns: a stepper supports neither.
        """
        _refuse_fields(options, "stepper")
        if self.unknowns.is_read:
            raise ValueError(
                f"{self.name} has first-order unknowns, which a stepper does not support: call problem.prepare(...), "
                "and the prepared run again and again."
            )
        if any(event.terminal or event.apply is not None for event in self.events.values()):
            raise ValueError(
                f"{self.name} has events that change or end its motion, which a stepper does not support: call "
                "problem.integrate(...), or leave the events out with problem.with_(events={})."
            )
        options |= {"t0": self.t_span[0], "params": self.params, "inline": inline}
        return Stepper(self.rhs, self.u0, self.v0, h=h, method=self._with_masses(method), **options)

    def critical_step(
        self, *, method: str | Method = "eig3", t: float | None = None, safety: float = 0.9
    ) -> CriticalStep:
        """Return the longest stable step, as `eig3.critical_step` finds it.

        The step holds for small motions about the start. In a scene with contacts or pair potentials, it is also short
        enough for the closest approach that the energy at the start allows: `CriticalStep.holds` says which of the two
        limits the step.
        """
        time = self.t_span[0] if t is None else t

        def find() -> CriticalStep:
            options: dict[str, Any] = {"method": method, "t": time, "safety": safety}
            u0, v0 = self.start if self.unknowns.is_read else (self.u0, self.v0)
            return critical_step(self.rhs, u0, v0, self.params, **options)

        ahead = self.ahead(time)
        if ahead is None:
            return find()
        return with_encounters(find, lambda: of_encounters(ahead, check_method(method), safety))

    def ahead(self, t: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return `encounters` for the motion from the start, at the time t; None if they are unknown."""
        return self.encounters and self.encounters(t, self.u0, self.v0, self.t_span[1] - t)

    @property
    def start(self) -> tuple[np.ndarray, np.ndarray]:
        """u0 and v0 as kernels get them: with first-order unknowns as velocities of further degrees of freedom."""
        if not self.z0:
            return self.u0, self.v0
        return self.unknowns.start(self.u0, self.v0, self.unknowns.joined(self.z0))

    def energy_of(self, u: ArrayLike, v: ArrayLike, t: ArrayLike | None = None, z: Any = None) -> Any:
        """Return the energy of a state, or of each state of a history.

        If the problem integrates the work, this is the mechanical energy, which changes by ``z["work"]``.

        Parameters
        ----------
        u, v : array_like
            Of the shape of u0 for one state, or with a first axis of states for a history, as in a solution.
        t : float or array_like, optional
            The times of these states; ``t_span[0]`` if not given.
        z : dict of str to array_like, optional
            The first-order unknowns of these states, as in a solution, if rhs reads them.

        Returns
        -------
        float or ndarray

        Raises
        ------
        ValueError
            If the problem has no energy, u or v has another shape, or z is missing.
        """
        if self.energy is None:
            raise ValueError(
                f"{self.name} has no energy: make its scene or structure with work=True, or give the problem one."
            )
        shape = np.shape(self.u0)
        if np.shape(u) != np.shape(v) or np.shape(u)[np.ndim(u) - len(shape) :] != shape:
            raise ValueError(
                f"u and v must have the shape {shape} of u0, or a first axis of states before it, not the shapes "
                f"{np.shape(u)} and {np.shape(v)}."
            )
        if self.unknowns.is_read:
            if z is None:
                raise ValueError("energy_of needs z too, such as z=solution.z.")
            if "work" in self.z0 and isinstance(z, Mapping):  # the energy of a state with the work is less the work
                z = {**z, "work": np.zeros_like(z["work"])}
            u, v = self.unknowns.start(u, v, self.unknowns.again(z))
        energy = check_callback(self.energy, "invariant", check_state(self.u0, self.v0)[2], "energy")
        params = guarded(check_params(self.params))  # a scene stores neighbour lists in them

        def of(t: Any, u: ArrayLike, v: ArrayLike) -> float:
            u, v, _ = check_state(u, v)
            return energy.call(float(t), u, v, params)

        time = self.t_span[0] if t is None else t
        if np.ndim(u) == np.ndim(self.u0):
            return of(time, u, v)
        u, v = np.asarray(u), np.asarray(v)
        times = np.broadcast_to(np.asarray(time, dtype=np.float64), len(u))
        return np.array([of(*state) for state in zip(times, u, v, strict=True)])

    def animate(
        self,
        solution: Solution,
        path: str | PathLike[str],
        *,
        limits: Any = None,
        camera: Any = None,
        color: Any = None,
        t_end: float | None = None,
    ) -> Path:
        """Write an animation of a run to scale, with its time and its speed.

        It lasts 6 to 10 s and has 20 frames a second, with states from ``solution.at``. A motion of 6 to 10 s is shown
        in real time, other motions faster or slower. If a run has more than 16 periods, the first 2 to 16 are shown; if
        it diverged, the part before the growth.

        Parameters
        ----------
        solution : Solution
            A run of this problem.
        path : str or path
            The file, which is replaced if it exists. The suffix sets the format: ".gif"; ".html", a self-contained page
            with a button and a slider; ".mp4", which needs ffmpeg.
        limits : array_like, shape (2 or 3, 2), or {"main", "all"}, optional
            The least and the largest coordinate along each axis, in the unit of the axis, such as ``((0, 1), (0, 2))``;
            or all points, for "main" without the few that fly far away, which is the default.
        camera : (float, float) or (float, float, float), optional
            The direction of view for points in space: azimuth and elevation, degrees, by default -60 and 30; and the
            distance relative to the usual one.
        color : str or array_like, shape (rows, points), optional
            What colours the points, with a scale: "speed"; in a scene without friction of grains "force", the size of
            the total force on each mass, N, and 0 for supports and points of bodies; the name of an output of the
            solution with a value for each point; or such values at the saved times, also for the moving points only.
        t_end : float, optional
            The end of the run, if the solution is only its beginning: the picture then names the part that it shows.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ValueError
            If the suffix is unknown, the states of the solution are too far apart to show the motion, or limits, camera
            or color do not fit the picture.
        ImportError
            If matplotlib, or for ".mp4" ffmpeg, is not installed.
        OSError
            If the file cannot be written.

        Notes
        -----
        The picture comes from `view`. Scenes and the problems of the library have a view: points, links, supports and
        planes of a scene, or a field over space. Without a view, the picture shows the degrees of freedom against time.
        With `limits`, `camera` or `color`, it shows the points that `show` has too, as `eig3.animation.Mechanism`.
        """
        self._check_own(solution)
        look = {"limits": limits, "camera": camera, "color": color}
        options: dict[str, Any] = {
            "name": self.name,
            "look": look,
            "has_seconds": self.labels.time == "s",
            "t_end": t_end,
        }
        return animate(self.view or Curves(self.labels), solution, path, **options)

    def show(
        self,
        solution: Solution,
        path: str | PathLike[str] | None = None,
        *,
        limits: Any = None,
        camera: Any = None,
        color: Any = None,
        t_end: float | None = None,
    ) -> Page:
        """Show a run in three dimensions, on a page that one can turn, with a clock and colours.

        The page is one HTML file, which needs no network. It shows the same part of the run as `animate`, at the same
        speed.

        Parameters
        ----------
        solution : Solution
            A run of this problem. Outputs with one value for each point can be shown as colours.
        path : str or path, optional
            The file, which ends with ".html" and is replaced if it exists. Without it, the page is shown in a notebook,
            or else as a temporary file in the browser.
        limits, camera, color
            What the page shows first, as in `animate`.
        t_end : float, optional
            The end of the run, if the solution is only its beginning: the page then names the part that it shows.

        Returns
        -------
        Page
            With the attributes `html` and `path`. A notebook shows it below the cell.

        Raises
        ------
        ValueError
            If the problem has no geometry, as `eig3.animation.Mechanism`, the states of the solution are too far apart
            to show the motion, or limits, camera or color do not fit the picture.
        OSError
            If the file cannot be written.
        RuntimeError
            If there is no browser to open.
        """
        from .view import show

        self._check_own(solution)
        has_seconds = self.labels.time == "s"
        look = {"limits": limits, "camera": camera, "color": color}
        return show(self.view, solution, path, name=self.name, look=look, has_seconds=has_seconds, t_end=t_end)

    def _check_own(self, solution: Any) -> None:
        """Refuse what is no solution, and one without states or with other degrees of freedom than the points shown."""
        if not isinstance(solution, Solution):
            kind = type(solution).__name__
            raise TypeError(f"solution must be a Solution, such as a member ensemble[0], not {kind}.")
        solution._check_states()
        own, has_points = np.shape(self.u0), self.view and self.shown_geometry
        if has_points and solution.u.shape[1:] != own:
            given = solution.u.shape[1:]
            raise ValueError(f"solution must be a run of {self.name}, with states of the shape {own}, not {given}.")

    def export(
        self,
        solution: Solution,
        path: str | PathLike[str],
        *,
        types: Any = None,
        scale: float = 1.0,
        every: int = 1,
        progress: bool = False,
    ) -> Path:
        """Write the saved states of a run to a file of OVITO, VMD or ParaView, one state at a time.

        Parameters
        ----------
        solution : Solution
            A run of this problem. With `save_to`, it may be larger than the memory.
        path : str or path
            The file, which is replaced if it exists. The suffix sets the format: ".extxyz" or ".xyz", extended XYZ;
            ".dump", the text dump of LAMMPS; ".dcd", which has positions only, at equal distances in time; ".pvd", a
            collection of VTU meshes in a folder of the same name; ".vtkhdf", the same meshes in one file.
        types : str or int, or array_like of these with shape (points,), optional
            The species of each point, such as "Ar", in the order in which the points were added, with fixed points; by
            default 1, and 2 for fixed points.
        scale : float
            Multiplies lengths, as in positions, velocities, radii and the box: with ``scale=1e10``, they are in
            Ångström. Times stay in s.
        every : int
            Write every so many of the saved states.
        progress : bool
            Show a progress bar, which needs tqdm.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ValueError
            If the suffix is unknown, the problem has no points in space, or the format cannot hold the run.
        ImportError
            If a library of the format is not installed: ``pip install 'eig3[files]'``.
        OSError
            If the file cannot be written.

        Notes
        -----
        The points come from `geometry`, or from `view` if that is an `eig3.animation.Mechanism`. Meshes have the links
        as lines, the triangles and tetrahedra of sheets and solids, for each rigid body the surface of its shape, or
        the box with its mass and inertia, and for each contact a line with the normal force. Positions in a periodic
        box are wrapped, with image flags in ".dump"; in ".extxyz" and ".dcd" they are as in the solution.
        """
        from .files import export

        self._check_own(solution)
        options: dict[str, Any] = {"types": types, "scale": scale, "every": every, "progress": progress}
        return export(self.shown_geometry, solution, path, **options, name=self.name)

    @property
    def shown_geometry(self) -> Geometry | None:
        """The `geometry`, or what the view draws; None if there is neither."""
        return self.geometry or getattr(self.view, "geometry", None)

    def unit(self, letter: str, i: int = 0) -> str:
        """Return the unit of "u" or "v" in the degree of freedom i."""
        return self.labels.unit(letter, i)

    @property
    def labels(self) -> Labels:
        """The names and units of the degrees of freedom, the names of the parameters, and the units of outputs."""
        layout, output_units = self._layout.text if self._layout else "", (*self.output_units.items(),)
        time = "-" if self.energy_unit == "-" else "s"  # without units, the time has no unit either
        return Labels(self.names, self.units, layout, output_units=output_units, time=time)

    def _facts(self) -> Iterator[tuple[str, str, str]]:
        """Yield the name, the value and the unit of each field that is known."""
        unit, second = self.labels.unit, self.labels.second.strip()
        units = {letter: brief([*dict.fromkeys(unit(letter, i) for i in range(np.size(self.u0)))]) for letter in "uv"}
        units = {"u0": units["u"], "v0": units["v"], "t_span": second, "h": second, "energy": self.energy_unit}
        rows = ((name, brief(getattr(self, name)), units.get(name, "")) for name in _SHOWN)
        return (row for row in rows if row[1])

    def __repr__(self) -> str:
        lines = (f"{name} = {value} {unit}".rstrip() for name, value, unit in self._facts())
        return "\n".join([self._title, *(f"  {line}".replace("\n", "\n    ") for line in lines)])

    def _repr_html_(self) -> str:
        return facts(self._title, self._facts())

    @property
    def _title(self) -> str:
        return f"{type(self).__name__}: {self.name}"

    @cached_property
    def uses_velocity(self) -> bool:
        """Whether rhs may read v. If not, "cd" takes one evaluation per step, and "eig3" uses fewer arrays."""
        return reads_velocity(self.rhs)

    def _with_own(self, options: dict[str, Any], call: str) -> dict[str, Any]:
        """Return the options of runs with the defaults of the problem; refuse options that would replace its fields."""
        _refuse_fields(options, call)
        if self.energy is not None and "invariants" not in options:
            options = {"invariants": {"energy": self.energy}, "invariants_every": _ENERGY_EVERY, **options}
        options = {"events": self.events, "invariants": {}, **options}
        options["events"] = self._with_effects(options["events"])
        options |= {"method": self._with_masses(options.get("method")), "labels": self.labels}
        return options | {"first_order": self.unknowns}

    def _with_effects(self, events: Any, names: Collection[str] | None = None) -> Any:
        """Return the events of a run, if it has any, after the events of effects, or after some of them by name."""
        if not events or not isinstance(events, Mapping):
            return events
        names = self.events if names is None else names
        of_effects = {name: event for name, event in self.events.items() if isinstance(event, EffectEvent)}
        return {name: event for name, event in of_effects.items() if name in names} | {**events}

    def _with_masses(self, method: Any) -> Any:
        """Return the method with the masses of the problem, if it is an instance of Method."""
        if self.masses is None or not isinstance(method, Method):
            return method
        masses = np.append(np.asarray(self.masses, dtype=np.float64), np.full(self.unknowns.size, np.inf))
        return method.for_masses(masses, self.name)

    def _checked(self, name: str, value: Any) -> Any:
        """Check and convert the new value of a field."""
        if name == "t_span":
            return check_span(value)
        if name not in _START:
            return value
        if name == "z0":
            if not self.z0:
                raise TypeError(f"{self.name} has no first-order unknowns: leave out z0.")
            return self.unknowns.named(self.unknowns.again(self._with_z0(value)))
        if name == "params" and self._layout:
            return self.params._replace(**value) if isinstance(value, Mapping) else in_layout(self._layout, value)
        if name == "params":
            self._refuse_names(value)
        old = np.shape(check_params(self.params) if name == "params" else self.u0)
        new = check_params(value) if name == "params" else reals(value, name)
        if new.shape != old:
            raise ValueError(f"{name} must keep its shape {old} in {self.name}, not have the shape {new.shape}.")
        if name == "params":
            check_left_out(left_out_of(self.rhs), new)
        return new

    def _check_degrees(self, n: int) -> None:
        """Check the fields that have a value for each of the n degrees of freedom."""
        for name, texts in (("names", self.names or ("",) * n), ("units", self.units)):
            are_texts = isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts)
            if not (are_texts and len(texts) == n) and not (name == "units" and isinstance(texts, str)):
                raise ValueError(f"{name} must have a text for each of {n} degrees of freedom, not {shown(texts)}.")
        if self.masses is not None:
            masses = reals(self.masses, "masses")
            if masses.shape != (n,) or not (masses > 0).all():
                given = shown(self.masses)
                raise ValueError(f"masses must have a positive number for each of {n} degrees of freedom, not {given}.")

    def _refuse_moving_states(self, v0: Any) -> None:
        """Refuse velocities of the states of effects, which are degrees of freedom that only events change."""
        if self.masses is None or isinstance(self.units, str) or np.shape(v0)[-1:] != (len(self.units),):
            return
        is_state = np.isinf(self.masses) & (np.array(self.units) == "-")
        moving = np.flatnonzero(is_state & (np.reshape(v0, (-1, is_state.size)) != 0).any(axis=0))
        if moving.size:
            name = self.names[moving[0]]
            raise ValueError(f"v0 must be 0 in the degree of freedom {name}, a state that only events change.")

    def _with_z0(self, changes: Any) -> Any:
        """Return the first-order unknowns at the start, some of which a dictionary changes."""
        return {**self.z0, **changes} if isinstance(changes, Mapping) else changes

    def _refuse_names(self, params: Any) -> None:
        """Refuse parameters with names, if the problem has none."""
        if has_names(params):
            raise TypeError(f"params of {self.name} have no names: give {np.size(self.params)} numbers for each run.")

    def _balanced(self, invariants: Any) -> Any:
        """Return the invariants, with the energy minus the work if the problem integrates the work."""
        if "work" not in self.z0 or not isinstance(invariants, Mapping):
            return invariants
        balance = EnergyLessWork(self.energy, np.size(self.u0) + self.unknowns.begin("work"))
        return {name: balance if function is self.energy else function for name, function in invariants.items()}


def _are_units(given: Any) -> bool:
    return all(isinstance(unit, str) for unit in (given if isinstance(given, tuple) else (given,)))


def _are_equal(value: Any, other: Any) -> bool:
    """Return whether two values of a field are equal; z0 has numbers and arrays by name."""
    if isinstance(value, Mapping):
        return all(np.array_equal(value[name], other[name]) for name in value)
    return np.array_equal(value, other)


def _refuse_fields(options: dict[str, Any], call: str) -> None:
    """Refuse options that would replace a field of the problem."""
    for name in _FIELDS:
        if name in options:
            raise TypeError(f"{name} is a field of the problem: call problem.with_({name}=...).{call}(...).")
    if "t0" in options:
        raise TypeError(f"t0 is the start of the field t_span: call problem.with_(t_span=...).{call}(...).")
