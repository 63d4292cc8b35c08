"""Structures by their matrices: closed forms, conserved quantities, every kind of mass and damping, and errors."""

import functools
import math
import pickle

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

import eig3
from eig3.effects import ElasticPlastic, Gap
from eig3.functions.records import _skipped, skips
from eig3.structures.factors import copies_in, factors, solution
from eig3.structures.matrices import check_mass
from eig3.structures.modes import highest_frequency, natural_modes

from .conftest import refusals

N = 6


def stiffness(n=N, k=100.0):
    ones = np.ones(n - 1)
    return k * scipy.sparse.diags_array([np.r_[2 * ones, 1.0], -ones, -ones], offsets=[0, 1, -1]).tocsr()


def consistent(n=N):
    """The mass of a bar of linear elements, fixed at one end."""
    ones = np.ones(n - 1)
    return scipy.sparse.diags_array([np.r_[4 * ones, 2.0], ones, ones], offsets=[0, 1, -1]).tocsr() / 6


def exact(M, C, K, u0, v0, t):
    """The free motion, by the exponential of the matrix of the first-order system."""
    n = len(u0)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return (scipy.linalg.expm(A * t) @ np.r_[u0, v0])[:n]


U0 = np.random.default_rng(0).normal(size=N)
V0 = np.random.default_rng(1).normal(size=N)
MASSES = {
    "numbers": np.linspace(1, 2, N),
    "diagonal": np.diag(np.linspace(1, 2, N)),
    "sparse diagonal": scipy.sparse.diags_array(np.linspace(1, 2, N)),
    "consistent": consistent(),
    "dense": consistent().toarray(),
}


@pytest.mark.parametrize(("mass", "has_damping"), [*((mass, False) for mass in MASSES), ("consistent", True)])
def test_free_motion_is_the_exact_one(mass, has_damping):
    M = MASSES[mass]
    C = 0.3 * stiffness() / 100 + 0.1 * scipy.sparse.eye_array(N) if has_damping else None
    problem = eig3.linear(M, C, stiffness(), t_span=(0, 2), u0=U0, v0=V0)
    full = np.diag(M) if np.ndim(M) == 1 else check_mass(M, None).matrix.toarray()
    C = np.zeros((N, N)) if C is None else C.toarray()
    run = problem.integrate(rtol=1e-11, method="rk8")
    np.testing.assert_allclose(run.u[-1], exact(full, C, stiffness().toarray(), U0, V0, 2.0), rtol=0, atol=1e-8)
    assert problem.uses_velocity == has_damping
    if not has_damping:
        assert run.drift["energy"] < 1e-8 * problem.energy_of(U0, V0)
        omega = np.sqrt(scipy.linalg.eigh(stiffness().toarray(), full, eigvals_only=True).max())
        assert problem.critical_step().omega_max == pytest.approx(omega, rel=1e-5)


