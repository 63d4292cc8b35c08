"""Frames and trusses: closed forms of statics and of vibrations, large rotations, the ready frame, and errors."""

import numpy as np
import pytest
import scipy.sparse.linalg
from scipy.spatial.transform import Rotation

import eig3
from eig3.effects import ElasticPlastic
from eig3.structures import Frame, Section
from eig3.structures.matrices import check_mass
from eig3.structures.modes import natural_modes

from .conftest import refusals

L = 4.0
SECTION = Section(E=2e11, A=1e-2, I=1e-5, density=7800.0)
IN_SPACE = Section(E=2e11, A=1e-2, I=1e-5, density=7800.0, I_side=4e-5, G=8e10, J=3e-5)
UNIT = np.sqrt(SECTION.E * SECTION.I / (SECTION.density * SECTION.A * L**4))


def line(n, section=SECTION, along=(1.0, 0.0), hinges=False):
    frame = Frame(len(along))
    for k in range(n + 1):
        frame.node(f"n{k}", *(np.array(along) * k * L / n))
    for k in range(n):
        releases = ["start"] * (hinges and k == 0) + ["end"] * (hinges and k == n - 1)
        frame.member(f"n{k}", f"n{k + 1}", section, releases=releases)
    return frame


def frequencies(frame, count):
    M, K = frame.matrices
    return natural_modes(check_mass(M, None), K, count)[0]


def test_the_frequencies_of_a_cantilever_converge_to_the_closed_form():
    """cos(x) cosh(x) = -1; the error of lumped masses falls with the square of the length of a member."""
    errors = []
    for n in (20, 40):
        frame = line(n)
        frame.support("n0")
        errors.append(frequencies(frame, 2) / UNIT / np.square([1.8751040687, 4.6940911330]) - 1)
    assert np.abs(errors[1]).max() < 2e-3
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.05)


def test_a_beam_on_hinges():
    frame = line(40, hinges=True)
    frame.support("n0")
    frame.support("n40")
    np.testing.assert_allclose(frequencies(frame, 2) / UNIT, np.square([np.pi, 2 * np.pi]), rtol=2e-3)


def test_a_cantilever_in_space_bends_with_both_stiffnesses():
    frame = line(20, IN_SPACE, np.array([1.0, 2.0, 2.0]) / 3)
    frame.support("n0")
    plane = line(20)
    plane.support("n0")
    first = frequencies(plane, 1)[0]
    np.testing.assert_allclose(frequencies(frame, 2), [first, 2 * first], rtol=1e-8)  # I_side is 4 I


def test_a_truss_of_two_bars_carries_a_load():
    """Bars at 45 degrees: the load moves the joint by P a / (E A) times 2 / sqrt(2), with the length a of a bar."""
    frame = Frame()
    for name, place in {"left": (-1, 1), "right": (1, 1), "joint": (0, 0)}.items():
        frame.node(name, *place)
    for name in ("left", "right"):
        frame.support(name)
        frame.member(name, "joint", Section(E=2e11, A=1e-3))
    assert frame.names == ("joint.ux", "joint.uy")  # rotations of hinges are no degrees of freedom
    u = scipy.sparse.linalg.spsolve(frame.matrices[1].tocsc(), [0.0, -1e4])
    np.testing.assert_allclose(u, [0.0, -1e4 * np.sqrt(2) / 2e8], rtol=1e-12, atol=1e-18)


def test_a_cantilever_in_space_carries_forces_and_torque():
    frame = line(3, IN_SPACE, (0.0, 1.0, 0.0))
    frame.support("n0")
    u = {}
    for direction, load in {"uz": 100.0, "ux": 100.0, "uy": 1e5, "ry": 50.0}.items():
        loads = np.array([load * (name == f"n3.{direction}") for name in frame.names])
        u[direction] = scipy.sparse.linalg.spsolve(frame.matrices[1].tocsc(), loads)[
            frame.names.index(f"n3.{direction}")
        ]
    s = IN_SPACE
    expected = {
        "uz": 100 * L**3 / (3 * s.E * s.I),  # in the plane of the member and of up, z
        "ux": 100 * L**3 / (3 * s.E * s.I_side),
        "uy": 1e5 * L / (s.E * s.A),
        "ry": 50 * L / (s.G * s.J),
    }
    assert u == pytest.approx(expected, rel=1e-9)


