"""The planner beside a robot under joint targets: it leads as it walks by itself, and its targets walk."""

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.joint.env import JointEpisodes
from push_recovery.envs.joint.taught import TaughtEpisodes
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
NOTHING = np.zeros((2, 14), np.float32)
SCENARIOS = [
    Scenario("walk", command=Command(0.2)),
    Scenario("pushed", (Push((60.0, 150.0, 0.0), 0.1, 0.8),), Command(0.1, turn=0.2), "right"),
]


def test_where_it_leads_the_robot_walks_as_under_the_planner_bit_for_bit():
    taught, plan = TaughtEpisodes(2), BipedEpisodes(2)
    for k, scenario in enumerate(SCENARIOS):
        taught.begin(k, scenario)
        plan.begin(k, scenario)
    taught.lead(np.ones(2, np.bool_))
    for _ in range(200):
        taught.step(NOTHING)
        plan.step(POLICY.predict(plan.core.observation)[0])
        assert taught.core.physics.qpos.tobytes() == plan.core.physics.qpos.tobytes()
        assert taught.core.teacher.seen[:, :34].tobytes() == plan.core.truth[:, :34].tobytes()
    assert (taught.core.walk.steps >= 5).all()
    np.testing.assert_array_equal(taught.core.gait.stance, taught.core.walk.stance)


def test_where_it_does_not_lead_robots_do_what_their_targets_say(run, pushed):
    scenarios, actions = pushed(4), np.random.default_rng(0).uniform(-0.2, 0.2, (50, 4, 14))
    found = [run(kind(4), scenarios, actions.astype(np.float32)) for kind in (JointEpisodes, TaughtEpisodes)]
    assert found[0].tobytes() == found[1].tobytes()


@pytest.mark.parametrize("side", ["left", "right"])
def test_its_targets_give_its_torques(side):
    """A physics step a period: PD control of its targets gives the torques that led."""
    leads, follows = TaughtEpisodes(1, control_hz=500.0), JointEpisodes(1, control_hz=500.0)
    for episodes in (leads, follows):
        episodes.begin(0, Scenario("walk", command=Command(0.2), stance_side=side))
    leads.lead(np.ones(1, np.bool_))
    for _ in range(300):
        leads.step(NOTHING[:1])
        follows.step(leads.targets.astype(np.float32))
        np.testing.assert_allclose(follows.core.physics.ctrl, leads.core.physics.ctrl, atol=2e-2)


def test_what_it_asks_is_the_same_in_a_mirror():
    taught = TaughtEpisodes(2)
    taught.begin(0, SCENARIOS[1])
    taught.begin(1, SCENARIOS[1].mirrored())
    actions = np.random.default_rng(2).uniform(-0.1, 0.1, (60, 1, 14)).astype(np.float32)
    for action in actions:
        taught.step(np.repeat(action, 2, axis=0))
        np.testing.assert_allclose(taught.targets[0], taught.targets[1], atol=1e-4)
    assert np.abs(taught.targets[0]).max() > 0.05


def test_episodes_alike_are_taught_by_the_same_planner():
    taught = TaughtEpisodes(1, policy="stage-1", control_hz=50.0, sensing="exact").clone(3, threads=2)
    assert (taught.n, taught.policy, taught.control_hz, taught.config.sensing) == (
        3,
        "stage-1",
        50.0,
        "exact",
    )
