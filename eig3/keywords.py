"""Errors for wrong keywords and positions, which suggest the right argument, also for the names of other codes."""

from __future__ import annotations

import difflib
import functools
import inspect
import re
from collections.abc import Callable, Collection
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_UNKNOWN = re.compile(r"(?:got an unexpected keyword argument|has no argument) '(\w+)'")
_MISSING = re.compile(r"missing \d+ required keyword-only argument")  # perhaps because its keyword is an unknown one
_INTERNAL = {"self", "layout", "labels", "first_order"}  # arguments for internal use

#: The names of an argument in other codes, by its name here.
_ELSEWHERE = {
    "E": "young youngs_modulus young_modulus modulus",
    "D": "D0 De depth epsilon eps",
    "a": "alpha width",
    "accuracy": "tol tolerance rtol",
    "alpha": "damping kappa dsf",
    "angle": "theta0 rest_angle",
    "angular_velocity": "spin omega angvel ang_vel angmom",
    "charges": "charge q",
    "contact_distance": "reach diameter size cutoff",
    "cubic": "S2 k3 beta",
    "cutoff": "reach rc r_c rcut r_cut cut r_max",
    "damping": "c d gamma gamman damp viscosity damping_coefficient",
    "density": "rho",
    "epsilon": "eps depth D0 well_depth",
    "exclude_bonded": "leaves_joined exclusions exclude special_bonds",
    "field": "g gravity",
    "first_step": "h0 dt0 initial_step InitialStep",
    "friction": "mu xmu coeff_friction coefficient",
    "h": "dt timestep time_step delta_t step step_size stepsize dt0 dt_max",
    "h_max": "max_step dt_max dtmax hmax MaxStep",
    "gamma": "friction damp",
    "inertia": "moment moment_of_inertia J diaginertia",
    "limit": "frictionloss",
    "m": "mass",
    "mass": "m",
    "max_steps": "mxstep max_num_steps maxsteps",
    "method": "solver integrator",
    "methods": "method solver integrator",
    "mixing": "mix mixing_rule combination_rule comb_rule",
    "mu": "friction coefficient xmu dynamicFriction",
    "neighbor_capacity": "room capacity max_neighbors one",
    "normal_force": "load fn",
    "nu": "poisson poissons_ratio poisson_ratio",
    "offset": "height",
    "others": "near other group2 walls",
    "params": "args p parameters",
    "parameters": "p0 x0 guess",
    "position": "pos x0",
    "prefactor": "strength charge q1q2 k_e",
    "progress": "verbose",
    "r0": "length rest_length equilibrium_distance",
    "radii": "radius",
    "regularization_speed": "slip v0 vd v_d frictionProportionalZone",
    "rest_length": "length l0 L0 r0 natural_length length0 springlength referenceLength reference_length",
    "rest_speed": "slow v_min",
    "restitution": "e cor coeff_restitution coefficient_of_restitution",
    "rhs": "f fun func",
    "rotation": "quat orientation",
    "rtol": "tol reltol tolerance RelTol",
    "atol": "abstol AbsTol",
    "saturation": "width",
    "save_every": "thermo dump save_interval",
    "sigma": "sig size diameter",
    "stiffness": "k S S1 K kn k_n spring_constant contactStiffness",
    "t_eval": "tsave saveat t_save ts",
    "t_end": "t1 tf tend t_final t_stop tmax",
    "t_span": "t tspan span t0 t1 tf tend t_end t_final t_stop tmax",
    "temperature": "kT T temp",
    "threads": "workers n_jobs num_workers num_threads",
    "torque": "moment gear",
    "u0": "y0 x0 q0 d0",
    "v0": "v qdot0 xdot0",
    "wall_radius": "near_radius radius",
}


def refusal(owner: str, keyword: str, known: Collection[str], fields: Collection[str] = ()) -> TypeError:
    """Return the error for an unknown keyword of `owner`, which suggests similar arguments, or names all arguments.

    `fields` are the fields of a problem that a copy may change, for a method of a problem.
    """
    meant, of_problem = _meant(keyword, known), _meant(keyword, fields)
    meant = meant or ([] if of_problem else _near(keyword, known))
    remedy = f"its arguments are {', '.join(known)}." if known else "it takes none."
    if meant:
        remedy = f"did you mean {' or '.join(meant)}?"
    elif of_problem:
        call = owner.rpartition(".")[2]
        remedy = f"did you mean the field {of_problem[0]}, as in problem.with_({of_problem[0]}=...).{call}(...)?"
    return TypeError(f"{owner}() has no argument {keyword!r}; {remedy}")