def test_the_frequency_by_members_is_a_bound():
    frame = line(10)
    frame.support("n0")
    frame.mass("n10", 50.0)
    highest = frequencies(frame, 30)[-1]
    assert highest <= frame.highest_frequency() < 1.3 * highest
    for damping in (None, eig3.Rayleigh(0.02, 100.0, 1e4), eig3.Modal(0.3, 30)):
        problem = frame.problem((0, 1), damping=damping)
        critical = problem.critical_step()
        assert 0.6 * critical.limit < problem.h < critical.limit
    assert frame.problem((0, 1)).critical_step().omega_max == pytest.approx(highest, rel=1e-5)


# Frequencies, rad/s, that OpenSees 3.7.1 prints for frames of its elasticBeamColumn: eigen("-fullGenLapack", n).
OF_OPENSEES = {
    "cantilever": [35.13102144, 218.9140639, 608.632195, 1181.820845],
    "portal": [48.09409658, 266.4704754, 356.753034, 357.4957901, 631.7137586, 714.2538523],
    "in space": [8.589779044, 10.54135348, 25.71126597, 31.3551572, 53.95054598, 72.05677549],
}


def storey():
    frame = Frame()
    for name, x, y in (("a", 0, 0), ("b", 6, 0), ("c", 0, 3.3), ("d", 6, 3.3)):
        frame.node(name, x, y)
    column, beam = Section(2.1e11, 2.4e-2, 8e-4), Section(2.1e11, 1.2e-2, 4.8e-4)
    for start, end, section in (("a", "c", column), ("b", "d", column), ("c", "d", beam)):
        frame.member(start, end, section)
    for name in "ab":
        frame.support(name)
    for name in "cd":
        frame.mass(name, 12e3, 600.0)
    return frame


def mast():
    section = Section(2e11, 1e-2, I=4e-5, I_side=1e-5, G=8e10, J=3e-5)
    frame = Frame(3)
    for name, place in {"a": (0, 0, 0), "b": (0, 0, 3), "c": (2, 0, 3), "d": (2, 1.5, 3)}.items():
        frame.node(name, *place)
    for start, end, up in (("a", "b", (0, 1, 0)), ("b", "c", (1, 0, 0)), ("c", "d", (0, 0, 1))):  # b to c uses z
        frame.member(start, end, section, up=up)
    frame.support("a")
    for name in "bcd":
        frame.mass(name, 500.0, 20.0)
    return frame


def test_frequencies_are_those_of_opensees_to_the_printed_digits():
    cantilever = line(20)
    cantilever.support("n0")
    for name, frame in {"cantilever": cantilever, "portal": storey(), "in space": mast()}.items():
        np.testing.assert_allclose(frequencies(frame, len(OF_OPENSEES[name])), OF_OPENSEES[name], rtol=5e-10)


def test_a_response_is_that_of_opensees():
    """Newmark's method with steps of 1e-3, 1e-4 and 1e-5 s: its error falls with h^2, and the last is 3e-11 m."""
    frame, times = storey(), np.linspace(0, 2, 201)
    M, K = frame.matrices
    C = 0.3 * np.diag(M) + 1e-4 * K.toarray()
    ground = times, 2 * np.sin(4 * times), np.array([1.0, 0, 0, 1, 0, 0])
    problem = eig3.linear(M, C, K, ground=ground, t_span=(0, 1))
    u = problem.integrate(h=1e-3, method="rk8").u[-1]
    np.testing.assert_allclose(u[3:], [0.0006100237719, -4.054205965e-06, -0.0001858638844], rtol=1e-7)
    np.testing.assert_allclose(eig3.structures.modal_solution(problem, 1.0)[0][0], u, rtol=1e-11)


# Rotations without inertia, and modes --------------------------------------------------------------------------------


