"""Histories in files: they are those of runs in memory, and a process that is killed leaves what it had computed."""

import errno
import json
import os
import shutil
import subprocess
import sys
import textwrap
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import eig3
from eig3.result import mapped, storage
from eig3.result.mapped import MappedRows, read_mapped

from .conftest import assert_same, coupled, energy, oscillator, python

H = 2.0**-6
SCALAR = (oscillator, (0.0, 10.0), 1.0, 0.0), {"params": (2.0, 0.1), "h": H}
VECTOR = (coupled, (0.0, 10.0), [1.0, 2.0, 3.0], [0.0] * 3), {"params": (1.0, 2.0, 3.0), "h": H}


@eig3.jit
def failing(t, u, v, p):
    if t > 5:
        raise ValueError("beyond the table")
    return -u


@pytest.mark.filterwarnings("ignore:the saved states around")  # two states are too few for `at`
@pytest.mark.parametrize("save_every", [1, 7, None])
@pytest.mark.parametrize(("system", "watched"), [(SCALAR, False), (SCALAR, True), (VECTOR, False)])
def test_a_history_in_files_is_that_in_memory(system, watched, save_every, tmp_path):
    arguments, options = system
    functions = {"invariants": {"e": energy}, "outputs": {"o": energy}} if watched else {}
    options = {**options, **functions, "save_every": save_every}
    run = eig3.integrate(*arguments, **options, save_to=tmp_path / "new" / "run")
    memory = eig3.integrate(*arguments, **options)
    loaded = eig3.load(tmp_path / "new" / "run")
    for each in (run, loaded):
        assert_same(each, memory)
        assert isinstance(each.u, np.memmap)
        with pytest.raises(ValueError, match="read-only"):
            each.u[0] = 0.0
    assert loaded.kernel_seconds == run.kernel_seconds
    assert repr(loaded) == repr(run)
    for name in ("t", "u", "v"):  # without eig3 too
        np.testing.assert_array_equal(np.load(tmp_path / "new" / "run" / f"{name}.npy"), getattr(memory, name))
    if save_every:  # the two ends alone are too far apart
        np.testing.assert_array_equal(run.at(1.234), memory.at(1.234))
    assert_same(eig3.load(loaded.save(tmp_path / "file")), memory)


@pytest.mark.parametrize(("t_end", "h", "status"), [(1e4, 1.5, "DIVERGED"), (10.0, H, "TERMINATED")])
def test_the_files_end_where_the_run_ended(t_end, h, status, tmp_path):
    arguments, options = (oscillator, (0.0, t_end), 1.0, 0.0), {"params": (2.0, 0.0), "h": h}
    if status == "TERMINATED":
        options["events"] = {"slow": eig3.Event(crossing, terminal=True)}
    run = eig3.integrate(*arguments, **options, save_to=tmp_path)
    memory = eig3.integrate(*arguments, **options)
    loaded = eig3.load(tmp_path)
    assert loaded.status is eig3.Status[status]
    assert_same(run, memory)
    assert_same(loaded, memory)
    assert len(np.load(tmp_path / "u.npy")) == len(memory.u)


crossing = eig3.jit(lambda t, u, v, p: u + 0.5)


def test_problems_with_integrals_are_saved_with_their_names(tmp_path):
    problem = eig3.problems.shear_building(work=True)
    memory = problem.integrate(h=1e-3, t_end=0.1)
    assert_same(problem.integrate(h=1e-3, t_end=0.1, save_to=tmp_path / "run"), memory)
    assert_same(eig3.load(tmp_path / "run"), memory)
    extended = problem.integrate(h=1e-3, t_end=0.05).extend(0.1, save_to=tmp_path / "extended")
    assert_same(eig3.load(tmp_path / "extended"), extended)
    np.testing.assert_array_equal(extended.u, memory.u)


def test_extended_runs_go_from_files_to_files(tmp_path):
    arguments, options = SCALAR
    first = eig3.integrate(*arguments, **options, save_every=7, save_to=tmp_path / "first")
    extended = first.extend(20.0, save_to=tmp_path / "second").extend(30.0)
    whole = eig3.integrate(arguments[0], (0.0, 30.0), *arguments[2:], **options, save_every=7)
    assert_same(extended, whole)
    assert eig3.load(tmp_path / "second").t[-1] == 20.0
    assert eig3.load(tmp_path / "first").t[-1] == 10.0


