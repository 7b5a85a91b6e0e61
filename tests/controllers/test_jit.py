"""The digest of a module sees what its kernels can be made of, and costs next to nothing.

Where kernels are kept: a directory nobody else can write, and no more versions than are of use.

Kernels are compiled anew when what they are made of changes, and only then, by one process only.

Ranges on threads.

What a process says while it compiles: with an empty cache of numba's, then with a filled one.
"""

import copy
import importlib
import multiprocessing
import os
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest
from push_recovery.controllers import jit
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.jit import LATELY, MESSAGE, RangeThreads

TEXTS = {
    "pack": "",
    "pack.room": "",
    "pack.room.deep": "from ..far import (\n    x,\n    near,\n)\n",
    "pack.far": "import heavy\n\n\ndef f():\n    from .unused import y\n",
    "pack.far.near": "A = 1\n",
    "pack.unused": "Y = 1\n",
    "pack.tables": 'NAME = "numbers.json"\n',
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Writes modules into `sys.modules` and gives a function: the digest of one of them, read anew."""
    for name in ("heavy", *TEXTS):
        module = types.ModuleType(name)
        module.__path__ = [str(tmp_path)]
        module.__file__ = str(tmp_path / name)
        module.__version__ = "1"
        monkeypatch.setitem(sys.modules, name, module)
        (tmp_path / name).write_text(TEXTS.get(name, ""))
    (tmp_path / "numbers.json").write_text("{}")

    def digest(name):
        jit.source_digest.cache_clear()
        jit.data_digest.cache_clear()
        return jit.source_digest(name)

    yield tmp_path, digest
    jit.source_digest.cache_clear()
    jit.data_digest.cache_clear()


@pytest.mark.parametrize("changed", ["pack.room.deep", "pack.far", "pack.far.near"])
def test_a_change_of_what_a_module_imports_changes_its_digest(package, changed):
    folder, digest = package
    before = digest("pack.room.deep")
    assert digest("pack.room.deep") == before
    (folder / changed).write_text(TEXTS[changed] + "# edited\n")
    assert digest("pack.room.deep") != before


@pytest.mark.parametrize("changed", ["pack.unused", "pack.tables", "numbers.json"])
def test_a_change_of_what_it_does_not_import_does_not(package, changed):
    folder, digest = package
    before = digest("pack.room.deep")
    (folder / changed).write_text("# edited\n")
    assert digest("pack.room.deep") == before


def test_data_files_count_where_a_module_names_any(package):
    folder, digest = package
    before = digest("pack.tables")
    (folder / "numbers.json").write_text("[]")
    assert digest("pack.tables") != before


def test_another_version_of_an_outside_package_counts(package, monkeypatch):
    _, digest = package
    before = digest("pack.far")
    monkeypatch.setattr(sys.modules["heavy"], "__version__", "2")
    assert digest("pack.far") != before


def test_the_modules_that_an_import_may_mean():
    found = jit.imported_modules("push_recovery.controllers.math3", 1, "jit", "njit")
    assert found == {"push_recovery.controllers.jit"}
    found = jit.imported_modules("push_recovery.controllers.math3", 1, "", "jit, x")
    assert found == {"push_recovery.controllers", "push_recovery.controllers.jit"}


def test_every_import_of_a_kernel_s_module_is_seen():
    """Against what Python holds: whatever of this project a module's globals came from is in its digest."""
    importlib.import_module("push_recovery.envs.biped.period")
    seen, wait = set(), ["push_recovery.envs.biped.period"]
    while wait:
        name = wait.pop()
        seen.add(name)
        for dots, base, names, _ in jit.IMPORT.findall(b"\n" + jit.source_of(name)):
            if dots:
                wait += jit.imported_modules(name, len(dots), base.decode(), names.decode()) - seen
    for name in seen:
        for value in vars(sys.modules[name]).values():
            origin = str(getattr(value, "__module__", ""))
            assert origin in seen or not origin.startswith("push_recovery."), (name, value)


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(jit.tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_the_least_lately_used_versions_of_a_module_are_deleted(tmp_path):
    digests = [f"{k:016x}" for k in range(jit.KEPT + 2)]
    for age, digest in enumerate(digests):
        path = tmp_path / f"controllers.a-{digest}"
        path.mkdir()
        (path / "kernel.nbi").write_text("")
        os.utime(path, (1000.0 - age, 1000.0 - age))
    others = ["controllers.a_b-00", "controllers.a.b-00", "lock"]
    for name in others:
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1.0, 1.0))
    new = tmp_path / f"controllers.a-{digests[-1]}"  # the oldest by its time, and the one just made
    jit.make_room(new)
    kept = {f"controllers.a-{digest}" for digest in [*digests[: jit.KEPT - 1], digests[-1]]}
    assert {path.name for path in tmp_path.iterdir()} == kept | set(others)