def column(inertia=0.0):
    """A column without weight, with a mass at its top."""
    frame = Frame()
    frame.node("foot", 0.0, 0.0)
    frame.node("top", 0.0, L)
    frame.member("foot", "top", Section(E=2e11, A=1e-2, I=1e-5))
    frame.support("foot")
    frame.mass("top", 500.0, inertia)
    return frame


def test_a_rotation_without_inertia_is_condensed():
    """A column of the stiffness 3 E I / L^3 for a force at its top, and E A / L along its axis."""
    assert column().names == ("top.ux", "top.uy")
    sideways, along = np.sqrt(3 * 2e11 * 1e-5 / (500 * L**3)), np.sqrt(2e11 * 1e-2 / (500 * L))
    np.testing.assert_allclose(column().modes(2).omega, [sideways, along], rtol=1e-12)
    assert column().highest_frequency() == pytest.approx(along, rel=1e-12)
    problem = column().problem((0.0, 1.0), u0=[0.01, 0.0])
    solution = problem.integrate(h=problem.h / 8, method="rk8")
    np.testing.assert_allclose(solution.u[:, 0], 0.01 * np.cos(sideways * solution.t), rtol=0, atol=1e-9)
    assert column(1.0).names == ("top.ux", "top.uy", "top.rz")


def test_a_condensed_frame_is_the_limit_of_a_small_inertia():
    """The relative error of a frequency is about the inertia over the mass times the square of a length."""
    massless = storey()
    massless._inertias.clear()
    small = storey()
    small._inertias.update(c=1e-3, d=1e-3)
    assert massless.names == ("c.ux", "c.uy", "d.ux", "d.uy")
    np.testing.assert_allclose(massless.modes(4).omega, small.modes(4).omega, rtol=1e-7)
    problem = massless.problem((0.0, 1.0), damping=eig3.Rayleigh(0.02, modes=(1, 2)))
    assert 0.85 < problem.h / problem.critical_step().limit < 0.95  # the factor is 0.9


def test_a_rotation_without_inertia_that_nothing_holds_is_refused():
    """The beam can turn about its axis without a force."""
    frame = Frame(3)
    for k in range(3):
        frame.node(f"n{k}", float(k), 0.0, 0.0)
    for k in range(2):
        frame.member(f"n{k}", f"n{k + 1}", Section(E=2e11, A=1e-2, I=1e-5, G=8e10, J=3e-5, I_side=1e-5))
    for name in ("n0", "n2"):
        frame.support(name, "ux uy uz")
    frame.mass("n1", 1.0)
    with pytest.raises(ValueError, match="a rotation without inertia moves without a force: support it"):
        frame.modes(1)
    frame.support("n0", "rx")
    sideways = np.sqrt(48 * 2e11 * 1e-5 / 2.0**3)
    np.testing.assert_allclose(frame.modes(2).omega, sideways, rtol=1e-10)


def test_a_frame_has_the_modes_of_its_problem():
    frame = storey()
    record = np.array([0.0, 1.0]), np.zeros(2)
    modes = frame.modes(6)
    np.testing.assert_allclose(modes.omega, OF_OPENSEES["portal"], rtol=5e-10)
    again = frame.problem((0, 1), ground=record).modes(6)
    np.testing.assert_array_equal(again.shapes, modes.shapes)
    np.testing.assert_array_equal(again.participation, modes.participation)
    assert modes.effective_masses.sum() == pytest.approx(modes.total_mass, rel=1e-12)
    assert modes.total_mass == 24e3
    assert frame.modes(6, "uy").effective_masses[0] < 1e-3 * modes.effective_masses[0]


# Corotational members ------------------------------------------------------------------------------------------------


def state(frame, **values):
    """Return numbers for the degrees of freedom, from functions of the number of the node."""
    split = (name.split(".") for name in frame.names)
    return np.array([values[direction](int(node[1:])) for node, direction in split])


