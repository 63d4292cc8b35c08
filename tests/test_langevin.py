"""Langevin dynamics by BAOAB: its formulas, its distribution within confidence intervals, and the same bits everywhere.

All seeds are fixed. A confidence interval is of 4 standard errors, which a right method leaves once in 16,000 cases.
"""

import concurrent.futures
import math

import numpy as np
import pytest
import scipy.special

import eig3
from eig3.effects import BreakingString, LinearSpring
from eig3.methods import LIBRARY
from eig3.scene import Scene
from eig3.stability import amplification_matrix, limit

from .conftest import harmonic, harmonic_vector, position

WARM = eig3.Langevin(gamma=1.0, temperature=0.5, mass=2.0, seed=3)

quartic = eig3.jit(lambda t, u, v, p: -u * u * u)
pendulum = eig3.jit(lambda t, u, v, p: -eig3.math.sin(u))


def normal(seed, stream, step, degree):
    """The random number of a step, by NumPy's Philox."""
    key, counter = np.array([seed, stream], dtype=np.uint64), np.array([step, degree, 1, 0], dtype=np.uint64)
    first, second = (int(word >> np.uint64(11)) for word in np.random.Philox(key=key, counter=counter).random_raw(2))
    return math.sqrt(-2 * math.log((first + 1) * 2.0**-53)) * math.cos(2 * math.pi * second * 2.0**-53)


def by_hand(method, f, u, v, h, n_steps):
    """Return u and v after steps of B A O A B in NumPy."""
    decay = math.exp(-method.gamma * h)
    spread = np.sqrt(method.temperature / np.asarray(method.mass) * (1 - decay**2))
    for i in range(n_steps):
        v = v + h / 2 * f(u)
        u = u + h / 2 * v
        random = np.reshape([normal(method.seed, method.stream, i, j) for j in range(np.size(u))], np.shape(u))
        v = decay * v + spread * random
        u = u + h / 2 * v
        v = v + h / 2 * f(u)
    return u, v


# The tolerances of 1e-12 are for the round-off of some hundred steps of regular motions of size 1.


@pytest.mark.parametrize("stream", [0, 5])
@pytest.mark.parametrize("inline", [False, True])
def test_the_steps_are_those_of_the_formulas(stream, inline):
    method = eig3.Langevin(gamma=0.7, temperature=0.5, mass=2.0, seed=3, stream=stream)
    run = eig3.integrate(harmonic, (0, 20), 1.0, 0.5, h=0.2, method=method, inline=inline)
    np.testing.assert_allclose([run.u[-1], run.v[-1]], by_hand(method, np.negative, 1.0, 0.5, 0.2, 100), atol=1e-12)
    assert run.n_rhs == 101
    assert run.notes == ()


def test_each_degree_of_freedom_has_its_mass_and_its_numbers(tmp_path):
    method = eig3.Langevin(gamma=0.7, temperature=0.5, mass=[0.5, 1.0, 4.0], seed=9)
    run = eig3.integrate(harmonic_vector, (0, 20), np.ones(3), np.zeros(3), h=0.2, method=method)
    expected = by_hand(method, np.negative, np.ones(3), np.zeros(3), 0.2, 100)
    np.testing.assert_allclose([run.u[-1], run.v[-1]], expected, rtol=0, atol=1e-12)
    saved = eig3.Langevin(gamma=0.7, temperature=0.5, mass=np.array([1, 2, 3]), seed=np.int64(4))
    run = eig3.integrate(harmonic_vector, (0, 1), np.ones(3), np.zeros(3), h=0.125, method=saved)
    assert eig3.load(run.save(tmp_path / "run")).method == saved == eig3.Langevin(0.7, 0.5, (1.0, 2.0, 3.0), 4)
    with pytest.raises(ValueError, match=r"^mass must be a number, or 2 of them for 2 degrees of freedom, not "):
        eig3.integrate(harmonic_vector, (0, 20), np.ones(2), np.zeros(2), h=0.2, method=method)


def test_without_friction_and_noise_it_is_velocity_verlet_of_order_2():
    def errors(h):
        run = eig3.integrate(quartic, (0, 10), 1.0, 0.0, h=h, method="langevin")
        u, v = 1.0, 0.0
        for _ in range(run.n_steps):
            v -= h / 2 * u**3
            u += h * v
            v -= h / 2 * u**3
        np.testing.assert_allclose([run.u[-1], run.v[-1]], [u, v], rtol=0, atol=1e-12)
        energy = run.v**2 / 2 + run.u**4 / 4
        return np.abs(energy - energy[0]).max()

    # The next term of the error is smaller by (omega h)^2, some 1 % with omega^2 = 3 u^2.
    assert np.log2(errors(0.1) / errors(0.05)) == pytest.approx(2, abs=0.05)


