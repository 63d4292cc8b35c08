"""Names that users choose: none of them becomes code, and a name that an effect cannot have is refused."""

import ast
import builtins
import inspect
import keyword
import unicodedata
from dataclasses import InitVar, dataclass, field, make_dataclass
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import eig3
from eig3.effects import Body, Link, Motion
from eig3.scene import Scene
from eig3.scene.names import identifier

from .conftest import acceleration

RAN = "eig3_test_ran"  # the variable that hostile names set
SET = f'setattr(__import__("builtins"),"{RAN}",1)'

HOSTILE = {
    "code when a scene is compiled": f"x=0\n{SET}\ndef f():\n    x=0#",
    "code when a scene runs": f"x={SET}or(1.0,1.0)#",
    "code after a semicolon": f"x = 1; {SET}; y",
    "code that makes a folder": "x = 1; __import__('os').mkdir('ran'); y",
    "a space": "My Spring",
    "a hyphen": "north-wind",
    "nothing": "",
    "digits": "3D",
    "a comment": "#",
    "a quote": '"',
    "three quotes": "'''",
    "a backslash": "\\",
    "a line": "one\ntwo\r\x0cthree",
    "braces": "{s}%s",
    "a ligature": "\N{LATIN SMALL LIGATURE FI}eld",
    "a black letter": "\N{BLACK-LETTER CAPITAL H}",
    "a fraction": "\N{VULGAR FRACTION ONE HALF}",
    "a digit that no name may have": "\N{AEGEAN NUMBER ONE}x",
    "a lone accent": "\N{COMBINING ACUTE ACCENT}",
    "a capital that becomes two letters": "\N{LATIN CAPITAL LETTER I WITH DOT ABOVE}",
    "another direction of writing": "\N{RIGHT-TO-LEFT OVERRIDE}x",
    "another alphabet": "\u91cd\u529b",
    "a long name": "x" * 10_000,
    **{word: word for word in ("class", "lambda", "None", "_", "__debug__", "__builtins__", "__import__")},
}

push = eig3.jit(lambda v, strength: (strength, strength * v[0]))
pull = eig3.jit(lambda r, strength: strength * r)
stored = eig3.jit(lambda r, strength: strength / 2 * r * r)
swing = eig3.jit(lambda t, strength: (strength * t, strength))


def effect(kind, name, fields=("strength",), values=(3.0,), **content):
    """An effect of a class of its own, as a program would make it from the names in a file."""
    own = {"force": push} if kind is Body else {"tension": pull, "potential": stored} if kind is Link else {}
    if kind is Motion:
        own, fields, values = (
            {"motion": swing, "vectors": ("direction",)},
            (*fields, "direction"),
            (*values, (1.0, 2.0)),
        )
    namespace = {key: staticmethod(item) if callable(item) else item for key, item in {**own, **content}.items()}
    return make_dataclass(name, fields, bases=(kind,), namespace=namespace, frozen=True, eq=False)(*values)


def problem_with(name, **content):
    """A scene with a body, a link and a motion, each of a class of this name, and with every function of a scene."""
    scene = Scene(2)
    post, masses = scene.fixed((0.0, 0.5)), scene.mass([1.0, 2.0], [(1.0, 0.0), (2.0, 0.1)], [(0.5, 0.0), (0.0, 1.0)])
    scene.add(effect(Motion, name, **content), post)
    scene.add(effect(Body, name, **content))
    scene.add(effect(Link, name, **content), post, masses)
    return scene.problem((0.0, 1.0), work=True)


def numbers(problem):
    """The accelerations, the power and the energy, as Python runs the code."""
    names, a = problem.rhs.py_func.__globals__, np.full(4, np.nan)
    problem.rhs.py_func(0.3, problem.u0, problem.v0, problem.params, a)
    state = 0.3, problem.u0, problem.v0, problem.params
    return [*a, names["power"].py_func(*state), names["energy"].py_func(*state)]