def test_eig3_keeps_its_order_on_a_consistent_mass_with_damping():
    problem = eig3.linear(
        consistent(), None, stiffness(), damping=eig3.Rayleigh(0.02, 1.0, 20.0), t_span=(0, 1), u0=U0, v0=V0
    )
    fine = problem.integrate(rtol=1e-12).u[-1]
    errors = [np.abs(problem.integrate(h=h).u[-1] - fine).max() for h in (2e-3, 1e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.05)


def test_damping_ratios_are_those_asked_for():
    """A mode decays as exp(-xi omega t): 1 s of each of the modes, alone.

    With C = a M + b K, 2 xi omega is a + b omega^2: on a line over omega^2 from the first mode to the last.
    """
    M, K = consistent(), stiffness()
    omega, shapes = natural_modes(check_mass(M, None), K, N)
    ratios = [0.01, 0.02, 0.03]
    modal = eig3.linear(M, None, K, damping=eig3.Modal(ratios, 3), t_span=(0, 1))
    rayleigh = eig3.linear(M, None, K, damping=eig3.Rayleigh((0.01, 0.04), omega[0], omega[-1]), t_span=(0, 1))
    rates = np.interp(omega**2, omega[[0, -1]] ** 2, [2 * 0.01 * omega[0], 2 * 0.04 * omega[-1]])
    for j in range(N):
        for problem, xi in ((modal, [*ratios, 0, 0, 0][j]), (rayleigh, rates[j] / (2 * omega[j]))):
            end = problem.with_(u0=shapes[:, j], v0=-xi * omega[j] * shapes[:, j]).integrate(rtol=1e-11).u[-1]
            expected = np.exp(-xi * omega[j]) * np.cos(omega[j] * np.sqrt(1 - xi**2)) * shapes[:, j]
            np.testing.assert_allclose(end, expected, rtol=0, atol=1e-8)


def test_modes_of_a_large_structure_are_those_of_the_closed_form():
    n, mass, K = 600, check_mass(np.ones(600), None), stiffness(600, 1.0)
    expected = 2 * np.sin((2 * np.arange(n) + 1) * np.pi / (2 * (2 * n + 1)))
    np.testing.assert_allclose(natural_modes(mass, K, 5)[0], expected[:5], rtol=1e-8)
    assert highest_frequency(mass, K) == pytest.approx(expected[-1], rel=1e-8)


def test_modes_of_a_shear_building():
    """n equal storeys: omega = 2 sqrt(k / m) sin((2 j - 1) pi / (4 n + 2))."""
    n = 4
    K = 9.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[-1, -1] = 9.0
    building = eig3.linear(np.full(n, 0.25), None, K, t_span=(0, 1))
    modes = building.modes(n)
    j = np.arange(1, n + 1)
    np.testing.assert_allclose(modes.omega, 12 * np.sin((2 * j - 1) * np.pi / (4 * n + 2)), rtol=1e-12)
    np.testing.assert_allclose(modes.frequencies, modes.omega / (2 * np.pi))
    np.testing.assert_allclose(modes.shapes @ (0.25 * modes.shapes.T), np.eye(n), rtol=0, atol=1e-12)
    first = np.sin((2 * 1 - 1) * np.pi * np.arange(1, n + 1) / (2 * n + 1))
    share = first.sum() ** 2 / (first @ first) / n
    assert modes.effective_masses[0] / modes.total_mass == pytest.approx(share, rel=1e-12)
    assert modes.effective_masses.sum() == pytest.approx(modes.total_mass, rel=1e-12)
    last = repr(modes).splitlines()[-1].split()
    assert (last[0], last[-1]) == (str(n), "100.00")
    only = building.modes(1, influence=[0.0, 0.0, 0.0, 1.0])
    assert only.total_mass == 0.25
    assert only.participation[0] == pytest.approx(0.25 * modes.shapes[0, -1], rel=1e-12)


@pytest.mark.parametrize("mass", ["numbers", "consistent"])
def test_rayleigh_damping_by_modes_is_that_by_their_frequencies(mass):
    M = MASSES[mass]
    omega = eig3.linear(M, None, stiffness(), t_span=(0, 1)).modes(3).omega
    by_modes, by_frequencies = (
        eig3.linear(M, None, stiffness(), damping=damping, t_span=(0, 1)).params
        for damping in (eig3.Rayleigh(0.03, modes=(1, 3)), eig3.Rayleigh(0.03, omega[0], omega[2]))
    )
    assert (by_modes.a, by_modes.b) == (by_frequencies.a, by_frequencies.b)


def with_a_short_influence():
    return eig3.linear(np.ones(6), None, stiffness(), t_span=(0, 1)).modes(1, influence=[1.0, 1.0])


test_modes_that_are_refused = refusals(
    {
        r"modes must be two different modes.*2, 2": lambda: eig3.Rayleigh(0.1, modes=(2, 2)),
        "modes must be two different modes, not 3": lambda: eig3.Rayleigh(0.1, modes=3),
        r"modes must be two different modes.*1, 2, 3": lambda: eig3.Rayleigh(0.1, modes=(1, 2, 3)),
        "a mode must be": lambda: eig3.Rayleigh(0.1, modes=(0, 2)),
        "coefficients depend on the structure": lambda: eig3.Rayleigh(0.1, modes=(1, 2)).coefficients,
        "K must have no negative eigenvalue: a mode has": lambda: eig3.linear([1.0], K=[[-4.0]], t_span=(0, 1)).modes(
            1
        ),
        "K must have no negative eigenvalue: a mode": lambda: eig3.linear([1.0], K=[[-4.0]], t_span=(0, 1)).exact(1.0),
        "xi gives the mode of .* rad/s a negative damping": lambda: made_of(
            {"damping": eig3.Rayleigh((0.3, 0.01), 0.5, 1.0)}
        )(),
        "xi gives the mode of .* a negative damping ratio": lambda: made_of(
            {"damping": eig3.Rayleigh((0.01, 0.3), 5.0, 6.0)}
        )(),
        "modes need K": lambda: eig3.linear([1.0, 1.0], t_span=(0, 1)).modes(1),
        "influence must be 6 finite numbers": with_a_short_influence,
    },
    {
        "Rayleigh takes two frequencies, omega1 and omega2, or modes=": lambda: eig3.Rayleigh(0.1),
        "Rayleigh takes two frequencies": lambda: eig3.Rayleigh(0.1, 1.0, 2.0, modes=(1, 2)),
        "Rayleigh takes two frequencies, omega1 and": lambda: eig3.Rayleigh(0.1, 1.0, modes=(1, 2)),
    },
)


@eig3.jit
def push(t, u, v, p, out):
    out[1] += 3.0


def test_blocks_and_threads():
    """Matrices of blocks give the accelerations of NumPy, and threads change no bit of them."""
    edge = 2
    n, block = N * edge, np.eye(edge) + 0.3
    K, C = scipy.sparse.kron(stiffness(), block), scipy.sparse.kron(0.01 * stiffness(), block)
    M, damping = scipy.sparse.kron(consistent(), scipy.sparse.eye_array(edge)), eig3.Rayleigh(0.05, 1.0, 10.0)
    a, b = damping.coefficients
    u0, v0 = np.random.default_rng(5).normal(size=(2, n))
    options = {"ground": GROUND, "force": push, "t_span": (0.33, 1.0), "damping": damping, "work": True}
    problem = eig3.linear(M, C, K, u0=u0, v0=v0, **options)
    assert problem.params.K.edge == edge
    full = check_mass(M, None).matrix.toarray()
    f = 3.0 * (np.arange(n) == 1) - K @ u0 - C @ v0 - b * (K @ v0) - a * (full @ v0)
    expected = np.linalg.solve(full, f) - np.interp(0.33, *GROUND)
    run = problem.integrate(h=1e-3)
    np.testing.assert_allclose(run.a[0], expected, rtol=1e-12, atol=1e-10)
    power = v0 @ (C @ v0 + b * (K @ v0) + a * (full @ v0))
    assert run.z["dissipated"][1] / run.h == pytest.approx(power, rel=1e-12)  # of the first step
    shared = eig3.linear(M, C, K, u0=u0, v0=v0, **options, threads=2)
    some = shared.integrate(h=run.h, t_end=0.33 + 50 * run.h).u
    np.testing.assert_array_equal(some, run.u[: len(some)])
    with pytest.raises(ValueError, match=r"^rhs uses threads, but the members already use all threads"):
        shared.ensemble(params={"ground_scale": [1.0, 2.0]}, h=1e-3)
    members = problem.ensemble(params={"ground_scale": [1.0, 2.0]}, h=1e-3)
    assert "one at a time, because params have a sparse matrix" in members.notes[0]


@eig3.jit
def gap(t, u, v, p, out):
    """A stop at the last mass."""
    if u[5] > 0.1:
        out[5] -= 1e3 * (u[5] - 0.1)


GROUND = np.linspace(0, 1, 11), np.sin(np.linspace(0, 9, 11))
TABLE = GROUND[0], np.column_stack([np.cos(GROUND[0]), GROUND[0] ** 2]), [4, 1]


@pytest.mark.parametrize("mass", ["consistent", "numbers"])
def test_loads(mass):
    """The acceleration at some times is that of NumPy; the energy less the work stays.

    The ground moves, and a table of forces acts, or a function.
    """
    M, K, t = MASSES[mass], stiffness(), 0.33
    influence, damping = np.array([1.0, 0.0] * 3), eig3.Rayleigh(0.05, 1.0, 10.0)
    force = TABLE if mass == "consistent" else gap
    options = {"t_span": (0, 2), "u0": U0, "v0": V0, "damping": damping, "ground": (*GROUND, influence)}
    problem = eig3.linear(M, None, K, work=True, force=force, **options)
    full = check_mass(M, None).matrix.toarray()
    a, b = damping.coefficients
    f = np.zeros(N)
    if force is TABLE:
        f[[4, 1]] = [np.interp(t, GROUND[0], column) for column in TABLE[1].T]
    else:
        f[5] = -1e3 * max(U0[5] - 0.1, 0.0)
    expected = np.linalg.solve(full, f - K @ U0 - (a * full + b * K) @ V0) - influence * np.interp(t, *GROUND)
    run = problem.with_(t_span=(t, 2.0)).integrate(h=1e-3, method="rk4")
    np.testing.assert_allclose(run.a[0], expected, rtol=1e-12, atol=1e-12)
    # the record has corners between the steps, of which each costs h^2
    assert run.drift["energy"] < 1e-6 * problem.energy_of(U0, V0)
    assert abs(run.z["work"][-1]) > 1


def test_outside_a_record_nothing_acts():
    rest = eig3.linear(np.ones(N), None, stiffness(), ground=GROUND, t_span=(1.5, 3.0))
    assert not rest.integrate(h=0.01).u.any()


def test_lumped_masses():
    """Both keep the mass of each direction; the row sums of a bar are those of its elements' halves."""
    bar = consistent()
    np.testing.assert_allclose(check_mass(bar, "row").diagonal[1:-1], 1.0, rtol=1e-15)
    plane = scipy.sparse.block_diag([bar, 3 * bar])
    for lump in ("row", "hrz"):
        diagonal = check_mass(plane, lump).diagonal
        assert diagonal[:N].sum() == pytest.approx(bar.sum(), rel=1e-14)
        assert diagonal[N:].sum() == pytest.approx(3 * bar.sum(), rel=1e-14)
        lumped = eig3.linear(plane, None, scipy.sparse.eye_array(2 * N), lump=lump, t_span=(0, 1))
        assert lumped.integrate(h=0.1, invariants={}).success


@pytest.mark.parametrize("directions", [1, 2, 3])
def test_factors_of_a_mass_solve_in_place(directions):
    """A mass that is the same in each direction is factored for one of them. Python runs the code here."""
    rng = np.random.default_rng(3)
    random = scipy.sparse.random_array((40, 40), density=0.05, rng=rng)
    one = random @ random.T + scipy.sparse.eye_array(40)
    M = check_mass(scipy.sparse.kron(one, scipy.sparse.eye_array(directions)), None).matrix
    assert copies_in(M) == directions
    found = factors(M[::directions][:, ::directions])
    assert {*np.diff(found.panels[:, 0])} == {1, 2, 4}
    b = rng.normal(size=40 * directions)
    x = b.copy()
    solution(directions).py_func(*found, x)
    np.testing.assert_allclose(M @ x, b, rtol=0, atol=1e-12)


def test_structures_with_the_same_parts_share_code():
    one, two = (eig3.linear(np.ones(n), None, stiffness(n), t_span=(0, 1)) for n in (3, 9))
    assert one.rhs is two.rhs
    assert one.energy is two.energy


def test_parameters_can_be_changed_and_members_have_their_own():
    problem = eig3.linear(np.ones(N), None, stiffness(), ground=GROUND, t_span=(0, 1))
    twice = problem.with_(params=problem.params._replace(ground_scale=2.0))
    np.testing.assert_allclose(twice.integrate(h=1e-2).u, 2 * problem.integrate(h=1e-2).u, rtol=1e-12, atol=1e-15)
    runs = problem.ensemble(params={"ground_scale": [1.0, 2.0]}, h=1e-2)
    np.testing.assert_allclose(runs.u[1, -1], 2 * runs.u[0, -1], rtol=1e-12)
    with pytest.raises(ValueError, match="structure has no energy: make its scene or structure with work=True"):
        problem.energy_of(U0, V0)


def test_gyroscopic_forces_keep_the_energy_and_a_note_tells_where_the_method_does_not():
    """In 2500 steps at omega h = 0.112, RK4 loses at most 2 (omega h)^6 / 144 of the energy in each."""
    rotor = eig3.linear([1.0, 1.0], [[0.0, 4.0], [-4.0, 0.0]], 9 * np.eye(2), t_span=(0, 50), u0=[1.0, 0.0])
    kept, grown = rotor.integrate(h=0.02, method="rk4"), rotor.integrate(h=0.02, method="eig3")
    assert kept.drift["energy"] < 7e-5 * rotor.energy_of(rotor.u0, rotor.v0)
    assert kept.notes == ()
    assert "energy grows steadily" in grown.notes[0]


K = stiffness()
M = np.ones(N)
UNSYMMETRIC = K.toarray() + np.eye(N, k=2)
FREE = K - scipy.sparse.diags_array([100.0, *[0.0] * (N - 1)])  # the links of an isolated building hold it
BAD = {
    r"M must be a square matrix, not one of the shape \(2, 3\)": {"M": np.ones((2, 3))},
    "M must have positive, finite masses, but the mass of degree of freedom 0 is 0: condense": {"M": np.zeros(N)},
    "M must have positive, finite masses, but the mass of .* 5 is 0": {"M": np.diag([1.0, 1, 1, 1, 1, 0])},
    "M must be positive definite, but a motion has zero or negative mass": {"M": np.ones((N, N))},
    "M must be positive definite": {"M": consistent() - scipy.sparse.eye_array(N)},
    r"M must be symmetric, but M\[0, 2\] and M\[2, 0\] differ": {"M": UNSYMMETRIC},
    "M must have at least one degree of freedom, but it is empty": {"M": []},
    r"K must be symmetric, but K\[0, 2\] and K\[2, 0\] differ": {"K": UNSYMMETRIC},
    r"K must have the shape \(6, 6\) of M, not \(4, 4\)": {"K": stiffness(4)},
    "K must be made of finite numbers, but it has nan": {"K": K * np.nan},
    "C must be a square matrix": {"C": np.ones((N, 2))},
    r"u0 must be a finite number, or 6 of them, not of the shape \(4,\)": {"u0": np.zeros(4)},
    "threads must be a whole number of at least 1": {"threads": 0},
    'lump must be "row" or "hrz"': {"lump": "best"},
    "modes must be at most the 6 degrees of freedom, not 7": {"damping": eig3.Modal(0.05, 7)},
    "modes must vibrate, but mode 1 is a rigid motion of K, which does not include links: give C = b K": {
        "K": FREE,
        "damping": eig3.Rayleigh(0.05, modes=(1, 3)),
    },
    "damping needs K": {"K": None, "damping": eig3.Rayleigh(0.05, 1, 2)},
    "ground must have a finite value for each of its 11 times": {"ground": (GROUND[0], GROUND[1][:5])},
    "the times of ground must be two or more finite numbers": {"ground": (GROUND[0][::-1], GROUND[1])},
    "the influence of ground must be 6 finite numbers": {"ground": (*GROUND, np.ones(3))},
    "ground must have one acceleration for each time": {"ground": (GROUND[0], np.ones((11, 2)))},
    "the degrees of force must be whole numbers from 0 to 5": {"force": (*GROUND, [9])},
    r"the degrees of force must be .* take names\.index\(name\)": {"force": (*GROUND, ["roof.ux"])},
    "force must have 2 values for each time, not values of the shape": {"force": (*GROUND, [1, 2])},
}
two_arguments, other_order = map(eig3.jit, (lambda t, out: None, lambda u, t, v, p, out: None))
BAD_TYPES = {
    "M must be made of real numbers": {"M": 1j * M},
    "K must be made of real numbers": {"K": K * 1j},
    "C must be made of real numbers": {"C": "stiff"},
    r"damping must be eig3\.Rayleigh\(\.\.\.\) or eig3\.Modal\(\.\.\.\), not 0\.05": {"damping": 0.05},
    r"ground must be \(times, accelerations\) or": {"ground": GROUND[1]},
    "force must be a jitted function": {"force": lambda t: 1.0},
    r"force takes 2 arguments, but must take 5: f\(t, u, v, p, out\), which adds to out": {"force": two_arguments},
    "force takes u, t, v, p as its first arguments, but must have the form": {"force": other_order},
}


def made_of(changes):
    given = {"M": M, "C": None, "K": K, "t_span": (0, 1)} | changes
    return functools.partial(eig3.linear, given.pop("M"), given.pop("C"), given.pop("K"), **given)


test_bad_arguments = refusals(*({f"^{said}": made_of(x) for said, x in bad.items()} for bad in (BAD, BAD_TYPES)))


CHANGED = {
    "ground must have a finite value for each of its 11": {"ground": GROUND[1][:7]},
    "the influence of ground must be 6": {"influence": np.ones(5)},
    "the degrees of force must be whole numbers from 0 to 5": {"degrees": [0, 6]},
    r"params\['m'\] must have 6 masses, not 5": {"m": M[:5]},
    r"params\['K'\] must have the shape \(6, 6\), not \(4, 4\)": {"K": scipy.sparse.csr_array(stiffness(4))},
    r"params\['link_0_stiffness'\] must have a value for each of 1 links, not 2: .* \(members, 1\)": {
        "link_0_stiffness": [1.0, 2.0]
    },
    r"params\['link_0_second'\] must be numbers from 0 to 5, or -1": {"link_0_second": [6]},
    "params must keep the number of links, 1, not have 2": {"link_0_first": [-1, 1]},
    "params are of a structure with 5 degrees of freedom, and not 6": {"size": 5},
}


@functools.cache
def loaded():
    loads = {"ground": GROUND, "force": (GROUND[0], np.ones((11, 2)), [0, 1]), "links": [(Gap(1.0, 1.0), None, 0)]}
    return eig3.linear(M, None, K, t_span=(0, 1), **loads)


test_changed_parameters = refusals(
    {
        words: functools.partial(lambda x: loaded().with_(params=loaded().params._replace(**x)), x)
        for words, x in CHANGED.items()
    }
)


def test_changed_parameters_of_a_prepared_run():
    run = pickle.loads(pickle.dumps(loaded().prepare(h=0.01)))
    with pytest.raises(ValueError, match="ground must have a finite value for each of its 11"):
        run(params=loaded().params._replace(ground=GROUND[1][:7]))


def test_parameters_beside_the_function_of_a_structure_are_checked_too():
    """The function reads as many values as there are times."""
    given = {"params": loaded().params._replace(ground=GROUND[1][:7]), "h": 0.01}
    for call, u0 in ((eig3.integrate, np.zeros(6)), (eig3.ensemble, np.zeros((3, 6)))):
        with pytest.raises(ValueError, match="ground must have a finite value for each of its 11"):
            call(loaded().rhs, (0, 1), u0, np.zeros(6), **given)


def test_the_parameters_of_each_member_are_checked():
    other = loaded().params._replace(link_0_second=[6])
    with pytest.raises(ValueError, match=r"params\['link_0_second'\] must be numbers from 0 to 5"):
        loaded().ensemble(params=[loaded().params, other], h=0.01)


def test_a_matrix_for_each_member_is_refused_with_the_remedy():
    first, second = (eig3.linear(np.eye(2), K=k * np.eye(2), t_span=(0, 1), u0=[1.0, 0.0]) for k in (1.0, 4.0))
    with pytest.raises(
        ValueError, match=r"^params\['K'\] must be one sparse matrix for all members: .* give params=\["
    ):
        first.ensemble(params={"K": [np.eye(2), 4 * np.eye(2)]}, h=0.01)
    members = first.ensemble(params=[first.params, second.params], h=0.01)
    np.testing.assert_array_equal(members.u[1, -1], second.integrate(h=0.01).u[-1])


def test_the_events_of_links_need_the_parameters_of_their_problem():
    """They read others at the places of these."""
    problem = eig3.linear([1.0], t_span=(0, 1), links=[(ElasticPlastic(1.0, 1.0), None, 0)])
    others = dict(reversed(problem.params._asdict().items()))
    with pytest.raises(TypeError, match=r"params must have the names and kinds of the problem of these events"):
        eig3.integrate(problem.rhs, (0, 1), [0.0], [0.0], params=others, z0=problem.z0, events=problem.events, h=0.1)


# Short loads

BLOW = np.array([0.0, 5.0, 5.0025, 5.005, 20.0])  # the record is padded with zeros
LONG = np.array([0.0, 5.0, 10.0, 15.0, 20.0])


def struck(times=BLOW, K=1.0):
    force = times, np.outer([0.0, 0.0, 1e3, 0.0, 0.0], [1.0, 1.0])
    return eig3.linear(np.ones(2), None, K and K * np.eye(2), force=force, t_span=(0, 20), u0=1.0)


@pytest.mark.parametrize("given", [{"rtol": 1e-6}, {"accuracy": 1e-4}, {"accuracy": 1e-4, "method": "rk4"}])
def test_no_step_jumps_over_a_blow(given):
    """Between blows the motion is smooth: the steps were a hundred times as long as a blow, and the error as large as
    the motion."""
    problem = struck()
    exact = problem.exact(20.0)[0][0]
    assert problem.integrate(**given).u[-1] == pytest.approx(exact, rel=0, abs=1e-4)
    beside = eig3.integrate(problem.rhs, (0, 20), problem.u0, problem.v0, params=problem.params, **given)
    assert beside.u[-1] == pytest.approx(exact, rel=0, abs=1e-4)


def test_h_max_replaces_the_limit_of_a_blow():
    assert struck().integrate(rtol=1e-6, h_max=20.0).n_steps < 100


def test_a_prepared_run_knows_the_blow_of_each_record():
    slow, fast = struck(LONG), struck(BLOW)
    run = slow.prepare(rtol=1e-6)
    assert run(params=fast.params).u[-1] == pytest.approx(fast.exact(20.0)[0][0], rel=0, abs=1e-4)
    assert run().n_steps == fast.prepare(rtol=1e-6)(params=slow.params).n_steps < 100


@pytest.mark.parametrize("m", [3, 20])  # one at a time, and in lanes
def test_members_know_the_blows_of_their_own_records(m):
    """A triangular load of the impulse I about the time t moves the free mass by I (20 - t)."""
    problem = struck(LONG, K=None)
    times = np.where(np.arange(m)[:, None] == 1, BLOW, LONG)
    found = problem.ensemble(params={"force_times": times}, rtol=1e-8, method="rk8")
    impulse, centre = 500 * (times[:, 3] - times[:, 1]), times[:, 2]
    np.testing.assert_allclose(found.u[:, -1, 0], 1 + impulse * (20 - centre), rtol=1e-5)
    assert (found.n_steps[[0, 2]] < 1000).all()  # the steps are held short while no load has acted
    assert found.n_steps[1] >= 20 / 0.0025


def test_a_fixed_step_that_jumps_over_a_blow_has_a_note():
    """No step has a sample of it: the lines between the steps have nothing of the record."""
    note = "h = 0.1 skips much of a record of loads: straight lines between the times that the method resolves "
    note += "differ from it by 100 % of its root mean square. Take h = 0.0025, or rtol."
    for given in ({}, {"check": True}, {"save_every": None}):
        assert note in struck().integrate(h=0.1, **given).notes[0]
    assert not struck().integrate(h=0.0025).notes
    assert not struck().integrate(h=0.1, t_end=4.9).notes
    assert not struck(LONG).integrate(h=0.1).notes


# Noise with the sampling 0.01 s; the smooth record has 60 samples in a period.
SAMPLED = np.arange(0, 10, 0.01)
NOISE, SMOOTH = np.random.default_rng(5).normal(size=1000), np.sin(10 * SAMPLED)


def shaken(record, times=SAMPLED):
    ground = times, record
    return eig3.linear(np.ones(1), None, [[400.0]], ground=ground, t_span=(0, 12), damping=eig3.Rayleigh(0.05, 20, 30))


def test_a_fixed_step_that_skips_much_of_a_ground_record_has_a_note():
    """A step that skips no sample has an error of its order alone: (20 h)^2 / 24 of the phase in each radian of the
    motion, which the damping ends after 1 / 0.05 radians, is below 4 % for EIG-3. White noise has as much load at the
    frequencies that are skipped, which appear at lower ones: the error is of the size of the motion.
    """
    problem, smooth = shaken(NOISE), shaken(SMOOTH)

    def error(run):
        exact = problem.exact(run.t)[0]
        return np.abs(run.u - exact).max() / np.abs(exact).max()

    rough, fine = problem.integrate(h=0.015), problem.integrate(h=0.01)
    assert "Take h = 0.01, or rtol." in rough.notes[0]
    assert error(rough) > 0.25
    assert not fine.notes
    assert error(fine) < 0.04
    assert not smooth.integrate(h=0.015).notes


@pytest.mark.parametrize(("evaluations", "h", "enough"), [(None, 0.019, 0.01), (4, 0.02, 0.01), (12, 0.04, 0.02)])
def test_methods_with_many_evaluations_resolve_half_a_step_of_a_record(evaluations, h, enough):
    given = np.asarray(shaken(NOISE).params), (0.0, 12.0)
    assert f"Take h = {enough}, or rtol." in skips(shaken(NOISE).rhs, *given, h, evaluations)
    assert not skips(shaken(NOISE).rhs, *given, enough, evaluations)


def test_the_note_about_a_skipped_record_is_one_for_all_members():
    given = {"params": {"ground_scale": np.ones(20)}}
    assert sum("skips much" in note for note in shaken(NOISE).ensemble(h=0.02, **given).notes) == 1
    assert not shaken(NOISE).ensemble(h=0.01, **given).notes
    own = {"ground": np.array([*[SMOOTH] * 3, NOISE])}
    found = shaken(SMOOTH).ensemble(params=own, h=0.02).notes
    assert [note[:31] for note in found] == ["h = 0.02 of member 3 skips much"]


def test_what_a_step_skips_of_a_record():
    """The error of a line over a step h, about a sine of the frequency w, is (w h)^2 / sqrt(120) of it."""
    t = np.linspace(0, 10, 100001)
    x, h, w = np.sin(2 * np.pi * t), 0.1, 2 * np.pi
    expected = (w * h) ** 2 / math.sqrt(120)
    # to the next term, of the fourth order
    assert _skipped(t, x[None], False, (0.0, 10.0), h) == pytest.approx(expected, rel=(w * h) ** 2)
    block = np.array([1.0, 2.0]), np.ones((1, 2))
    # a block gets the half of a step, with the mean square of a third, on each side
    assert _skipped(*block, False, (0.0, 9.0), 0.1) == pytest.approx(math.sqrt(2 * 0.1 / 3), rel=1e-9)
    ramp = np.array([1.0, 2.0]), np.array([[0.0, 1.0]])
    assert _skipped(*ramp, False, (0.0, 9.0), 0.1) == pytest.approx(math.sqrt(0.1), rel=1e-9)
    assert _skipped(*ramp, True, (0.0, 9.0), 0.1) == pytest.approx(0.0, abs=1e-9)  # the last value acts on
    # the first step along t^2 loses h^5 / 30, of h / 5 which is the mean in all of the record
    square = t[:10001] / t[10000], (t[None, :10001] / t[10000]) ** 2
    assert _skipped(*square, False, (0.0, 0.1), 0.1) == pytest.approx(0.1**2 / math.sqrt(6), rel=1e-6)


def test_the_note_about_a_jump_names_the_member():
    note = "skips much of a record of loads"
    of_all = struck().ensemble(u0=np.ones((3, 2)), h=0.1)
    of_steps = struck().ensemble(h=[0.001, 0.1, 0.05])
    of_records = struck().ensemble(params={"force_times": np.array([LONG, LONG, BLOW])}, h=0.1)
    for found, who in ((of_all, ""), (of_steps, " of member 1"), (of_records, " of member 2")):
        assert f"h = 0.1{who} {note}" in " ".join(found.notes)
    assert not struck().ensemble(h=[0.001, 0.0025]).notes


def test_one_influence_is_of_all_degrees_of_freedom():
    given = {"K": K, "t_span": (0, 1)}
    one, each = (eig3.linear(M, ground=(*GROUND, influence), **given) for influence in (0.5, np.full(N, 0.5)))
    assert one.params == each.params


def test_each_member_must_load_a_degree_of_freedom():
    """A number beyond them would be written to other memory."""
    with pytest.raises(ValueError, match="the degrees of force must be whole numbers from 0 to 5"):
        loaded().ensemble(params={"degrees": np.array([[0, 1], [0, 6]])}, h=0.01)


@pytest.mark.parametrize(
    "bad", [{"xi": -0.1}, {"xi": 5}, {"xi": np.nan}, {"xi": [0.1, 0.2, 0.3]}, {"omega1": 0.0}, {"omega2": 1.0}]
)
def test_bad_damping(bad):
    with pytest.raises(ValueError, match=r"^(xi|omega1 and omega2) must be "):
        eig3.Rayleigh(**{"xi": 0.05, "omega1": 1.0, "omega2": 2.0, **bad})
    with pytest.raises(ValueError, match=r"^(xi|modes) must be "):
        eig3.Modal(-0.1, 3) if "xi" in bad else eig3.Modal(0.1, 0)


# Closed forms --------------------------------------------------------------------------------------------------------

LATER = GROUND[0] + 0.2, GROUND[1], [1, 0] * 3
EXACT = {
    "free": ("numbers", {}),
    "Rayleigh": ("numbers", {"damping": eig3.Rayleigh(0.05, 1.0, 10.0), "ground": LATER, "force": TABLE}),
    "modal": ("consistent", {"damping": eig3.Modal([0.0, 0.3, 1.0, 2.0], 4), "ground": GROUND, "force": TABLE}),
}


@pytest.mark.parametrize(("mass", "given"), EXACT.values(), ids=EXACT)
def test_the_exact_motion_by_modes_is_that_of_small_steps(mass, given):
    """RK8 keeps its order: its steps end at the corners of the records."""
    problem = eig3.linear(MASSES[mass], None, stiffness(), t_span=(0, 1), u0=U0, v0=V0, **given)
    run = problem.integrate(h=0.001, method="rk8", invariants={})
    u, v = problem.exact(run.t)
    np.testing.assert_allclose(u, run.u, rtol=0, atol=1e-11 * np.abs(u).max())
    np.testing.assert_allclose(v, run.v, rtol=0, atol=1e-11 * np.abs(v).max())


FAINT = EXACT["Rayleigh"][1] | {"damping": eig3.Rayleigh(1e-8, 1.0, 10.0)}


@pytest.mark.parametrize("given", [{"ground": GROUND}, EXACT["Rayleigh"][1], FAINT])
def test_the_exact_motion_of_a_free_structure(given):
    """Without supports the centre of mass is pushed by the loads, against a damping that may be faint."""
    K = stiffness().toarray()
    K[0, 0] = 100.0  # no spring to the ground
    problem = eig3.linear(np.ones(N), None, K, t_span=(0, 1), u0=U0, v0=V0, **given)
    run = problem.integrate(h=0.001, method="rk8")
    np.testing.assert_allclose(problem.exact(run.t)[0], run.u, rtol=0, atol=1e-11)


def test_the_exact_motion_of_a_soft_mode_beside_a_stiff_spring():
    """Two masses on a stiff spring move together at omega = sqrt(1/2), 2e5 times slower than against each other.

    The square of this frequency has a round-off of at most 1e-16 of the largest square, 2e10, so 4e-6 of itself: the
    phase omega t = 7 then is off by at most 1.4e-5.
    """
    k = 1e10
    problem = eig3.linear([1.0, 1.0], None, [[k + 1, -k], [-k, k]], t_span=(0, 10), u0=1.0)
    t = np.linspace(0, 10, 21)
    np.testing.assert_allclose(problem.exact(t)[0][:, 0], np.cos(np.sqrt(0.5) * t), rtol=0, atol=1.4e-5)


def test_the_lowest_mode_of_a_free_structure_is_of_a_rigid_body():
    """Also where no other mode is known, and the mass coasts for long: its frequency is 0, and not round-off."""
    K = 1e10 * np.array([[3.0, -3.0, 0.0], [-3.0, 4.1, -1.1], [0.0, -1.1, 1.1]])
    problem = eig3.linear([0.1, 0.3, 0.7], None, K, t_span=(0, 1e4), v0=1.0)
    assert problem.modes(1).omega[0] == 0.0
    np.testing.assert_allclose(eig3.structures.modal_solution(problem, [1e4], modes=1)[0], 1e4, rtol=1e-12)


def test_a_changed_copy_has_its_own_exact_motion():
    mass, given = EXACT["modal"]
    problem = eig3.linear(MASSES[mass], None, stiffness(), t_span=(0, 1), u0=U0, v0=V0, **given)
    stronger = problem.params._replace(ground_scale=2.0)
    changes = {"u0": 2 * U0, "v0": -V0, "params": stronger, "t_span": (0.25, 1.0)}
    for changed in (*(problem.with_(**{name: value}) for name, value in changes.items()), problem.with_(**changes)):
        run = changed.integrate(h=0.001, method="rk8")
        np.testing.assert_allclose(changed.exact(run.t)[0], run.u, rtol=0, atol=1e-11)


GYROSCOPIC = np.diag(np.ones(N - 1), 1) - np.diag(np.ones(N - 1), -1)
UNKNOWN = {
    "C": ({"C": GYROSCOPIC}, r"C may couple the modes: eig3\.structures\.modal_solution"),
    "force": ({"force": gap, "params": {"gap": 1.0}}, "the force is a function"),
    "K": ({"K": None}, "it has no K"),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_exact_motion_that_is_not_known_says_why(name):
    given, message = UNKNOWN[name]
    problem = eig3.linear(np.ones(N), **{"K": stiffness(), **given}, t_span=(0, 1), u0=U0)
    for each in (problem, problem.with_(u0=2 * U0)):
        assert not each.exact
        with pytest.raises(ValueError, match=f"^the exact motion of this structure is not known, because {message}"):
            each.exact(1.0)


def test_the_exact_motion_of_another_structure_is_not_known():
    """Its modes, and the factors of its mass, follow from what eig3.linear gets."""
    problem = eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1), u0=U0)
    stiffer = problem.with_(params=problem.params._replace(K=2 * stiffness()))
    assert not stiffer.exact
    with pytest.raises(ValueError, match=r"K, its mass or its modes have changed: make .* with eig3\.linear"):
        stiffer.exact(1.0)


