"""Events in lanes with fixed steps: occurrences, resets, ends and extremes are those of single runs."""

import numpy as np
import pytest

import eig3
from eig3.effects import Cable, ElasticPlastic, LeadRubber

from .conftest import position

MEMBERS = 0, 7, 39
K = np.linspace(0.5, 4, 40)[:, None]
STEPS = {"one step": 0.01, "steps": np.linspace(0.008, 0.012, 40)}

spring = eig3.jit(lambda t, u, v, p: -p[0] * u - 0.1 * v)


@eig3.jit
def two_springs(t, u, v, p, a):
    a[0] = -p[0] * u[0] + 0.3 * u[1]
    a[1] = -2 * u[1] - 0.1 * v[1]


wall = eig3.jit(lambda t, u, v, p: u - 0.3)
rebound = eig3.jit(lambda t, u, v, p: (u, -0.8 * v))
speed = eig3.jit(lambda t, u, v, p: v - 0.7)
first = eig3.jit(lambda t, u, v, p: u[0] - 0.3)


@eig3.jit
def turn(t, u, v, p):
    v[0] = -0.8 * v[0]


EVENTS = {
    "passed": {"wall": eig3.Event(wall)},
    "one way": {"wall": eig3.Event(wall, direction=1)},
    "reset": {"wall": eig3.Event(wall, direction=1, apply=rebound)},
    "two": {"wall": eig3.Event(wall, apply=rebound), "end": eig3.Event(speed, terminal=True)},
}


def assert_members_are_single_runs(members, single):
    """The sums of lanes round in another way. An impact changes the time of the next one by about this difference."""
    for i in MEMBERS:
        mine, alone = members[i], single(i)
        assert (mine.status, mine.n_steps, mine.n_rhs) == (alone.status, alone.n_steps, alone.n_rhs)
        for name in ("t", "u", "v"):
            np.testing.assert_allclose(getattr(mine, name), getattr(alone, name), rtol=0, atol=1e-9)
        for name, found in alone.events.items():
            for field in ("t", "u", "v", "u_after", "v_after"):
                ours, theirs = (getattr(x, field) for x in (mine.events[name], found))
                np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)
        for name, extremes in alone.extremes.items():
            for field in ("low", "high", "t_low", "t_high"):
                ours, theirs = (getattr(x, field) for x in (mine.extremes[name], extremes))
                np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 if field in ("low", "high") else 1e-6)
            np.testing.assert_allclose(mine.outputs[name], alone.outputs[name], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("method", "events", "h"),
    [("eig3", "reset", "one step")]
    + [("eig3", events, "steps") for events in EVENTS]
    + [("ab3", "passed", "one step"), ("ab3", "reset", "steps")],
)
def test_events_of_one_degree_of_freedom(method, events, h):
    """After a reset, a member of AB3 runs alone: the lanes do not take the steps of its starter again."""
    options = {"method": method, "events": EVENTS[events], "outputs": {"u": position}, "save_every": 7}
    members = eig3.ensemble(spring, (0, 20), 1.0, 0.0, h=STEPS[h], params=K, **options)
    assert members.notes == ()
    assert sum(map(len, members.events.values())) > 100
    own = np.broadcast_to(STEPS[h], 40)
    assert_members_are_single_runs(
        members, lambda i: eig3.integrate(spring, (0, 20), 1.0, 0.0, h=own[i], params=K[i], **options)
    )


pushed_later = eig3.jit(lambda t, u, v, p: (10.0 if 0.5 < t < 0.6 else 0.0) - p[0] * u - 0.1 * v)


def test_a_function_that_stays_at_its_zero_is_looked_at_when_it_leaves_it():
    """At rest until the push, then about ten zeros of a free oscillation."""
    options = {"h": 0.01, "events": {"zero": eig3.Event(position)}, "outputs": {"u": position}, "save_every": 7}
    members = eig3.ensemble(pushed_later, (0, 20), 0.0, 0.0, params=K, **options)
    assert members.notes == ()
    assert np.bincount(members.events["zero"].member).min() >= 4
    assert_members_are_single_runs(
        members, lambda i: eig3.integrate(pushed_later, (0, 20), 0.0, 0.0, params=K[i], **options)
    )


