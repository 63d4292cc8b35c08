"""`Problem`: changed copies, and options that belong to the problem."""

import numpy as np
import pytest

import eig3
from eig3 import problems

from .conftest import assert_same, first_position, spring


@eig3.jit
def springs(t, u, v, p, a):
    a[0], a[1] = -p[0] * u[0], -p[1] * u[1]


def test_a_changed_copy_runs_with_the_changes():
    problem = problems.spring_pendulum()
    other = problem.with_(u0=[0.6, 0.1], t_span=(1.0, 2.0), name="short")
    assert (other.name, other.t_span) == ("short", (1.0, 2.0))
    solution = other.integrate(h=1e-3)
    assert solution.t[[0, -1]].tolist() == [1.0, 2.0]
    assert solution.u[0].tolist() == [0.6, 0.1]
    options = {"h": 1e-3, "params": problem.params, "method": "eig3"}
    direct = eig3.integrate(problem.rhs, (1.0, 2.0), [0.6, 0.1], problem.v0, **options)
    np.testing.assert_array_equal(solution.u, direct.u)
    assert problem.u0 is not other.u0
    assert problem.name == "spring_pendulum"


def test_changed_parameters_reach_rhs_and_energy():
    problem = problems.hardening_spring()
    double = problem.with_(params=2 * np.asarray(problem.params))
    assert double.energy_of(1.0, 0.0) != problem.energy_of(1.0, 0.0)
    assert double.integrate(h=1e-3).u[-1] != problem.integrate(h=1e-3).u[-1]


def test_states_of_another_problem_have_no_energy_here():
    problem = problems.kepler()
    for u, v in ((np.ones(3), np.ones(3)), (np.ones((5, 2)), np.ones((4, 2))), (1.0, 1.0)):
        with pytest.raises(ValueError, match=r"^u and v must have the shape \(2,\) of u0, or a first axis of states "):
            problem.energy_of(u, v)


def test_what_holds_for_one_start_is_dropped_with_it():
    problem = problems.single_dof()
    later = problem.with_(t_span=(problem.t_span[0] + 1, problem.t_span[1] + 1))
    stiffer = problem.with_(params=2 * np.asarray(problem.params))
    assert problem.exact
    for copy in (problem.with_(u0=2.0), problem.with_(v0=2.0), stiffer, later, later.with_(u0=2.0)):
        assert not copy.exact
        with pytest.raises(ValueError, match=r"^the exact motion of single_dof is known for its own start"):
            copy.exact(1.0)
    bar = problems.elastic_bar()
    assert bar.continuum is not None
    assert bar.with_(u0=2 * np.asarray(bar.u0)).continuum is None


def test_what_still_holds_is_kept():
    problem = problems.single_dof()
    longer = problem.with_(t_span=(problem.t_span[0], 2 * problem.t_span[1]), name="long", u0=problem.u0)
    assert longer.exact is problem.exact
    assert longer.energy is problem.energy
    assert problem.with_(u0=2.0, exact=np.sin).exact is np.sin
    road = problems.quarter_car()
    assert road.with_(u0=road.u0 + 0.1).draw is road.draw
    assert road.with_(params=road.params * 1.01).draw is None  # it draws constants of the problem


def test_a_copy_with_work_follows_the_work():
    problem = problems.rail_joint(t_end=0.01, work=True)
    moved = problem.with_(v0=problem.v0 + 0.1).integrate(h=problem.h, save_every=None)
    assert set(moved.z) == {"work"}
    assert moved.u.shape == (2, 4)


@pytest.mark.parametrize("field", ["u0", "v0", "params", "t_span"])
@pytest.mark.parametrize("call", ["integrate", "stepper"])
def test_fields_are_no_options_of_a_run(call, field):
    problem = problems.spring_pendulum()
    with pytest.raises(
        TypeError, match=rf"{field} is a field of the problem: call problem.with_\({field}=...\).{call}"
    ):
        getattr(problem, call)(h=1e-3, **{field: (0.0, 1.0)})


