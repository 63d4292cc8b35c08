"""Solutions that are saved to files and loaded again."""

import dataclasses
import json
import resource
import zipfile

import numpy as np
import pytest

import eig3
from eig3.result import storage
from eig3.result.error_estimate import ErrorEstimate
from eig3.result.occurrences import Occurrences
from eig3.result.solution import TRANSIENT

from .conftest import coupled, energy, oscillator, python, structure

derivative = eig3.jit(lambda t, u, v, p: -2 * p[1] * p[0])


def oscillate(method="rk4", **options):
    return eig3.integrate(oscillator, (0, 3), 1.0, 0.0, h=0.1, params=(2.0, 0.1), method=method, **options)


def full_solution():
    """A solution with a value in every field, also such values as no run gives."""
    run = oscillate(invariants={"energy": energy})
    before, after = np.array([[0.5], [-0.5]]), np.array([[0.5], [0.4]])
    labels = eig3.problems.spring_pendulum().labels
    return dataclasses.replace(
        run,
        status=eig3.Status.TERMINATED,
        message="An event ended the run: größer.",
        drift={"energy": np.nan, "a/../b": 0.1},
        extremes={"energy": eig3.Extremes(-np.inf, np.inf, 0.5, 1.0)},
        notes=("One.", 'Two "quoted".'),
        z={"work": run.u**2},
        events={
            "never": Occurrences(*5 * [np.empty(0)], *2 * [{"work": np.empty(0)}], labels=labels),
            "impact": Occurrences(np.array([1.05]), *before, *after, *2 * [{"work": np.array([0.1])}], labels=labels),
        },
        outputs={"reaction": 3 * run.u, "storey drift": np.stack([run.u, run.v], axis=1)},
        n_rejected=3,
        steps=np.where(run.t > 1, np.nan, 0.1),
        labels=labels,
        error=ErrorEstimate(
            run.t, 1e-3 * run.u, 1e-3 * run.v, "a run", {"reaction": 0 * run.u}, order=4.0, notes=("So.",)
        ),
    )


def assert_same(one, other):
    """Every field is the same to the last bit, with the same type."""
    for field in dataclasses.fields(one):
        if field.name == "_a":
            assert_equal(one.a, other.a)
        elif field.name not in (*TRANSIENT, "_resume"):
            assert_equal(getattr(one, field.name), getattr(other, field.name))


def assert_equal(one, other):
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert list(one) == list(other)
        for name in one:
            assert_equal(one[name], other[name])
    elif isinstance(one, tuple | list):
        for pair in zip(one, other, strict=True):
            assert_equal(*pair)
    elif isinstance(one, ErrorEstimate | Occurrences):
        assert_equal(vars(one), vars(other))
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    else:
        np.testing.assert_equal(one, other)


def test_a_loaded_solution_has_every_field(tmp_path):
    solution = full_solution()
    loaded = eig3.load(solution.save(tmp_path / "run.npz"))
    assert loaded.a is not None
    assert_same(loaded, solution)
    fine = np.linspace(0, 3, 100)
    assert np.array_equal(loaded.at(fine), solution.at(fine))
    assert loaded.explain() == " ".join([solution.message, *solution.notes])
    assert repr(loaded) == repr(solution)
    again = eig3.load(loaded.save(tmp_path / "again"))
    assert_same(again, solution)


def test_runs_of_problems_and_of_ensembles_are_saved(tmp_path):
    runs = [
        eig3.problems.shear_building(work=True).integrate(h=1e-3, t_end=0.1),
        eig3.integrate(coupled, (0, 1), [1.0, 2.0, 3.0], [0.0] * 3, h=0.1, params=(1, 2, 3)),
        eig3.ensemble(oscillator, (0, 1), [1.0, 2.0], 0.0, h=0.1, params=[[2.0, 0.1]])[1],
    ]
    for run in runs:
        assert_same(eig3.load(run.save(tmp_path / "run")), run)


def test_the_explanation_is_kept(tmp_path):
    run = eig3.integrate(oscillator, (0, 100), 1.0, 0.0, h=1.5, params=(2.0, 0.0), method="eig3")
    assert run.status is eig3.Status.DIVERGED
    assert eig3.load(run.save(tmp_path / "unexplained")).explain() == run.message
    explanation = run.explain()
    assert explanation != run.message
    assert eig3.load(run.save(tmp_path / "explained")).explain() == explanation