def test_a_version_in_use_counts_as_new(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "cache_root", lambda: tmp_path)
    path = tmp_path / "controllers.a-00"
    path.mkdir()
    os.utime(path, (1.0, 1.0))
    assert jit.module_directory("push_recovery.controllers.a", "00") == path
    assert path.stat().st_mtime > 1.0
    assert not jit.module_directory("push_recovery.controllers.a", "11").exists()


@pytest.mark.parametrize("given", [True, False])
def test_the_directory_is_the_users_or_the_one_that_is_named(tmp_path, monkeypatch, given):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    if given:
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "named"))
    elif os.name != "posix" or os.uname().sysname == "Darwin":
        pytest.skip("XDG is a convention of Linux")
    path = jit.cache_root.__wrapped__()
    assert path == tmp_path / ("named" if given else "xdg") / "push-recovery"
    assert path.is_dir()


def test_the_place_for_temporary_files_is_closed_to_others(temporary):
    path = jit.own_temporary_directory()
    assert path.parent == temporary
    assert path.stat().st_mode & 0o777 == 0o700
    assert jit.own_temporary_directory() == path


@pytest.mark.parametrize("planted", ["open", "link", "file"])
def test_what_another_may_have_planted_is_not_used(temporary, planted):
    path = jit.own_temporary_directory()
    path.rmdir()
    if planted == "open":
        path.mkdir()
        path.chmod(0o777)
    elif planted == "link":
        (temporary / "elsewhere").mkdir(mode=0o700)
        path.symlink_to(temporary / "elsewhere")
    else:
        path.write_text("")
    other = jit.own_temporary_directory()
    assert other not in (path, temporary / "elsewhere")
    assert Path(other).stat().st_mode & 0o777 == 0o700


IMPORT = "from push_recovery.controllers.jit import njit\n"
FILES = {
    "__init__.py": "",
    "limits.py": "GAIN = 2.0\n",
    "callee.py": IMPORT + "from .limits import GAIN\n\n\n"
    "@njit(cache=True)\ndef scaled(x):\n    return GAIN * x\n",
    "caller.py": IMPORT + "from .callee import scaled\n\n\n"
    "@njit(cache=True)\ndef shifted(x):\n    return scaled(x) + 1.0\n",
    "other.py": IMPORT + "\n\n@njit(cache=True)\ndef half(x):\n    return 0.5 * x\n",
}
CODE = """
from toy.caller import shifted
from toy.callee import scaled
from toy.other import half
print(shifted(3.0), half(3.0), [sum(k.stats.cache_misses.values()) for k in (shifted, scaled, half)])
"""


@pytest.fixture
def toy(tmp_path):
    """Folder of a package of four modules, and a function that runs CODE with a cache of its own."""
    folder = tmp_path / "toy"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    env = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def start(code=CODE):
        return subprocess.Popen([sys.executable, "-B", "-c", code], env=env, stdin=subprocess.PIPE,
                                stdout=subprocess.PIPE, text=True)  # fmt: skip

    return folder, start


def said(process):
    out, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return out.strip()