def moments(method, Omega):
    """The matrix of a step on (u, h v) for f = -Omega^2 u / h^2, as Leimkuhler and Matthews (2013) derive it."""
    kick, drift = np.array([[1, 0], [-(Omega**2) / 2, 1]]), np.array([[1, 0.5], [0, 1]])
    return kick @ drift @ np.diag([1, math.exp(-method.gamma * Omega)]) @ drift @ kick


@pytest.mark.parametrize("Omega", [0.25, 0.8, 1.5])
def test_the_variances_of_an_oscillator_are_those_of_the_theory(Omega):
    """That of u is T / m at every step, and that of v is T / m (1 - Omega^2 / 4).

    The mean of x^2 over N states has the variance 2 s^4 / N^2 times the sum of r_|i-j|^2 over all pairs of states. Here
    s^2 is the variance of the normal x, and r_k the correlation of x with x after k steps, from the matrix of a step.
    """
    m, warm_up, count = 1024, math.ceil(40 / Omega), 1000  # the start is forgotten, except for e^-20
    method = WARM
    span = 0, (warm_up + count) * Omega
    runs = eig3.ensemble(harmonic, span, np.zeros(m), 0.0, h=Omega, method=method, save_every=1)
    assert not runs.notes  # it runs in lanes
    variance = method.temperature / method.mass
    covariance = np.diag([variance, variance * (1 - Omega**2 / 4) * Omega**2])
    step, power, correlations = moments(method, Omega), np.eye(2), []
    for _ in range(count):
        correlations.append(np.diag(power @ covariance) / np.diag(covariance))
        power = step @ power
    counts = np.r_[count, 2 * np.arange(count - 1, 0, -1)]
    spread = np.sqrt(2 / m * (counts @ np.array(correlations) ** 2)) / count
    means = [np.mean(x[:, warm_up + 1 :] ** 2) for x in (runs.u, runs.v)]
    expected = np.array([variance, variance * (1 - Omega**2 / 4)])
    assert (np.abs(means / expected - 1) < 4 * spread).all()
    assert (spread < 0.004).all()  # so that a variance of v without its error of Omega^2 / 4 would be seen


@pytest.mark.parametrize(("gamma", "steps", "order"), [(1.0, (0.7, 1.0), 2), (1e3, (1.0, 1.4), 4)])
def test_averages_have_order_2_and_with_large_friction_4(gamma, steps, order):
    """<cos u> of exp(cos u / T) is I_1(1/T) / I_0(1/T).

    The next term of the error, of h^2 relatively, changes the order by up to 0.45 at these steps. Three standard errors
    of it are 0.45: the means of 4096 members have standard errors of up to 0.0018, and the lesser error is 0.033.
    """
    m, warm_up, count, T = 4096, 50, 1000, 2.0
    exact = scipy.special.iv(1, 1 / T) / scipy.special.iv(0, 1 / T)

    def cosines(part):
        return np.cos(part.u[:, warm_up + 1 :]).mean(axis=1)

    def error(h):
        method = eig3.Langevin(gamma=gamma, temperature=T, seed=11)
        options = {"h": h, "method": method, "save_every": 2, "reduce": cosines}
        parts = eig3.ensemble(pendulum, (0, 2 * h * (warm_up + count)), np.zeros(m), 0.0, **options)
        return abs(np.concatenate(parts).mean() / exact - 1)

    found = math.log(error(steps[1]) / error(steps[0])) / math.log(steps[1] / steps[0])
    assert found == pytest.approx(order, abs=0.9)


# The same bits, however a run is divided.