def test_a_moment_rolls_a_beam_into_a_circle():
    """The moment of a member whose ends turn by the angle phi against each other is E I phi / length."""
    n = 8
    frame, phi, length = line(n), 2 * np.pi / n, L / n
    corners = np.concatenate([[0], np.cumsum(length * np.exp(1j * (phi * np.arange(n) + phi / 2)))])
    u0 = state(frame, ux=lambda k: corners[k].real - k * length, uy=lambda k: corners[k].imag, rz=lambda k: phi * k)
    problem = frame.problem((0, 1e-6), corotational=True, u0=u0)
    forces = problem.integrate(h=1e-6).a[0] * problem.params.m
    moment = SECTION.E * SECTION.I * phi / length
    expected = state(frame, ux=lambda k: 0, uy=lambda k: 0, rz=lambda k: moment * ((k == 0) - (k == n)))
    np.testing.assert_allclose(forces, expected, rtol=0, atol=1e-9 * SECTION.E * SECTION.A)


def test_a_beam_that_turns_freely_keeps_its_energy_and_momentum():
    frame, rate = line(4, Section(E=1e7, A=1e-2, I=1e-4, density=1000.0)), 2 * np.pi
    v0 = state(frame, ux=lambda k: 0, uy=lambda k: rate * (k - 2), rz=lambda k: rate)
    problem = frame.problem((0, 1), corotational=True, v0=v0)
    run = problem.integrate(rtol=1e-9)
    assert run.drift["energy"] < 1e-8 * problem.energy_of(run.u[0], run.v[0])
    places, m = frame.places(run.u), problem.params.m
    assert np.abs(run.u[-1, 2::3] - 2 * np.pi).max() < 0.2  # almost a turn: the beam is longer while it turns
    x, y = places[..., 0] - L / 2, places[..., 1]
    momentum = (x * run.v[:, 1::3] - y * run.v[:, ::3]) @ m[::3] + run.v[:, 2::3] @ m[2::3]
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-7)


# Corotational members in space ---------------------------------------------------------------------------------------

OBLIQUE = np.array([1.0, 2.0, 2.0]) / 3
SOFT = Section(E=1e7, A=1e-2, I=1e-4, density=1000.0, I_side=2e-4, G=4e6, J=3e-4)


def crane(fixed=""):
    """Return a mast on a support with a jib, which is on a hinge, and held by a bar."""
    frame = Frame(3)
    for name, place in {"a": (0, 0, 0), "b": (0, 0, 3), "c": (2, 0, 3), "d": (2, 1.5, 3), "e": (3, 1, 0)}.items():
        frame.node(name, *place)
    frame.member("a", "b", IN_SPACE, up=(0, 1, 0))
    frame.member("b", "c", IN_SPACE, releases="start")
    frame.member("d", "c", IN_SPACE)
    frame.member("d", "e", Section(E=2e11, A=1e-3, density=7800.0))
    for name in "ae":
        frame.support(name)
    if fixed:
        frame.support("b", fixed)
    return frame


def rates(turn):
    """Return T, which takes the rates of a rotation vector to the angular velocity."""
    r, x = np.linalg.norm(turn), np.cross(np.eye(3), turn)
    if r == 0:
        return np.eye(3)
    return np.eye(3) + (1 - np.cos(r)) / r**2 * x + (r - np.sin(r)) / r**3 * x @ x


def angular_velocity(turn, rate):
    return np.array([rates(x) @ y for x, y in zip(turn, rate, strict=True)])


def strain_energy(p, u):
    """Return what the page of the members says, from the rotations of SciPy."""
    total = 0.0
    for ends, rest, axes, k in zip(p.ends, p.chords, p.axes, p.stiffness, strict=True):
        parts = np.where(ends < 0, 0.0, u[ends]).reshape(4, 3)
        now = rest + parts[2] - parts[0]
        a, b = (Rotation.from_rotvec(turn).apply(axes.reshape(3, 3).copy()) for turn in (parts[1], parts[3]))
        bent = []
        for own in (a, b):
            c = own @ now / np.linalg.norm(now)
            across = np.cross(c, [1.0, 0.0, 0.0])
            s = np.linalg.norm(across)
            bent.append(across * (np.arctan2(s, c[0]) / s if s > 0 else 1.0))
        x, _, _, w = Rotation.from_matrix(a @ b.T).as_quat()
        strains = np.array([np.linalg.norm(now) - np.linalg.norm(rest), 0, 0, 0, 0, 2 * np.arctan(x / w)])
        strains[1:5] = bent[0][2], bent[1][2], bent[0][1], bent[1][1]
        total += strains @ k.reshape(6, 6) @ strains / 2
    return total