def test_a_changed_constant_reaches_the_callers_of_its_users_and_nothing_else(toy):
    folder, start = toy
    assert said(start()) == "7.0 1.5 [1, 1, 1]"
    assert said(start()) == "7.0 1.5 [0, 0, 0]"
    (folder / "limits.py").write_text("GAIN = 5.0\n")
    assert said(start()) == "16.0 1.5 [1, 1, 0]"
    (folder / "limits.py").write_text("GAIN = 2.0\n")
    assert said(start()) == "7.0 1.5 [0, 0, 0]"  # the former version is still there


def test_a_changed_callee_reaches_its_caller(toy):
    folder, start = toy
    assert said(start()) == "7.0 1.5 [1, 1, 1]"
    (folder / "callee.py").write_text(FILES["callee.py"].replace("GAIN * x", "GAIN * x - x"))
    assert said(start()) == "4.0 1.5 [1, 1, 0]"


def test_of_two_processes_one_compiles(toy):
    _, start = toy
    code = "import sys\nfrom toy.caller import shifted\nsys.stdin.read()\n" + CODE
    runs = [start(code), start(code)]
    misses = [said(run).split("[")[1].strip("]").split(", ") for run in runs]
    assert [int(a) + int(b) for a, b in zip(*misses, strict=True)] == [1, 1, 1]


def test_a_damaged_file_is_compiled_anew(toy, tmp_path):
    _, start = toy
    said(start())
    for path in (tmp_path / "cache").rglob("*.nb[ic]"):
        path.write_bytes(path.read_bytes()[:20])
    assert said(start()) == "7.0 1.5 [1, 1, 1]"
    assert said(start()) == "7.0 1.5 [0, 0, 0]"


def test_a_process_waits_for_another_that_compiles_the_same_kernel(toy):
    _, start = toy
    code = (
        "import sys\nfrom push_recovery.controllers.jit import _only_process\n"
        "with _only_process('a'):\n    print('held', flush=True)\n    sys.stdin.read()\n"
    )
    waiting = (
        "from push_recovery.controllers.jit import _only_process\n"
        "with _only_process('b'):\n    print('free', flush=True)\n"
        "with _only_process('a'):\n    print('had', flush=True)\n"
    )
    holder = start(code)
    assert holder.stdout.readline() == "held\n"
    waiter = start(waiting)
    assert waiter.stdout.readline() == "free\n"
    got = []
    reader = threading.Thread(target=lambda: got.append(waiter.stdout.readline()))
    reader.start()
    reader.join(0.3)
    assert got == []
    said(holder)
    reader.join(60)
    assert got == ["had\n"]
    waiter.communicate()


def test_a_place_that_cannot_be_written_costs_a_warning_and_no_more(tmp_path):
    (tmp_path / "file").write_text("")
    code = (
        "from push_recovery.controllers.model.gait_box import GaitLimits\n"
        "print(GaitLimits().from_action([0.0] * 7).shape)"
    )
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert run.stdout == "(7,)\n"
    assert run.stderr.count("RuntimeWarning") == 1
    assert "NUMBA_CACHE_DIR" in run.stderr
    assert "Traceback" not in run.stderr
    assert list(tmp_path.glob("push-recovery-kernels-*/*gait_box-*/*.nbc"))


def test_without_cache_nothing_is_kept(tmp_path):
    kernel = jit.njit(cache=False)(lambda x: x + 1)
    assert kernel(1) == 2
    assert kernel.stats.cache_path is None


@pytest.mark.parametrize(("threads", "n"), [(1, 5), (2, 5), (3, 3), (4, 2), (2, 1), (3, 17)])
def test_the_ranges_cover_all_once_with_a_worker_each(threads, n):
    calls, meeting = [], threading.Barrier(min(threads, n))

    def job(worker, first, end):
        meeting.wait(10.0)  # all ranges are under way at the same time
        calls.append((worker, first, end))

    RangeThreads(threads).run(job, n)
    assert [worker for worker, _, _ in sorted(calls)] == list(range(min(threads, n)))
    assert sorted(i for _, first, end in calls for i in range(first, end)) == list(range(n))
    lengths = [end - first for _, first, end in calls]
    assert max(lengths) - min(lengths) <= 1


