"""Every way to hand over a model, from every environment: the rows of that environment, or one clear line.

What is expected comes from stepping the environment of the training itself, wrapper by wrapper.
"""

import copy
import io
import re
import sys
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import FrameStackObservation, NormalizeObservation, RescaleAction
from push_recovery.controllers.errors import PushRecoveryError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.envs.episode import gym_env
from push_recovery.envs.wrappers import ActionHold, ResidualAction
from push_recovery.eval.score.suites import Suite

from push_recovery import GaitEvent, Push, Scenario, evaluate, record, rollout

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra train")
from push_recovery.training import model_policy  # noqa: E402
from push_recovery.training.from_sb3 import from_sb3  # noqa: E402
from push_recovery.training.model_policy import ArchivePolicy, Trained, _correction  # noqa: E402
from push_recovery.training.vec_env import SB3VecEnv  # noqa: E402
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    SubprocVecEnv,
    VecEnvWrapper,
    VecFrameStack,
    VecNormalize,
)

PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
RESIDUAL = "PushRecovery/BipedResidual-v0"
SCENARIOS = [
    Scenario(
        f"push {k}", (Push(force=force, duration=0.1, start=GaitEvent(step=2, side="left")),), duration=3.0
    )
    for k, force in enumerate([(0.0, 500.0, 0.0), (300.0, -200.0, 0.0)])
]


def pendulum(residual=None, hold=1):
    env = gym.make(f"push_recovery:{PENDULUM}")
    if residual is not None:
        env = ResidualAction(env, **residual)
    return env if hold == 1 else ActionHold(env, hold)


# name -> the environment on which rows are to be had, and how that of the training is made
TRAININGS = {
    "plain": (PENDULUM, pendulum),
    "held": (PENDULUM, lambda: pendulum(hold=3)),
    "residual": (PENDULUM, lambda: pendulum({"policy": "two-stage"})),
    "scaled": (PENDULUM, lambda: pendulum({"policy": "stage-1", "scale": 0.2})),
    "gated and held": (PENDULUM, lambda: pendulum({"policy": "two-stage", "gate": (0.02, 0.06)}, hold=2)),
    "biped": (BIPED, lambda: gym.make(f"push_recovery:{BIPED}")),
    "biped residual": (BIPED, lambda: gym.make(f"push_recovery:{RESIDUAL}", hold=2, gate=(0.03, 0.10))),
}
NORMALISED = "normalised"  # "gated and held" within a VecNormalize
VECTOR = "vector"  # "biped residual" as robots on one core


def random_head(model, spread=0.3):
    """The model with random weights in its last layer, so that its actions are neither nothing nor bounds."""
    with torch.no_grad():
        for parameter in model.policy.action_net.parameters():
            parameter.normal_(0.0, spread, generator=torch.Generator().manual_seed(1))
    return model


def trained(venv, steps=8):
    """A model that has seen a few steps, as those that are saved have."""
    model = sb3.PPO(
        "MlpPolicy", venv, n_steps=8, batch_size=8, n_epochs=1, device="cpu", seed=0,
        policy_kwargs={"net_arch": [8]},
    )  # fmt: skip
    return random_head(model.learn(steps))


@pytest.fixture(scope="module")
def models():
    """Of every training: the model, the environment for its rows, the environment below VecNormalize."""
    found = {name: (trained(make()), where, make()) for name, (where, make) in TRAININGS.items()}
    where, make = TRAININGS["gated and held"]
    venv = VecNormalize(DummyVecEnv([make]), clip_obs=3.0)
    venv.obs_rms.update(np.random.default_rng(2).normal(0.4, 0.5, (500, 36)))
    found[NORMALISED] = trained(venv), where, make()
    where, make = TRAININGS["biped residual"]
    robots = gym.make_vec(
        f"push_recovery:{RESIDUAL}", 2, vectorization_mode="vector_entry_point", hold=2, gate=(0.03, 0.10)
    )
    found[VECTOR] = trained(SB3VecEnv(robots), 16), where, make()
    return found