def accelerations(scene):
    """The accelerations at the start, as Python runs the code."""
    problem = scene.problem((0.0, 1.0))
    a = np.full(problem.u0.size, np.nan)
    problem.rhs.py_func(0.0, problem.u0, problem.v0, problem.params, a)
    return a.tolist()


def nodes(problem):
    """The syntactic parts of all functions."""
    functions = problem.rhs.py_func.__globals__
    texts = [inspect.getsource(functions[name].py_func) for name in ("power", "rhs", "energy")]
    return [node for text in texts for node in ast.walk(ast.parse(text))]


def structure(problem):
    return [type(node) for node in nodes(problem)]


@pytest.fixture
def nothing_ran(tmp_path, monkeypatch):
    """Check that no name was run as code."""
    monkeypatch.chdir(tmp_path)
    yield
    ran = hasattr(builtins, RAN)
    vars(builtins).pop(RAN, None)
    assert not ran
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def ordinary():
    return problem_with("Ordinary")


@pytest.mark.parametrize("name", list(HOSTILE)[:2])
@pytest.mark.parametrize("is_title", [False, True])
def test_the_code_in_a_name_does_not_run(name, is_title, nothing_ran):
    """In this scene, the name in the place of an identifier would make a program without a syntax error."""
    scene = Scene(2)
    scene.mass(2.0, (0.0, 0.0), (5.0, 0.0))
    scene.add(effect(Body, "Titled", title=HOSTILE[name]) if is_title else effect(Body, HOSTILE[name]))
    assert accelerations(scene) == [1.5, 7.5]


@pytest.mark.parametrize("name", HOSTILE)
def test_the_name_of_a_class_is_no_code(name, ordinary, nothing_ran):
    """The code has the same structure and the same results as with an ordinary name."""
    problem = problem_with(HOSTILE[name])
    assert structure(problem) == structure(ordinary)
    assert numbers(problem) == numbers(ordinary)


@pytest.mark.parametrize("name", [*HOSTILE, "half of a pair"])
def test_a_title_is_no_code(name, ordinary, nothing_ran):
    title = {**HOSTILE, "half of a pair": "\ud800"}[name]  # which the name of a class cannot contain
    problem = problem_with("Titled", title=title)
    assert structure(problem) == structure(ordinary)
    assert numbers(problem) == numbers(ordinary)


def test_the_name_of_a_class_may_be_a_word_of_the_code(ordinary):
    words = {node.id for node in nodes(ordinary) if isinstance(node, ast.Name)} | {"rhs", "energy", "index"}
    assert {"t", "p", "jit", "sqrt", "tiny", "range", "power", "y_anchor", "x_shift_0"} <= words
    for word in words:
        problem = problem_with(word)
        assert structure(problem) == structure(ordinary), word
        assert numbers(problem) == numbers(ordinary), word


def test_a_scene_with_hostile_names_compiles(nothing_ran):
    """In another alphabet, with a letter that Python reads as another one."""
    problem = problem_with(f"\u91cd\u529b \N{BLACK-LETTER CAPITAL H}; {SET}")
    found = acceleration(problem, problem.u0, problem.v0, 0.3)
    np.testing.assert_allclose(found, numbers(problem)[:4], rtol=1e-14)


@pytest.mark.parametrize(
    ("one", "other"), [("north-wind", "north wind"), ("My Spring", "MySpring"), ("", "_"), ("#", "?")]
)
def test_classes_whose_names_become_the_same_identifier_stay_apart(one, other):
    twice = eig3.jit(lambda t, strength: (0.0, 2 * strength))
    scene = Scene(2)
    scene.mass(2.0, (0.0, 0.0), (5.0, 0.0))
    scene.add(effect(Body, one))
    scene.add(effect(Body, other, values=(10.0,), force=twice))
    assert accelerations(scene) == [3.0 / 2, (3.0 * 5.0 + 20.0) / 2]


