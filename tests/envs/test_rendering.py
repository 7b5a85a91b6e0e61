"""What is left of the process's environment where a backend of OpenGL fails."""

import os

import pytest
from push_recovery.envs import rendering

VARIABLE = "MUJOCO_GL"


def fail(seen: str) -> None:
    assert os.environ[VARIABLE] == seen
    raise OSError("no driver")


@pytest.mark.parametrize("before", [None, "osmesa"])
def test_a_backend_that_fails_leaves_the_variable_as_it_was_and_one_that_works_sets_it(monkeypatch, before):
    monkeypatch.setenv(VARIABLE, before or "")
    if before is None:
        monkeypatch.delenv(VARIABLE)
    with pytest.raises(OSError, match="no driver"), rendering._backend_variables("egl"):
        fail("egl")
    assert os.environ.get(VARIABLE) == before
    with rendering._backend_variables("egl"):
        pass
    assert os.environ[VARIABLE] == "egl"