def test_a_run_has_the_same_bits_in_every_way_to_run_it(tmp_path):
    whole = eig3.integrate(harmonic, (0, 20), 1.0, 0.0, h=0.125, method=WARM)
    again = eig3.prepare(harmonic, h=0.125, method=WARM)((0, 20), 1.0, 0.0)
    np.testing.assert_array_equal(again.u, whole.u)
    stepper = eig3.Stepper(harmonic, 1.0, 0.0, h=0.125, method=WARM)
    for count in (1, 7, 52, 100):
        assert stepper.advance(count) == count
        assert (stepper.u, stepper.v) == (whole.u[stepper.index], whole.v[stepper.index])
    half = eig3.integrate(harmonic, (0, 10), 1.0, 0.0, h=0.125, method=WARM)
    np.testing.assert_array_equal(half.extend(20).v, whole.v)
    loaded = eig3.load(half.save(tmp_path / "half"), rhs=harmonic)
    assert loaded.method == WARM
    np.testing.assert_array_equal(loaded.extend(20).u, whole.u)
    seen = eig3.integrate(harmonic, (0, 20), 1.0, 0.0, h=0.125, method=WARM, t_eval=whole.t)
    np.testing.assert_array_equal(seen.u, whole.u)
    watched = eig3.integrate(harmonic, (0, 20), 1.0, 0.0, h=0.125, method=WARM, events={"zero": eig3.Event(position)})
    np.testing.assert_array_equal(watched.u, whole.u)
    assert len(watched.events["zero"].t) == np.sum(whole.u[1:] * whole.u[:-1] < 0)


def ends(m, **options):
    options = {"h": 0.125, "method": WARM, **options}
    return eig3.ensemble(harmonic, (0, 20), np.linspace(0, 1, 300)[:m], 0.0, **options)


def test_a_member_has_a_stream_of_its_own_wherever_it_runs():
    whole = ends(300)
    for other in (ends(300, threads=1), ends(300, threads=3), ends(17)):
        np.testing.assert_array_equal(other.u, whole.u[: len(other)])
    parts = ends(300, reduce=lambda part: part.u[:, -1])
    assert len(parts) > 1
    np.testing.assert_array_equal(np.concatenate(parts), whole.u[:, -1])
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        np.testing.assert_array_equal(ends(300, executor=pool).v, whole.v)


def test_a_member_runs_alone_with_its_stream():
    """And keeps its bits without the others: a member of an ensemble of one has the stream of the method."""
    whole = ends(300)
    for i in (0, 7, 299):
        method = eig3.Langevin(gamma=1.0, temperature=0.5, mass=2.0, seed=3, stream=i)
        assert whole[i].method == method
        start = np.linspace(0, 1, 300)[i]
        alone = eig3.integrate(harmonic, (0, 20), start, 0.0, h=0.125, method=method)
        assert alone.u[-1] == pytest.approx(whole.u[i, -1], abs=1e-12)
        one = eig3.ensemble(harmonic, (0, 20), [start], 0.0, h=0.125, method=method)
        np.testing.assert_array_equal(one.u, whole.u[i : i + 1])


softening = eig3.jit(lambda t, u, v, p: u * u * u - u)


def test_a_member_that_diverges_does_not_change_the_others():
    method, u0 = eig3.Langevin(gamma=1.0, temperature=1e-3, seed=3), np.linspace(0, 0.1, 20)
    well = eig3.ensemble(softening, (0, 20), u0, 0.0, h=0.125, method=method)
    ill = eig3.ensemble(softening, (0, 20), np.where(np.arange(20) == 3, 50.0, u0), 0.0, h=0.125, method=method)
    assert np.flatnonzero(~ill.success).tolist() == [3]
    np.testing.assert_array_equal(np.delete(ill.u, 3, axis=0), np.delete(well.u, 3, axis=0))


def test_degrees_of_freedom_in_lanes_have_their_masses():
    method = eig3.Langevin(gamma=1.0, temperature=0.5, mass=(0.5, 1.0, 4.0), seed=3)
    runs = eig3.ensemble(harmonic_vector, (0, 20), np.zeros((20, 3)), np.zeros(3), h=0.125, method=method)
    assert not runs.notes
    alone = eig3.integrate(harmonic_vector, (0, 20), np.zeros(3), np.zeros(3), h=0.125, method=runs[3].method)
    np.testing.assert_allclose(runs.u[3, -1], alone.u[-1], rtol=0, atol=1e-12)


def test_members_that_do_not_run_in_lanes_have_the_same_streams():
    steps = ends(20, h=np.full(20, 0.125))
    np.testing.assert_allclose(steps.u, ends(20).u, rtol=0, atol=1e-12)
    method, n = eig3.Langevin(gamma=1.0, temperature=0.5, seed=3), 25  # more degrees of freedom than run in lanes
    many = eig3.ensemble(harmonic_vector, (0, 5), np.zeros((3, n)), np.zeros(n), h=0.125, method=method)
    few = eig3.ensemble(harmonic_vector, (0, 5), np.zeros((3, 2)), np.zeros(2), h=0.125, method=method)
    np.testing.assert_allclose(many.u[..., :2], few.u, rtol=0, atol=1e-12)
    assert np.unique(many.u[:, -1]).size == 3 * n