def spinning(turn=None, t_end=0.8):
    """Return a free beam in space that spins about an oblique axis, bends and twists; all of it may be turned."""
    frame = line(3, SOFT, OBLIQUE)
    turn = Rotation.identity() if turn is None else turn
    places, spin = frame.places(np.zeros(24))[0], np.array([3.0, -4.0, 2.0])
    turns = np.outer(np.arange(4), [0.05, 0.08, -0.03])
    v, rate = np.cross(spin, places) + OBLIQUE, spin + 4 * turns
    turned = (turn * Rotation.from_rotvec(turns)).as_rotvec()
    u0 = np.hstack([turn.apply(places) - places, turned])
    v0 = np.hstack(
        [turn.apply(v), [np.linalg.solve(rates(x), y) for x, y in zip(turned, turn.apply(rate), strict=True)]]
    )
    problem = frame.problem((0, t_end), corotational=True, u0=u0.ravel(), v0=v0.ravel())
    return frame, problem


def test_the_forces_of_members_in_space_are_the_gradient_of_their_energy():
    frame = crane()
    names, rng = frame.names, np.random.default_rng(5)
    for size in (1e-3, 0.3, 1.2):
        u = size * rng.standard_normal(len(names))
        problem = frame.problem((0, 1e-9), corotational=True, u0=u)
        a, p, d = problem.integrate(h=1e-9).a[0], problem.params, 1e-5
        forces = -p.m * a
        for i in p.rotations:  # dU = moment . T dturn, and the moment is J T a
            T = rates(u[i : i + 3])
            forces[i : i + 3] = T.T @ T @ forces[i : i + 3]
        gradient = [(strain_energy(p, u + d * e) - strain_energy(p, u - d * e)) / (2 * d) for e in np.eye(u.size)]
        np.testing.assert_allclose(forces, gradient, rtol=0, atol=1e-6 * np.abs(forces).max())


def test_small_motions_of_corotational_members_in_space_are_those_of_the_linear_frame():
    beam = line(3, IN_SPACE, OBLIQUE, hinges=True)
    beam.support("n0")
    beam.support("n3")
    for frame in (beam, crane()):
        v0 = 1e-3 * np.random.default_rng(2).standard_normal(len(frame.names))
        turning, linear = (frame.problem((0, 0.02), corotational=choice, v0=v0) for choice in (True, False))
        u = linear.integrate(h=1e-5).u
        np.testing.assert_allclose(turning.integrate(h=1e-5).u, u, rtol=0, atol=1e-4 * np.abs(u).max())


def test_a_beam_that_spins_in_space_keeps_its_energy_and_momentum():
    frame, problem = spinning()
    run, p = problem.integrate(rtol=1e-9), problem.params
    assert run.drift["energy"] < 1e-8 * problem.energy_of(run.u[0], run.v[0])
    assert np.linalg.norm(run.u[-1, 3:6]) > 3.5
    m, J = p.m.reshape(-1, 6)[:, :1], p.m.reshape(-1, 6)[:, 3:]
    energies, moments = [], []
    for u, v, places in zip(run.u, run.v, frame.places(run.u), strict=True):
        speed, omega = v.reshape(-1, 6)[:, :3], angular_velocity(u.reshape(-1, 6)[:, 3:], v.reshape(-1, 6)[:, 3:])
        energies.append((m * speed**2 + J * omega**2).sum() / 2 + strain_energy(p, u))
        moments.append([*(m * speed).sum(0), *(m * np.cross(places, speed) + J * omega).sum(0)])
    elastic = [strain_energy(p, u) for u in run.u]
    assert np.ptp(elastic) > 0.01 * energies[0]
    np.testing.assert_allclose(energies, energies[0], rtol=1e-7)
    np.testing.assert_allclose(problem.energy_of(run.u, run.v), energies, rtol=1e-9)
    np.testing.assert_allclose(
        moments, np.tile(moments[0], (len(moments), 1)), rtol=0, atol=1e-7 * np.abs(moments).max()
    )