def test_what_modes_and_factors_are_computed_from_cannot_change_alone():
    """The damping would keep the old modes, and the motion the old mass."""
    damped = eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1), u0=U0, damping=eig3.Modal(0.1, 2))
    coupled = eig3.linear(consistent(), None, stiffness(), t_span=(0, 1), u0=U0)
    heavy = np.ones((2, N))
    heavy[1, 0] = 1.1
    softer = damped.params._replace(K=0.9 * stiffness())
    for refused, names in (
        (lambda: damped.with_(params={"m": heavy[1]}), "K and m"),
        (lambda: damped.with_(params=softer), "K and m"),
        (lambda: damped.ensemble(params={"m": heavy}, h=0.01), "K and m"),
        (lambda: damped.prepare(h=0.01)((0, 1), U0, 0 * U0, softer), "K and m"),
        (lambda: coupled.with_(params={"M": 2 * consistent()}), "M"),
    ):
        with pytest.raises(ValueError, match=rf"^params must keep {names}, because .* with eig3\.linear"):
            refused()
    assert damped.with_(params={"m": heavy[0]}).integrate(h=0.01).success
    assert coupled.with_(params={"K": 2 * stiffness()}).integrate(h=0.01).success


def test_each_member_has_positive_masses_and_times_that_increase():
    problem = eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1), u0=U0, ground=GROUND, force=TABLE)
    for name, bad, rule in (
        ("m", -np.ones(N), "be positive"),
        ("m", np.full(N, np.nan), "be positive"),
        ("ground_times", GROUND[0][::-1], "increase"),
        ("force_times", 0 * TABLE[0], "increase"),
    ):
        with pytest.raises(ValueError, match=rf"^params\['{name}'\] must {rule}, but the values of member 1 do not"):
            problem.ensemble(params={name: [getattr(problem.params, name), bad]}, h=0.01)


