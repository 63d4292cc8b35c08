"""Kernels are loaded from disk where they were compiled before: compilations are counted, not seconds."""

import errno
import os
import re
import shutil
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest

import eig3
from eig3.cli import main
from eig3.kernels import carried_points
from eig3.kernels.compile import cache, content
from eig3.kernels.compile.jit import symbol_of, with_symbol
from eig3.kernels.compile.numba_internals import NoFolderError, cache_of
from eig3.kernels.compile.numba_internals import compilations as counted

from .conftest import ALL_METHODS, python

USER = """
import numba
import eig3
from eig3.cli import main

@numba.njit(cache=True)
def rhs(t, u, v, p):
    return -u

print(eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.1).u[-1])
"""

SCRIPT = """
import gc
import sys

import eig3
from eig3.cli import main
from eig3.kernels.compile.numba_internals import Jitted, compilations, compile_results

ours = [x for x in gc.get_objects() if issubclass(type(x), Jitted) and x.py_func.__module__.startswith("eig3.")]
assert ours and not any(map(compile_results, ours))  # the import compiles and loads nothing

@eig3.jit
def rhs(t, u, v, p):
    return -u - 0.1 * v

@eig3.jit
def vector_rhs(t, u, v, p, a):
    a[0] = -u[0] - 0.1 * v[0]

@eig3.jit
def energy(t, u, v, p):
    return v * v + u * u

with compilations() as compiled:
    for method in [eig3.METHODS[name] for name in sys.argv[1:]]:
        assert eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.01, method=method(), invariants={"energy": energy}).success
        assert eig3.integrate(vector_rhs, (0, 1), [1.0], [0.0], h=0.01, method=method()).success
names = [str(function.py_func.__module__) for function in compiled]  # a function that Numba writes may have none
print(sum(name.startswith("eig3.kernels") for name in names), names.count("__main__"))
"""