@pytest.mark.parametrize("path", ["run", "run.npz", "run.1", ".npz.d/run"])
def test_the_ending_is_added_where_it_is_missing(path, tmp_path):
    target = tmp_path / path
    target.parent.mkdir(exist_ok=True)
    run = oscillate()
    written = run.save(str(target))
    assert written.name == (target.name if path == "run.npz" else f"{target.name}.npz")
    assert [file.name for file in target.parent.iterdir()] == [written.name]
    for other in (target, str(written)):
        assert np.array_equal(eig3.load(other).u, run.u)


METHODS = [
    eig3.EIG3(alpha=1.2, beta=np.float64(0.5)),
    eig3.EIG3(velocity="explicit"),
    eig3.EIG(3),
    eig3.EIG(np.int64(5)),
    eig3.CentralDifference(solver="newton", tol=1e-9, max_iterations=20),
    eig3.RK8(),
]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_the_record_of_the_method_comes_back(method, tmp_path):
    loaded = eig3.load(oscillate(method).save(tmp_path / "run"))
    assert loaded.method == method
    assert type(loaded.method) is type(method)


def test_a_jacobian_is_left_out_with_a_note(tmp_path):
    run = oscillate(eig3.CentralDifference(jacobian=derivative, tol=1e-10))
    loaded = eig3.load(run.save(tmp_path / "run"))
    assert loaded.method == eig3.CentralDifference(tol=1e-10)
    assert len(loaded.notes) == len(run.notes) + 1
    assert "jacobian" in loaded.notes[-1]


def test_a_method_of_the_user_must_be_imported_first(symplectic_euler, tmp_path, monkeypatch):
    path = oscillate(symplectic_euler()).save(tmp_path / "run")
    assert eig3.load(path).method == symplectic_euler()
    with monkeypatch.context() as patch:
        patch.delitem(eig3.METHODS, "symplectic-euler")
        with pytest.raises(ValueError, match="import its class SymplecticEuler from the module symplectic_euler"):
            eig3.load(path)


def test_a_method_that_could_not_be_loaded_is_not_saved(tmp_path):
    class Variant(eig3.RK4):
        """It has no name of its own."""

    with pytest.raises(TypeError, match=r"give its class .*Variant a name"):
        oscillate(Variant()).save(tmp_path / "run")
    assert not [*tmp_path.iterdir()]


def test_other_values_are_refused_by_name(tmp_path):
    for outputs in ({"f": object()}, {"f": np.array([None])}):
        run = dataclasses.replace(oscillate(), outputs=outputs)
        with pytest.raises(TypeError, match=r"outputs\.0 of the solution is of the type"):
            run.save(tmp_path / "run")
    assert not [*tmp_path.iterdir()]


# Other files ---------------------------------------------------------------------------------------------------------


