"""Models of Stable-Baselines3 as policy files: the same actions, and what a file can't hold is refused."""

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.wrappers import ActionHold, ResidualAction
from push_recovery.training.from_sb3 import from_sb3

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize  # noqa: E402

OBSERVATIONS = np.random.default_rng(1).normal(0.5, 1.5, (60, 36))
PENDULUM = "push_recovery:PushRecovery/Pendulum-v0"


def make_model(kind, venv, net=(24, 16), activation=torch.nn.ReLU, **options):
    """A model with random weights, whose actions are neither all small nor all at their bounds."""
    arch = list(net) if kind is sb3.SAC else {"pi": list(net), "vf": [8]}
    model = kind(
        "MlpPolicy", venv, seed=0, device="cpu",
        policy_kwargs={"net_arch": arch, "activation_fn": activation, **options.pop("policy", {})}, **options,
    )  # fmt: skip
    last = model.policy.actor.mu if kind is sb3.SAC else model.policy.action_net
    with torch.no_grad():
        for parameter in last.parameters():
            parameter.normal_(0.0, 0.3, generator=torch.Generator().manual_seed(1))
    return model


def assert_same_actions(model, learned, seen=OBSERVATIONS, normalise=None):
    theirs, _ = model.predict(
        seen if normalise is None else normalise.normalize_obs(seen), deterministic=True
    )
    assert np.abs(theirs).max() > 0.2
    np.testing.assert_allclose(learned.learned_action(seen), theirs, atol=3e-6)


@pytest.mark.parametrize("kind", [sb3.PPO, sb3.SAC, sb3.A2C])
@pytest.mark.parametrize("activation", [torch.nn.Tanh, torch.nn.ReLU])
def test_a_model_acts_alike_in_memory_and_in_a_file(tmp_path, toy, kind, activation):
    env = gym.make(toy)
    model = make_model(kind, env, activation=activation)
    saved = from_sb3(model, env).save(tmp_path / "mine")
    learned = NetworkPolicy.load(saved)
    assert learned.network.activation == activation.__name__.lower()
    assert learned.network.output == ("tanh" if kind is sb3.SAC else "linear")
    assert learned.description.env_id == toy.partition(":")[2]
    assert_same_actions(model, learned)
    np.testing.assert_array_equal(learned.predict(OBSERVATIONS)[0], learned.learned_action(OBSERVATIONS))


@pytest.mark.parametrize("kind", [sb3.PPO, sb3.SAC])
def test_normalisation_becomes_part_of_the_policy(toy, kind):
    venv = VecNormalize(DummyVecEnv([lambda: gym.make(toy)]), clip_obs=1.5)
    venv.obs_rms.update(np.random.default_rng(2).normal(0.7, 2.0, (500, 36)))
    model = make_model(kind, venv)
    learned = from_sb3(model, gym.make(toy), venv)
    assert learned.normalisation.clip == 1.5
    assert_same_actions(model, learned, OBSERVATIONS, venv)
    rewards_only = VecNormalize(DummyVecEnv([lambda: gym.make(toy)]), norm_obs=False)
    assert_same_actions(model, from_sb3(model, gym.make(toy), rewards_only))


def test_a_linear_model_and_one_with_squashed_exploration_fit_too(toy):
    env = gym.make(toy)
    for model in (
        make_model(sb3.PPO, env, net=()),
        make_model(sb3.PPO, env, use_sde=True, policy={"squash_output": True}),
    ):
        assert_same_actions(model, from_sb3(model, env))