@pytest.mark.parametrize("system", ["scalar", "vector with work"])
@pytest.mark.parametrize("steps", [{"h": H}, {"rtol": 1e-6}], ids=["h", "rtol"])
def test_many_states_in_files_are_not_joined_in_memory(steps, system, tmp_path, monkeypatch):
    monkeypatch.setattr("eig3.run.chunks._MOST_JOINED", 8 * 3 * 2)
    if system == "scalar":
        run, load = partial(eig3.prepare(oscillator, **steps), params=(2.0, 0.1)), partial(eig3.load, rhs=oscillator)
        given = (0.0, 1.0), 1.0, 0.0
    else:
        problem = eig3.problems.shear_building(work=True)
        run, load, given = problem.prepare(**steps), problem.load, ((0.0, 1.0),)
    in_memory, in_files = run(*given), run(*given, save_to=tmp_path / "run")
    longer = in_memory.extend(2.0)
    for k, each in enumerate((in_files, load(tmp_path / "run"))):
        with pytest.raises(ValueError, match=r"^save_to must name a new directory for the whole history: .* bytes"):
            each.extend(2.0)
        assert_same(each.extend(2.0, save_to=tmp_path / f"longer {k}"), longer)


def test_an_exception_leaves_the_rows_before_it(tmp_path):
    with pytest.raises(ValueError, match="beyond the table") as caught:
        eig3.integrate(failing, (0.0, 10.0), 1.0, 0.0, h=H, save_to=tmp_path)
    loaded = eig3.load(tmp_path)
    assert loaded.status is eig3.Status.INTERRUPTED
    assert "raised ValueError" in loaded.message
    assert loaded.t[-1] == 5.0 + H  # the step from t = 5 to here evaluates rhs at t = 5
    assert_same(loaded, caught.value.solution)


def fail_after(limit):
    """Return a posix_fallocate for a disk with space for `limit` bytes."""
    given = 0

    def reserve(file, offset, size):
        nonlocal given
        given += size
        if given > limit:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fallocate(file, offset, size)

    fallocate = os.posix_fallocate
    return reserve


@pytest.mark.parametrize("limit", [0, 10_000])
def test_a_full_disk_is_an_error_before_the_run(limit, tmp_path, monkeypatch):
    arguments, options = SCALAR
    monkeypatch.setattr(os, "posix_fallocate", fail_after(limit))
    with pytest.raises(
        OSError, match=r"history in .* needs 1\.54e\+04 bytes for 641 rows.* larger save_every"
    ) as caught:
        eig3.integrate(*arguments, **options, save_to=tmp_path)
    assert caught.value.errno == errno.ENOSPC
    assert not any(tmp_path.iterdir())
    monkeypatch.undo()
    assert eig3.integrate(*arguments, **options, save_to=tmp_path).success


def test_too_little_free_space_is_an_error_that_names_a_save_every(tmp_path, monkeypatch):
    arguments, options = SCALAR
    monkeypatch.setattr("shutil.disk_usage", lambda path: Usage)
    with pytest.raises(OSError, match=r"needs 1\.54e\+04 bytes and the disk of .* has 6e\+03 free; save_every=3 would"):
        eig3.integrate(*arguments, **options, save_to=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    assert eig3.integrate(*arguments, **options, save_every=3, save_to=tmp_path / "run").success


class Usage:
    free = 6000


def test_the_free_memory_is_no_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("eig3.result.memory.available_memory", lambda: 1e5)
    arguments, options = SCALAR
    options = {**options, "h": 5e-5}  # more rows than those of a short run, which does not look at the free memory
    with pytest.raises(MemoryError):
        eig3.integrate(*arguments, **options)
    assert len(eig3.integrate(*arguments, **options, save_to=tmp_path).t) == 200_001


@pytest.fixture
def many_records(monkeypatch):
    """A run is recorded after each of its slices, which are short."""
    monkeypatch.setattr(storage, "_LEAST_PAUSE", 0.0)
    monkeypatch.setattr(storage, "_LARGEST_SHARE", 1e9)
    for name in ("run.chunks._CHUNK_SECONDS", "stepping.slices._SECONDS", "stepping.slices._FIRST_SECONDS"):
        monkeypatch.setattr(f"eig3.{name}", 1e-6)


@pytest.mark.parametrize("options", [{"h": 2.0**-13}, {"rtol": 1e-6}], ids=["fixed", "tolerances"])
def test_a_full_disk_loses_no_more_than_the_steps_since_the_last_record(options, tmp_path, monkeypatch, many_records):
    """These are in memory, and a run that goes on from the record finds them again."""
    options = {**options, "params": (2.0, 0.1)}
    writes = iter(4 * [False] + 2 * [True])
    savez = np.savez

    def full(*files, **arrays):
        if next(writes):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        savez(*files, **arrays)

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="No space left") as caught:
        eig3.integrate(*SCALAR[0], **options, save_to=tmp_path)
    monkeypatch.undo()
    kept = caught.value.solution
    loaded = eig3.load(tmp_path)
    assert loaded.status is eig3.Status.INTERRUPTED
    assert 1 < len(loaded.u) <= len(kept.u)
    np.testing.assert_array_equal(loaded.u, kept.u[: len(loaded.u)])
    whole = eig3.integrate(*SCALAR[0], **options)
    assert_same(eig3.load(tmp_path, rhs=oscillator).extend(10.0), whole)
    assert not [path for path in tmp_path.iterdir() if path.suffix == ".part"]