@settings(deadline=None)
@given(st.text(), st.lists(st.text(max_size=3)))
@example("class", ["class_2", "class_3"])
@example("\N{LATIN SMALL LIGATURE FI}", ["fi"])
@example("1", ["_1"])
@example("__debug__", [])
def test_any_text_becomes_an_identifier_that_python_reads_as_it_is(wanted, taken):
    name = identifier(wanted, taken)
    assert name.isidentifier()
    assert not keyword.iskeyword(name)
    assert name not in taken
    assert compile(f"{name} = 1", "", "exec").co_names == (name,)


@settings(deadline=None)
@given(st.text(st.characters(categories=["L", "Nd"]) | st.just("_"), min_size=1))
@example("gravity_field")
@example("gr\u00f6\u00dfe")
def test_an_identifier_stays_as_it_is(name):
    name = unicodedata.normalize("NFKC", name)
    if name.isidentifier() and not keyword.iskeyword(name):
        assert identifier(name) == name
        assert identifier(name, [name]) == f"{name}_2"


# Fields


@dataclass(frozen=True, eq=False)
class Written(Body):
    """Python reads the name of its field as "stiffness"."""

    stiﬀness: float

    force = eig3.jit(lambda stiffness: (stiﬀness,))


def test_a_field_written_with_a_ligature_works():
    scene = Scene(1)
    scene.mass(2.0, 0.0)
    scene.add(Written(stiffness=3.0))
    assert accelerations(scene) == [1.5]


@pytest.mark.parametrize("kind", [Body, Link, Motion])
def test_no_field_has_the_name_of_an_attribute_of_its_base(kind):
    """Whether or not it has a default. As a field, it would replace a method or a class variable."""
    for name in dir(kind):
        for fields in ([(name, float), "strength"], ["strength", (name, float, 3.0)]):
            with pytest.raises(
                TypeError, match=f"^Clash must rename its field {name}( or remove .*)?: {kind.__name__} has"
            ):
                effect(kind, "Clash", fields)


@dataclass(frozen=True, eq=False)
class Common:
    """Fields for several classes, one of them with the name of an attribute of every effect."""

    strength: float
    source: float = 0.0


@dataclass(frozen=True, eq=False)
class Computed(Body):
    """Its second field is what the caller gives, or has no value."""

    given: object
    found: object = field(init=False, repr=False)

    def __post_init__(self):
        if self.given is not None:
            object.__setattr__(self, "found", self.given)
        super().__post_init__()

    force = eig3.jit(lambda found: (found, found))


@dataclass(frozen=True, eq=False)
class Filled(Body):
    """The caller fills its list after the effect is made."""

    strength: object
    samples: list = field(init=False, default_factory=list)

    arrays = ("samples",)

    force = eig3.jit(lambda samples, strength: (samples[0] * strength, 0.0))


@dataclass(frozen=True, eq=False)
class Checked(Computed):
    nonnegative = ("found",)


def add(effect):
    scene = Scene(2)
    masses = scene.mass(1.0, np.eye(2))
    scene.add(effect, *(masses if isinstance(effect, Link) else ()))
    return scene


def declaring(name, annotation=float):
    return lambda: type("Declaring", (Body,), {"__annotations__": {name: annotation}})


def naming(**content):
    return lambda: add(effect(Link, "Naming", ("strength", "reach"), (3.0, 1.0), **content))