def suggestion(keyword: str, known: Collection[str]) -> str:
    """Return the end of an error about an unknown keyword: a question with the names that are meant, or a full stop."""
    meant = _meant(keyword, known) or _near(keyword, known)
    return f": did you mean {' or '.join(meant)}?" if meant else "."


def _meant(keyword: str, known: Collection[str]) -> list[str]:
    return [name for name in known if keyword in _ELSEWHERE.get(name, "").split()]


def _near(keyword: str, known: Collection[str]) -> list[str]:
    """Return a similar name; dt is not similar to t, but tt is."""
    return difflib.get_close_matches(keyword, [x for x in known if len(x) > 1 or keyword.startswith(x)], n=1)


def refuse_unknown(record: type, given: Collection[str]) -> None:
    """Refuse keywords that are not fields of a dataclass."""
    known = [field.name for field in getattr(record, "__dataclass_fields__", {}).values() if field.init]
    for keyword in given:
        if keyword not in known:
            raise refusal(record.__name__, keyword, known)


def with_suggestions(*further: Callable, fields: Collection[str] = ()) -> Callable[[F], F]:
    """Return a decorator for functions, or for classes and their public methods, that suggests the right keyword.

    Parameters
    ----------
    *further : function
        The functions to which the `**options` are passed.
    fields : sequence of str
        The fields of a problem, for its methods: they are suggested for names that no argument has.
    """

    def decorated(public: Any) -> Any:
        if isinstance(public, type):
            for name, method in list(vars(public).items()):
                is_own = inspect.isfunction(method) and not hasattr(method, "__wrapped__")
                if is_own and (name == "__init__" or not name.startswith("_")):
                    setattr(public, name, decorated(method))
            return public

        @functools.wraps(public)
        def call(*args: Any, **keywords: Any) -> Any:
            try:
                return public(*args, **keywords)
            except TypeError as error:
                known, found = _names(public, *further, without=fields), _UNKNOWN.search(str(error))
                refused = [found[1]] if found else keywords.keys() - known if _MISSING.search(str(error)) else []
                unknown = [name for name in keywords if name in refused and name not in known]
                by_position = _positional(public)
                if not unknown and (by_position is None or len(args) <= len(by_position)):
                    raise
            *kind, name = public.__qualname__.split(".")
            owner = [type(args[0]).__name__] if kind else []
            name = re.sub(r"\.__(init|call)__$", "", ".".join([*owner, name]))
            if unknown:
                raise refusal(name, unknown[0], known, fields)
            first = [x for x in by_position or () if x not in _INTERNAL]
            named = next((f", as in {name}(..., {x}=...)" for x in known if x not in first), "")
            taken = f"only {', '.join(first)}" if first else "no argument"
            raise TypeError(f"{name}() takes {taken} by position; give others by name{named}.")

        return call

    return decorated


def _positional(function: Callable) -> list[str] | None:
    """Return the names of the arguments that may be given by position; None if their number has no limit."""
    parameters = inspect.signature(function).parameters.values()
    if any(x.kind is x.VAR_POSITIONAL for x in parameters):
        return None
    return [x.name for x in parameters if x.kind in (x.POSITIONAL_ONLY, x.POSITIONAL_OR_KEYWORD)]


def _names(function: Callable, *further: Callable, without: Collection[str] = ()) -> list[str]:
    """Return the names of the arguments of a function, and of keywords that it passes on, without some names."""
    own, *others = (inspect.signature(f).parameters.values() for f in (function, *further))
    named = [x.name for x in own if x.kind in (x.POSITIONAL_OR_KEYWORD, x.KEYWORD_ONLY)]
    named += [x.name for other in others for x in other if x.kind is x.KEYWORD_ONLY and x.name not in without]
    return [name for name in dict.fromkeys(named) if name not in _INTERNAL]
