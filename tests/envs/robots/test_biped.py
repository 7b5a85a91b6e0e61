"""Variants of the biped walk and recover on the biped's preset."""

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import HELD_VARIANTS, VARIANTS, legs_below_a_yaw
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


def test_legs_below_a_yaw_hang_from_the_hips_and_weigh_as_much_as_before():
    model = legs_below_a_yaw().compile()
    for side in ("left", "right"):
        assert model.body(model.body(f"{side}_thigh").parentid[0]).name == "hips"
    assert model.body(model.body("hips").parentid[0]).name == "pelvis"
    assert model.body_subtreemass[0] == pytest.approx(60.0)