def stepped(model, env, scenario):
    """What becomes of a scenario where the model acts in the environment of its training."""
    normalise, total, over, info = model.get_vec_normalize_env(), 0.0, False, {}
    seen, _ = env.reset(seed=scenario.noise_seed, options={"scenario": scenario})
    while not over:
        seen = seen if normalise is None else normalise.normalize_obs(seen)
        seen, reward, fell, truncated, info = env.step(model.predict(seen, deterministic=True)[0])
        total, over = total + reward, fell or truncated
    return (
        not fell,
        info["recovered_at"],
        info["failure_reason"],
        info["time"],
        pytest.approx(total, rel=1e-9),
    )


def row(found):
    return found.survived, found.recovered_at, found.failure_reason, found.end_time, found.total_reward


def in_memory(model, env, folder):
    return model


def saved(model, folder):
    normalise = model.get_vec_normalize_env()
    if normalise is not None:
        normalise.save(str(folder / "vecnormalize.pkl"))
    model.save(folder / "model.zip")
    return str(folder / "model.zip")


def loaded(model, env, folder):
    return sb3.PPO.load(saved(model, folder), device="cpu")


def loaded_with_environment(model, env, folder):
    path, venv = saved(model, folder), DummyVecEnv([lambda: env])
    if model.get_vec_normalize_env() is not None:
        venv = VecNormalize.load(str(folder / "vecnormalize.pkl"), venv)
    return sb3.PPO.load(path, env=venv, device="cpu")


def archive(model, env, folder):
    return ArchivePolicy.of(saved(model, folder))


def attribute(model, env, folder):
    """A function in a module of the working directory that loads the model."""
    name = f"my_models_{abs(hash(str(folder)))}"
    code = "from stable_baselines3 import PPO\n\ndef make():\n    return PPO.load({path!r}, device='cpu')\n"
    (folder / f"{name}.py").write_text(code.format(path=saved(model, folder)))
    sys.path.insert(0, str(folder))
    return f"{name}:make"


def policy_file(model, env, folder):
    return str(from_sb3(model, env, model.get_vec_normalize_env()).save(folder / "mine"))


def own_object(model, env, folder):
    """An object of the user around a file, whose actions are gait actions whatever the model gives."""

    class Mine:
        policy = NetworkPolicy.load(policy_file(model, env, folder))

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return self.policy.predict(observation, state, episode_start)

    return Mine()


WAYS = [in_memory, loaded, loaded_with_environment, archive, attribute, policy_file, own_object]
NO_STATISTICS = (
    "was trained on observations that VecNormalize normalised, and their statistics are not "
    "here: load it with "
    "them, PPO.load(FILE, env=VecNormalize.load(STATISTICS, venv))"
)


@pytest.mark.parametrize("training", [*TRAININGS, NORMALISED, VECTOR])
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_a_model_is_scored_on_what_it_was_trained_on(models, way, training, tmp_path, monkeypatch):
    model, where, env = models[training]
    monkeypatch.setattr(sys, "path", list(sys.path))
    policy = way(model, env, tmp_path)
    if training == NORMALISED and way in {loaded, attribute}:
        with pytest.raises(PushRecoveryError, match=re.escape(NO_STATISTICS)):
            rollout(policy, SCENARIOS[0], where)
        return
    here = gym.make(f"push_recovery:{where}")
    for scenario in SCENARIOS:
        expected = stepped(model, env, scenario)
        found = row(rollout(policy, scenario, here))
        if way in {policy_file, own_object}:  # whose network numpy runs
            assert (found[0], found[2]) == (expected[0], expected[2])
            assert found[3] == pytest.approx(expected[3], abs=0.02)
        else:
            assert found == expected


def test_taken_for_gait_actions_corrections_would_give_other_rows(models):
    """So the rows above tell the two apart."""
    model, where, env = models["biped residual"]

    class Raw:
        def predict(self, observation):
            return model.predict(observation, deterministic=True)[0]

    assert row(rollout(Raw(), SCENARIOS[0], where)) != stepped(model, env, SCENARIOS[0])


def test_an_untrained_model_of_the_readme_is_the_planner(tmp_path):
    """Whose mean action is nothing: in memory and as the environment itself is named."""
    env = gym.make(f"push_recovery:{RESIDUAL}", hold=2, gate=(0.03, 0.10))
    model = random_head(trained(env), spread=0.0)
    found = evaluate(
        {"ppo": model, "two-stage": "two-stage"}, Suite("two", "1", tuple(SCENARIOS)), out=tmp_path / "two"
    )
    (mine, planner) = (
        [{**one, "policy": "", "policy_sha256": ""} for one in found.rows[name]] for name in found.rows
    )
    assert mine == planner
    assert [one["recovered"] for one in planner] == [True, True]