def test_modal_solutions_of_changed_problems_and_of_some_modes():
    C = 0.002 * stiffness() + 0.1 * scipy.sparse.eye_array(N)
    problem = eig3.linear(np.ones(N), C, stiffness(), t_span=(0, 1), u0=U0)
    t = np.linspace(0, 1, 11)
    _, shapes = natural_modes(check_mass(np.ones(N), None), stiffness(), N)
    for start in (U0, 2 * U0):
        changed = problem.with_(u0=start)
        u, _ = eig3.structures.modal_solution(changed, t)
        np.testing.assert_allclose(u[-1], exact(np.eye(N), C.toarray(), stiffness().toarray(), start, 0 * U0, 1.0))
        first, _ = eig3.structures.modal_solution(changed, t, modes=1)
        np.testing.assert_allclose(first, np.outer(u @ shapes[:, 0], shapes[:, 0]), rtol=0, atol=1e-12)
    for bad, error, message in (
        (eig3.problems.bouncing_ball(), TypeError, r"problem must be a problem of eig3\.linear"),
        (
            problem.with_(params=problem.params._replace(C=np.diag(1.0 + np.arange(N)) * scipy.sparse.eye_array(N))),
            ValueError,
            "C couples the modes",
        ),
        (eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1), force=gap), ValueError, "the force of this problem"),
    ):
        with pytest.raises(error, match=f"^{message}"):
            eig3.structures.modal_solution(bad, t)
    with pytest.raises(ValueError, match=r"^t must be finite times from the start 0 on"):
        eig3.structures.modal_solution(problem, [-1.0])


