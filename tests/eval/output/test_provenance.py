import platform
from pathlib import Path

import mujoco
import numpy as np
from push_recovery.eval.output.provenance import machine_kind, source_commit, versions


def test_versions_are_those_in_use():
    found = versions()
    assert found["numpy"] == np.__version__
    assert found["mujoco"] == mujoco.__version__
    assert found["Python"] == platform.python_version()


def test_the_kind_of_a_machine_does_not_name_it():
    assert platform.node() not in machine_kind() or not platform.node()
    assert platform.machine() in machine_kind()


def test_no_commit_outside_a_repository(tmp_path):
    (tmp_path / "file.py").write_text("")
    assert source_commit(tmp_path / "file.py") is None
    commit = source_commit(Path(__file__))
    assert commit is None or len(commit.removesuffix("-dirty")) == 40