def test_members_and_degrees_of_freedom_are_independent():
    """The correlations of 2000 pairs are within 4 standard errors of 1 / sqrt(2000)."""
    method = eig3.Langevin(gamma=1.0, temperature=1.0, seed=1)
    runs = eig3.ensemble(harmonic_vector, (0, 20), np.zeros((2001, 2)), np.zeros(2), h=0.25, method=method)
    u = runs.u[:, -1]
    pairs = (u[:-1, 0], u[1:, 0]), (u[:, 0], u[:, 1]), (runs.u[:, -1, 0], runs.v[:, -1, 0])
    assert max(abs(np.corrcoef(*pair)[0, 1]) for pair in pairs) < 4 / math.sqrt(2000)
    assert u.mean() == pytest.approx(0, abs=4 / math.sqrt(4002))


# What the rest of the library makes of it.


def test_noise_is_no_divergence_and_an_unstable_step_is_one():
    """From a start of 1e-9 the noise makes a motion of size 1, but nothing is wrong with the step."""
    assert eig3.integrate(harmonic, (0, 20), 1e-9, 0.0, h=0.125, method=WARM).success
    assert eig3.ensemble(harmonic, (0, 20), np.full(20, 1e-9), 0.0, h=0.125, method=WARM).success.all()
    unstable = eig3.integrate(harmonic, (0, 210), 1.0, 0.0, h=2.1, method=WARM)
    assert unstable.status is eig3.Status.DIVERGED
    assert "critical step" in unstable.message
    runs = eig3.ensemble(harmonic, (0, 210), np.ones(20), 0.0, h=2.1, method=WARM)
    assert all(status is eig3.Status.DIVERGED for status in runs.status)


@eig3.jit
def between_hard_walls(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j] + 1e-3 * np.sign(u[j]) / (abs(u[j]) + 1e-3) ** 3


def test_a_run_that_ends_hot_has_a_note():
    """At the temperature, 100 degrees of freedom are 4.5 times as hot with a chance below exp(-99), by Chernoff."""
    start = np.full(100, 0.5), np.zeros(100)
    method = eig3.Langevin(0.1, 1.0, seed=1)
    cool, hot = (eig3.integrate(between_hard_walls, (0, 50), *start, h=h, method=method) for h in (1e-3, 0.02))
    assert cool.notes == ()
    assert "h = 0.02 is too long for the fastest motion" in hot.notes[-1]
    assert np.mean(hot.v[-1] ** 2) > 4.5


@eig3.jit
def energy(t, u, v, p):
    total = 0.0
    for j in range(u.size):
        total += (u[j] * u[j] + v[j] * v[j]) / 2
    return total


def test_warming_up_is_no_instability():
    """The energy of many oscillators grows steadily from a cold start, as that of a method that grows weakly does."""
    method = eig3.Langevin(gamma=1e-3, temperature=5.0, seed=3)
    options = {"h": 0.05, "method": method, "invariants": {"energy": energy}}
    run = eig3.integrate(harmonic_vector, (0, 200), np.ones(200), np.zeros(200), **options)
    assert run.drift["energy"] > 100  # in 200 s, 18 % of 1000 - 100 J
    assert run.notes == ()
    assert f"  change of energy: {run.drift['energy']:.4g}" in repr(run)


def test_noise_is_no_short_period():
    """With much friction, u forgets its place within a few steps of this length, and its path bends in every step."""
    method = eig3.Langevin(gamma=1000.0, temperature=1.0, seed=2)
    assert eig3.integrate(harmonic, (0, 103), 0.0, 0.0, h=1.03, method=method).notes == ()


def test_its_limit_is_that_of_verlet():
    assert limit(WARM) == pytest.approx(2, abs=1e-8)
    np.testing.assert_array_equal(amplification_matrix(WARM, 1.5), amplification_matrix("langevin", 1.5))
    step = eig3.critical_step(
        harmonic_vector, np.ones(2), np.zeros(2), method=eig3.Langevin(1.0, 0.5, (1.0, 2.0)), safety=1
    )
    assert step.h == pytest.approx(2, rel=1e-6)  # a frequency by differences of f


def test_it_is_compared_with_no_other_method():
    assert "langevin" in eig3.METHODS
    assert "langevin" not in LIBRARY
    with pytest.raises(ValueError, match=r"^methods must be deterministic, and Langevin\(.*\) adds random numbers: "):
        eig3.plan(eig3.problems.henon_heiles(), 1e-3, methods=["eig3", WARM])


