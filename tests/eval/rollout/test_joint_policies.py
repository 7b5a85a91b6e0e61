"""Policies that act on the joints: the random one, files, and their rows beside those of the planner."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env, own_form
from push_recovery.eval.rollout.load_policy import make_policy
from push_recovery.eval.rollout.workers import Runner

JOINT, RESIDUAL, BIPED_ENV = (f"PushRecovery/Biped{form}-v0" for form in ("Joint", "JointResidual", ""))
SIZES = {JOINT: 58, RESIDUAL: 94, BIPED_ENV: 36}
G1 = "PushRecovery/G1JointResidual-v0"
PUSHED = Scenario("pushed", (Push((60.0, 90.0, 0.0), 0.1, 0.4),), duration=1.2)


def save_zero(path, env_id) -> str:
    """A policy file whose action is zero everywhere."""
    inputs, outputs = SIZES.get(env_id, 94), 7 if env_id == BIPED_ENV else 14
    network = Mlp((np.zeros((outputs, inputs), np.float32),), (np.zeros(outputs, np.float32),))
    normalisation = Normalisation(np.zeros(inputs), np.ones(inputs))
    about = PolicyDescription(env_id, BIPED, BIPED_LIMITS)
    return str(NetworkPolicy(network, normalisation, about).save(path))


@pytest.mark.parametrize("env_id", [JOINT, RESIDUAL])
def test_the_random_policy_fits_single_and_vector_form(env_id):
    env = make_env(env_id)
    observation, _ = env.reset(seed=0)
    policy = make_policy("random", env)
    one, _ = policy.predict(observation)
    assert env.action_space.contains(one)
    vector = gym.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point")
    both, _ = make_policy("random", vector).predict(np.stack([observation, observation + 1.0]))
    np.testing.assert_array_equal(both[0], one)
    assert (both[1] != one).all()


@pytest.mark.parametrize("env_id", [JOINT, RESIDUAL])
def test_arms_give_no_actions_of_joints(env_id):
    with pytest.raises(InvalidValueError, match=rf"'two-stage' gives gait actions, but {env_id} takes 14"):
        make_policy("two-stage", make_env(env_id))


def test_each_robot_has_forms_of_its_own(tmp_path):
    file = save_zero(tmp_path / "g1", G1)
    assert own_form(file, "PushRecovery/G1-v0") == G1
    assert own_form(file, "PushRecovery/G1-v0@g1") == f"{G1}@g1"
    for other in (G1, BIPED_ENV, "PushRecovery/G1Residual-v0", "PushRecovery/T1-v0", f"my_robot:{BIPED_ENV}"):
        assert own_form(file, other) is None


def test_a_file_stands_beside_the_planner_in_the_form_that_it_acts_in(tmp_path):
    """On the same scenario; a residual of zero has the planner's outcome in every field but its name."""
    names = {env_id: save_zero(tmp_path / f"{i}", env_id) for i, env_id in enumerate(SIZES)}
    assert own_form(names[BIPED_ENV], BIPED_ENV) is None
    assert own_form("two-stage", BIPED_ENV) is None
    assert own_form(names[JOINT], "PushRecovery/Pendulum-v0") is None
    assert own_form(names[JOINT], f"{BIPED_ENV}@biped") == f"{JOINT}@biped"
    runner = Runner(BIPED_ENV)
    rows = {}
    for name in ("two-stage", names[JOINT], names[RESIDUAL]):
        (outcome,) = runner.run_all(name, [PUSHED])
        assert outcome == runner.run((name, PUSHED))
        rows[name] = outcome.to_dict() | {"policy": ""}
    runner.close()
    assert rows[names[RESIDUAL]] == rows["two-stage"]
    assert rows[names[JOINT]] != rows["two-stage"]
    assert {row["scenario_id"] for row in rows.values()} == {"pushed"}
