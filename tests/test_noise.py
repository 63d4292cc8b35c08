"""Noise by counts: NumPy's bits, its distribution, its spectral density, and the response of a linear oscillator."""

import numba
import numpy as np
import pytest
import scipy.linalg
import scipy.signal
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3.kernels.philox import block

OMEGA, XI, DT = 2.0, 0.1, 0.0625  # dt is a power of 2, so that steps end at its multiples


@numba.njit
def numbers(seed, member, k):
    zero = np.uint64(0)
    return block(seed, member, k, zero, zero)


WORD = st.integers(0, 2**64 - 1)


@settings(deadline=None)
@given(WORD, WORD, st.integers(0, 2**64 - 2))
def test_the_bits_are_those_of_numpy(seed, member, k):
    key, counter = np.array([seed, member], dtype=np.uint64), np.array([k, 0, 0, 0], dtype=np.uint64)
    expected = np.random.Philox(key=key, counter=counter).random_raw(2)
    np.testing.assert_array_equal(np.array(numbers(*key, counter[0]), dtype=np.uint64), expected)


def test_the_numbers_are_normal_and_independent():
    """The tests of Kolmogorov and Smirnov reject at a level of 1e-3; correlations are within 4 standard errors."""
    sequences = np.array([[eig3.noise(1, member, k) for k in range(4000)] for member in range(3)])
    for sequence in sequences:
        assert scipy.stats.kstest(sequence, "norm").pvalue > 1e-3
    error = 4 / np.sqrt(4000)
    assert np.abs(np.corrcoef(sequences) - np.eye(3)).max() < error
    assert abs(np.corrcoef(sequences[0, :-1], sequences[0, 1:])[0, 1]) < error
    x, y = (np.random.Philox(key=[1, 2], counter=[7, 0, 0, 0]).random_raw(2) >> np.uint64(11)) * 2.0**-53
    expected = np.sqrt(-2 * np.log(x + 2.0**-53)) * np.cos(2 * np.pi * y)  # Box and Muller
    assert sequences[2, 7] == pytest.approx(expected, rel=1e-12)
    assert eig3.noise(1, 2.0, 7) == eig3.noise(1, 2, 7) == sequences[2, 7]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_counts_that_are_not_finite_give_no_number(bad):
    for counts in ((bad, 2, 3), (1, bad, 3.0), (1, 2, bad)):
        assert np.isnan(eig3.noise(*counts))
    assert np.isnan(eig3.white_noise(1, 2, bad, 0.1, 1.0))
    with pytest.raises(ValueError, match=r"^rhs gives nan"):
        eig3.integrate(shaken, (0, 1), 0.0, 0.0, h=DT, params={"amplitude": 1.0, "member": bad})


@numba.njit
def series(member, dt, S, count):
    """White noise at eight times in each dt."""
    return np.array([eig3.white_noise(4, member, (i + 0.5) * dt / 8, dt, S) for i in range(count)])


def test_white_noise_has_its_spectral_density():
    """S sinc(omega dt / 2)^2 in bands of omega dt up to 3, and 4 pi S over frequencies in Hz on one side.

    The values of a periodogram are exponential and independent: the mean of m bands of k values has the relative
    standard error 1 / sqrt(m k). Eight points in dt add (omega dt / 16)^2 / 3 = 1.2 % at omega dt = 3.
    """
    dt, S, m, count = 0.1, 0.7, 100, 8 * 1024
    x = np.array([series(member, dt, S, count) for member in range(m)])
    frequency, density = scipy.signal.periodogram(x, 8 / dt, detrend=False)  # one-sided, over Hz
    omega, density = 2 * np.pi * frequency, density.mean(axis=0) / (4 * np.pi)
    for low, high in ((0.01, 0.3), (0.8, 1.2), (2.6, 3.0)):
        band = (omega * dt > low) & (omega * dt < high)
        ratio = np.mean(density[band] / (S * np.sinc(omega[band] * dt / (2 * np.pi)) ** 2))
        assert ratio == pytest.approx(1, abs=4 / np.sqrt(m * band.sum()) + (high / 16) ** 2 / 3)
    assert eig3.white_noise(4, 2, 0.35, dt, S) == np.sqrt(2 * np.pi * S / dt) * eig3.noise(4, 2, 3)


@settings(deadline=None)
@given(st.floats(1e-6, 1e3), st.integers(1, 8), st.integers(0, 10**9))
def test_white_noise_jumps_at_the_ends_of_steps(dt, parts, i):
    assert eig3.white_noise(4, 2, i * (dt / parts), dt, 1 / (2 * np.pi)) == pytest.approx(
        eig3.noise(4, 2, i // parts) / np.sqrt(dt), rel=1e-12
    )


@eig3.jit
def shaken(t, u, v, p):
    return p.amplitude * eig3.noise(3, p.member, int(t / DT)) - 2 * XI * OMEGA * v - OMEGA**2 * u


def exact(member, steps):
    """The response to noise that is constant over times of dt, by the exponential of the matrix of the system."""
    E = scipy.linalg.expm(np.array([[0, 1, 0], [-(OMEGA**2), -2 * XI * OMEGA, 1], [0, 0, 0]]) * DT)
    x = np.zeros(2)
    for k in range(steps):
        x = (E @ [*x, eig3.noise(3, member, k)])[:2]
    return x[0]


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_a_path_converges_with_the_first_power_of_the_step(method):
    params = {"amplitude": 1.0, "member": 5.0}
    errors = [
        eig3.integrate(shaken, (0, 4), 0.0, 0.0, h=DT / n, method=method, params=params).u[-1] - exact(5, 64)
        for n in (16, 32)
    ]
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.05)


def test_the_stationary_variance_is_that_of_white_noise():
    """pi S / (2 xi omega^3), see Crandall and Mark (1963), within 4 standard errors and the bias of dt."""
    S, m = 0.7, 4096
    params = {"amplitude": np.sqrt(2 * np.pi * S / DT), "member": np.arange(m, dtype=float)}
    runs = eig3.ensemble(shaken, (0, 32), np.zeros(m), 0.0, h=DT / 2, params=params)
    assert not runs.notes  # it runs in lanes
    variance = np.pi * S / (2 * XI * OMEGA**3)
    assert np.mean(runs.u[:, -1] ** 2) == pytest.approx(variance, rel=4 * np.sqrt(2 / m) + (OMEGA * DT) ** 2)
    few = eig3.ensemble(shaken, (0, 32), np.zeros(8), 0.0, h=DT / 2, params={**params, "member": np.arange(40.0, 48)})
    np.testing.assert_allclose(few.u[:, -1], runs.u[40:48, -1], rtol=0, atol=1e-11)
