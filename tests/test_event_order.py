"""Random sets of events with resets at the ends of steps, simultaneous ones, and ones that only look.

Bodies under constant accelerations fly on parabolas. `fly` finds the events of such flights from the roots of these, in
plain Python. Every method is exact here, so that only round-off remains. All numbers of a case are multiples of 1/16:
many events are at the ends of steps or at the same time, without round-off.
"""

import itertools
import math

import numpy as np
import pytest

import eig3
from eig3 import Event

END, STEP = 3.0, 1 / 16
NEAR = 1e-9  # events within this time are simultaneous
UNCLEAR = 1e-5  # events that are less apart than this, and no closer than NEAR, may have any order

#: The parameters: the acceleration of each body, then the levels, times and factors of the events.
GRAVITY, FLOOR, REBOUND, KICK_TIME, KICK, MARK, GATE, FACTOR, CLOCK = 0, 2, 3, 4, 5, 6, 7, 8, 9

fall = eig3.jit(lambda t, u, v, p: p[0])


@eig3.jit
def falls(t, u, v, p, a):
    a[0], a[1] = p[0], p[1]


def _both_forms(scalar_g, vector_g, scalar_apply=None, vector_apply=None):
    compiled = [eig3.jit(f) if f else None for f in (scalar_g, scalar_apply, vector_g, vector_apply)]
    return compiled[:2], compiled[2:]


def _bounce_first(t, u, v, p):
    u[0], v[0] = p[2], -p[3] * v[0]


def _kick_first(t, u, v, p):
    v[0] += p[5]


def _through_gate(t, u, v, p):
    v[0] *= p[8]


#: The two forms of each event, (g, apply). The events of the vector form watch the first of two bodies.
FORMS = {
    "floor": _both_forms(
        lambda t, u, v, p: u - p[2], lambda t, u, v, p: u[0] - p[2], lambda t, u, v, p: (p[2], -p[3] * v), _bounce_first
    ),
    "kick": _both_forms(
        lambda t, u, v, p: t - p[4], lambda t, u, v, p: t - p[4], lambda t, u, v, p: (u, v + p[5]), _kick_first
    ),
    "mark": _both_forms(lambda t, u, v, p: u - p[6], lambda t, u, v, p: u[0] - p[6]),
    "gate": _both_forms(
        lambda t, u, v, p: u - p[7], lambda t, u, v, p: u[0] - p[7], lambda t, u, v, p: (u, p[8] * v), _through_gate
    ),
    "clock": _both_forms(lambda t, u, v, p: t - p[9], lambda t, u, v, p: t - p[9]),
    "turn": _both_forms(lambda t, u, v, p: v, lambda t, u, v, p: v[0]),
    "copy": _both_forms(lambda t, u, v, p: p[2] - u, lambda t, u, v, p: p[2] - u[0]),  # looks at the floor
}


class UnclearError(Exception):
    """Round-off decides what happens."""


def _g(name, t, u, v, a, p):
    """Return g and its first two derivatives at one time of a flight."""
    values = {
        "floor": (u - p[FLOOR], v, a),
        "kick": (t - p[KICK_TIME], 1.0, 0.0),
        "mark": (u - p[MARK], v, a),
        "gate": (u - p[GATE], v, a),
        "clock": (t - p[CLOCK], 1.0, 0.0),
        "turn": (v, a, 0.0),
        "copy": (p[FLOOR] - u, -v, -a),
    }
    return values[name]


def _apply(name, u, v, p):
    return {"floor": (p[FLOOR], -p[REBOUND] * v), "kick": (u, v + p[KICK]), "gate": (u, p[FACTOR] * v)}.get(name)


def _crossings(g, rate, bend):
    """Return the times after which g changes its sign, with the sign that it gets. g is zero where it is below NEAR."""
    if abs(bend) < NEAR:
        roots = [-g / rate] if rate else []
    else:
        square = rate * rate - 2 * bend * g
        if abs(square) < UNCLEAR:
            raise UnclearError  # it touches zero
        roots = [(-rate + sign * math.sqrt(square)) / bend for sign in (-1, 1)] if square > 0 else []
    return sorted((x, math.copysign(1.0, rate + bend * x)) for x in roots)