def test_in_the_environment_of_its_training_a_model_acts_as_it_is(models, tmp_path):
    model, _, env = models["biped residual"]
    outcomes = [rollout(model, scenario, env) for scenario in SCENARIOS]
    assert [row(one) for one in outcomes] == [stepped(model, env, scenario) for scenario in SCENARIOS]
    plain = gym.make(f"push_recovery:{RESIDUAL}")
    model = trained(plain)
    found = evaluate({"ppo": model}, Suite("two", "1", tuple(SCENARIOS)), env=RESIDUAL, out=tmp_path / "two")
    ends = [(one["survived"], one["recovered_at"], one["end_time"]) for one in found.rows["ppo"]]
    expected = [stepped(model, plain, scenario) for scenario in SCENARIOS]
    assert ends == [(survived, at, end) for survived, at, _, end, _ in expected]


def test_a_hold_is_made_up_for_where_the_environment_lacks_it_alone():
    model = trained(gym.make(f"push_recovery:{RESIDUAL}", hold=4))
    env = gym.make(f"push_recovery:{RESIDUAL}", hold=4)
    here = gym.make(f"push_recovery:{RESIDUAL}", hold=2)
    assert row(rollout(model, SCENARIOS[0], here)) == stepped(model, env, SCENARIOS[0])


def test_records_go_the_same_way(models):
    model, where, env = models["biped residual"]
    assert row(record(model, SCENARIOS[0], where).outcome) == stepped(model, env, SCENARIOS[0])


def test_wrappers_that_the_environment_has_too_are_its_own():
    env = RescaleAction(gym.make(f"push_recovery:{PENDULUM}"), -0.5, 0.5)
    model = trained(env)
    assert row(rollout(model, SCENARIOS[0], env)) == stepped(model, env, SCENARIOS[0])


def without_notes(model):
    """A model as older versions of the environments left it."""
    buffer = io.BytesIO()
    model.action_space = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
    model.save(buffer)
    return sb3.PPO.load(io.BytesIO(buffer.getvalue()), device="cpu")


class Middle:
    def predict(self, observation):
        return 0.0 * observation[:7]


def with_memory():
    model = trained(pendulum(hold=2))
    model.policy.lstm_actor = None
    return model


class Half(gym.Wrapper):
    """Halves the action, unseen by its spaces."""

    def step(self, action):
        return self.env.step(0.5 * np.asarray(action))


class HalfMonitor(Monitor):
    """A harmless wrapper, made one that is not."""

    def step(self, action):
        return super().step(0.5 * np.asarray(action))


class HalfAll(VecEnvWrapper):
    """The same around all environments."""

    def reset(self):
        return self.venv.reset()

    def step_async(self, actions):
        self.venv.step_async(0.5 * actions)

    def step_wait(self):
        return self.venv.step_wait()


class Times(gym.ObservationWrapper):
    """Multiplies observations by a number that Gymnasium does not know of."""

    def __init__(self, env, number):
        super().__init__(env)
        self.number = number

    def observation(self, observation):
        return self.number * observation


class Twice(gym.RewardWrapper):
    def reward(self, reward):
        return 2.0 * float(reward)


def halved(observation):
    return 0.5 * observation


def in_a_worker(*made):
    """A model that was trained in a process of its own, which has ended."""
    venv = SubprocVecEnv([lambda: wrapped(*made)], start_method="fork")
    model = trained(venv)
    known = model_policy.in_memory(model)
    venv.close()
    return model, known


def wrapped(make=None, *rest):
    return pendulum() if make is None else make(pendulum(), *rest)


def below_a_vector_wrapper(make, *rest):
    robots = gym.make_vec(f"push_recovery:{PENDULUM}", 2, vectorization_mode="vector_entry_point")
    return trained(SB3VecEnv(make(robots, *rest)), 16)