def test_the_first_range_runs_in_the_calling_thread():
    names = {}
    RangeThreads(2).run(lambda worker, first, end: names.update({worker: threading.current_thread()}), 4)
    assert names[0] is threading.current_thread()
    assert names[1] is not names[0]


@pytest.mark.parametrize(("n", "calls"), [(1, 1), (19, 1), (20, 2), (39, 3), (400, 4)])
def test_few_problems_are_not_worth_a_thread(n, calls):
    ranges = []
    RangeThreads(4).run(lambda *job: ranges.append(job), n, least=10 if n != 39 else 13)
    assert len(ranges) == calls


@pytest.mark.parametrize("culprit", [0, 1])
def test_an_error_of_any_range_is_raised_when_all_are_done(culprit):
    done = []

    def job(worker, first, end):
        if worker == culprit:
            raise ArithmeticError(f"worker {worker}")
        done.append(worker)

    with pytest.raises(ArithmeticError, match=f"worker {culprit}"):
        RangeThreads(2).run(job, 2)
    assert done == [1 - culprit]


def _count_in_child(pool: RangeThreads, queue) -> None:
    calls = []
    pool.run(lambda *job: calls.append(job), 4)
    queue.put(len(calls))


def test_a_forked_process_starts_its_own():
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork on this system")
    pool, context = RangeThreads(2), multiprocessing.get_context("fork")
    pool.run(lambda *job: None, 4)
    queue = context.SimpleQueue()
    child = context.Process(target=_count_in_child, args=(pool, queue))
    child.start()
    child.join(10.0)
    alive = child.is_alive()
    child.kill()
    assert not alive
    assert queue.get() == 2


def test_a_copy_has_threads_of_its_own():
    pool = RangeThreads(3)
    pool.run(lambda *job: None, 4)
    assert copy.deepcopy(pool).threads == 3


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "two"])
def test_impossible_numbers(threads):
    with pytest.raises(InvalidValueError, match="threads must be a whole number from 1 to 1024, got"):
        RangeThreads(threads)


CODE_COMPILE_NOTICE = """
from push_recovery.controllers.jit import announce_compilation
announce_compilation(), announce_compilation()
from push_recovery.controllers.model.gait_box import GaitLimits, _scale
from numba import njit
njit(lambda x: x + 1)(1)
print(len(_scale.overloads), flush=True)
GaitLimits().from_action([0.0] * 7)
GaitLimits().to_action([0.0] * 7)
"""


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """Standard output and error of two runs, the first with an empty cache."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))}
    runs = []
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", CODE_COMPILE_NOTICE], env=env, capture_output=True, text=True, check=True
        )
        runs.append((run.stdout, run.stderr))
    return runs


def test_compiling_is_announced_once_on_standard_error(outputs):
    assert outputs[0] == ("0\n", MESSAGE + "\n")


def test_nothing_is_said_where_kernels_come_from_disk_or_are_not_of_this_package(outputs):
    assert outputs[1] == ("0\n", "")


def test_one_of_a_group_of_processes_says_it_and_again_when_it_is_long_ago(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "cache_root", lambda: tmp_path)
    assert jit._first_to_say()
    assert not jit._first_to_say()
    (path,) = tmp_path.iterdir()
    past = time.time() - LATELY - 1.0
    os.utime(path, (past, past))
    assert jit._first_to_say()
    assert not jit._first_to_say()


def test_it_is_said_where_nothing_can_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "cache_root", lambda: tmp_path / "missing")
    assert jit._first_to_say()


def test_a_kernel_that_cannot_be_kept_costs_a_warning(monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(jit.FunctionCache, "save_overload", full)
    kept = object.__new__(jit._KernelCache)
    with pytest.warns(RuntimeWarning, match="a compiled kernel was not kept: .*No space left on device"):
        kept.save_overload(None, None)
