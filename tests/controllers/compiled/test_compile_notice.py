"""What a process says while it compiles: with an empty cache of numba's, then with a filled one."""

import os
import subprocess
import sys
import time

import pytest
from push_recovery.controllers import jit as compile_notice
from push_recovery.controllers.jit import LATELY, MESSAGE

CODE = """
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
            [sys.executable, "-c", CODE], env=env, capture_output=True, text=True, check=True
        )
        runs.append((run.stdout, run.stderr))
    return runs


def test_compiling_is_announced_once_on_standard_error(outputs):
    assert outputs[0] == ("0\n", MESSAGE + "\n")


def test_nothing_is_said_where_kernels_come_from_disk_or_are_not_of_this_package(outputs):
    assert outputs[1] == ("0\n", "")


def test_one_of_a_group_of_processes_says_it_and_again_when_it_is_long_ago(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_notice, "cache_root", lambda: tmp_path)
    assert compile_notice._first_to_say()
    assert not compile_notice._first_to_say()
    (path,) = tmp_path.iterdir()
    past = time.time() - LATELY - 1.0
    os.utime(path, (past, past))
    assert compile_notice._first_to_say()
    assert not compile_notice._first_to_say()


def test_it_is_said_where_nothing_can_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_notice, "cache_root", lambda: tmp_path / "missing")
    assert compile_notice._first_to_say()