def test_files_of_others_are_refused(tmp_path):
    np.savez(tmp_path / "arrays.npz", t=np.zeros(3), u=np.zeros(3))
    (tmp_path / "text.npz").write_text("t,u,v\n")
    (tmp_path / "empty.npz").write_bytes(b"")
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "array.npy").rename(tmp_path / "array.npz")
    np.savez(tmp_path / "pickled.npz", eig3=np.array([{}], dtype=object))
    for name in ("arrays", "text", "empty", "array", "pickled"):
        with pytest.raises(ValueError, match=r"is not a file that Solution\.save has written"):
            eig3.load(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.npz"):
        eig3.load(tmp_path / "nowhere")


def test_damaged_files_are_refused(tmp_path):
    path = full_solution().save(tmp_path / "run")
    whole, sound = path.read_bytes(), eig3.load(path)
    message = "damaged|not a file that Solution.save has written"
    for size in (10, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=message):
            eig3.load(path)
    with zipfile.ZipFile(path.with_name("whole.npz"), "w") as file:
        file.writestr("eig3.npy", b"")
    with pytest.raises(ValueError, match=message):
        eig3.load(tmp_path / "whole")
    for place in range(0, len(whole), len(whole) // 40):
        flipped = bytearray(whole)
        flipped[place] ^= 0x10
        path.write_bytes(flipped)
        try:
            loaded = eig3.load(path)  # the place may be one of the file that nothing reads, such as a date
        except ValueError as error:
            assert "damaged: " in str(error)  # noqa: PT017
        else:
            assert_same(loaded, sound)


def rewritten(path, change):
    """Change the record of a file."""
    arrays = dict(np.load(path))
    record = json.loads(str(arrays["eig3"]))
    change(record, arrays)
    np.savez(path, **{**arrays, "eig3": np.array(json.dumps(record))})


def test_files_of_another_version_and_broken_records_are_refused(tmp_path):
    path = oscillate().save(tmp_path / "run")
    rewritten(path, lambda record, arrays: record.update(version=storage._VERSION + 1, solution="of another form"))
    with pytest.raises(ValueError, match=r"has version 8 of its format, and not 7: use the eig3 that wrote it"):
        eig3.load(path)
    changes = [
        lambda record, arrays: record.pop("version"),
        lambda record, arrays: record["solution"].pop("t"),
        lambda record, arrays: arrays.pop("u"),
        lambda record, arrays: record["solution"].update(status={"status": "FINE"}),
        lambda record, arrays: record["solution"].update(colour="red"),
        lambda record, arrays: record["solution"]["method"].update(options={"alpha": 1}),
        lambda record, arrays: record["solution"].update(labels={"part": "os", "fields": {}}),
    ]
    for change in changes:
        oscillate().save(path)
        rewritten(path, change)
        with pytest.raises(ValueError, match="is damaged: take a copy of it"):
            eig3.load(path)


def hostile(path, place, value):
    """Change one value of the record of a file."""

    def change(record, arrays):
        fields = record["solution"]
        for name in place[:-1]:
            fields = fields[name]
        fields[place[-1]] = value

    rewritten(path, change)


ARRAY = {"array": "matrix"}
HOSTILE = [
    *((("h",), value) for value in ("0.1", None, [0.1], True, {"array": "t"})),
    *((("n_steps",), value) for value in (-1, 1.5, True, 10**30, "3", None)),
    *(((name,), -3) for name in ("n_rhs", "n_iterations", "n_rejected")),
    *((("kernel_seconds",), value) for value in ("fast", None, 10**400)),
    *((("message",), value) for value in (3, None, ["a"], {"array": "t"})),
    *((("_explanation",), value) for value in (3, None)),
    *((("status",), value) for value in ("COMPLETED", None, 3)),
    *((("method",), value) for value in ("rk4", None, {"part": "Labels", "fields": {}})),
    *((("notes",), value) for value in ("a note", [3], None)),
    *((("labels",), value) for value in ("x", {"part": "Labels", "fields": {"names": [3]}})),
    (("labels",), {"part": "Labels", "fields": {"names": [], "units": 3}}),
    *((("drift",), value) for value in (3, {"names": ["e"], "values": ["large"]}, {"names": [3], "values": [0.1]})),
    (("drift",), {"names": ["e", "f"], "values": [0.1]}),
    (("drift",), {"names": ["e"], "values": [10**400]}),
    *((("extremes",), {"names": ["e"], "values": [value]}) for value in (3, [1, 2, 3, 4], ARRAY)),
    (("extremes", "values", 0, "fields", "low"), "low"),
    *((("events",), {"names": ["e"], "values": [value]}) for value in (3, ARRAY)),
    (("events", "values", 1, "fields", "u_after"), {"array": "t"}),
    (("events", "values", 1, "fields", "t"), 3.0),
    *((("outputs",), {"names": ["e"], "values": [value]}) for value in (3, ARRAY, {"array": "texts"})),
    (("z",), {"names": ["work"], "values": [ARRAY]}),
    *((("t",), value) for value in (3, None, ARRAY, {"array": "texts"}, {"array": "nowhere"}, {"array": "nothing"})),
    *((("u",), value) for value in (3, None, ARRAY, {"array": "texts"}, {"array": "scalar"})),
    *((("v",), value) for value in (3, None, ARRAY)),
    *((("steps",), value) for value in (3, ARRAY)),
    *((("_a",), value) for value in (3, ARRAY)),
    *((("error",), value) for value in ("text", 3, ARRAY)),
    (("error", "fields", "u"), {"array": "scalar"}),
    (("error", "fields", "outputs"), {"names": ["e"], "values": [ARRAY]}),
    (("error", "fields", "order"), "two"),
    (("error", "fields", "by"), 3),
    *((("reason",), value) for value in ("text", 3)),
    *((("_extend",), value) for value in ("text", 3)),
    *((("_knots",), value) for value in ("text", 3)),
    *((("_resume",), value) for value in ("text", 3)),
]


@pytest.mark.parametrize(("place", "value"), HOSTILE, ids=repr)
def test_values_of_other_types_are_refused(place, value, hostile_file, tmp_path):
    path = tmp_path / "run.npz"
    path.write_bytes(hostile_file.read_bytes())
    hostile(path, place, value)
    with pytest.raises(ValueError, match="is damaged: take a copy of it"):
        eig3.load(path)


@pytest.fixture(scope="module")
def hostile_file(tmp_path_factory):
    path = full_solution().save(tmp_path_factory.mktemp("hostile") / "run")
    others = {"matrix": np.zeros((7, 7, 7)), "texts": np.full(31, "a"), "nothing": np.zeros(0), "scalar": np.array(1.0)}
    rewritten(path, lambda record, arrays: arrays.update(others))
    assert repr(eig3.load(path))
    return path


@pytest.mark.parametrize("place", [("stepper", "state"), ("stepper", "counters"), ("stepper", "numbers")])
@pytest.mark.parametrize("value", [None, "text", 3, {"array": "t"}, {"array": "texts"}], ids=repr)
def test_a_damaged_state_is_found_when_the_run_goes_on(place, value, tmp_path):
    """A right-hand side beside a state of another shape would read and write beyond its arrays."""
    path = oscillate(invariants={"energy": energy}).save(tmp_path / "run")

    def change(record, arrays):
        described = record["solution"]["_resume"]
        for name in place[:-1]:
            described = described["values"][described["names"].index(name)]
        described["values"][described["names"].index(place[-1])] = value
        arrays["texts"] = np.full(3, "a")

    rewritten(path, change)
    assert eig3.load(path).success
    with pytest.raises(ValueError, match="the run cannot be continued from its file"):
        eig3.load(path, rhs=oscillator, invariants={"energy": energy})


def test_only_the_arrays_of_the_record_are_read(tmp_path, monkeypatch):
    path = oscillate().save(tmp_path / "run")
    rewritten(path, lambda record, arrays: arrays.update(other=np.zeros(10)))
    read = []
    getitem = np.lib.npyio.NpzFile.__getitem__
    monkeypatch.setattr(
        np.lib.npyio.NpzFile, "__getitem__", lambda file, name: (read.append(name), getitem(file, name))[1]
    )
    eig3.load(path)
    assert {"eig3", "t", "u"} <= set(read)
    assert "other" not in read


def test_compressed_arrays_are_refused(tmp_path):
    """A small file of zeros could fill the memory."""
    path = oscillate().save(tmp_path / "run")
    np.savez_compressed(path, **dict(np.load(path)))
    with pytest.raises(ValueError, match=r"is not a file that Solution\.save has written"):
        eig3.load(path)


def test_a_file_is_complete_or_not_there(tmp_path):
    """A limit of the system to the size of files stands for a full disk."""
    old = oscillate().save(tmp_path / "run").read_bytes()
    big = eig3.integrate(structure, (0, 1), np.ones(20), np.zeros(20), h=1e-3, params=np.ones(800))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for name in ("run", "other"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        try:
            with pytest.raises(OSError, match="File too large"):
                big.save(tmp_path / name)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == {"run.npz": old}
    with pytest.raises(OSError, match="No such file or directory"):
        big.save(tmp_path / "no folder" / "run")


def test_a_file_is_read_in_a_new_process_and_by_numpy_alone(tmp_path):
    run = full_solution()
    path = run.save(tmp_path / "run")
    code = f"import eig3; s = eig3.load({str(path)!r}); print(repr(float(s.at(1.23)[0])), len(s.outputs))"
    assert python("-c", code) == f"{float(run.at(1.23)[0])!r} {len(run.outputs)}\n"
    with np.load(path, allow_pickle=False) as arrays:
        for name in ("t", "u", "v", "a", "steps"):
            np.testing.assert_array_equal(arrays[name], getattr(run, name))
        np.testing.assert_array_equal(arrays["events.1.t"], [1.05])
