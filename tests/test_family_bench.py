"""`eig3 bench family`: the table of the family from exact coefficients, and the drift of synchronised velocities."""

import math

import numpy as np
import pytest

from eig3.bench import characteristic, family
from eig3.cli import main
from eig3.methods import EIG
from eig3.stability import amplification_matrix, eigenvalues, limit, practical_limit

from .conftest import ROOT

pytestmark = pytest.mark.system

#: Limits against the damping ratio, from an independent computation in steps of 0.002. None: it found growth at
#: every step, or the limit is below some steps.
LIMITS = {
    3: (2, 1.960, 1.808, 1.640, 1.131, 0.828, 0.472),
    4: (1.732, 1.676, 1.479, 1.267, 0.741, 0.500, 0.266),
    5: (1.414, 1.349, 1.119, 0.895, 0.448, 0.286, 0.148),
    6: (None, 1.033, 0.793, 0.585, 0.256, 0.160, 0.080),
    7: (None, 0.763, 0.528, 0.358, 0.142, 0.086, 0.042),
    8: (0.618, 0.546, 0.332, 0.206, 0.076, 0.046, 0.022),
    9: (0.459, 0.380, 0.198, 0.114, 0.040, 0.024, 0.012),
    10: (None, 0.258, 0.112, 0.060, 0.020, 0.012, 0.006),
    11: (None, 0.168, 0.060, 0.032, 0.010, 0.006, None),
    12: (0.174, 0.106, 0.032, 0.016, 0.004, None, None),
    13: (0.126, 0.064, 0.016, 0.008, None, None, None),
}
PRACTICAL = {6: 0.25, 7: 0.33, 10: 0.33, 11: 0.24}

#: Growth a step from the same computation, in double precision: what it could not tell from zero is None.
GROWTH = {
    3: (None, None, None, 2.5e-9, 1.6e-6, 2.6e-5),
    4: (-2.6e-7, -4.2e-6, -6.6e-5, -3.7e-9, -2.3e-6, -3.7e-5),
    5: (-6.5e-10, -4.2e-8, -2.6e-6, -5.4e-13, -8.5e-9, -5.4e-7),
    6: (5.8e-10, 3.7e-8, 2.3e-6, 3.3e-13, 5.1e-9, 3.2e-7),
    7: (2.8e-12, 7.2e-10, 1.8e-7, None, 3.1e-11, 7.9e-9),
    8: (-1.3e-12, -3.3e-10, -7.6e-8, None, -1.2e-11, 0.20),
    9: (None, -9.8e-12, -9.5e-9, None, 0.16, 0.44),
    10: (None, 3.0e-12, 2.4e-9, None, 0.37, 0.69),
    11: (None, 1.2e-13, 4.5e-10, 0.06, 0.58, 0.93),
    12: (None, None, 0.06, 0.2, 0.8, 1.2),
    13: (None, None, 0.2, 0.4, 1.0, 1.4),
}
_ROUND_OFF = 5e-14  # of that computation


@pytest.fixture(scope="module")
def printed():
    """The printed tables, whose drift is computed at the two longest steps only: the others take seconds."""
    pages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(family, "STEPS_OF_DRIFT", 2)
        family.benchmark(write=pages.append)
    return pages


def cells(page):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line[:1] == "|"][2:]


def test_order_and_error_constant():
    """The error constants are the next of Stoermer's coefficients: Hairer, Norsett and Wanner, table III.10.1."""
    known = ["1/12", "1/12", "19/240", "3/40", "863/12096", "275/4032", "33953/518400"]
    for grade in family.GRADES:
        order, constant = family.order_and_constant(grade)
        assert order == grade - 1
        if grade - 3 < len(known):
            assert str(constant) == known[grade - 3]


@pytest.mark.parametrize("grade", family.GRADES)
def test_limits(printed, grade):
    row = cells(printed[0])[grade - 3]
    assert row[:2] == [str(grade), str(grade - 1)]
    for cell, expected in zip(row[3:], LIMITS[grade], strict=True):
        if expected is not None:
            assert float(cell) == pytest.approx(expected, abs=2.2e-3)  # a step, and the rounding to three digits
    assert ("*" in row[3]) == (grade in PRACTICAL)
    if grade in PRACTICAL:
        assert float(row[3].split()[0]) == pytest.approx(PRACTICAL[grade], abs=0.01)


@pytest.mark.parametrize("grade", family.GRADES)
def test_growth(printed, grade):
    row = cells(printed[1])[grade - 3]
    for cell, value, expected in zip(row[1:], family.growths(grade), GROWTH[grade], strict=True):
        assert float(cell) == pytest.approx(value, rel=0.06, abs=family.NO_GROWTH)  # two digits are printed
        if expected is None:
            assert abs(value) < _ROUND_OFF
        else:
            assert value == pytest.approx(expected, rel=0.1 if abs(expected) > 0.01 else 0.03)  # one digit or two


