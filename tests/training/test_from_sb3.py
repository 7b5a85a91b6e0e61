"""Models of Stable-Baselines3 as policy files: the same actions, and what a file can't hold is refused."""

import copy

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
    model = make_model(kind, rewards_only)
    assert_same_actions(model, from_sb3(model, gym.make(toy), rewards_only))
    around = VecNormalize(venv, norm_obs=False)
    model = make_model(kind, around)
    assert_same_actions(
        model, from_sb3(model, gym.make(toy), model.get_vec_normalize_env()), OBSERVATIONS, venv
    )


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
    yield lambda: (make_model(sb3.PPO, gym.make(toy)), Flat(gym.make(toy))), "the wrapper Flat may change"
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


class Half(gym.Wrapper):
    """Halves the action, unseen by its spaces."""

    def step(self, action):
        return self.env.step(0.5 * np.asarray(action))


def pendulum(**residual):
    env = gym.make(PENDULUM)
    return ResidualAction(env, **residual) if residual else env


def normalised(venv=None, seed=0):
    venv = VecNormalize(DummyVecEnv([pendulum]) if venv is None else venv)
    venv.obs_rms.update(np.random.default_rng(seed).normal(0.4, 0.5, (500, 36)))
    return venv


TWO = {"policy": "two-stage"}
# What a model was trained in, what is handed over, and what the message says
UNLIKE = {
    "no residual": (lambda: pendulum(**TWO), pendulum, "residual two-stage there and none here"),
    "a residual": (pendulum, lambda: pendulum(**TWO), "residual none there and two-stage here"),
    "no hold": (lambda: ActionHold(pendulum(), 3), pendulum, r"\(hold 3\), .*: hold 3 there and 1 here"),
    "no gate": (
        lambda: pendulum(**TWO, gate=(0.02, 0.06)),
        lambda: pendulum(**TWO),
        r"corrections of two-stage \(gate \(0.02, 0.06\)\) .*: gate \(0.02, 0.06\) there and none here",
    ),
    "another scale": (lambda: pendulum(**TWO, scale=0.25), lambda: pendulum(**TWO), r"scale \(0.25, 0.25"),
    "another policy": (
        lambda: pendulum(policy="stage-1"),
        lambda: pendulum(**TWO),
        "policy stage-1 there and two-stage here",
    ),
    "an unseen wrapper": (lambda: Half(pendulum()), pendulum, "was trained within Half, which may change"),
    "an unseen wrapper here": (pendulum, lambda: Half(pendulum()), "the wrapper Half may change"),
    "frames": (
        lambda: gym.wrappers.FrameStackObservation(pendulum(), 2),
        lambda: gym.wrappers.FrameStackObservation(pendulum(), 2),
        "the wrapper FrameStackObservation may change",
    ),
}


@pytest.mark.parametrize("name", UNLIKE)
def test_another_environment_than_that_of_the_training_is_refused(name):
    theirs, here, said = UNLIKE[name]
    model = make_model(sb3.PPO, theirs())
    with pytest.raises(InvalidValueError, match=said) as error:
        from_sb3(model, here())
    assert "\n" not in str(error.value)


def test_a_loaded_model_knows_its_training_by_its_note(tmp_path):
    """One without a note is taken at the word of whoever hands over the environment."""
    make_model(sb3.PPO, pendulum(**TWO)).save(tmp_path / "model.zip")
    model = sb3.PPO.load(tmp_path / "model.zip", device="cpu")
    with pytest.raises(InvalidValueError, match="residual two-stage there and none here"):
        from_sb3(model, pendulum())
    assert_same_actions(model, from_sb3(model, pendulum(**TWO)))
    elsewhere = sb3.PPO.load(tmp_path / "model.zip", env=pendulum(), device="cpu")
    with pytest.raises(InvalidValueError, match="residual two-stage there and none here"):
        from_sb3(elsewhere, pendulum())
    model.action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
    for env in (pendulum(), pendulum(**TWO)):
        assert_same_actions(model, from_sb3(model, env))


def test_other_normalisation_than_that_of_the_training_is_refused(tmp_path):
    venv, other = normalised(), normalised(seed=1)
    model, raw = make_model(sb3.PPO, venv), make_model(sb3.PPO, pendulum())
    for one, given, said in (
        (model, None, "trained on normalised observations, and those of `normalise` are raw"),
        (raw, venv, "trained on raw observations, and those of `normalise` are normalised"),
        (model, other, "the statistics of `normalise` are not those of the model PPO"),
        (make_model(sb3.PPO, normalised(venv)), None, "2 layers of VecNormalize"),
        (model, normalised(venv), "2 layers of VecNormalize"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            from_sb3(one, pendulum(), given)
    venv.save(str(tmp_path / "statistics.pkl"))
    same = VecNormalize.load(str(tmp_path / "statistics.pkl"), DummyVecEnv([pendulum]))
    assert_same_actions(model, from_sb3(model, pendulum(), same), OBSERVATIONS, venv)


def test_a_loaded_model_knows_whether_it_saw_normalised_observations(tmp_path):
    venv = normalised()
    for number, (env, given, said) in enumerate(
        (
            (venv, None, "hand them over as `normalise`, or load it with them"),
            (pendulum(), venv, "leave them"),
        )
    ):
        model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu", seed=0)
        model.learn(8).save(tmp_path / f"{number}.zip")
        with pytest.raises(InvalidValueError, match=said):
            from_sb3(sb3.PPO.load(tmp_path / f"{number}.zip", device="cpu"), pendulum(), given)


# What a file would be scored in without being told of
UNHELD = {
    "another planning rate": (lambda: gym.make(PENDULUM, control_hz=50), "control_hz 50 there and 100 here"),
    "two residuals": (
        lambda: ResidualAction(pendulum(**TWO), "two-stage"),
        "below residual two-stage there and none here",
    ),
    "a hold below a residual": (
        lambda: ResidualAction(ActionHold(pendulum(), 2), "two-stage"),
        "below hold 2 there and none here",
    ),
}


@pytest.mark.parametrize("name", UNHELD)
def test_what_a_file_does_not_record_is_refused(name):
    make, said = UNHELD[name]
    with pytest.raises(
        InvalidValueError, match=f"a policy file is scored in PushRecovery/Pendulum-v0, .*{said}"
    ):
        from_sb3(make_model(sb3.PPO, make()), make())


def test_of_another_robot_a_file_says_which(toy):
    """Robot and gait box are recorded, so that they may be others than those of the id."""
    env = gym.make("push_recovery:PushRecovery/Biped-v0", robot="g1")
    about = from_sb3(make_model(sb3.PPO, env), env).description
    assert about.robot.mass == env.unwrapped.robot.mass != gym.make(PENDULUM).unwrapped.robot.mass


@pytest.mark.parametrize("change", [{"clip_obs": 3.0}, {"epsilon": 1e-3}])
def test_equal_statistics_that_are_clipped_otherwise_are_refused(change):
    venv, other = normalised(), VecNormalize(DummyVecEnv([pendulum]), **change)
    other.obs_rms = copy.deepcopy(venv.obs_rms)
    with pytest.raises(InvalidValueError, match="the statistics of `normalise` are not those of"):
        from_sb3(make_model(sb3.PPO, venv), pendulum(), other)