@pytest.mark.parametrize("options", [SCALAR[1], {"params": (2.0, 0.1), "rtol": 1e-6}], ids=["fixed", "tolerances"])
def test_the_run_that_comes_second_leaves_the_files_of_the_first(options, tmp_path, monkeypatch):
    """Both have seen an empty directory."""
    first = eig3.integrate(*SCALAR[0], **options, save_to=tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(mapped, "check_directory", lambda path: None)
    monkeypatch.setattr(storage, "check_directory", lambda path: None)
    with pytest.raises(
        FileExistsError, match=r"save_to must name a new .* the files of another run.*: name another one"
    ):
        eig3.integrate(*SCALAR[0], **options, save_to=tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert_same(eig3.load(tmp_path), first)


TWO_RUNS = """
    import sys, time
    import eig3

    @eig3.jit
    def rhs(t, u, v, p):
        return -u

    eig3.integrate(rhs, (0.0, 1.0), 1.0, 0.0, h=0.1)
    print("ready", flush=True)
    for line in sys.stdin:
        try:
            eig3.integrate(rhs, (0.0, 1.0), 1.0, 0.0, h=0.1, save_to=line.strip())
            print("ran", flush=True)
        except FileExistsError as error:
            print(str(error).partition(",")[0], flush=True)
"""


@pytest.mark.system
def test_of_two_runs_that_begin_together_one_is_complete(tmp_path):
    code = [sys.executable, "-c", textwrap.dedent(TWO_RUNS)]
    processes = [subprocess.Popen(code, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    try:
        assert [process.stdout.readline() for process in processes] == ["ready\n"] * 2
        for k in range(20):
            for process in processes:
                process.stdin.write(f"{tmp_path / str(k)}\n")
                process.stdin.flush()
            said = sorted(process.stdout.readline() for process in processes)
            assert said == ["ran\n", "save_to must name a new or an empty directory\n"]
            loaded = eig3.load(tmp_path / str(k))
            assert (loaded.status, len(loaded.t)) == (eig3.Status.COMPLETED, 11)
    finally:
        for process in processes:
            process.communicate()


def test_a_directory_is_read_again_if_its_run_ends_meanwhile(tmp_path, monkeypatch):
    """Between the header of a file and its rows, the run cuts the file after its last row."""
    run = eig3.integrate(*SCALAR[0], **SCALAR[1], save_to=tmp_path)
    load, failures = np.load, iter(2 * [True])

    def cut(file, mmap_mode=None, **options):
        if mmap_mode and next(failures, False):
            raise ValueError("mmap length is greater than file size")
        return load(file, mmap_mode=mmap_mode, **options)

    monkeypatch.setattr(np, "load", cut)
    assert_same(eig3.load(tmp_path), run)


@pytest.mark.parametrize("refusals", [4, 5])
def test_a_file_that_is_being_read_is_replaced_later(refusals, tmp_path, monkeypatch):
    """Windows does not replace a file while another process reads it."""
    (tmp_path / "new").write_text("new")
    (tmp_path / "old").write_text("old")
    replace, asked, waited = Path.replace, [], []

    def refusing(path, target):
        asked.append(path)
        if len(asked) <= refusals:
            raise PermissionError(errno.EACCES, "Access is denied")
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", refusing)
    monkeypatch.setattr(storage.time, "sleep", waited.append)
    if refusals < storage._TRIALS:
        storage._rename(tmp_path / "new", tmp_path / "old")
        assert (tmp_path / "old").read_text() == "new"
    else:
        with pytest.raises(PermissionError):
            storage._rename(tmp_path / "new", tmp_path / "old")
        assert (tmp_path / "old").read_text() == "old"
    assert waited == 4 * [storage._PAUSE]


def test_a_directory_is_sound_at_every_moment_of_a_run(tmp_path, monkeypatch):
    """A thread reads it again and again while runs begin and end."""
    monkeypatch.setattr(storage, "_LEAST_PAUSE", 0.0)
    monkeypatch.setattr("eig3.run.chunks._CHUNK_SECONDS", 1e-4)
    options = {**SCALAR[1], "h": 1e-3, "events": {"down": eig3.Event(crossing)}, "outputs": {"o": energy}}
    over, failures, seen = threading.Event(), [], set()

    def read():
        while not over.is_set():
            for directory in [*tmp_path.iterdir()]:
                if (directory / "run.npz").exists():
                    try:
                        loaded = eig3.load(directory)
                        assert np.isfinite(loaded.u).all()
                        expected = loaded.u * loaded.u + loaded.v * loaded.v
                        np.testing.assert_allclose(loaded.outputs["o"], expected, rtol=1e-15)  # fused or not
                        seen.add(loaded.status)
                    except Exception as error:
                        failures.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    try:
        for k in range(10):
            eig3.integrate(*SCALAR[0], **options, save_to=tmp_path / str(k))
    finally:
        over.set()
        thread.join()
    assert not failures
    assert eig3.Status.COMPLETED in seen


LIMITED = """
    import json, pathlib, resource, sys
    import numpy as np
    from eig3.result.mapped import MappedRows

    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    rows = MappedRows(pathlib.Path(sys.argv[1]), {"t": (), "u": (3,)}, 64)
    try:
        while True:
            new = slice(rows.count, len(rows.arrays["t"]))
            rows.arrays["t"][new] = np.arange(new.start, new.stop)
            rows.arrays["u"][new] = rows.arrays["t"][new, None] + [0, 1, 2]
            rows.count = new.stop
            rows.grow()
    except OSError as error:
        print(rows.count, error)
        print(json.dumps(rows.checksums(rows.count)))
"""


def test_rows_are_kept_when_the_disk_is_full(tmp_path):
    printed = python("-c", textwrap.dedent(LIMITED), tmp_path)
    assert "disk has no space (File too large); free some" in printed
    rows = int(printed.split()[0])
    arrays = read_mapped(tmp_path, json.loads(printed.splitlines()[1]), rows)
    assert 1000 <= rows <= 200_000 / 24
    np.testing.assert_array_equal(arrays["t"], np.arange(rows))
    np.testing.assert_array_equal(arrays["u"][:, 2], 2 + np.arange(rows))


@pytest.mark.parametrize("code", [None, errno.EOPNOTSUPP])
def test_zeros_reserve_the_space_where_the_system_cannot(code, tmp_path, monkeypatch):
    def refuse(*arguments):
        raise OSError(code, os.strerror(code))

    if code is None:
        monkeypatch.delattr(os, "posix_fallocate")
    else:
        monkeypatch.setattr(os, "posix_fallocate", refuse)
    rows = MappedRows(tmp_path, {"u": (2,)}, 200_000)
    file = tmp_path / "u.npy"
    assert file.stat().st_size == 128 + 16 * 200_000
    assert 512 * file.stat().st_blocks >= 16 * 200_000  # it is not sparse
    rows.arrays["u"][:] = 1.0
    rows.count = 150_000
    rows.close()
    assert file.stat().st_size == 128 + 16 * 150_000
    assert np.load(file).sum() == 300_000


def test_what_save_to_does_not_take(tmp_path):
    arguments, options = SCALAR
    with pytest.raises(TypeError, match="save_to must be the path of a directory, not 3"):
        eig3.integrate(*arguments, **options, save_to=3)
    with pytest.raises(ValueError, match=r"^\. is not a directory that save_to has written"):
        eig3.load(".")
    with pytest.raises(ValueError, match="is not a directory that save_to has written"):
        eig3.load(tmp_path)
    assert not any(tmp_path.iterdir())
    (tmp_path / "file").write_text("")
    for save_to in (tmp_path, tmp_path / "file"):
        with pytest.raises(FileExistsError, match=r"save_to must name a new or an empty directory, but .*another one"):
            eig3.integrate(*arguments, **options, save_to=save_to)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


DAMAGES = [
    lambda content: content[:200] + bytes(4) + content[200:],  # inserted
    lambda content: content[:200] + bytes(400) + content[600:],
    lambda content: content[:-8] + np.array(np.nan).tobytes(),
    lambda content: content[:300] + bytes([content[300] ^ 1]) + content[301:],
    lambda content: content[:-16] + content[-8:] + content[-16:-8],  # two numbers exchanged
    lambda content: content[: len(content) // 2],
]


@pytest.mark.parametrize("options", [SCALAR[1], {"params": (2.0, 0.1), "rtol": 1e-9}], ids=["fixed", "tolerances"])
def test_damage_is_found(options, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "_PAUSE", 0.0)
    eig3.integrate(*SCALAR[0], **options, outputs={"o": energy}, save_to=tmp_path)
    for file in tmp_path.glob("*.npy"):
        sound = file.read_bytes()
        for damage in DAMAGES:
            file.write_bytes(damage(sound))
            with pytest.raises(ValueError, match=rf"{file.name} is damaged: take a copy of it, or run again\.$"):
                eig3.load(tmp_path)
        file.unlink()
        with pytest.raises(ValueError, match="is damaged: take a copy of it"):
            eig3.load(tmp_path)
        file.write_bytes(sound)
    assert eig3.load(tmp_path).success
    os.truncate(tmp_path / "run.npz", (tmp_path / "run.npz").stat().st_size // 2)
    with pytest.raises(ValueError, match="damaged"):
        eig3.load(tmp_path)


def test_damage_of_a_run_that_was_killed_is_found(tmp_path, monkeypatch, many_records):
    """The rows after the last record may have any numbers, but not those before it."""
    keep, records = storage.Place.keep, []

    def copying(place, *arguments):
        if len(records) < 9:  # there could be one after each step
            keep(place, *arguments)
            records.append(tmp_path / f"after {len(records)}")
            shutil.copytree(place.directory, records[-1])

    monkeypatch.setattr(storage.Place, "keep", copying)
    whole = eig3.integrate(*SCALAR[0], params=(2.0, 0.1), h=H, save_every=3, save_to=tmp_path / "run")
    assert len(records) > 3
    rows = [len(eig3.load(record).t) for record in records]
    assert rows == sorted(rows)
    assert rows[-1] > 1
    for record, count in zip(records, rows, strict=True):
        for name in ("t", "u", "v"):
            saved = np.load(record / f"{name}.npy", mmap_mode="r+")
            saved[count:] = np.nan
            np.testing.assert_array_equal(getattr(eig3.load(record), name), getattr(whole, name)[:count])
        saved[count - 1] = np.nextafter(saved[count - 1], 1.0)
        with pytest.raises(ValueError, match=r"v\.npy is damaged"):
            eig3.load(record)


@pytest.mark.parametrize("save_every", [1, 7, None])
@pytest.mark.parametrize("system", [SCALAR, VECTOR])
def test_runs_with_tolerances_are_saved_too(system, save_every, tmp_path):
    arguments, options = system
    options = {"params": options["params"], "rtol": 1e-6, "save_every": save_every}
    if system is SCALAR:
        options |= {"invariants": {"e": energy}, "outputs": {"o": energy}}
    memory = eig3.integrate(*arguments, **options)
    run = eig3.integrate(*arguments, **options, save_to=tmp_path)
    for each in (run, eig3.load(tmp_path)):
        assert_same(each, memory)
        np.testing.assert_array_equal(each.steps, memory.steps)
        assert each.n_rejected == memory.n_rejected
        assert isinstance(each.u, np.memmap)


def test_a_full_disk_ends_a_run_with_tolerances_without_loss(tmp_path, monkeypatch):
    arguments, options = SCALAR
    options = {"params": options["params"], "rtol": 1e-9, "h_max": 1e-3}
    memory = eig3.integrate(*arguments, **options)
    monkeypatch.setattr(os, "posix_fallocate", fail_after(200_000))
    with pytest.raises(OSError, match="disk has no space") as caught:
        eig3.integrate(*arguments, **options, save_to=tmp_path)
    monkeypatch.undo()
    loaded = eig3.load(tmp_path)
    assert loaded.status is eig3.Status.INTERRUPTED
    rows = len(loaded.t)
    assert 1000 < rows < len(memory.t)
    for name in ("t", "u", "v"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(memory, name)[:rows])
    np.testing.assert_array_equal(caught.value.solution.u, loaded.u)