@pytest.mark.parametrize("grade", family.GRADES)
def test_growth_on_the_oscillator_is_that_of_the_kernel(grade):
    """To the round-off of eigenvalues. A kernel has two roots more, for V and v, which are zero."""
    Omega = np.array([0.02, 0.1, 0.3])
    kernel = np.abs(eigenvalues(amplification_matrix(EIG(grade), Omega))).max(axis=-1) - 1
    exact = [characteristic.oscillator_growth(grade, x) for x in Omega.tolist()]
    np.testing.assert_allclose(exact, kernel, rtol=1e-6, atol=1e-11)


@pytest.mark.parametrize(
    ("grade", "power"), [(4, 4), (5, 6), (6, 6), (7, 8), (8, 8), (9, 10), (10, 10), (11, 12), (12, 12), (13, 14)]
)
def test_growth_follows_its_power_where_no_eigenvalue_shows_it(grade, power):
    """Grade g has the leading growth C Omega^q with q = g, or g + 1 if g is odd; the next term is Omega^2 smaller."""
    growth = [characteristic.oscillator_growth(grade, x) for x in (2e-3, 1e-3)]
    assert math.log2(growth[0] / growth[1]) == pytest.approx(power, abs=1e-3)


def test_grade_3_does_not_grow_at_all():
    """|z| = 1 exactly below Omega = 2."""
    assert abs(characteristic.oscillator_growth(3, 1.9)) < family.NO_GROWTH


def test_drift_of_the_hardening_spring(printed):
    """Table 2: the positions of EIG-3 obey u'' = a - h^2/12 D^2 a + O(h^4).

    So the energy from exact velocities errs by -h^2/12 (f'(u) v^2 - (a^2 - a0^2)/2). The velocity of EIG3() is
    v - h^2/3 f'(u) v, which adds -h^2/3 f'(u) v^2. Terms of higher order are below 2 % at h = 1e-3, and below 1e-3 at
    the next step.
    """
    S1, S2, u0 = 100.0, 10.0, 1.5
    u = np.linspace(0, u0, 1001)
    potential, a, slope = S1 * u**2 / 2 * (1 + S2 * u**2 / 2), -S1 * u * (1 + S2 * u**2), -S1 * (1 + 3 * S2 * u**2)
    square = 2 * (potential[-1] - potential)
    positions = -(slope * square - (a**2 - a[-1] ** 2) / 2) / 12
    rows = [row for row in cells(printed[2]) if row[0] == "Table 2, hardening_spring"]
    for (_, h, own, synchronised, ratio), rel in zip(rows, (0.04, 0.02), strict=True):
        expected = np.abs(positions - slope * square / 3).max(), np.abs(positions).max()
        assert float(own) == pytest.approx(expected[0] * float(h) ** 2, rel=rel)
        assert float(synchronised) == pytest.approx(expected[1] * float(h) ** 2, rel=rel)
        assert float(ratio) == pytest.approx(float(own) / float(synchronised), rel=0.02)


def test_the_command_prints_the_tables(capsys, monkeypatch):
    monkeypatch.setattr(family, "GRADES", range(3, 4))
    monkeypatch.setattr(family, "STEPS_OF_DRIFT", 1)
    assert not main(["bench", "family"])
    assert capsys.readouterr().out.count("| 3 ") == 2


def test_the_table_of_the_readme():
    """The table of "Higher order" has the figures that the command prints, to its digits."""
    section = (ROOT / "eig3/diagnosis/README.md").read_text().split("## Higher order")[1].split("\n## ")[0]
    rows = cells(section)
    assert [row[0] for row in rows] == [str(grade) for grade in family.GRADES]
    for grade, row in zip(family.GRADES, rows, strict=True):
        undamped = practical_limit(EIG(grade)) if grade in PRACTICAL else limit(EIG(grade))
        values = [grade - 1, undamped, limit(EIG(grade), 0.01), limit(EIG(grade), 0.1)]
        values += [characteristic.oscillator_growth(grade, 0.1), characteristic.gyroscope_growth(grade, 0.05)]
        for cell, value in zip(row[1:], values, strict=True):
            assert float(cell.rstrip(" *")) == pytest.approx(value, rel=0.06, abs=family.NO_GROWTH)
        for cell, value in zip(row[2:5], values[1:4], strict=True):
            assert float(cell.rstrip(" *")) == pytest.approx(value, abs=5e-4)