def test_residual_and_hold_become_part_of_the_policy():
    """On the plain environment the policy does what the model does as a held residual."""
    plain = gym.make(PENDULUM)
    planner = make_policy("two-stage", plain.unwrapped.robot, plain.unwrapped.limits, plain.unwrapped.preset)
    env = ActionHold(ResidualAction(gym.make(PENDULUM), planner, scale=0.2), 2)
    model = make_model(sb3.PPO, env)
    learned = from_sb3(model, env)
    residual = learned.description.residual
    assert (residual.policy, residual.gate, learned.description.hold) == ("two-stage", None, 2)
    mine, theirs = plain.reset(seed=4)[0], env.reset(seed=4)[0]
    state = None
    for _ in range(12):
        theirs, *_ = env.step(model.predict(theirs, deterministic=True)[0])
        for _ in range(2):
            action, state = learned.predict(mine, state)
            mine, *_ = plain.step(action)
        np.testing.assert_allclose(mine, theirs, atol=1e-4)
    base = planner.predict(mine)[0]
    assert np.abs(learned.predict(mine, state)[0] - base).max() > 1e-3


def test_the_residual_of_the_biped_is_named_by_the_environment_below():
    env = gym.make("push_recovery:PushRecovery/BipedResidual-v0", hold=2, gate=[0.02, 0.06])
    about = from_sb3(make_model(sb3.PPO, env), env).description
    assert (about.env_id, about.hold) == ("PushRecovery/Biped-v0", 2)
    assert about.residual is not None
    assert about.residual.gate == (0.02, 0.06)
    assert about.residual.config == make_policy("two-stage", about.robot, about.limits, "biped").config


class Unit(gym.Env):
    """Nothing of a gait."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float64)
    action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)

    def reset(self, *, seed=None, options=None):
        return np.zeros(3), {}


class Own:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((*np.shape(observation)[:-1], 7), np.float32), state


def refused():
    """What a file can't hold: model, environment, and what the message says."""

    class Flat(gym.ObservationWrapper):
        def observation(self, observation):
            return observation

    class Normal(sb3.common.torch_layers.FlattenExtractor):
        pass

    toy = "gymnasium:PushRecoveryTest/Toy-v0"
    yield lambda: (sb3.TD3("MlpPolicy", gym.make(toy), device="cpu"), gym.make(toy)), "got a TD3Policy of TD3"
    yield (
        lambda: (make_model(sb3.PPO, gym.make(toy), activation=torch.nn.ELU), gym.make(toy)),
        "is Linear, ELU",
    )
    yield (
        lambda: (
            make_model(sb3.PPO, gym.make(toy), policy={"features_extractor_class": Normal}),
            gym.make(toy),
        ),
        "no features extractor Normal",
    )
    yield (
        lambda: (sb3.SAC("MlpPolicy", gym.make(toy), use_sde=True, device="cpu"), gym.make(toy)),
        "Sequential",
    )
    yield lambda: (make_model(sb3.PPO, gym.make(toy)), Flat(gym.make(toy))), "the wrapper Flat changes"
    yield lambda: (make_model(sb3.PPO, gym.make("Pendulum-v1")), gym.make(toy)), "with the observation_space"
    yield lambda: (make_model(sb3.PPO, gym.make("Pendulum-v1")), gym.make("Pendulum-v1")), r"in \[-1, 1\]"
    yield (
        lambda: (make_model(sb3.PPO, gym.make(toy)), ResidualAction(gym.make(toy), Own())),
        "names what it corr",
    )
    yield lambda: (make_model(sb3.PPO, Unit()), Unit()), "has no robot, limits, preset"
    yield lambda: (make_model(sb3.PPO, gym.make(toy)), type(gym.make(toy).unwrapped)()), "has no id"


@pytest.mark.parametrize(
    ("make", "said"), list(refused()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_what_a_file_can_not_hold_is_refused(make, said):
    with pytest.raises(InvalidValueError, match=said):
        from_sb3(*make())


def test_a_model_that_acts_by_more_than_its_network_is_refused(toy, monkeypatch):
    env = gym.make(toy)
    model = make_model(sb3.PPO, env)
    whole = model.predict
    monkeypatch.setattr(model, "predict", lambda *a, **k: (0.5 * whole(*a, **k)[0], None))
    with pytest.raises(InvalidValueError, match="differs from the model by"):
        from_sb3(model, env)
