"""Kernels are compiled anew when what they are made of changes, and only then, by one process only."""

import os
import subprocess
import sys
import threading

import pytest
from push_recovery.controllers import jit as kernels

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
    kernel = kernels.njit(cache=False)(lambda x: x + 1)
    assert kernel(1) == 2
    assert kernel.stats.cache_path is None
