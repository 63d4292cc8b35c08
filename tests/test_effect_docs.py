"""The docstring of each public effect: its formula, the unit of each parameter, and its name in other codes."""

import dataclasses
import inspect
import math
import re

import pytest

from eig3 import effects
from eig3.scene import RigidBody
from eig3.structures import Modal, Rayleigh, Section

BASES = ("Angle", "Bending", "Body", "Cell", "Constraint", "Dihedral", "FrictionalContact", "Link", "Motion")
BASES += ("Tetrahedron", "Triangle")
EFFECTS = [name for name in effects.__all__ if name not in BASES]
CODES = ("LAMMPS", "OpenMM", "OpenSees", "MuJoCo", "exudyn", "Modelica", "FEBio")
UNIT = re.compile(r"\b(N|m|kg|s|J|Pa|rad)\b|unit vector|[Cc]oefficient|ratio|[Vv]ectors? ")


def parameters(doc):
    """Return what the section of parameters says about each of them."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", doc, flags=re.MULTILINE | re.DOTALL)
    entries = re.findall(r"^([\w, ]+) : .*\n((?:    .*\n?|\n)+)", section[1] if section else "", flags=re.MULTILINE)
    return {name: text for names, text in entries for name in names.split(", ")}


def test_the_kinds_are_classes_without_parameters():
    """All else is an effect, which the tests below read."""
    assert [name for name in BASES if dataclasses.is_dataclass(getattr(effects, name))] == []


def codes_and_limits(doc):
    notes = doc.split("\nNotes\n-----\n")[1]
    (others,) = re.findall(r"^Other codes: (.*?)\n\n", notes, flags=re.MULTILINE | re.DOTALL)
    assert any(code in others for code in CODES)
    assert re.search(r"^Not included: \w", notes, flags=re.MULTILINE)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_docstring_has_the_formula_the_codes_and_the_limits(name):
    doc = inspect.getdoc(getattr(effects, name))
    assert re.search(r"^Formula: ", doc.split("\nNotes\n")[0], flags=re.MULTILINE)
    codes_and_limits(doc)


@pytest.mark.parametrize("law", [Modal, Rayleigh, RigidBody, Section])
def test_joints_and_laws_of_structures_have_the_codes_and_the_limits(law):
    codes_and_limits(inspect.getdoc(law))


@pytest.mark.parametrize("name", EFFECTS)
def test_each_parameter_has_a_unit(name):
    effect = getattr(effects, name)
    given = [field.name for field in dataclasses.fields(effect) if field.init]
    described = parameters(inspect.getdoc(effect))
    assert list(described) == given
    assert [name for name, text in described.items() if not UNIT.search(text)] == []


@pytest.mark.parametrize("name", EFFECTS)
def test_the_formula_has_the_parameters(name):
    """Records and coefficients with an index have other names there."""
    doc = inspect.getdoc(getattr(effects, name))
    text = doc.split("\nParameters\n")[0]
    missing = [given for given in parameters(doc) if not re.search(rf"\b{given}\b", text)]
    assert set(missing) <= {"times", "values", "direction", "coefficients", "contact_distance", "wall_radius"}


NAMES = {"r": 1.1, "d": 0.3, "theta": 1.3, "rate": -0.4, "exp": math.exp, "tanh": math.tanh, "erfc": math.erfc}
#: The functions of an effect whose formulas are evaluated, as "function: what the docstring calls it".
FORMULAS = {
    "LinearSpring": ((50.0, 0.8), {"tension": "tension", "potential": "energy"}),
    "HardeningSpring": ((50.0, 2.0, 0.8), {"tension": "tension", "potential": "energy"}),
    "SofteningSpring": ((50.0, 0.2, 0.8), {"tension": "tension"}),
    "LinearDamper": ((2.0,), {"tension": "tension"}),
    "HarmonicAngle": ((15.0, 1.9), {"torque": "torque", "potential": "energy"}),
    "Coulomb": ((2.0,), {"potential": "V(r)"}),
    "Morse": ((8.0, 2.5, 0.9), {"potential": "V(r)"}),
    "LennardJones": ((2.0, 0.9, 4.0), {"potential": "V(r)"}),
}


def python_of(name, quantity):
    """Return a formula of a docstring in Python: it ends before a word that begins a sentence, or at a comma."""
    doc = " ".join(inspect.getdoc(getattr(effects, name)).split())
    (formula,) = re.findall(rf"(?<!\w){re.escape(quantity)} = (?:V\(r\) = )?(.*?)(?=[,;:]|\.(?!\d)| at the )", doc)[:1]
    return re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", formula.replace("r'", "rate").replace("^", "**"))


def computed(function, names):
    return function.py_func(*(names[argument] for argument in inspect.signature(function.py_func).parameters))


@pytest.mark.parametrize("name", FORMULAS)
def test_the_code_computes_the_formula(name):
    values, quantities = FORMULAS[name]
    effect = getattr(effects, name)(*values)
    names = {**NAMES, **{field.name: getattr(effect, field.name) for field in dataclasses.fields(effect)}}
    for function, quantity in quantities.items():
        code = python_of(name, quantity)
        expected = eval(code, {}, names)
        if names.get("cutoff"):  # a shifted force: less the line that touches V at the cutoff
            at_end, step = names["cutoff"], 1e-5
            below, end, above = (eval(code, {}, {**names, "r": at_end + x}) for x in (-step, 0.0, step))
            expected -= end + (names["r"] - at_end) * (above - below) / (2 * step)
        assert computed(effect.functions()[function], names) == pytest.approx(expected, rel=1e-7), code
