"""Variants of the biped walk and recover on the biped's preset."""

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.variants import HELD_VARIANTS, VARIANTS
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario

SCENARIOS = (
    Scenario("walk", (), Command(0.3)),
    Scenario("aside", (Push((0.0, 100.0, 0.0), 0.1, 1.0),)),
    Scenario("forward", (Push((150.0, 0.0, 0.0), 0.1, 1.2),)),
)


@pytest.mark.parametrize("description", [*VARIANTS, *HELD_VARIANTS], ids=lambda description: description.name)
def test_it_walks_and_recovers(description):
    episodes = BipedEpisodes(len(SCENARIOS), robot=description)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, "biped")
    for k, scenario in enumerate(SCENARIOS):
        episodes.begin(k, scenario)
    for _ in range(1000):
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
    gait = episodes.core.gait
    np.testing.assert_allclose(gait.time, 10.0, atol=1e-9)
    assert not gait.failure.any()
    assert episodes.core.physics.com[0, 0, 0] == pytest.approx(0.3 * 10.0, abs=0.15)  # at the commanded speed
    np.testing.assert_allclose(episodes.core.physics.com[1:, 0, :2], 0.0, atol=0.4)
    assert all(episodes.monitor.recovered_at(k) is not None for k in (1, 2))
