"""Outcomes that are kept: a change that moves one of them is a change of the results.

The rows are those that `record.py` beside this file has found to hang on nothing small. So words and counts
are compared exactly and numbers to `TOLERANCE` on any machine, and every bit on a machine like the one that
recorded them. After a change of the results, which the changelog names, they are recorded anew.
"""

import json
import platform
from importlib.metadata import version
from itertools import groupby
from pathlib import Path

import llvmlite.binding
import pytest
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout_all
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.suites import get_suite

FOLDER = Path(__file__).parent
SLOTS = 16
TOLERANCE = 1e-5  # of a number's size, or where it is below 1, of 1
RECORDED_ON = {
    "cpu": "znver4",
    "libc": "glibc 2.36",
    "python": "3.11",
    "numpy": "2.4.6",
    "numba": "0.68.1",
    "mujoco": "3.17.0",
    "daqp": "0.11.0",
}


def this_machine() -> dict[str, str]:
    """What the last bits of an outcome hang on."""
    return {
        "cpu": llvmlite.binding.get_host_cpu_name(),
        "libc": " ".join(platform.libc_ver()),
        "python": ".".join(platform.python_version_tuple()[:2]),
        **{name: version(name) for name in ("numpy", "numba", "mujoco", "daqp")},
    }


def close(value, pinned, tolerance=TOLERANCE) -> bool:
    """Equal words, counts and order of names; numbers within the tolerance."""
    if isinstance(pinned, dict):
        return list(value) == list(pinned) and all(
            close(value[key], pinned[key], tolerance) for key in pinned
        )
    if isinstance(pinned, list):
        return len(value) == len(pinned) and all(
            close(*both, tolerance) for both in zip(value, pinned, strict=True)
        )
    if isinstance(pinned, float):
        return isinstance(value, float) and abs(value - pinned) <= tolerance * max(1.0, abs(pinned))
    return type(value) is type(pinned) and value == pinned


def check(env_id: str, scenarios: dict[str, Scenario], rows: list[dict]) -> None:
    """Run the rows, those of one policy side by side, and compare the fields that they state."""
    env, exact = make_env(env_id), this_machine() == RECORDED_ON
    for name, group in groupby(rows, lambda row: row["policy"]):
        pinned = list(group)
        chosen = [scenarios[row["scenario_id"]] for row in pinned]
        outcomes = rollout_all(env, load_policy(name, env), chosen, name, SLOTS)
        for outcome, expected in zip(outcomes, pinned, strict=True):
            found = json.loads(json.dumps(outcome.to_dict()))
            found = {key: found[key] for key in expected}
            assert close(found, expected), f"{found}\nwas {expected}"
            if exact:
                assert found == expected, "a last bit has changed on the machine that recorded it"


@pytest.mark.parametrize("suite", ["quick", "standard", "hard"])
def test_fifty_rows_of_a_suite_are_what_they_were(suite):
    pinned = json.loads((FOLDER / "suites.json").read_text())
    assert len(pinned[suite]) == 50
    check(
        pinned["env"],
        {scenario.id: scenario for scenario in get_suite(suite).scenarios},
        pinned[suite],
    )


@pytest.mark.parametrize("name", ["biped", "pendulum"])
def test_hand_written_scenarios_end_as_they_did(name):
    """Turning, pushes on the trunk and off-centre, slopes, noise, delay, changes of command, falls."""
    pinned = json.loads((FOLDER / f"{name}.json").read_text())
    scenarios = [Scenario.from_dict(entry) for entry in pinned["scenarios"]]
    check(pinned["env"], {scenario.id: scenario for scenario in scenarios}, pinned["rows"])


@pytest.mark.parametrize(
    ("value", "pinned"),
    [
        ({"a": 1.0, "b": 2}, {"b": 2, "a": 1.0}),  # limits in the order in which they were met
        ({"a": 1.0 + 1e-4}, {"a": 1.0}),
        (True, 1),
        (None, 0.0),
        ("com_height", "pelvis_tilt"),
        ([1.0], [1.0, 2.0]),
    ],
)
def test_what_differs_is_seen(value, pinned):
    assert not close(value, pinned)
    assert close(pinned, pinned)
