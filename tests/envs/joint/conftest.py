"""Scenarios, and episodes of robots whose joints are acted on."""

from collections.abc import Callable

import numpy as np
import pytest
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

PUSH = Push((60.0, 90.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
ERRORS = ModelErrors(), ModelErrors(delay=0.004, dcm_noise=0.002), ModelErrors(payload=3.0, slope_left=0.03)


@pytest.fixture(scope="session")
def pushed() -> Callable:
    """n scenarios of different commands, sides, model errors and sensing."""

    def make(n: int) -> list[Scenario]:
        sides, sensing = ("left", "right"), ("exact", "exact", "onboard", "onboard")
        return [
            Scenario(
                f"s{k}", (PUSH,), Command(0.1 * k), sides[k % 2], noise_seed=k, errors=ERRORS[k % 3],
                sensing=sensing[k % 4],
            )
            for k in range(n)
        ]  # fmt: skip

    return make


@pytest.fixture(scope="session")
def run() -> Callable:
    """States, observations and rewards of robots under given scenarios and actions (periods, n, 14)."""

    def trajectory(episodes, scenarios, actions):
        for k, scenario in enumerate(scenarios):
            episodes.begin(k, scenario)
        rows = []
        for action in actions:
            period = episodes.step(action)
            state = [np.concatenate([data.qpos, data.qvel]) for data in episodes.core.simulations.data]
            rows.append(np.concatenate([state, episodes.seen, period.reward.total[:, None]], axis=1))
        return np.array(rows)

    return trajectory
