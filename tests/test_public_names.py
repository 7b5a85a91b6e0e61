import subprocess
import sys

import pytest

import push_recovery

NAMES = (
    "make_policy", "load_policy", "evaluate", "compare", "frontier", "rollout", "Scenario", "Push",
    "GaitEvent", "Command", "CommandChange", "ModelErrors", "PushDistribution", "ResidualAction",
    "ActionHold", "get_suite", "RobotModel", "PlannerConfig", "record", "describe", "Kick",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_is_there_and_listed(name):
    assert getattr(push_recovery, name).__name__ == name
    assert name in dir(push_recovery)
    assert name in push_recovery.__all__


def test_the_names_load_when_they_are_used():
    code = (
        "import sys, push_recovery\n"
        "print('numba' in sys.modules)\n"
        "push_recovery.PlannerConfig\n"
        "print(any(name.startswith('push_recovery.e') for name in sys.modules))\n"
        "from push_recovery import *\n"
        "print(evaluate.__module__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.split() == ["False", "False", "push_recovery.eval.api"]


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'evaluat'"):
        push_recovery.evaluat  # noqa: B018