MAY = "which may change observations or actions"
REFUSED = {
    "without a note": (
        lambda: without_notes(trained(pendulum())), PENDULUM,
        "the model PPO does not say what environment it was trained in, and to its spaces "
        "PushRecovery/Pendulum-v0 and one whose actions correct a planner are alike: load it with "
        'that of its training, PPO.load(FILE, env=gym.make("push_recovery:PushRecovery/BipedResidual-v0", '
        "hold=2)), or make it a policy file, push_recovery.training.from_sb3.from_sb3(model, env).save(NAME)",
    ),
    "of a pendulum": (
        lambda: trained(pendulum()), BIPED,
        "the model PPO was trained in PushRecovery/Pendulum-v0 (hold 1), and PushRecovery/Biped-v0 is "
        "PushRecovery/Biped-v0 (hold 1): environment PushRecovery/Pendulum-v0 there and "
        "PushRecovery/Biped-v0 here",
    ),
    "of another gate": (
        lambda: trained(gym.make(f"push_recovery:{RESIDUAL}", gate=(0.03, 0.10))), RESIDUAL,
        "the model PPO was trained in PushRecovery/Biped-v0 with corrections of two-stage (gate "
        "(0.03, 0.1)) (hold "
        "1), and PushRecovery/BipedResidual-v0 is PushRecovery/Biped-v0 with corrections of "
        "two-stage (no gate) "
        "(hold 1): actions mean different things there (gate (0.03, 0.1) there and none here); score it by "
        'evaluate(..., env="PushRecovery/Biped-v0") or push_recovery.rollout(model, scenario, env)',
    ),
    "of gait actions": (
        lambda: trained(gym.make(f"push_recovery:{BIPED}")), RESIDUAL, "actions mean different things there"
    ),
    "on a policy without a name": (
        lambda: trained(pendulum({"policy": Middle()})), PENDULUM,
        "the model PPO was trained in PushRecovery/Pendulum-v0 with corrections of a policy (no "
        "gate) (hold 1), "
        "and PushRecovery/Pendulum-v0 is PushRecovery/Pendulum-v0 (hold 1): what its actions "
        "correct has no name",
    ),
    "a hold below the residual": (
        lambda: trained(ResidualAction(pendulum(hold=2))), PENDULUM, "below hold 2 there and none here"
    ),
    "normalised": (
        lambda: trained(NormalizeObservation(pendulum())), PENDULUM,
        f"the model PPO was trained within NormalizeObservation, {MAY}, and "
        "PushRecovery/Pendulum-v0 has none of these wrappers: score it by push_recovery.rollout(model, "
        "scenario, env), env wrapped like that of its training; of running means only those of "
        "VecNormalize are taken "
        "along",
    ),
    "rescaled": (
        lambda: trained(RescaleAction(pendulum(), -0.5, 0.5)), PENDULUM, "within RescaleAction, which may"
    ),
    "frames": (
        lambda: trained(VecFrameStack(DummyVecEnv([pendulum]), 2)), PENDULUM,
        f"the model PPO was trained within VecFrameStack around all its environments, {MAY}, and one "
        "environment has no such wrapper: nothing scores it here",
    ),
    "rows of frames": (
        lambda: trained(FrameStackObservation(pendulum(), 2)), PENDULUM,
        f"within FrameStackObservation, {MAY}, and {PENDULUM} has none of these wrappers: score it by "
        "push_recovery.rollout(model, scenario, env), env wrapped like that of its training",
    ),
    "own wrapper": (lambda: trained(Half(pendulum())), PENDULUM, f"was trained within Half, {MAY}"),
    "repeated": (
        lambda: trained(wrappers.RepeatAction(pendulum(), 3)), PENDULUM, f"within RepeatAction, {MAY}"
    ),
    "a subclass": (lambda: trained(HalfMonitor(pendulum())), PENDULUM, f"within HalfMonitor, {MAY}"),
    "around all": (lambda: trained(HalfAll(DummyVecEnv([pendulum]))), PENDULUM, "within HalfAll around all"),
    "unlike": (
        lambda: trained(DummyVecEnv([pendulum, lambda: Half(pendulum())])), PENDULUM,
        f"was trained in environments within unlike wrappers, {MAY}",
    ),
    "below a vector": (
        lambda: below_a_vector_wrapper(wrappers.vector.TransformObservation, halved), PENDULUM,
        f"with wrappers that can't be looked at from here, {MAY}: load it with one environment like those of "
        "its training, PPO.load(FILE, env=env), and score it by push_recovery.rollout(model, scenario, env)",
    ),
    "normalised twice": (
        lambda: trained(VecNormalize(VecNormalize(DummyVecEnv([pendulum])))), PENDULUM,
        "2 layers of VecNormalize normalise the observations one after the other",
    ),
    "another robot": (
        lambda: trained(gym.make("push_recovery:PushRecovery/G1Residual-v0")), BIPED,
        "was trained in PushRecovery/G1-v0 with corrections of two-stage (no gate)",
    ),
    "on joints": (
        lambda: trained(gym.make("push_recovery:PushRecovery/BipedJointResidual-v0")), BIPED,
        'score it by evaluate(..., env="PushRecovery/BipedJointResidual-v0") or',
    ),
    "two residuals": (
        lambda: trained(ResidualAction(pendulum({"policy": "two-stage"}))), PENDULUM,
        "(hold 1): below residual two-stage there and none here; score it by push_recovery.rollout(model,",
    ),
    "another task": (
        lambda: trained(gym.make("CartPole-v1")), PENDULUM, "(4,) and gives actions Discrete(2)"
    ),
    "with a memory": (with_memory, PENDULUM, "the model PPO remembers (it is recurrent)"),
    "a network alone": (
        lambda: trained(pendulum()).policy, PENDULUM,
        "the model ActorCriticPolicy is the network of a model alone, which does not say what it "
        "was trained in: "
        "hand over the model itself, not its policy",
    ),
    "a graph": (lambda: "mine.onnx", PENDULUM, "there is no file 'mine.onnx'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_not_be_scored_rightly_is_refused_in_one_line(name):
    make, where, said = REFUSED[name]
    with pytest.raises(PushRecoveryError) as error:
        rollout(make(), SCENARIOS[0], where)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


HARMLESS = {
    "a function of rewards": lambda: wrappers.TransformReward(pendulum(), lambda reward: 2.0 * reward),
    "own rewards": lambda: Twice(pendulum(hold=2)),
    "normalised rewards": lambda: wrappers.NormalizeReward(pendulum()),
    "a time limit": lambda: wrappers.TimeLimit(pendulum(), 2000),
    "statistics": lambda: wrappers.RecordEpisodeStatistics(Monitor(pendulum())),
}


@pytest.mark.parametrize("name", HARMLESS)
def test_wrappers_that_change_neither_observations_nor_actions_are_none(name):
    model, plain = trained(HARMLESS[name]()), pendulum(hold=2 if name == "own rewards" else 1)
    assert row(rollout(model, SCENARIOS[0], PENDULUM)) == stepped(model, plain, SCENARIOS[0])


def test_wrappers_in_worker_processes_are_asked_for():
    """Also those that leave both spaces as they are; a plain environment is scored as it is."""
    model, known = in_a_worker(wrappers.DelayObservation, 2)
    assert known.changed_by == ((model_policy.HIDDEN,),)
    with pytest.raises(PushRecoveryError, match="wrappers that can't be looked at from here"):
        rollout(model, SCENARIOS[0], PENDULUM)
    model, known = in_a_worker(Monitor)
    assert known.changed_by == ((),)
    with pytest.raises(PushRecoveryError, match="wrappers that can't be looked at from here"):
        rollout(model, SCENARIOS[0], PENDULUM)  # since its workers have ended


def test_of_two_normalisations_the_one_of_observations_counts():
    """Whether it is the inner or the outer one."""
    for outer_sees in (True, False):
        inner = VecNormalize(DummyVecEnv([pendulum]), norm_obs=not outer_sees)
        venv = VecNormalize(inner, norm_obs=outer_sees)
        sees = venv if outer_sees else inner
        sees.obs_rms.update(np.random.default_rng(2).normal(0.4, 0.5, (500, 36)))
        model = trained(venv)
        mean, deviation = sees.obs_rms.mean, np.sqrt(sees.obs_rms.var + sees.epsilon)

        class Seen:
            def predict(self, observation, model=model, mean=mean, deviation=deviation):
                seen = np.clip((observation - mean) / deviation, -10.0, 10.0).astype(np.float32)
                return model.predict(seen, deterministic=True)[0]

        found = row(rollout(model, SCENARIOS[0], PENDULUM))
        assert found == row(rollout(Seen(), SCENARIOS[0], PENDULUM))


def test_other_settings_of_an_own_wrapper_are_refused():
    model = trained(Times(pendulum(), 0.5))
    expected = stepped(model, Times(pendulum(), 0.5), SCENARIOS[0])
    assert row(rollout(model, SCENARIOS[0], Times(pendulum(), 0.5))) == expected
    with pytest.raises(PushRecoveryError, match="the same with other settings"):
        rollout(model, SCENARIOS[0], Times(pendulum(), 0.1))


def test_running_means_stay_as_they_are_while_an_episode_is_scored():
    env = NormalizeObservation(pendulum())
    model = trained(env)
    mean, count = env.obs_rms.mean.copy(), env.obs_rms.count
    rows = [row(rollout(model, SCENARIOS[0], env)) for _ in range(3)]
    assert rows[0] == rows[1] == rows[2]
    np.testing.assert_array_equal(env.obs_rms.mean, mean)
    assert env.obs_rms.count == count
    env.reset(seed=0)
    assert env.obs_rms.count == count + 1  # outside it learns on
    env.update_running_mean = False
    rollout(model, SCENARIOS[0], env)
    assert not env.update_running_mean  # as its owner has it


def test_statistics_beside_an_archive_of_raw_observations_are_refused(models, tmp_path):
    saved(models[NORMALISED][0], tmp_path)
    path = saved(models["gated and held"][0], tmp_path)
    with pytest.raises(PushRecoveryError, match=r"vecnormalize\.pkl beside it is another model's"):
        rollout(ArchivePolicy.of(path), SCENARIOS[0], PENDULUM)
    (tmp_path / "vecnormalize.pkl").unlink()
    saved(models[NORMALISED][0], tmp_path)
    (tmp_path / "vecnormalize.pkl").unlink()
    with pytest.raises(PushRecoveryError, match=r"put vecnormalize\.pkl \(of VecNormalize\.save\) beside it"):
        rollout(ArchivePolicy.of(path), SCENARIOS[0], PENDULUM)


def test_the_note_changes_nothing_else_of_a_space():
    env = gym.make(f"push_recovery:{RESIDUAL}", hold=2)
    box = gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
    assert env.action_space == box
    assert repr(env.action_space) == repr(box)
    assert copy.deepcopy(env.action_space) == box


CORRECTS = {"policy": "two-stage", "gate": None}
DIFFERENT = "actions mean different things there"


@pytest.mark.parametrize(
    ("theirs", "here", "lacks"),
    [
        ({gym_env.HOLD: 2}, {gym_env.HOLD: 2}, (None, 1)),
        ({gym_env.HOLD: 4}, {gym_env.HOLD: 2}, (None, 2)),
        ({gym_env.HOLD: 3}, {}, (None, 3)),
        ({gym_env.HOLD: 3}, {gym_env.HOLD: 2}, DIFFERENT),  # no whole number of those here
        ({gym_env.HOLD: 2, gym_env.RESIDUAL: CORRECTS}, {}, (CORRECTS, 2)),
        ({gym_env.HOLD: 4, gym_env.RESIDUAL: CORRECTS}, {gym_env.RESIDUAL: CORRECTS}, (None, 4)),
        (
            {gym_env.HOLD: 4, gym_env.RESIDUAL: CORRECTS},
            {gym_env.HOLD: 2},
            DIFFERENT,
        ),  # of the planner, too
        ({gym_env.RESIDUAL: CORRECTS}, {gym_env.RESIDUAL: {**CORRECTS, "gate": (0.1, 0.2)}}, DIFFERENT),
        ({}, {gym_env.RESIDUAL: CORRECTS}, DIFFERENT),
    ],
)
def test_residual_and_hold_are_made_up_for_where_they_come_to_the_same(theirs, here, lacks):
    known = Trained("a model", None, None, None)
    env = SimpleNamespace(spec=SimpleNamespace(id="here"))
    if isinstance(lacks, tuple):
        assert _correction(known, theirs, here, env) == lacks
        return
    with pytest.raises(PushRecoveryError, match=lacks):
        _correction(known, theirs, here, env)
