"""Errors for unknown keywords name the argument that is meant, also by its name in other codes."""

import dataclasses
import inspect
import pickle
import re

import numpy as np
import pytest

import eig3
from eig3 import effects, problems
from eig3.keywords import _ELSEWHERE
from eig3.scene import RigidBody, Scene

from .conftest import spring

ELSEWHERE = {
    "LAMMPS's epsilon": (effects.LennardJones, "eps", "epsilon"),
    "exudyn's referenceLength": (effects.LinearSpring, "referenceLength", "rest_length"),
    "MuJoCo's frictionloss": (Scene(2).body(1.0, 1.0, (0.0, 0.0)).friction, "frictionloss", "limit"),
    "HOOMD's kT": (eig3.Langevin, "kT", "temperature"),
    "LAMMPS's damp": (eig3.Langevin, "damp", "gamma"),
    "an earlier name": (effects.LennardJones, "depth", "epsilon"),
    "LAMMPS's D0": (effects.Morse, "D0", "D"),
    "LAMMPS's alpha": (effects.Morse, "alpha", "a"),
    "HOOMD's cutoff": (effects.Coulomb, "r_cut", "cutoff"),
    "a stiffness": (effects.LinearSpring, "k", "stiffness"),
    "OpenMM's length": (effects.LinearSpring, "length", "rest_length"),
    "MuJoCo's springlength": (effects.Cable, "springlength", "rest_length"),
    "LAMMPS's coefficient of restitution": (effects.HertzMindlin, "coeff_restitution", "restitution"),
    "a coefficient of friction": (effects.HertzMindlin, "mu", "friction"),
    "another coefficient of friction": (effects.CoulombFriction, "friction", "mu"),
    "two meanings": (effects.HertzMindlin, "radius", "radii or wall_radius"),
    "the article's S2": (effects.HardeningSpring, "S2", "cubic"),
    "a slip of the pen": (effects.PlaneContact, "stifness", "stiffness"),
    "OpenMM's theta0": (effects.HarmonicAngle, "theta0", "angle"),
    "a method": (eig3.EIG3, "aplha", "alpha"),
    "SciPy's step": (problems.kepler().integrate, "max_step", "h_max"),
    "SciPy's tolerance": (problems.kepler().prepare, "reltol", "rtol"),
    "an option of the problem": (problems.kepler().integrate, "t_ends", "t_end"),
    "an accuracy of the problem": (problems.kepler().integrate, "acuracy", "accuracy"),
    "threads": (problems.kepler().ensemble, "n_threads", "threads"),
    "a near group": (Scene(2).add, "near", "others"),
    "a spin": (Scene(2).mass, "spin", "angular_velocity"),
    "a box": (Scene, "boxes", "box"),
    "a problem": (problems.spinning_top, "tilts", "tilt"),
    "a step": (problems.kepler().stepper, "dt", "h"),
    "a stepper": (eig3.Stepper, "dt", "h"),
    "steps": (problems.kepler().stepper(h=0.1).advance, "counts", "count"),
    "displacements": (Scene(2).mass(1.0, (0.0, 0.0)).positions, "uu", "u"),
    "MATLAB's tolerance": (problems.kepler().integrate, "RelTol", "rtol"),
    "MATLAB's longest step": (problems.kepler().ensemble, "MaxStep", "h_max"),
    "diffrax's times": (problems.kepler().prepare, "ts", "t_eval"),
    "diffrax's first step": (problems.kepler().integrate, "dt0", "h or first_step"),
    "an end": (problems.kepler().ensemble, "t1", "t_end"),
    "members": (problems.kepler().ensemble, "x0", "u0"),
    "workers": (problems.kepler().ensemble, "n_jobs", "threads"),
    "a joint": (Scene(2).body(1.0, 1.0, (0.0, 0.0)).revolute, "pos", "position"),
}


@pytest.mark.parametrize(("called", "given", "meant"), ELSEWHERE.values(), ids=ELSEWHERE)
def test_the_argument_that_is_meant(called, given, meant):
    owner = getattr(called, "__self__", None)
    name = called.__name__ if owner is None else f"{type(owner).__name__}.{called.__name__}"
    with pytest.raises(TypeError) as caught:
        called(**{given: 1.0})
    assert str(caught.value) == f"{name}() has no argument {given!r}; did you mean {meant}?"


def test_without_a_near_one_all_arguments_are_named():
    with pytest.raises(TypeError) as caught:
        effects.LinearSpring(colour="red")
    assert str(caught.value) == "LinearSpring() has no argument 'colour'; its arguments are stiffness, rest_length."
    with pytest.raises(TypeError, match=r"integrate\(\) has no argument 'dt'; did you mean h\?"):
        eig3.integrate(None, (0.0, 1.0), 1.0, 0.0, dt=0.1)


RUN = (None, (0.0, 1.0), 1.0, 0.0)
CLASSICAL = {
    "integrate": (
        lambda **given: eig3.integrate(*RUN, **given),
        {"dt": "h", "tol": "rtol or accuracy", "t0": "t_span"},
    ),
    "ensemble": (lambda **given: eig3.ensemble(*RUN, **given), {"step": "h", "p": "params", "v": "v0", "tf": "t_span"}),
    "prepare": (lambda **given: eig3.prepare(None, **given), {"dt": "h", "dt_max": "h or h_max", "saveat": "t_eval"}),
    "plan": (
        lambda **given: eig3.plan(None, 1e-3, **given),
        {"tol": "accuracy", "rtol": "accuracy", "solver": "methods"},
    ),
    "fit": (lambda **given: eig3.fit(None, None, **given), {"dt": "h", "x0": "parameters", "p0": "parameters"}),
    "report": (lambda **given: eig3.report(None, **given), {"accuracy": "accuracies"}),
}


