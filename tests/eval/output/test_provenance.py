import platform
import re
import subprocess
from pathlib import Path

import mujoco
import numpy as np
from push_recovery.eval.output.rows import machine_kind, source_commit, versions


def test_versions_are_those_in_use():
    found = versions()
    assert found["numpy"] == np.__version__
    assert found["mujoco"] == mujoco.__version__
    assert found["python"] == platform.python_version()


def test_the_kind_of_a_machine_does_not_name_it():
    assert platform.node() not in machine_kind() or not platform.node()
    assert platform.machine() in machine_kind()


def test_no_commit_outside_a_repository(tmp_path):
    (tmp_path / "file.py").write_text("")
    assert source_commit(tmp_path / "file.py") is None
    commit = source_commit(Path(__file__))
    assert commit is None or len(commit.removesuffix("-dirty")) == 40


def git(folder, *words):
    subprocess.run(["git", "-c", "user.name=x", "-c", "user.email=x", *words], cwd=folder, check=True)  # noqa: S607


def test_the_commit_is_that_of_the_repository_that_tracks_the_file(tmp_path):
    file = tmp_path / "code.py"
    file.write_text("1")
    assert source_commit(file) is None
    git(tmp_path, "init", "-q")
    assert source_commit(file) is None  # a repository that does not know it, such as one around a venv
    git(tmp_path, "add", "code.py")
    git(tmp_path, "commit", "-qm", "x")
    git(tmp_path, "tag", "-a", "v1", "-m", "x")
    commit = source_commit(file)
    assert commit is not None
    assert re.fullmatch("[0-9a-f]{40}", commit)
    file.write_text("2")
    assert source_commit(file) == f"{commit}-dirty"
    assert source_commit(Path("/nowhere/code.py")) is None
