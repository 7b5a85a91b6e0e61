"""Training on the joints: the kinds, their environments, and a short run to a policy that is scored."""

import re
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout_all
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.training import run
from push_recovery.training.builders import make_env as make_training_env
from push_recovery.training.imitation import ImitationSettings
from push_recovery.training.run import train
from push_recovery.training.settings import TrainingSettings
from push_recovery.training.vec_env import TrainingRobots

ENVS = {"joint": "PushRecovery/BipedJoint-v0", "joint-residual": "PushRecovery/BipedJointResidual-v0"}
SHORT = TrainingSettings(
    kind="joint", timesteps=16, n_envs=2, n_steps=8, policy_layers=(8,), value_layers=(8,),
    evaluation_scenarios=1, hold=1, walks=4,
)  # fmt: skip
WALK = Scenario("walk", duration=0.3)


@pytest.mark.parametrize("kind", ENVS)
def test_a_kind_takes_its_own_environment_of_the_biped(kind):
    settings = TrainingSettings(kind=kind)
    assert settings.env_id == ENVS[kind]
    assert replace(settings, seed=1) == TrainingSettings(kind=kind, seed=1)
    assert TrainingSettings.from_json(settings.to_json()) == settings


@pytest.mark.parametrize(
    ("kind", "env_id", "choices"),
    [
        ("joint", "PushRecovery/Pendulum-v0", "residual, scratch"),
        ("scratch", "PushRecovery/BipedJoint-v0", "joint, joint-residual"),
        ("residual", "PushRecovery/BipedJoint-v0", "joint, joint-residual"),
    ],
)
def test_an_environment_of_other_actions_is_refused(kind, env_id, choices):
    with pytest.raises(InvalidValueError, match=f"{kind}'; choose from: {choices}"):
        make_training_env(TrainingSettings(kind=kind, env_id=env_id))


def test_what_belongs_to_gait_residuals_is_refused():
    with pytest.raises(InvalidValueError, match="residual training"):
        TrainingSettings(kind="joint", scale=(0.5,) * 7)
    with pytest.raises(InvalidValueError, match="corrects two-stage, not 'stage-1'"):
        TrainingSettings(kind="joint-residual", policy="stage-1")


def test_a_policy_on_joints_begins_as_what_the_planner_shows(tmp_path, monkeypatch, capsys):
    """Two rounds with six robots: the first policy is the taught one, and going on shows nothing again."""
    few = {"robots": 6, "rounds": 2, "periods": 10, "batches": 4, "last_batches": 4, "batch_size": 32}
    monkeypatch.setattr(run, "ImitationSettings", lambda **given: ImitationSettings(**given, **few))
    settings = replace(SHORT, timesteps=0, teacher=True)
    result = train(settings, tmp_path / "run")
    said = capsys.readouterr().err
    assert re.search(r"^imitation of the planner, before PPO: .*; output in .*taught$", said, flags=re.M)
    assert re.search(r"^2/2 in ", said, flags=re.M)
    taught, begun = (NetworkPolicy.load(path) for path in (tmp_path / "run" / "taught", result.policy))
    for mine, shown in zip(begun.network.weights, taught.network.weights, strict=True):
        np.testing.assert_array_equal(mine, shown)
    np.testing.assert_array_equal(begun.normalisation.mean, taught.normalisation.mean)
    assert any(np.any(weight) for weight in taught.network.weights)
    monkeypatch.setattr(run, "imitate_once", None)
    assert run.resume(tmp_path / "run", 16).timesteps == 16


def test_what_a_kind_leaves_open():
    by_kind = {
        kind: TrainingSettings(kind=kind) for kind in ("residual", "scratch", "joint", "joint-residual")
    }
    assert [one.periods for one in by_kind.values()] == [2, 2, 1, 1]
    assert not any(one.teacher for one in by_kind.values())
    with pytest.raises(InvalidValueError, match="teacher must be False but for the kind joint"):
        replace(by_kind["residual"], teacher=True)


@pytest.mark.parametrize(("kind", "sizes"), [("joint", (58, 14)), ("joint-residual", (94, 14))])
def test_a_short_run_leaves_a_policy_that_is_scored_where_it_acts(tmp_path, kind, sizes):
    result = train(replace(SHORT, kind=kind, env_id=ENVS[kind]), tmp_path / "run")
    policy = NetworkPolicy.load(result.policy)
    assert (policy.observation_size, policy.action_size) == sizes
    assert policy.description.env_id == ENVS[kind]
    assert policy.description.residual is None
    env = make_env(ENVS[kind])
    alone, together = (
        rollout_all(env, load_policy(str(result.policy), env), [WALK] * n, "mine", n)[0] for n in (1, 2)
    )
    assert alone == together
    assert alone.env_steps == 30
    with pytest.raises(InvalidValueError, match="was made for"):
        load_policy(str(result.policy), make_env("PushRecovery/Biped-v0"))


def test_robots_of_a_run_share_one_native_environment(vec_env_of):
    venv = vec_env_of(replace(SHORT, kind="joint-residual", env_id=ENVS["joint-residual"]), 0)
    inner = venv.unwrapped
    assert isinstance(inner, TrainingRobots)
    assert venv.reset().shape == (2, 94)
    _, rewards, _, _ = venv.step(np.zeros((2, 14), np.float32))
    assert np.isfinite(rewards).all()
    venv.close()


def test_a_teacher_shows_by_the_seed_and_the_layers_of_the_run(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(run, "imitate_once", lambda settings, path, report: shown.append((settings, path)))
    settings = TrainingSettings("joint", teacher=True, seed=7, policy_layers=(16, 8))
    run.taught_policy(settings, tmp_path / "taught")
    ((asked, path),) = shown
    assert (asked.seed, asked.layers, path) == (7, (16, 8), tmp_path / "taught")
