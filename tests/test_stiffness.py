"""Notes about stiff motions: stability, and not the tolerance, decides about the steps."""

import functools
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eig3
from eig3 import Status
from eig3.diagnosis.stiffness import stiffness
from eig3.stability import limit

SPAN = 0, 20

van_der_pol = eig3.jit(lambda t, u, v, p: p[0] * (1 - u * u) * v - u)


@eig3.jit
def creep(t, u, v, p, a):
    """A chain whose first mass hangs in a strong damper."""
    for j in range(u.size):
        left, right = u[j - 1] if j else 0.0, u[j + 1] if j < u.size - 1 else 0.0
        a[j] = left - 2 * u[j] + right
    a[0] -= p[0] * v[0]


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("rk5", {}),
        ("rk5", {"save_every": None}),
        ("rk5", {"t_eval": np.linspace(*SPAN, 50)}),
        ("rk8", {}),
        ("eig3", {}),
    ],
)
def test_a_stiff_motion_gets_a_note(method, options):
    solution = eig3.integrate(van_der_pol, SPAN, 2.0, 0.0, params=1000.0, rtol=1e-6, method=method, **options)
    (note,) = solution.notes
    assert note.startswith("The motion is stiff: in ")
    assert re.search(r"decay at a rate of (2\.9e\+03|3e\+03)", note)
    assert solution.explain().endswith(note)


def test_the_call_that_the_note_names_takes_few_steps():
    (note,) = eig3.integrate(van_der_pol, SPAN, 2.0, 0.0, params=1000.0, rtol=1e-6).notes
    names = {"rhs": van_der_pol, "p": np.array([1000.0]), "t_span": SPAN, "u0": 2.0, "v0": 0.0, "solve_ivp": solve_ivp}
    call = note[note.index("solve_ivp(") : note.rindex(".")]
    assert eval(call, names).t.size < 100


def test_many_degrees_of_freedom_and_a_run_that_ends_early():
    start = np.linspace(0.1, 1, 100)
    solution = eig3.integrate(creep, (0, 1e4), start, 0 * start, params=1e4, rtol=1e-6, max_steps=3000, save_every=10)
    assert solution.status is Status.TOO_MANY_STEPS
    assert "The motion is stiff" in solution.explain()
    assert "solve_ivp(fun, t_span, [*u0, *v0]" in solution.explain()


@pytest.mark.parametrize(
    ("build", "t_end", "method"),
    [
        ("van_der_pol", 1000, "rk5"),
        ("duffing", 1000, "eig3"),
        ("double_pendulum", 300, "rk5"),
        ("quarter_car", 5, "rk5"),
        ("spinning_top", 50, "rk5"),
    ],
)
def test_no_note_about_other_motions(build, t_end, method):
    problem = getattr(eig3.problems, build)(t_end=t_end)
    solution = problem.integrate(rtol=1e-6, method=method, save_every=10, invariants={})
    assert solution.n_steps > 2000
    assert not any("stiff" in note for note in solution.notes)


def test_a_mode_is_stiff_if_it_decays_within_its_period_and_a_little_longer_step_lets_it_grow():
    """In most states. The step may be longer by a quarter, and a mode may have a damping ratio of up to 0.7."""

    def note(xi, parts):
        def oscillator(t, u, v):
            return -u - 2 * xi * v

        states = [(0.0, 1.0, 0.5, part * limit("rk4", xi)) for part in parts]
        return stiffness(eig3.RK4(), oscillator, states, "accuracy")

    assert "in 4 of 4 states" in note(0.8, [0.95] * 4)
    assert not note(0.6, [0.95] * 4)
    assert not note(0.8, [0.75] * 4)
    assert "in 3 of 4 states" in note(0.8, [0.95, 0.95, 0.95, 0.1])
    assert not note(0.8, [0.95, 0.95, 0.1, 0.1])


@eig3.jit
def pair(t, u, v, p, a):
    """Masses of 1 and 2, each with a weak spring, which a strong spring joins."""
    pull = 1e8 * (u[0] - u[1])
    a[0], a[1] = -u[0] - pull, (-u[1] + pull) / 2


@pytest.mark.parametrize(("method", "rtol"), [("rk5", 1e-4), ("rk8", 1e-6), ("rkn12", 1e-8)])
def test_a_vibration_that_limits_the_steps_of_a_slow_motion_has_a_note(method, rtol):
    """Its omega is 1.2e4, and the motion's sqrt(2 / 3). EIG-3 with the named step is right to about h^2, and to the
    elasticity, 1e-8. The vibration alone has no note: it is not slow.
    """
    run = functools.partial(eig3.integrate, pair, (0, 10), v0=[0.0, 0.0], save_every=100)
    slow = run(u0=[1.0, 1.0], rtol=rtol, method=method)
    h, part = re.search(r"omega = 1.22e\+04, .* step h = (\S+) takes 1/(\d+) of the", slow.notes[0]).groups()
    fixed = run(u0=[1.0, 1.0], h=float(h))
    np.testing.assert_allclose(fixed.u[-1], np.cos(10 * np.sqrt(2 / 3)), rtol=0, atol=1e-6)
    assert int(part) * fixed.n_rhs == pytest.approx(slow.n_rhs, rel=0.15)  # the note has few digits, and a median step
    assert not run(u0=[1.0, -1.0], rtol=rtol, method=method).notes


def test_a_plan_says_that_the_motion_is_stiff():
    plan = eig3.plan(eig3.problems.van_der_pol(mu=1000.0, t_end=20), 1e-3, methods=["eig3"])
    assert "stability limits the step of EIG-3 and the accuracy does not" in str(plan)
    steps = re.search(r"It takes about (.*) steps and .* s, with rtol=0.001.", str(plan))
    y0 = (plan.problem.u0, plan.problem.v0)
    mu = plan.problem.params[0]
    radau = solve_ivp(
        lambda t, y: (y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]), (0, 20), y0, method="Radau", rtol=1e-3, atol=2e-3
    )
    assert float(steps[1]) == pytest.approx(radau.t.size - 1, rel=0.1)  # it is printed with two digits
    assert not eig3.plan(eig3.problems.duffing(), 1e-6, methods=["eig3"]).elsewhere