def test_a_motion_in_space_does_not_depend_on_the_direction():
    turn, ends = Rotation.from_rotvec([0.4, -0.7, 0.5]), []
    for each in (Rotation.identity(), turn):
        frame, problem = spinning(each, t_end=0.2)
        u = problem.integrate(rtol=1e-11).u[-1]
        ends.append((frame.places(u)[0], Rotation.from_rotvec(u.reshape(-1, 6)[:, 3:])))
    np.testing.assert_allclose(ends[1][0], turn.apply(ends[0][0]), rtol=0, atol=1e-8)
    assert (ends[1][1] * (turn * ends[0][1]).inv()).magnitude().max() < 1e-8


def test_a_motion_in_a_plane_of_space_is_that_of_the_plane_frame():
    section, runs = Section(E=1e7, A=1e-2, I=1e-4, density=1000.0), []
    for along in ((1.0, 0.0), (1.0, 0.0, 0.0)):
        frame = line(4, section, along)
        frame.support("n0")
        still = dict.fromkeys(("ux", "uz", "rx", "ry"), lambda k: 0)
        v0 = state(frame, uy=lambda k: 6.0 * k**2 / 4, rz=lambda k: 3.0 * k, **still)
        u = frame.problem((0, 0.3), corotational=True, v0=v0).integrate(rtol=1e-11).u[-1]
        runs.append(u if len(along) == 2 else u[[name.endswith((".ux", ".uy", ".rz")) for name in frame.names]])
    assert np.abs(runs[0]).max() > 2
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-8)


def test_a_run_in_space_ends_where_a_node_has_turned_once():
    frame = line(1, SOFT, (1.0, 0.0, 0.0))
    v0 = state(frame, **dict.fromkeys(("ux", "uy", "uz", "ry", "rz"), lambda k: 0), rx=lambda k: 3.0)
    problem = frame.problem((0, 3), corotational=True, v0=v0)
    run, fixed = problem.integrate(rtol=1e-6), problem.integrate(h=1e-3)
    assert run.status is eig3.Status.STEP_TOO_SMALL
    assert fixed.status is eig3.Status.DIVERGED
    for each, error in ((run, 1e-6), (fixed, 2e-3)):  # the fixed run ends within two steps
        assert each.t[-1] == pytest.approx(2 * np.pi / 3, abs=error)
        for text in (each.message, each.explain()):
            assert "a node has rotated by 2 pi" in text
    slow = problem.ensemble(v0=np.outer([1.0, 0.5], v0), h=1e-3, save_every=None)  # which turns by half of it
    assert ["a node has rotated by 2 pi" in text for text in slow.message] == [True, False]
    assert "The force of the problem is not vectorised: it calls atan2" in slow.notes[0]


def test_an_unstable_step_is_no_whole_turn():
    """Nodes swing by radians in a step before the motion ends, and one of them may be near 2 pi."""
    problem = line(3, SOFT, (1.0, 0.0, 0.0)).problem((0, 3), corotational=True)
    v0 = 0.1 * np.random.default_rng(1).standard_normal(len(problem.u0))
    run = problem.with_(v0=v0).integrate(h=1.02 * problem.critical_step().limit, t_end=40.0, save_every=None)
    assert "rotated by 2 pi" not in run.message
    assert "the critical step of EIG3" in run.explain()


# The ready frame and errors ------------------------------------------------------------------------------------------


