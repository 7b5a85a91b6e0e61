"""The script that says what the closed-form limits leave of a suite."""

import importlib.util
from pathlib import Path

import pytest
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command

SPEC = importlib.util.spec_from_file_location(
    "suite_limits", Path(__file__).parents[1] / "benchmarks" / "suite_limits.py"
)
assert SPEC is not None
assert SPEC.loader is not None
script = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(script)


@pytest.mark.parametrize("psi", [0.0, 0.9, 1.6, 2.8, -0.7, -1.5])
@pytest.mark.parametrize("owned", list(script.OWNED.values()))
def test_the_largest_push_at_the_start_of_a_step_has_no_margin(psi, owned):
    force = max_recoverable_force(BIPED, psi, 0.1, *owned, limits=BIPED_LIMITS)
    push = polar_push(force, psi, 0.1, GaitEvent(4, "left", 0.0))
    assert script.margin(push, Command(), *owned) == pytest.approx(0.0, abs=1e-9)
    stronger = polar_push(1.01 * force, psi, 0.1, GaitEvent(4, "left", 0.0))
    assert script.margin(stronger, Command(), *owned) < 0.0


def test_a_mirrored_push_has_the_same_margin():
    push = polar_push(700.0, 1.1, 0.2, GaitEvent(4, "right", 0.6))
    command = Command(0.4, 0.15)
    mirrored = Command(0.4, -0.15)
    assert script.margin(push, command, True, True) == script.margin(push.mirrored(), mirrored, True, True)
