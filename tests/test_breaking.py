"""Links that break at a limit, around other laws."""

import numpy as np
import pytest

import eig3
from eig3.effects import BoucWen, Breaking, ElasticPlastic, LeadRubber, LinearDamper, LinearSpring, Maxwell, RigidStop
from eig3.scene import Scene

from .conftest import refusals

OMEGA, BREAK = 10.0, 0.05  # rad/s, m
SPRING = LinearSpring(OMEGA**2, 1.0)


def oscillator(law, speed=1.0, **options):
    """A mass of 1 kg that starts where the link is relaxed."""
    scene = Scene(dimension=1)
    scene.add(law, scene.fixed(0.0), scene.mass(1.0, 1.0, velocity=speed))
    return scene.problem((0, 0.5), **options)


@pytest.mark.parametrize(
    ("limits", "speed"),
    [
        ({"max_stretch": BREAK}, 1.0),
        ({"min_stretch": -BREAK, "max_stretch": 9.0}, -1.0),
        ({"max_force": OMEGA**2 * BREAK}, 1.0),
        ({"max_energy": OMEGA**2 * BREAK**2 / 2}, -1.0),
    ],
)
def test_a_spring_breaks_where_its_limit_is_and_the_mass_flies_on(limits, speed):
    """The stretch is v sin(omega t) / omega; the elastic energy is lost. EIG-3 locates the break to its order."""
    problem = oscillator(Breaking(SPRING, **limits), speed, work=True)
    run = problem.integrate(rtol=1e-10)
    broken = run.events["breaking 0"]
    assert broken.t == pytest.approx([np.arcsin(OMEGA * BREAK) / OMEGA], abs=1e-9)
    v = speed * np.sqrt(1 - (OMEGA * BREAK) ** 2)
    end = 1 + np.sign(speed) * BREAK + v * (0.5 - broken.t[0])
    assert [run.u[-1, 0], run.v[-1, 0]] == pytest.approx([end, v], abs=1e-8)
    assert run.z["work"][-1] == pytest.approx(-((OMEGA * BREAK) ** 2) / 2, rel=1e-8)
    assert run.drift["energy"] < 1e-9
    errors = [abs(problem.integrate(h=h).u[-1, 0] - end) for h in (4e-3, 1e-3)]
    assert errors[1] < errors[0] / 4 ** (2 - 0.4)


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"rtol": 1e-8, "h_max": 0.02}], ids=["h", "rtol"])
def test_members_break_at_their_times(options):
    """In lanes with a fixed step; slow members stay whole."""
    problem = oscillator(Breaking(SPRING, max_stretch=BREAK), work=True)
    speeds = np.array([0.3, 0.49, 0.51, 0.7, 1.0, 1.5])
    members = problem.ensemble(v0=np.column_stack([speeds, 0 * speeds]), save_every=None, **options)
    broken = members.events["breaking 0"]
    assert broken.member.tolist() == [2, 3, 4, 5]
    times = np.arcsin(OMEGA * BREAK / speeds[2:]) / OMEGA
    # near the turn, the time of the weakest break is less certain than its stretch
    np.testing.assert_allclose(broken.t[1:], times[1:], rtol=0, atol=1e-5)
    alone = problem.with_(v0=[speeds[3], 0.0]).integrate(save_every=None, **options)
    np.testing.assert_allclose(members.u[3, -1], alone.u[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(members.z["work"][3, -1], alone.z["work"][-1], rtol=0, atol=1e-12)


def test_a_brace_breaks_by_the_energy_that_it_absorbs(tmp_path):
    """Below a structure, with the state of the law behind its energy; broken, nothing changes."""
    limit, law = 0.8, BoucWen(40.0, 0.05, deltaEta=0.1)
    T = np.linspace(0, 10, 1001)
    force = T, 6 * np.cos(5.6 * T)[:, None]
    links = [(Breaking(law, max_energy=limit), None, 0), (LinearSpring(20.0), None, 0)]
    problem = eig3.linear([1.0], links=links, force=force, t_span=(0, 10), work=True)
    run = problem.integrate(rtol=1e-9)
    (time,) = run.events["breaking 0"].t
    broken, energy, *state = run.z["breaking"].T
    assert len(state) == 2
    assert (broken == (run.t > time)).all() or run.t[np.argmax(broken)] == time
    whole = eig3.linear(
        [1.0], links=[(Breaking(law, max_energy=1e9), None, 0), links[1]], force=force, t_span=(0, time), work=True
    )
    until = whole.integrate(rtol=1e-9)
    absorbed = until.z["absorbed"][-1] - 10 * until.u[-1, 0] ** 2  # the spring stores the rest
    assert absorbed == pytest.approx(limit, rel=1e-6)
    np.testing.assert_allclose(energy[run.t > time], limit, rtol=1e-9)
    assert np.ptp(state[0][run.t > time]) == 0
    assert run.drift["energy"] < 1e-6
    run.save(tmp_path / "run.npz")
    np.testing.assert_array_equal(eig3.load(tmp_path / "run.npz").z["breaking"], run.z["breaking"])


@pytest.mark.parametrize("steps", [{"h": 1e-3}, {"rtol": 1e-8}])
def test_a_damper_breaks_at_an_impact_that_reverses_its_force(steps):
    """It pushed before, and would pull with more than its strength after. The mass then flies on with its speed."""
    scene = Scene(dimension=1)
    ground, mass = scene.fixed(0.0), scene.mass(2.0, 1.0, velocity=-3.0)
    scene.add(Breaking(LinearDamper(4.0), max_force=2.0), ground, mass)
    scene.add(RigidStop(normal=1.0, offset=0.7, restitution=0.5), mass)
    run = scene.problem((0, 1)).integrate(**steps)
    (impact,), (end,) = (run.events[name].t for name in ("rigid stop 0", "breaking 0"))
    assert impact == end
    speed = 0.5 * (3.0 - 4.0 / 2.0 * 0.3)  # the impulse of the damper is 4 N s/m times its way of 0.3 m
    assert run.v[-1, 0] == pytest.approx(speed, abs=1e-5)  # of EIG-3: h^2


def test_a_body_breaks_loose():
    """The state with a rate changes at an event beside a rigid body; the link is Maxwell's with a break."""
    scene = Scene(dimension=2)
    body = scene.body(1.0, 0.1, [1.0, 0.0], velocity=[0.5, 0.0])
    body.prismatic(None, [1.0, 0.0], [1.0, 0.0])
    law = Breaking(Maxwell(30.0, 10.0), max_energy=0.05)
    scene.add(law, scene.fixed([0.0, 0.0]), body.at([1.0, 0.0]))
    run = scene.problem((0, 2)).integrate(rtol=1e-9, invariants={})
    (time,) = run.events["breaking 0"].t
    speed = np.sqrt(0.5**2 - 2 * 0.05)  # by the energy
    late = run.t > time
    assert late.any()
    np.testing.assert_allclose(run.v[late, 0], speed, rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.z["breaking"][late, :2], [[1.0, 0.05]] * late.sum(), rtol=1e-9)


def one_of_two():
    links = [(Breaking(SPRING, min_stretch=-1.1), [0, 1], [1, None])]
    eig3.linear([1.0, 1.0], links=links, u0=[0, 0.2], t_span=(0, 1))


def pulled_later():
    links = [(Breaking(SPRING, max_stretch=0.5), None, 0)]
    eig3.linear([1.0], links=links, t_span=(0, 1)).with_(u0=[1.6]).integrate(h=0.01)


test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        "max_force of Breaking must be positive": lambda: Breaking(SPRING, max_force=-1.0),
        "law of Breaking must act along one line": lambda: Breaking(LeadRubber(1.0, 1.0, 0.1), max_force=1.0),
        "min_stretch of Breaking must be negative": lambda: Breaking(SPRING, min_stretch=1.0),
        "Breaking is broken at the start: link 0": lambda: oscillator(Breaking(LinearSpring(9.0, 0.5), max_force=4.0)),
        "Breaking is broken at the start: link 1": one_of_two,
        "law of Breaking must be whole at the start, but the start lies behind 'breaking 0'": pulled_later,
    },
    {
        "Breaking must have a limit: give max_stretch, min_stretch, max_force or max_energy": lambda: Breaking(SPRING),
        "law of Breaking must have no event": lambda: Breaking(ElasticPlastic(1.0, 1.0), max_stretch=1.0),
        "law of Breaking must be a link of eig3.effects, not 3.0": lambda: Breaking(3.0, max_force=1.0),
    },
)