RENAME = "because Python cannot read it or reads it as another name: take a name such as"
BAD = {
    "a ligature": (
        lambda: effect(Body, "Lig", ("\ufb01eld",)),
        f"Lig must rename its field '\ufb01eld', {RENAME} 'field'.",
    ),
    "a black letter": (lambda: effect(Body, "Lig", ("\u210c",)), f"Lig must rename its field '\u210c', {RENAME} 'H'."),
    "code": (declaring("x=1;y"), f"Declaring must rename its field 'x=1;y', {RENAME} 'x_1_y'."),
    "nothing": (declaring(""), f"Declaring must rename its field '', {RENAME} '_'."),
    "a keyword": (declaring("class"), f"Declaring must rename its field 'class', {RENAME} 'class_2'."),
    "a method": (declaring("check"), "Declaring must rename its field check: Body has an attribute of this name."),
    "a class variable": (
        declaring("vectors"),
        "Declaring must rename its field vectors or remove its annotation: Body has an attribute of this name.",
    ),
    "a field of another base": (
        lambda: type("Mixed", (Common, Body), {}),
        "Mixed must rename its field source or remove its annotation: Body has an attribute of this name.",
    ),
    "a vector": (
        naming(vectors=("strength", "\ufb01eld")),
        "vectors of Naming can name only strength, reach, not '\ufb01eld'.",
    ),
    "an array": (naming(arrays=("x = 1; y",)), "arrays of Naming can name only strength, reach, not 'x = 1; y'."),
    "no tuple of vectors": (naming(vectors=None), "vectors of Naming must be a tuple of names, not None."),
    "not negative": (
        naming(nonnegative=("height",)),
        "nonnegative of Naming can name only strength, reach, not 'height'.",
    ),
    "no tuple": (naming(nonnegative="reach"), "nonnegative of Naming must be a tuple of names, not 'reach'."),
    "a cutoff": (naming(cutoff_field="re\nach"), "cutoff_field of Naming must be the name of a field, not 're\\nach'."),
    "cutoffs": (naming(cutoff_field=["reach"]), "cutoff_field of Naming must be the name of a field, not ['reach']."),
    "no value": (
        lambda: add(Computed(None)),
        "found of Computed must be computed in __post_init__, because the field has init=False.",
    ),
    "no value to check": (
        lambda: Checked(None),
        "nonnegative of Checked can name only given, "
        "not 'found', unless it is computed before super().__post_init__().",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_class_raises_an_error_of_one_sentence(name):
    build, sentence = BAD[name]
    with pytest.raises(TypeError) as caught:
        build()
    assert str(caught.value) == sentence


def test_what_a_class_may_replace():
    """Class variables without an annotation or with ClassVar, properties and methods."""

    class Replacing(Body):
        strength: float

        vectors: ClassVar = ("strength",)
        nonnegative: "ClassVar[tuple[str, ...]]" = ()
        source = "a test"

        @property
        def title(self):
            return "Another title"

        def components(self, vector, dimension):
            return 2

        force = eig3.jit(lambda strength: strength)

    replacing = dataclass(frozen=True, eq=False)(Replacing)
    scene = add(replacing((1.0, 2.0)))
    assert accelerations(scene) == [1.0, 1.0, 2.0, 2.0]
    assert "2 x Another title" in scene.problem((0.0, 1.0)).note


def test_a_field_may_be_an_array_that_is_computed():
    assert accelerations(add(Computed(np.array([1.0, 2.0])))) == [1.0, 2.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="found of Checked must not be negative"):
        Checked(-1.0)


def test_lists_that_are_computed_or_filled_later_count_as_they_are_when_the_effect_is_added():
    computed, filled = Computed([1.0, 2.0]), Filled([1.0, 2.0])
    filled.samples.append(3.0)
    scene = add(computed)
    scene.add(filled)
    computed.found[:] = [7.0, 7.0]
    filled.samples[0] = 7.0
    problem = scene.problem((0, 1))
    a = problem.stepper(h=0.1).first_acceleration
    np.testing.assert_array_equal(a, [1.0 + 3.0, 2.0 + 6.0, 1.0, 2.0])


@dataclass(frozen=True, eq=False)
class Halved(Body):
    strength: list
    half: InitVar[bool] = False

    def __post_init__(self, half):
        if half:
            object.__setattr__(self, "strength", [x / 2 for x in self.strength])
        super().__post_init__()

    force = eig3.jit(lambda strength: (strength, 0.0))


def test_an_effect_may_have_arguments_that_are_not_fields():
    problem = add(Halved([2.0, 4.0], half=True)).problem((0, 1))
    np.testing.assert_array_equal(problem.stepper(h=0.1).first_acceleration, [1.0, 2.0, 0.0, 0.0])