def test_base_shear_drifts_and_absolute_motion():
    names = [f"floor {k}" for k in range(1, N + 1)]
    problem = eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1.5), ground=GROUND, names=names)
    drifts = eig3.structures.storey_drifts(problem, names)
    run = problem.integrate(
        h=1e-3, method="rk8", outputs={"shear": eig3.structures.base_shear(problem), "drifts": drifts}
    )
    np.testing.assert_allclose(run.outputs["drifts"], np.diff(run.u, axis=1, prepend=0), rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.outputs["shear"], 100 * run.u[:, 0], rtol=0, atol=1e-10)  # the spring to the ground
    u, v, a = eig3.structures.absolute_motion(problem, run)
    # Newton's law for all masses together: the spring to the ground is the only force
    np.testing.assert_allclose(a.sum(axis=1), -run.outputs["shear"], rtol=0, atol=1e-10)
    moved, speed, _ = eig3.structures.ground_motion(problem, [1.0, 1.5])
    assert speed[0] == pytest.approx(np.trapezoid(GROUND[1], GROUND[0]), rel=1e-14)
    assert moved[1] - moved[0] == pytest.approx(0.5 * speed[0], rel=1e-13)
    np.testing.assert_allclose(u[-1] - run.u[-1], moved[1], rtol=1e-12)
    np.testing.assert_allclose(np.gradient(u[:, 0], run.t)[500], v[500, 0], rtol=1e-4)