@pytest.mark.parametrize(("called", "meant"), CLASSICAL.values(), ids=CLASSICAL)
def test_classical_names_of_the_arguments_of_runs(called, meant):
    for given, wanted in meant.items():
        with pytest.raises(TypeError, match=rf"\(\) has no argument '{given}'; did you mean {wanted}\?$"):
            called(**{given: 1.0})


@pytest.mark.parametrize("call", ["integrate", "prepare", "ensemble", "stepper"])
def test_classical_names_of_the_fields_of_a_problem(call):
    names = {"tspan": "t_span", "t0": "t_span"}
    if call != "ensemble":
        names |= {"x0": "u0", "args": "params"}
    for given, field in names.items():
        with pytest.raises(TypeError, match=rf"the field {field}.*problem\.with_\({field}=\.\.\.\)\.{call}\("):
            getattr(problems.kepler(), call)(**{given: 1.0, "h": 0.1})
    with pytest.raises(TypeError, match=r"^with_ can change name, .*, but not dt: did you mean h\?$"):
        problems.kepler().with_(dt=0.1)


def test_a_name_of_one_letter_is_similar_if_the_keyword_begins_with_it():
    with pytest.raises(
        TypeError, match=r"critical_step\(\) has no argument 'dt'; its arguments are method, t, safety\."
    ):
        problems.kepler().critical_step(dt=0.1)


def test_the_public_names_are_listed_and_no_others():
    names = dir(eig3)
    assert sorted(eig3.__all__) == names
    assert all(getattr(eig3, name) is not None for name in names)
    assert not {"Any", "importlib", "keywords", "functions", "np"} & {*names}


def test_a_prepared_run_and_a_problem_answer_too():
    with pytest.raises(TypeError) as caught:
        problems.kepler().prepare(h=0.1)(tspan=(0.0, 1.0))
    assert str(caught.value) == "Prepared() has no argument 'tspan'; did you mean t_span?"
    with pytest.raises(TypeError, match=r"missing 1 required keyword-only argument: 'h'"):
        problems.kepler().stepper(method="rk4")
    solution = eig3.integrate(spring, (0, 1), 1.0, 0.0, h=0.5, params=1.0)
    with pytest.raises(TypeError, match=r"^Solution\.extend\(\) has no argument 'method'; its arguments are t_end, "):
        solution.extend(2.0, method="cd")
    for name in problems.__all__:
        build = getattr(problems, name)
        assert pickle.loads(pickle.dumps(build)) is build
        with pytest.raises(TypeError, match=rf"{name}\(\) has no argument 't_ends'; did you mean t_end\?"):
            build(t_ends=1.0)


def test_an_error_within_the_call_is_not_about_its_keywords():
    def reduce(part):
        return (lambda each: each)(part, h=0.1)

    with pytest.raises(TypeError, match=r"lambda.*got an unexpected keyword argument 'h'$"):
        eig3.ensemble(spring, (0, 1), np.ones(2), 0.0, h=0.1, params=1.0, reduce=reduce)


def test_too_many_arguments_by_position_are_refused_in_a_sentence():
    problem = eig3.problems.single_dof()
    for call, sentence in [
        (lambda: eig3.integrate(spring, (0, 1), 1.0, 0.0, 0.1), "integrate() takes only rhs, t_span, u0, v0 by "),
        (lambda: problem.integrate(0.1), "Problem.integrate() takes no argument by position; give others by name, as "),
        (lambda: eig3.Stepper(spring, 1.0, 0.0, 0.1), "Stepper() takes only rhs, u0, v0 by position; "),
        (lambda: eig3.prepare(spring, (0, 1)), "prepare() takes only rhs by position; give others by name, as in "),
        (lambda: problem.with_(0.1), "Problem.with_() takes no argument by position; give others by name."),
    ]:
        with pytest.raises(TypeError, match=f"^{re.escape(sentence)}"):
            call()


def test_errors_from_inside_stay():
    """Also those of a function of the user that has no argument of this name."""

    def motion(t):
        return inner(t, speed=1.0)

    def inner(t):
        return t

    with pytest.raises(TypeError, match="unexpected keyword argument 'speed'"):
        motion(0.0)
    with pytest.raises(TypeError, match="rhs must be"):
        eig3.integrate(len, (0.0, 1.0), 1.0, 0.0, h=0.1)


def test_other_codes_have_names_for_what_is_there():
    """No row of the table is left over when a name changes."""
    records = [x for x in vars(effects).values() if inspect.isclass(x) and dataclasses.is_dataclass(x)]
    functions = [
        eig3.integrate, eig3.ensemble, eig3.plan, eig3.fit, eig3.Problem.integrate, Scene.add, Scene.mass,
        Scene.body, Scene.add_mesh, RigidBody.friction, eig3.Langevin
    ]  # fmt: skip
    known = {field.name for record in records for field in dataclasses.fields(record)}
    known |= {name for function in functions for name in inspect.signature(function).parameters}
    assert _ELSEWHERE.keys() <= known


def test_signatures_and_names_are_those_of_the_functions():
    assert next(iter(inspect.signature(eig3.integrate).parameters)) == "rhs"
    assert "neighbor_capacity" in inspect.signature(Scene.add).parameters
    assert Scene.add.__name__ == "add"
    assert np.ndim(Scene(2).mass(1.0, (0.0, 0.0)).position) == 1
