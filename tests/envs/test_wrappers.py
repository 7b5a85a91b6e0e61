import json
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.residual import check_residual_scale, compose, default_residual_scale
from push_recovery.envs.biped.env import BipedEnv
from push_recovery.envs.wrappers import ActionHold, ResidualAction


class EchoEnv(gym.Env):
    """The observation is the last action and a random part; the reward its first entry."""

    def __init__(self, steps=20):
        self.observation_space = gym.spaces.Box(-10.0, 10.0, (36,), np.float64)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
        self.robot, self.limits, self.preset = RobotModel(), GaitLimits(), "default"
        self.steps = steps
        self.actions = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count, self.actions = 0, []
        return self.np_random.uniform(-1, 1, 36), {}

    def step(self, action):
        self.count += 1
        self.actions.append(np.array(action))
        observation = self.np_random.uniform(-1, 1, 36)
        observation[27:34] = action
        reward = float(action[0])
        return observation, reward, self.count >= self.steps, False, {"reward_terms": {"alive": reward}}


class EchoPolicy:
    """The action is the first seven observations; counts its calls in the state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = 0 if state is None or np.any(episode_start) else state
        return np.asarray(observation)[..., :7].astype(np.float32), count + 1


def rollout(env, action_of, seed=3):
    observations, totals = [], []
    observation, _ = env.reset(seed=seed)
    done = False
    while not done:
        observations.append(observation)
        observation, _, terminated, truncated, info = env.step(action_of(observation))
        totals.append(info)
        done = terminated or truncated
    return np.array(observations), totals


def test_zero_action_is_the_wrapped_policy_bit_for_bit():
    plain, wrapped = EchoEnv(), ResidualAction(EchoEnv(), EchoPolicy())
    a, _ = rollout(plain, lambda obs: EchoPolicy().predict(obs)[0])
    b, infos = rollout(wrapped, lambda obs: np.zeros(7, np.float32))
    assert a.tobytes() == b.tobytes()
    assert np.array(plain.actions).tobytes() == np.array(wrapped.unwrapped.actions).tobytes()
    assert not any(np.any(info["residual_action"]) for info in infos)


def test_zero_keeps_the_sign_of_zero_and_values_off_the_box():
    base = np.array([-0.0, 0.0, 1.5, -3.0, 0.1, 1.0, -1.0], dtype=np.float32)
    for residual in (np.zeros(7, np.float32), -np.zeros(7, np.float32)):
        assert compose(base, residual, np.ones(7, np.float32)).tobytes() == base.tobytes()
    assert compose(base, np.ones(7, np.float32), np.zeros(7, np.float32)).tobytes() == base.tobytes()


def test_compose_is_the_clipped_sum():
    rng = np.random.default_rng(0)
    base, residual = rng.uniform(-1, 1, (2, 50, 7)).astype(np.float32)
    scale = rng.uniform(0, 1, 7).astype(np.float32)
    expected = np.clip(base + scale * residual, -1, 1)
    assert np.array_equal(compose(base, residual, scale), expected)


def test_default_scale_moves_the_gait_by_its_physical_size():
    limits = GaitLimits()
    scale = default_residual_scale(limits)
    middle = np.zeros(7, np.float32)
    moved = limits.from_action(compose(middle, np.full(7, 0.5, np.float32), scale)) - limits.from_action(
        middle
    )
    np.testing.assert_allclose(moved, 0.5 * np.array([0.12, 0.10, 0.15, 0.06, 0.03, 12, 12]), atol=1e-6)


def test_info_tells_base_and_residual_apart():
    env = ResidualAction(EchoEnv(), EchoPolicy(), scale=0.25)
    observation, _ = env.reset(seed=0)
    action = np.linspace(-1, 1, 7, dtype=np.float32)
    _, _, _, _, info = env.step(action)
    np.testing.assert_array_equal(info["baseline_action"], observation[:7].astype(np.float32))
    np.testing.assert_array_equal(info["residual_action"], np.float32(0.25) * action)
    np.testing.assert_array_equal(
        env.unwrapped.actions[0], np.clip(info["baseline_action"] + info["residual_action"], -1, 1)
    )


def test_the_policy_sees_the_observation_even_if_the_caller_overwrites_it():
    env = ResidualAction(EchoEnv(), EchoPolicy())
    observation, _ = env.reset(seed=0)
    kept = observation.copy()
    observation[:] = 7.0
    _, _, _, _, info = env.step(np.zeros(7, np.float32))
    np.testing.assert_array_equal(info["baseline_action"], kept[:7].astype(np.float32))


def test_a_policy_with_memory_starts_anew_each_episode():
    class Counter(EchoPolicy):
        seen: list[int]

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            action, state = super().predict(observation, state, episode_start)
            self.seen.append(state)
            return action, state

    policy = Counter()
    policy.seen = []
    env = ResidualAction(EchoEnv(steps=3), policy)
    for seed in range(2):
        rollout(env, lambda obs: np.zeros(7, np.float32), seed)
    assert policy.seen == [1, 2, 3, 1, 2, 3]


@pytest.mark.parametrize(
    "scale", [-0.1, np.nan, np.inf, [1, 2, 3], np.ones((7, 1)), [1] * 6 + [-1], "wide", [[1], 2], 10**400]
)
def test_impossible_scales_are_refused(scale):
    with pytest.raises(InvalidValueError, match="residual scale"):
        check_residual_scale(scale)
    with pytest.raises(InvalidValueError, match="residual scale"):
        ResidualAction(EchoEnv(), EchoPolicy(), scale=scale)


@pytest.mark.parametrize("action", [np.full(7, np.nan), np.zeros(6), np.zeros((1, 7)), [np.inf] + [0] * 6])
def test_bad_actions_are_refused(action):
    env = ResidualAction(EchoEnv(), EchoPolicy())
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match="residual action"):
        env.step(action)


def test_step_before_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        ResidualAction(EchoEnv(), EchoPolicy()).step(np.zeros(7, np.float32))


def test_hold_repeats_the_residual_while_the_base_replans():
    env = ActionHold(ResidualAction(EchoEnv(steps=5), EchoPolicy(), scale=0.1), 2)
    rng = np.random.default_rng(1)
    rewards, terms, residuals = [], [], []
    env.reset(seed=5)
    done = False
    while not done:
        residuals.append(rng.uniform(-1, 1, 7).astype(np.float32))
        _, reward, terminated, truncated, info = env.step(residuals[-1])
        rewards.append(reward)
        terms.append(info["reward_terms"]["alive"])
        done = terminated or truncated
    inner = ResidualAction(EchoEnv(steps=5), EchoPolicy(), scale=0.1)
    inner.reset(seed=5)
    single = [float(inner.step(residuals[i // 2])[1]) for i in range(5)]
    assert len(rewards) == 3  # the last hold ends with the episode
    np.testing.assert_allclose(rewards, [single[0] + single[1], single[2] + single[3], single[4]], atol=1e-12)
    np.testing.assert_allclose(terms, rewards, atol=1e-12)


@pytest.mark.parametrize("periods", [0, -1, 1.5, True, "2", None])
def test_an_action_is_held_for_whole_periods(periods):
    with pytest.raises(InvalidValueError, match=r"^hold must be an integer >= 1, got"):
        ActionHold(EchoEnv(), periods)
    assert ActionHold(EchoEnv(), np.int64(3)).periods == 3


def test_checkers_pass_on_the_wrapper():
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    env = ActionHold(ResidualAction(EchoEnv(), EchoPolicy()), 2)
    check_env(env, skip_render_check=True)
    sb3.check_env(env, warn=True)


def test_the_registered_residual_is_made_again_from_its_json_spec():
    name = "PushRecovery/BipedResidual-v0"
    env = gym.make(name, policy="passive", scale=[0.1] * 7, hold=2)
    again = gym.make(env.spec)
    assert env.spec.id == name
    assert type(env.unwrapped) is BipedEnv
    assert str(env) == str(again)
    assert json.loads(env.spec.to_json())["kwargs"] == {"policy": "passive", "scale": [0.1] * 7, "hold": 2}
    observations = [rollout(e, lambda obs: 0.1 * np.ones(7, np.float32))[0] for e in (env, again)]
    assert observations[0].tobytes() == observations[1].tobytes()


def test_scale_serialises_in_the_wrapper_spec():
    env = EchoEnv()
    env.spec = SimpleNamespace(additional_wrappers=())
    spec = ResidualAction(env, EchoPolicy(), scale=0.5).spec
    assert json.dumps(spec.additional_wrappers[0].kwargs["scale"]) == json.dumps([0.5] * 7)


def on_joints():
    env = EchoEnv()
    env.action_space = gym.spaces.Box(-1, 1, (14,), np.float32)
    return env


@pytest.mark.parametrize(
    ("env", "policy", "told"),
    [
        (3, "two-stage", "env must be a Env, got 3"),
        (on_joints(), EchoPolicy(), "gait residual"),
        (EchoEnv(), "two-stages", "two-stage"),
        *((EchoEnv(), bad, "a policy needs a method predict") for bad in (3, None, object(), {"predict": 1})),
    ],
)
def test_what_is_no_gait_environment_or_no_policy_is_refused(env, policy, told):
    with pytest.raises(PushRecoveryError, match=told):
        ResidualAction(env, policy)


def test_what_the_caller_does_to_the_observation_of_a_step_does_not_reach_the_policy():
    env = ResidualAction(EchoEnv(), EchoPolicy())
    env.reset(seed=0)
    observation = env.step(np.zeros(7, np.float32))[0]
    kept = observation.copy()
    observation[:] = 7.0
    info = env.step(np.zeros(7, np.float32))[4]
    np.testing.assert_array_equal(info["baseline_action"], kept[:7].astype(np.float32))


def test_a_robot_is_not_put_back_above_a_policy_that_remembers():
    env = ResidualAction(EchoEnv(), EchoPolicy())
    env.reset(seed=0)
    env.step(np.zeros(7, np.float32))
    with pytest.raises(InvalidValueError, match="only above a policy without memory"):
        env.restore(None)