@pytest.mark.parametrize("options", [{"h": 1e-2, "save_every": 1}, {"rtol": 1e-6, "method": "rk8", "save_every": 1}])
def test_the_absolute_motion_of_members_has_the_ground_of_each(options):
    """A structure that is at rest before its record moves in proportion to the record."""
    problem = eig3.linear(np.ones(N), None, stiffness(), t_span=(0, 1.5), ground=GROUND)
    scales = [0.5, 1.0, 2.0]
    runs = problem.ensemble(params={"ground_scale": scales}, **options)
    together = eig3.structures.absolute_motion(problem, runs)
    assert together[0].shape == runs.u.shape
    for i, scale in enumerate(scales):
        changed = problem.with_(params=problem.params._replace(ground_scale=scale))
        expected = eig3.structures.absolute_motion(changed, changed.integrate(**options))
        alone = eig3.structures.absolute_motion(problem, runs[i])
        for x, y, z in zip(expected, alone, together, strict=True):
            np.testing.assert_allclose(y, x, rtol=0, atol=1e-12)
            np.testing.assert_array_equal(z[i, : len(y)], y)
            assert np.isnan(z[i, len(y) :]).all()
    longer = problem.params._asdict() | {"ground_times": 2 * GROUND[0][:5], "ground": GROUND[1][:5]}
    other = problem.with_(params=eig3.Parameters(longer))
    run = problem.prepare(h=1e-2)(params=longer)
    np.testing.assert_array_equal(
        eig3.structures.absolute_motion(problem, run), eig3.structures.absolute_motion(other, run)
    )
    copied = pickle.loads(pickle.dumps(runs))
    with pytest.raises(ValueError, match=r"^solution must have its right-hand side, for the accelerations"):
        eig3.structures.absolute_motion(problem, copied)
