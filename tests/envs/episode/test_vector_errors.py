"""Model errors through gym.make and gym.make_vec: each robot's own, through partial resets, from ranges."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.scenario import Scenario

import push_recovery  # noqa: F401

ERRORS = (ModelErrors(mass=0.2, dcm_noise=1e-3), ModelErrors(), ModelErrors(slope_left=0.03, delay=0.01))
RANGES = {"mass": [-0.2, 0.2], "delay": [0.0, 0.01], "dcm_noise": [0.0, 0.002]}
KINDS = ("Pendulum", "Biped")


def scenarios(errors=ERRORS) -> list[Scenario]:
    return [Scenario(f"s{k}", noise_seed=k, errors=one) for k, one in enumerate(errors)]


def alone(kind: str, scenario: Scenario, actions: np.ndarray) -> np.ndarray:
    """Observations (steps + 1, 36) of a single environment."""
    env = gym.make(f"PushRecovery/{kind}-v0")
    out = [env.reset(options={"scenario": scenario})[0]]
    out += [env.step(action)[0] for action in actions]
    env.close()
    return np.array(out)


def vector(kind: str, n: int, **kwargs):
    return gym.make_vec(
        f"PushRecovery/{kind}-v0", num_envs=n, vectorization_mode="vector_entry_point", **kwargs
    )


@pytest.mark.parametrize("kind", KINDS)
def test_each_robot_has_its_own_errors_through_partial_resets(kind):
    envs, actions = vector(kind, 3), np.zeros((12, 7), np.float32)
    actions[:, 1] = -0.2
    seen = [envs.reset(options={"scenario": scenarios()})[0]]
    for tick, action in enumerate(actions):
        if tick == 6:  # robot 1 begins anew with the errors of robot 0
            mask = np.array([False, True, False])
            again = [scenarios()[0]] * 3
            envs.reset(options={"scenario": again, "reset_mask": mask})
        seen.append(envs.step(np.repeat(action[None], 3, axis=0))[0])
    envs.close()
    seen = np.array(seen)
    for k in (0, 2):
        np.testing.assert_array_equal(seen[:, k], alone(kind, scenarios()[k], actions))
    np.testing.assert_array_equal(seen[:7, 1], alone(kind, scenarios()[1], actions[:6]))
    np.testing.assert_array_equal(seen[7:, 1], alone(kind, scenarios()[0], actions[:6])[1:])


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_drawn_anew_for_every_episode(kind):
    distribution = {"errors": RANGES}
    envs, drawn = vector(kind, 3, push_distribution=distribution), []
    for seed in (0, 0, 9):
        envs.reset(seed=seed)
        core = envs.unwrapped.core
        noise = core.errors.noise[:, 0] if kind == "Biped" else core.errors.deviation
        drawn.append(noise.copy())
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert len(np.unique(drawn)) == 6
    assert 0.0 < np.max(drawn) <= 0.002
    envs.close()
    env = gym.make(f"PushRecovery/{kind}-v0", push_distribution=distribution)
    env.reset(seed=1)
    assert env.unwrapped.scenario.errors.names == ("mass", "delay", "dcm_noise")
    assert env.spec is not None
    assert gym.make(env.spec.from_json(env.spec.to_json())).unwrapped.push_distribution.errors is not None
    env.close()


def test_rewards_and_the_criterion_of_recovery_know_no_noise():
    """Two pendulums under the same actions, one seen with noise: all but what is seen is the same."""
    envs, policy = vector("Pendulum", 2), make_policy("two-stage")
    pair = scenarios((ModelErrors(), ModelErrors(dcm_noise=0.02)))
    envs.reset(options={"scenario": pair})
    for _ in range(300):
        action = policy.predict(envs.unwrapped.core.truth)[0]
        observation, reward, _, _, info = envs.step(action)
        assert reward[0] == reward[1]
        assert info["capture_margin"][0] == info["capture_margin"][1]
        np.testing.assert_array_equal(info["recovered_at"][0], info["recovered_at"][1])
        assert not np.array_equal(observation[0], observation[1])
    assert info["recovered_at"][0] > 0.0
    envs.close()


def test_an_error_that_the_robot_cannot_have_is_named():
    envs = vector("Pendulum", 2)
    with pytest.raises(InvalidValueError, match="the pendulum has no model error 'friction'"):
        envs.reset(options={"scenario": Scenario("a", errors=ModelErrors(friction=0.5))})
    envs.close()