def test_the_ready_frame_moves_as_its_modes():
    problem = eig3.problems.ten_storey_frame(t_end=8.0)
    run = problem.integrate(h=problem.h)
    largest = np.abs(run.u).max()
    assert 0.01 < largest < 1.0
    assert np.abs(run.u - problem.exact(run.t)[0]).max() < 1e-4 * largest
    assert problem.units[:3] == ("m", "m", "rad")
    shear = eig3.structures.base_shear(problem)
    drifts = eig3.structures.storey_drifts(problem, [f"{k}A.ux" for k in range(1, 11)])
    with pytest.raises(ValueError, match=r"^the problem has no 1A\.xu: did you mean 1A\.uy or 1A\.ux or 10A\.uy\?$"):
        eig3.structures.storey_drifts(problem, ["1A.xu"])
    with pytest.raises(ValueError, match=r"^the problem has no attic: did you mean (\S+ or ){8}one of \d+ others\?$"):
        eig3.structures.storey_drifts(problem, ["attic"])
    with pytest.raises(ValueError, match=r"^floors must be numbers from 0 to 1, or names, not 'roof'\.$"):
        eig3.structures.storey_drifts(eig3.linear([1.0, 1.0], t_span=(0, 1)), ["roof"])
    outputs = problem.integrate(h=problem.h, t_end=2.0, outputs={"shear": shear, "drifts": drifts}).outputs
    assert np.abs(outputs["shear"]).max() > 1e3
    assert outputs["drifts"].shape[1] == 10


def portal(**changes):
    frame = Frame()
    frame.node("a", 0.0, 0.0)
    frame.node("b", 0.0, 3.0)
    frame.member("a", "b", changes.get("section", SECTION))
    frame.support("a")
    return frame


WEIGHTLESS = Section(2e11, 1e-2, 1e-5)
BAD_VALUES = {
    "dimension must be 2 or 3, not 4": lambda: Frame(4),
    "there is a node a already": lambda: portal().node("a", 1.0, 0.0),
    "the place of c must have 2 finite coordinates, such as .*, 0, 1": lambda: portal().node("c", [1.0, 2.0]),
    "the frame has no c: did you mean a or b": lambda: portal().member("a", "c", SECTION),
    "the member from a to a must have a length": lambda: portal().member("a", "a", SECTION),
    "releases must be some of": lambda: portal().member("a", "b", SECTION, releases="middle"),
    "up must be a direction in space": lambda: portal().member("a", "b", SECTION, up=[0, 0, 0]),
    "m and inertia must be at least 0": lambda: portal().mass("b", -1.0),
    "b has no uz: did you mean uy or ux": lambda: portal().support("b", "uz"),
    "the frame must have at least one member": lambda: Frame().names,
    r"b\.ux must have a mass": lambda: portal(section=WEIGHTLESS).problem((0, 1)),
    r"b\.ux must have a mass: give its members": lambda: portal(section=WEIGHTLESS).highest_frequency(),
    "the ground has no rz": lambda: portal().modes(1, "rz"),
    "modes must be at most the": lambda: portal().modes(1000),
    "E must be a positive number": lambda: Section(0.0, 1.0),
    "I must be a number of at least 0": lambda: Section(1.0, 1.0, -1.0),
    "I_side must be a number of at least 0": lambda: Section(1.0, 1.0, 1.0, I_side=-1.0),
    'releases must be some of "start" and': lambda: portal().member("a", "b", SECTION, releases=True),
    "the ground has no uz: did you mean": lambda: portal().problem((0, 1), ground=([0, 1], [0, 1]), direction="uz"),
    r"corotational members in space need all rotations of b fixed, or none\.$": lambda: crane("ry").problem(
        (0, 1), corotational=True
    ),
    "force, work and params are for linear frames": lambda: portal().problem((0, 1), corotational=True, work=True),
}
BAD_TYPES = {
    "the name of a node must be a text without a point": lambda: portal().node("c.d", 1.0, 0.0),
    "directions must be a text": lambda: portal().support("b", ["ux"]),
    "hinges must be a dictionary": lambda: portal().member("a", "b", SECTION, hinges=ElasticPlastic(1.0, 1.0)),
    "C of a frame comes from its nodes and members": lambda: portal().problem((0, 1), C=np.eye(3)),
    r"ground of a frame must be \(times, accelerations\)": lambda: portal().problem(
        (0, 1), ground=([0, 1], [0, 1], np.ones(3))
    ),
    r"section must be an eig3\.structures\.Section": lambda: portal().member("a", "b", 3.0),
}


test_bad_frames = refusals(BAD_VALUES, BAD_TYPES)