@pytest.mark.parametrize("h", STEPS.values(), ids=STEPS)
def test_resets_of_two_degrees_of_freedom(h):
    options = {"events": {"wall": eig3.Event(first, apply=turn)}, "save_every": 3}
    members = eig3.ensemble(two_springs, (0, 10), [1.0, 0.2], [0.0, 0.0], h=h, params=K, **options)
    own = np.broadcast_to(h, 40)
    assert_members_are_single_runs(
        members,
        lambda i: eig3.integrate(two_springs, (0, 10), [1.0, 0.2], [0.0, 0.0], h=own[i], params=K[i], **options),
    )


T = np.linspace(0, 4, 81)
#: States without events, states that events reset, and events that only look
LINKS = [
    (LeadRubber(2.0, 0.5, 0.05), (0, 1), None),
    (ElasticPlastic(40.0, 0.5, 0.1), [0, 1], [1, 2]),
    (Cable(40.0, 0.005), [0, 1], [1, 2]),
]
STOREYS = eig3.linear(
    np.ones(3), None, 40 * np.eye(3), ground=(T, np.sin(5 * T), [1, 0.5, 0]), links=LINKS, t_span=(0, 4)
)


def test_links_with_events_run_in_lanes():
    """All events of one kind of links are values of one function, written line by line."""
    scales = np.linspace(0.3, 3, 40)
    options = {"h": 0.01, "save_every": 10}
    members = STOREYS.ensemble(params={"ground_scale": scales}, **options)
    assert members.notes == ()
    assert min(map(len, members.events.values())) > 100
    assert_members_are_single_runs(
        members, lambda i: STOREYS.with_(params=STOREYS.params._replace(ground_scale=scales[i])).integrate(**options)
    )


def test_links_of_members_with_the_same_parameters():
    v0 = np.multiply.outer(np.linspace(0, 1, 40), [1.0, 0.0, 0.0])
    members = STOREYS.ensemble(h=0.01, v0=v0, save_every=10)
    assert members.notes == ()
    assert_members_are_single_runs(members, lambda i: STOREYS.with_(v0=v0[i]).integrate(h=0.01, save_every=10))


def test_a_full_log_is_emptied():
    """There is one occurrence in each step, so that the log of the block is full after some steps."""
    often = eig3.jit(lambda t, u, v, p: np.sin(np.pi * t / 0.01 + 0.5))
    members = eig3.ensemble(
        spring, (0, 10), 1.0, 0.0, h=0.01, params=K, events={"often": eig3.Event(often)}, save_every=None
    )
    found = members.events["often"]
    np.testing.assert_array_equal(np.bincount(found.member), np.full(40, 1000))
    exact = (np.arange(1, 1001) - 0.5 / np.pi) * 0.01
    np.testing.assert_allclose(found.t.reshape(40, 1000), np.broadcast_to(exact, (40, 1000)), rtol=0, atol=1e-11)


def test_members_that_diverge_keep_their_events():
    params = np.r_[np.linspace(0.5, 4, 30), np.full(10, 9e4)][:, None]  # h omega = 3: beyond the limit of the method
    events = {"wall": eig3.Event(wall, direction=1, apply=rebound)}
    members = eig3.ensemble(spring, (0, 20), 1.0, 0.0, h=0.01, params=params, events=events, save_every=None)
    for i in (0, 29, 35):
        alone = eig3.integrate(spring, (0, 20), 1.0, 0.0, h=0.01, params=params[i], events=events, save_every=None)
        assert members.status[i] is alone.status
        first = slice(100)  # later, the states grow until they overflow, and so does their round-off
        np.testing.assert_allclose(members[i].events["wall"].t[first], alone.events["wall"].t[first], rtol=0, atol=1e-9)