def bath(masses):
    """Masses on springs in space."""
    scene = Scene(3)
    points = scene.mass(masses, np.zeros((len(masses), 3)))
    scene.add(LinearSpring(1.0), points, scene.fixed(np.zeros(3)))
    return scene, points


def test_a_scene_gives_its_masses():
    """<m v^2> is the temperature for each mass; who gives the masses of the scene gets the same bits."""
    masses = np.repeat([0.5, 3.0], 500)
    scene, points = bath(masses)
    problem, options = scene.problem((0.0, 12.0)), {"gamma": 1.0, "temperature": 1.0, "seed": 3}
    method = eig3.Langevin(**options)
    run = problem.integrate(h=0.05, method=method, save_every=40)
    v = points.velocities(run.v)[3:]
    for m in (0.5, 3.0):
        assert (m * v[:, masses == m] ** 2).mean() == pytest.approx(1.0, abs=0.04)
    given = problem.integrate(h=0.05, method=run.method, save_every=40)
    assert given.method == run.method == eig3.Langevin(**options, mass=np.tile(masses, 3))
    assert "mass=<3000 values>" in str(run)
    np.testing.assert_array_equal(given.v, run.v)
    np.testing.assert_array_equal(problem.ensemble(h=0.05, u0=[problem.u0] * 2, method=method).v[0, -1], run.v[-1])
    stepper = problem.stepper(h=0.05, method=method)
    stepper.advance(240)
    np.testing.assert_array_equal(stepper.v, run.v[-1])
    message = "^mass of Langevin must equal the masses of scene: leave it out"
    for wrong in (1.0, masses, np.tile(masses[::-1], 3)):
        with pytest.raises(ValueError, match=message):
            problem.integrate(h=0.05, method=eig3.Langevin(**options, mass=wrong))
    same, _ = bath([2.0, 2.0])
    assert same.problem((0.0, 1.0)).integrate(h=0.1, method=eig3.Langevin(**options, mass=2.0)).method.mass == 2.0


def test_noise_is_for_coordinates_and_spins_only(tmp_path):
    """Not for the state of a string, nor for the angle of a mass that does not spin."""
    scene = Scene(2)
    disc, mass = scene.mass(2.0, (1.0, 0.0), inertia=0.5), scene.mass(3.0, (2.0, 0.0))
    scene.add(BreakingString(10.0, 0.9, 1e9), disc, mass)
    problem = scene.problem((0.0, 5.0))
    run = problem.integrate(h=0.05, method=eig3.Langevin(gamma=1.0, temperature=1.0), events={})
    assert run.method.mass == (2.0, 3.0, 2.0, 3.0, 0.5, math.inf, math.inf)
    assert (run.u[1:, :5] != run.u[:-1, :5]).all()
    assert not run.u[:, 5:].any()
    assert problem.load(run.save(tmp_path / "run")).method == run.method


damped = eig3.jit(lambda t, u, v, p: -u - 0.1 * v)


def test_a_force_that_reads_the_velocity_is_refused():
    with pytest.raises(ValueError, match=r"^Langevin\(.*\) needs a rhs that ignores v and has no z0; "):
        eig3.integrate(damped, (0, 1), 1.0, 0.0, h=0.1, method=WARM)
    with pytest.raises(ValueError, match=r"^Langevin\(.*\) needs a rhs that ignores v .* such as drag, dampers and"):
        eig3.ensemble(damped, (0, 1), np.ones(3), 0.0, h=0.1, method=WARM)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gamma": -1.0}, "^gamma must be a finite number of at least 0, not -1.0"),
        ({"temperature": math.nan}, "^temperature must be a finite number of at least 0, not nan"),
        ({"temperature": 1.2}, "^temperature acts only with friction: give gamma too, such as gamma=1.0"),
        ({"temperature": "hot"}, "^temperature must be a finite number of at least 0, not 'hot'"),
        ({"mass": 0.0}, "^mass must be a positive number, or a sequence of them, not 0.0"),
        ({"mass": [1.0, -1.0]}, r"^mass must be a positive number, or a sequence of them, not \[1.0, -1.0\]"),
        ({"mass": []}, r"^mass must be a positive number, or a sequence of them, not \[\]"),
        ({"seed": 1.5}, r"^seed must be a whole number from 0 to 2\^53, not 1.5"),
        ({"stream": -1}, r"^stream must be a whole number from 0 to 2\^53, not -1"),
    ],
)
def test_options_that_are_not_valid_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        eig3.Langevin(**options)