def fly(names, directions, terminal, u, v, p):
    """Return the times of all events, by name, and whether one of them ended the flight."""
    t, a, found = 0.0, p[GRAVITY], {name: [] for name in names}
    begun = dict.fromkeys(names, -math.inf)  # a zero at the start of a flight is no event
    while True:
        coming = []
        for name in names:
            crossings = _crossings(*_g(name, t, u, v, a, p))
            if any(NEAR < abs(x) < UNCLEAR for x, _ in crossings):
                raise UnclearError
            times = [x for x, _ in crossings if x > NEAR]
            if len(times) > 1 and times[1] - times[0] < 1.5 * STEP:
                raise UnclearError  # two zeros in a step are not seen
            coming += [(t + x, name, sign) for x, sign in crossings if x > NEAR]
        if any(abs(x[0] - END) < UNCLEAR for x in coming):
            raise UnclearError
        coming = sorted(x for x in coming if x[0] < END)
        if any(NEAR < later[0] - earlier[0] < UNCLEAR for earlier, later in itertools.pairwise(coming)):
            raise UnclearError
        wanted = [x for x in coming if directions[x[1]] in (0, x[2])]
        stops = [x[0] for x in wanted if x[1] == terminal or _apply(x[1], 0, 0, p)]
        stop = stops[0] if stops else END
        for at, name, _ in wanted:
            if at <= stop + NEAR:
                found[name].append(at)
        if not stops:
            return found, False
        now = [name for at, name, _ in wanted if at <= stop + NEAR]
        resets = [name for name in now if _apply(name, u, v, p)]
        ends = terminal in now
        x = stop - t
        t, u, v = stop, u + v * x + a / 2 * x * x, v + a * x
        if "kick" in resets and len(resets) > 1:
            raise UnclearError  # the order of the two matters
        if any(name == "turn" and abs(at - stop) < NEAR for at, name, _ in coming) and resets:
            raise UnclearError  # the reset changes the velocity before or after it is zero
        before = {name: _g(name, t, u, v, a, p)[0] for name in names}
        for name in names:
            if name in resets:
                if name == "floor" and t - begun[name] < 3 * STEP:
                    raise UnclearError  # it comes to rest
                begun[name] = t
                u, v = _apply(name, u, v, p)
        if ends:
            return found, True
        for name in names:
            g, rate, _ = _g(name, t, u, v, a, p)
            if abs(g) < NEAR and (abs(rate) < UNCLEAR or abs(before[name]) > NEAR):
                raise UnclearError  # it rests on a zero, or a reset moved it there


def _case(rng):
    """Return a random set of events, their directions, the terminal one, and a state and parameters."""
    names = rng.permutation(list(FORMS))[: rng.integers(2, len(FORMS) + 1)].tolist()
    directions = {name: int(rng.choice([-1, 0, 1])) for name in names}
    if "floor" in names:
        directions["floor"] = int(rng.choice([-1, 0]))
    looking = [name for name in names if name in ("mark", "clock", "copy", "turn", "floor")]
    terminal = rng.choice(looking) if looking and rng.random() < 0.4 else ""

    def some(low, high, parts):
        return float(rng.integers(low * parts, high * parts + 1)) / parts

    p = [-some(1, 8, 1), 0.5, 0.0, rng.choice([0.5, 1.0]), some(0, 3, 16), some(-2, 2, 4)]
    p += [some(0, 4, 4), some(0, 4, 4), rng.choice([0.5, 2.0]), some(0, 3, 8)]
    return names, directions, terminal, some(1, 5, 4), some(-2, 4, 4), p


RUNS = {
    "eig3": {"h": STEP, "method": "eig3"},
    "ab3": {"h": STEP, "method": "ab3"},
    "rk5": {"rtol": 1e-6, "method": "rk5", "h_max": STEP},
}


@pytest.mark.parametrize("is_vector", [False, True], ids=["scalar", "vector"])
@pytest.mark.parametrize("options", RUNS.values(), ids=RUNS)
def test_random_sets_of_events(options, is_vector):
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 150:
        names, directions, terminal, u, v, p = _case(rng)
        try:
            expected, has_ended = fly(names, directions, terminal, u, v, p)
        except UnclearError:
            continue
        tried += 1
        events = {}
        for name in names:
            g, apply = FORMS[name][is_vector]
            events[name] = Event(g, directions[name], name == terminal, apply)
        start = ([u, 1.0], [v, 0.0]) if is_vector else (u, v)
        solution = eig3.integrate(falls if is_vector else fall, (0, END), *start, params=p, events=events, **options)
        case = f"{names} {directions} {terminal!r} {u} {v} {p}"
        assert solution.status is (eig3.Status.TERMINATED if has_ended else eig3.Status.COMPLETED), case
        for name in names:
            times = solution.events[name].t
            assert len(times) == len(expected[name]), (case, name, times, expected[name])
            # the round-off of u and v, of some 1e-15 in each step, at speeds of a hundredth at least
            np.testing.assert_allclose(times, expected[name], rtol=0, atol=1e-11, err_msg=case)
        if is_vector:
            times = solution.t
            np.testing.assert_allclose(solution.u[:, 1], 1 + times * times / 4, rtol=0, atol=1e-12)


first_twice = eig3.jit(lambda t, u, v, p: (u[0] - 0.3) * (u[0] - 0.8))
between = eig3.jit(lambda t, u, v, p: u[0] - 0.6)


@eig3.jit
def drifting(t, u, v, p, a):
    a[0], a[1] = 0.0, 0.0


@eig3.jit
def turned(t, u, v, p):
    v[1] = -v[1]


@pytest.mark.parametrize("options", [{"h": 1.0}, {"h": 1.0, "method": "ab3"}, {"rtol": 1e-6, "first_step": 1.0}])
@pytest.mark.parametrize("apply", [None, turned])
def test_a_zero_before_a_reset_is_found_if_g_changes_its_sign_again_after_it(options, apply):
    """The reset ends the step between two zeros of the other event. u[0] = t without error, up to some roundings."""
    events = {"twice": Event(first_twice, apply=apply), "once": Event(between, apply=turned)}
    run = eig3.integrate(drifting, (0, 1), [0.0, 0.0], [1.0, 1.0], events=events, **options)
    np.testing.assert_allclose(run.events["twice"].t, [0.3, 0.8], rtol=1e-14)
    np.testing.assert_allclose(run.events["once"].t, [0.6], rtol=1e-14)