def compilations(*methods, cache=None):
    """How many functions of the kernels and of the script a new process compiles, for these methods."""
    environment = os.environ if cache is None else {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", SCRIPT, *methods]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert result.stderr == ""  # no warning of Numba's reaches the user
    return tuple(map(int, result.stdout.split()))


@pytest.mark.system
def test_second_process_compiles_nothing_until_the_cache_is_cleared(tmp_path):
    kernels, own = compilations("rk2", cache=tmp_path)
    assert kernels > 0
    assert own == 3
    assert compilations("rk2", cache=tmp_path) == (0, 0)
    kept = list(tmp_path.rglob("*.nbc"))
    assert kept
    assert cache_command("--path", tmp_path) == [str(kept[0].parent)]
    assert cache_command("--clear", tmp_path) == [f"{kept[0].parent}: {len(kept)} files deleted"]
    assert not list(tmp_path.rglob("*.nbc"))


@pytest.mark.system
def test_the_cache_is_filled_ahead(tmp_path):
    first, took, last = cache_command("--fill", tmp_path, "cd")
    assert re.match(r" 1 of 1: cd, \d\d+ functions in \d+\.\d s$", first)
    assert re.match(r"\d\d+ functions compiled in \d+ s \(\d+\.\d s of CPU time\)\. They are in$", took)
    assert Path(last).is_dir()
    assert compilations("cd", cache=tmp_path)[0] == 0  # the kernels are there
    assert cache_command("--fill", tmp_path, "cd")[0].startswith(" 1 of 1: cd, 0 functions")


def test_a_use_that_is_not_known_is_refused():
    with pytest.raises(SystemExit, match=r"there is no use rk17; the uses are eig3, cd, "):
        main(["cache", "--fill", "rk17"])


def cache_command(option, folder, *arguments):
    """The lines that `eig3 cache` prints for another folder."""
    return python("-m", "eig3", "cache", option, *arguments, NUMBA_CACHE_DIR=str(folder)).splitlines()


@pytest.mark.system
def test_no_method_compiles_a_kernel_that_is_on_disk():
    methods = sorted({method.name for method in ALL_METHODS})
    compilations(*methods)  # the first process may compile them
    assert compilations(*methods) == (0, 0)


def test_a_change_of_any_kernel_file_is_noticed(tmp_path, monkeypatch):
    copy = tmp_path / "kernels"
    shutil.copytree(Path(content.__file__).parent.parent, copy)
    monkeypatch.setattr(content, "__file__", str(copy / "compile" / "content.py"))
    before = content.fingerprint.__wrapped__()
    march = copy / "loops" / "march.py"
    march.write_text(march.read_text() + "\n")
    assert content.fingerprint.__wrapped__() != before


@eig3.jit
def square(x):
    return x * x


def test_without_a_place_for_the_cache_functions_are_compiled_with_a_warning(monkeypatch):
    def nowhere(function, name):
        raise NoFolderError

    monkeypatch.setattr(cache, "_warned", set())
    monkeypatch.setattr(cache, "CheckedCache", nowhere)
    with pytest.warns(RuntimeWarning, match=r"code \(neither .* can be written\), so .*: choose another folder"):
        function = eig3.jit(square.py_func)
    assert function(3.0) == 9.0


@pytest.mark.parametrize("option", ["--path", "--clear", "--fill"])
def test_the_command_says_first_that_there_is_no_place(option, monkeypatch):
    """Nothing is compiled before that."""

    def nowhere(function):
        raise NoFolderError

    monkeypatch.setattr(cache, "CheckedCache", nowhere)
    monkeypatch.delattr("eig3.cli.cache._fill")
    with pytest.raises(SystemExit, match=r"eig3 cache: neither .* can be written"):
        main(["cache", option])


def test_the_warning_comes_once_and_names_the_folder_and_the_command(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_warned", set())
    functions = [eig3.jit(square.py_func) for _ in range(2)]
    for function in functions:
        cache_of(function.for_python).files.folder = tmp_path / "a file"
    (tmp_path / "a file").touch()
    with pytest.warns(RuntimeWarning) as caught:
        values = [function(3.0) for function in functions]
    assert values == [9.0, 9.0]
    (warning,) = caught
    assert str(tmp_path) in str(warning.message)
    assert "eig3 cache --clear" in str(warning.message)


def test_other_errors_of_numba_come_through(monkeypatch):
    def broken(function, name):
        raise RuntimeError("out of registers")

    monkeypatch.setattr(cache, "CheckedCache", broken)
    with pytest.raises(RuntimeError, match="out of registers"):
        eig3.jit(square.py_func)


@pytest.mark.system
def test_a_users_function_in_numbas_cache_survives_damage(tmp_path):
    (tmp_path / "user.py").write_text(USER)

    def printed():
        return python("-W", "ignore", "user.py", cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))

    first = printed()
    files = list((tmp_path / "cache").rglob("*.nbc"))
    assert files
    for path in files:
        os.truncate(path, 100)
    assert printed() == first


def test_a_function_can_be_compiled_anew():
    function = eig3.jit(square.py_func)
    assert function(3.0) == 9.0
    function.recompile()
    assert function(3.0) == 9.0
    with counted() as functions:  # the code stays on the disk
        assert eig3.jit(square.py_func)(3.0) == 9.0
    assert not functions


OWN = cache._this_user()


class Intruder:
    """An object whose pickle makes a file where it is loaded."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.fixture
def shared(tmp_path):
    """A folder with a file of compiled code that makes another file, "mark", when it is loaded."""
    folder = tmp_path / "shared"
    folder.mkdir(mode=0o755)
    files = cache._Files(folder, "stamp", OWN)
    files.save("key", Intruder(tmp_path / "mark"))
    return SimpleNamespace(folder=folder, files=files, path=next(folder.iterdir()), mark=tmp_path / "mark")


needs_owners = pytest.mark.skipif(os.name == "nt", reason="Windows has no owners and modes of files")


@needs_owners
@pytest.mark.parametrize("name", ["folder", "path"])
@pytest.mark.parametrize("mode", [0o757, 0o777])
def test_what_others_can_write_is_not_loaded(shared, name, mode):
    getattr(shared, name).chmod(mode)
    with pytest.raises(cache._UntrustedError, match=f"any user.* can write {getattr(shared, name)}$"):
        shared.files.load("key")
    assert not shared.mark.exists()
    if name == "folder":
        with pytest.raises(cache._UntrustedError):
            shared.files.save("key", 1)
    else:
        shared.files.save("key", 1)  # the file is replaced by one that nobody else can write
        assert shared.files.load("key") == 1


@needs_owners
def test_code_of_another_user_is_not_loaded(shared):
    """Seen from that user, the files are those of another one; but not if the source of the function is so too."""
    stranger = frozenset({("user", os.geteuid() + 1)})
    files = cache._Files(shared.folder, "stamp", stranger)
    with pytest.raises(cache._UntrustedError, match=f"^user {os.geteuid()} can write {shared.folder}$"):
        files.load("key")
    assert not shared.mark.exists()
    shared.files.save("key", 1)
    assert cache._Files(shared.folder, "stamp", stranger | cache._writers(Path(__file__).stat())).load("key") == 1


@needs_owners
def test_a_link_to_a_file_that_others_can_write_is_not_loaded(shared, tmp_path):
    place = tmp_path / "elsewhere"
    shared.path.rename(place)
    place.chmod(0o666)
    shared.path.symlink_to(place)
    with pytest.raises(cache._UntrustedError, match=r"^any user.* can write"):
        shared.files.load("key")
    assert not shared.mark.exists()


@needs_owners
def test_new_files_can_be_written_by_nobody_else(tmp_path):
    before = os.umask(0)
    try:
        cache._Files(tmp_path, "stamp", OWN).save("key", 1)
    finally:
        os.umask(before)
    assert [path.stat().st_mode & 0o777 for path in tmp_path.iterdir()] == [0o644]


@needs_owners
def test_only_a_group_without_other_members_is_the_users_own(monkeypatch):
    def groups(name, *members):
        monkeypatch.setattr(cache.pwd, "getpwuid", lambda user: SimpleNamespace(pw_name="ada", pw_gid=1234))
        monkeypatch.setattr(
            cache.grp, "getgrgid", lambda group: SimpleNamespace(gr_name=name, gr_gid=group, gr_mem=members)
        )
        return {number for kind, number in cache._this_user() if kind == "group"}

    assert groups("ada") == groups("ada", "ada") == {1234}
    assert groups("ada", "bob") == groups("users") == set()


@needs_owners
def test_in_a_folder_of_others_a_function_is_compiled_with_one_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_warned", set())
    functions = [eig3.jit(square.py_func) for _ in range(2)]
    tmp_path.chmod(0o777)
    for function in functions:
        cache_of(function.for_python).files.folder = tmp_path
    with pytest.warns(RuntimeWarning) as caught:
        values = [function(3.0) for function in functions]
    assert values == [9.0, 9.0]
    (warning,) = caught
    words = str(warning.message)
    assert f"any user, group {tmp_path.stat().st_gid} can write" in words or f"any user can write {tmp_path}" in words
    assert "your own (chown, chmod go-w), or choose another folder with the environment variable NUMBA_CACHE" in words
    assert not list(tmp_path.iterdir())


def test_what_a_users_function_calls_has_the_checked_cache_too():
    @numba.njit(cache=True)
    def helper(x):
        return x * x

    @numba.njit
    def between(x):
        return helper(x)

    @eig3.jit
    def rhs(t, u, v, p):
        return -between(u)

    eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.1)
    assert type(cache_of(helper)) is cache.CheckedCache


def test_to_clear_the_cache_leaves_what_links_point_at(tmp_path):
    folder, other = tmp_path / "folder", tmp_path / "other"
    for each in (folder, other, folder / "d.nbc", other / "e.nbc"):
        each.mkdir()
    for name in ("a.nbi", "b.nbc", "c.py"):
        (folder / name).touch()
        (other / name).touch()
    (folder / "f.nbc").symlink_to(other / "b.nbc")
    (folder / "g.nbc").symlink_to(other)
    (folder / "h.nbi").symlink_to(other / "missing")
    (tmp_path / "link").symlink_to(other)
    with pytest.raises(OSError, match=f"link is a link to {other}: nothing is deleted there; delete"):
        cache.clear(tmp_path / "link")
    assert cache.clear(folder) == 6
    assert [path.name for path in folder.iterdir()] == ["c.py"]
    assert sorted(path.name for path in other.iterdir()) == ["a.nbi", "b.nbc", "c.py", "e.nbc"]


def test_a_file_that_cannot_be_deleted_is_named_and_the_others_are_deleted(tmp_path, monkeypatch):
    for name in ("a.nbc", "b.nbc", "c.nbc"):
        (tmp_path / name).touch()
    unlink = Path.unlink

    def refuse(path, **options):
        if path.name == "b.nbc":
            raise PermissionError(errno.EACCES, "Permission denied")
        unlink(path, **options)

    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(OSError, match=r"2 files deleted, but not b.nbc \(Permission denied\)"):
        cache.clear(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["b.nbc"]


def test_code_of_an_older_source_is_deleted(tmp_path):
    def files(stamp):
        return cache._Files(tmp_path, stamp, OWN)

    files("monday").save("key", 1)
    files("monday").save("other", 2)
    assert (files("monday").load("key"), files("monday").load("other")) == (1, 2)
    files("tuesday").save("key", 3)
    files("tuesday")._tidy()
    assert files("monday").load("key") is None
    assert len(list(tmp_path.iterdir())) == 1


def test_what_was_not_used_for_long_goes_first(tmp_path, monkeypatch):
    files = cache._Files(tmp_path, "stamp", OWN)
    for age, key in enumerate("abcd"):
        files.save(key, bytes(1000))
        os.utime(files._path((key, files._versions)), (1e9 - age, 1e9 - age))
    assert files.load("d") == bytes(1000)  # it is used now
    monkeypatch.setattr(cache, "_MOST_BYTES", 2500)
    files._tidy()
    assert [files.load(key) is not None for key in "abcd"] == [True, False, False, True]


def test_two_keys_of_one_text_are_different(tmp_path):
    files = cache._Files(tmp_path, "stamp", OWN)
    files.save("'a'", 1)
    assert files.load("'a'") == 1
    path = files._path(("'a'", files._versions))
    path.rename(files._path(("'b'", files._versions)))
    assert files.load("'b'") is None


def test_a_function_is_looked_for_once_to_find_its_symbol(monkeypatch):
    """What is looked for on the disk needs the symbols of the functions that it calls, but not its own."""
    looked = []
    find = cache.CheckedCache.find_key
    monkeypatch.setattr(cache.CheckedCache, "find_key", lambda self: looked.append(self) or find(self))

    @eig3.jit
    def doubled(x):
        return 2.0 * x

    symbol = symbol_of(with_symbol(doubled, numba.float64(numba.float64)))
    assert symbol.startswith("doubled_")
    assert looked == [cache_of(doubled)]


def test_a_function_of_the_library_that_is_loaded_has_the_symbol_of_its_code(monkeypatch):
    asked = []
    monkeypatch.setattr(carried_points.gather.py_func, "made", lambda: asked.append("gather"))
    assert cache.CheckedCache(carried_points.gather.for_python).find_key()
    assert asked == ["gather"]


def test_compilation_in_threads_leaves_the_filters_of_warnings_as_they_were():
    def compile_new(number):
        @eig3.jit
        def rhs(t, u, v, p):
            return -u - 0.1 * v

        return eig3.integrate(rhs, (0, 1), 1.0, 0.0, h=0.1, inline=number % 2 == 0).u[-1]

    before = list(warnings.filters)
    with ThreadPoolExecutor(6) as pool:
        values = list(pool.map(compile_new, range(6)))
    assert warnings.filters == before
    assert len(values) == 6