BAD = {
    "shape": ({"u0": [1.0, 2.0, 3.0]}, ValueError, r"u0 must keep its shape \(2,\) in spring_pendulum, not have"),
    "number": ({"v0": 1.0}, ValueError, r"v0 must keep its shape \(2,\)"),
    "short params": ({"params": [1.0]}, ValueError, r"params must keep its shape \(4,\)"),
    "NaN": ({"u0": [1.0, np.nan]}, ValueError, "u0 must be finite"),
    "text": ({"v0": "fast"}, TypeError, "v0 must be made of real numbers"),
    "span": ({"t_span": (1.0, 0.0)}, ValueError, "t_span must end after it starts"),
    "rhs": ({"rhs": None}, TypeError, "with_ can change name, u0, .*, but not rhs"),
    "unknown": ({"step": 1.0}, TypeError, "with_ can change name, u0, .*, but not step"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_change_raises_an_error_of_one_sentence(name):
    changes, error, sentence = BAD[name]
    with pytest.raises(error, match=sentence):
        problems.spring_pendulum().with_(**changes)


def test_a_stepper_refuses_events_that_change_the_motion():
    ball = problems.bouncing_ball()
    with pytest.raises(ValueError, match="bouncing_ball has events that change or end its motion"):
        ball.stepper(h=0.01)
    falling = ball.with_(events={}).stepper(h=0.01)
    falling.advance(100)
    assert falling.u == pytest.approx(1 - 9.81 / 2)


def test_arrays_that_change_later_do_not_matter():
    """Those of the caller: the problem and its runs have their own."""
    given = {"u0": np.array([0.6, 0.1]), "v0": [0.0, 0.5], "params": np.array([4.0, 9.0]), "t_span": [0.0, 1.0]}
    given |= {"events": {"low": eig3.Event(first_position)}, "outputs": {"height": first_position}}
    problem = eig3.Problem("springs", springs, **given)
    run, before = problem.prepare(h=0.01), problem.integrate(h=0.01)
    for name in ("u0", "v0", "params", "t_span"):
        given[name][1] *= 3
    given["events"].clear()
    given["outputs"].clear()
    for each in (run(), problem.integrate(h=0.01), problem.with_(name="other").integrate(h=0.01)):
        assert_same(each, before)
        assert list(each.events) == ["low"]
    assert list(problem.outputs) == ["height"]


@pytest.mark.parametrize("name", ["kepler", "spring_pendulum", "elastic_bar"])
def test_the_start_of_a_vector_problem_is_an_array(name):
    problem = getattr(problems, name)()
    for each in (problem, problem.with_(u0=[*problem.u0])):
        assert type(each.u0) is type(each.v0) is np.ndarray


def test_the_start_of_a_scalar_problem_is_a_number():
    problem = eig3.Problem("oscillator", spring, 1, np.array(0.0), 4, [0, 1])
    for each in (problem, problem.with_(u0=2)):
        assert type(each.u0) is type(each.v0) is float


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("h", -1, r"^h must be a positive, finite number"),
        ("events", {"impact": spring}, r"^events\['impact'\] must be an eig3\.Event, not "),
        ("events", [spring], r"^events must be a dictionary of names and events"),
        ("masses", [1.0], r"^masses must have a positive number for each of 2 degrees of freedom, not \[1\.0\]\."),
        ("masses", [1.0, -1.0], r"^masses must have a positive number for each of 2 degrees of freedom"),
        ("names", ("x",), r"^names must have a text for each of 2 degrees of freedom, not \('x',\)\."),
        ("names", "xy", r"^names must have a text for each of 2 degrees of freedom, not 'xy'\."),
        ("units", ("m",), r"^units must have a text for each of 2 degrees of freedom, not \('m',\)\."),
        ("output_units", "N", r"^output_units must be a dictionary such as \{'force': 'N'\}, not 'N'\."),
    ],
)
def test_a_field_that_no_run_could_use_is_refused_at_once(field, value, message):
    given = {"name": "springs", "rhs": springs, "u0": [1.0, 0.0], "v0": [0.0, 0.0], "params": [1.0, 2.0]}
    with pytest.raises((TypeError, ValueError), match=message):
        eig3.Problem(**given, t_span=(0.0, 1.0), **{field: value})
