"""Policies with a robot of their own: who walks what, wherever a policy is named."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.api import rollout as named_rollout
from push_recovery.eval.rollout.environments import (
    full_body_form,
    has_own_robot,
    make_env,
    preset_digest,
    under_profile,
)
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.policy_source import policy_sources
from push_recovery.eval.rollout.workers import Runner

BIPED = "PushRecovery/Biped-v0"
OWN = {"touchdown_delay": 0.009, "biped": {"gait": {"apex": 0.05}, "limits": {"length_max": 0.4}}}
SCENARIO = Scenario("push", (polar_push(300.0, 0.4, 0.1, 0.5),), duration=0.9)


@pytest.fixture(scope="module")
def preset(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "own.json"
    PresetFile("biped", variants={"stage-1": OWN}).save(path)
    return str(path)


def test_the_environment_is_the_robot_of_its_variant(preset):
    one = BipedEpisodes(1, preset=preset, variant="stage-1")
    for episodes in (one, one.clone(2)):
        assert (episodes.core.gait_settings.apex, episodes.limits.length_max) == (0.05, 0.4)
        assert episodes.touchdown_delay == 0.009
    for variant in ("", "two-stage"):
        episodes = BipedEpisodes(1, preset=preset, variant=variant)
        assert (episodes.core.gait_settings.apex, episodes.limits.length_max) == (0.0527, 0.431)
        assert episodes.touchdown_delay == 0.0155


def test_only_a_variant_with_its_own_robot_needs_another_environment(preset):
    env = BipedEnv(preset=preset)
    assert has_own_robot(env, "stage-1")
    assert not has_own_robot(BipedEnv(preset=preset, variant="stage-1"), "stage-1")
    assert not any(has_own_robot(env, other) for other in ("two-stage", "random", "file.json", object()))
    assert not has_own_robot(BipedEnv(), "stage-1")


def test_policies_side_by_side_walk_their_own_robots(preset):
    """Those of a run are those of environments made by hand, whatever the label and the order."""
    sources = policy_sources({"mine": "stage-1", "two-stage": "two-stage"})
    env_id = f"{BIPED}@{preset}"
    runner = Runner(env_id, sources)
    for label, variant in (("two-stage", "two-stage"), ("mine", "stage-1")):
        kwargs = {"variant": variant} if label == "mine" else {}
        env = make_env(env_id, **kwargs)
        expected = rollout(env, load_policy(variant, env), SCENARIO, label)
        assert runner.run((label, SCENARIO)) == expected
        assert list(runner.run_all(label, [SCENARIO])) == [expected]
        assert named_rollout(variant, SCENARIO, env_id) == replace(expected, policy=variant)
        common = make_env(env_id)
        differs = rollout(common, load_policy(variant, common), SCENARIO, label) != expected
        assert differs == (label == "mine")
    runner.close()


def test_a_profile_is_put_on_a_scenario_at_the_size_of_the_robot():
    """Half the mass at the same height halves torques, inertias and powers; what a scenario says stands."""
    env = SimpleNamespace(unwrapped=SimpleNamespace(robot=RobotModel(mass=30.0)))
    found = under_profile(env, Scenario("x", errors=ModelErrors(friction=0.3)), "hardware")
    errors = found.errors
    assert (errors.joint_friction, errors.armature, errors.motor_power) == pytest.approx((0.5, 0.015, 1000.0))
    assert (errors.friction, found.sensing) == (0.3, "onboard")


@pytest.mark.parametrize(
    ("env_id", "form"),
    [
        ("PushRecovery/Biped-v0", "PushRecovery/BipedFullBody-v0"),
        ("PushRecovery/Biped-v0@mine.json", "PushRecovery/BipedFullBody-v0@mine.json"),
        ("PushRecovery/G1FullBody-v0@g1", "PushRecovery/G1FullBody-v0@g1"),
        ("theirs:Robot-v0", "theirs:RobotFullBody-v0"),
        ("PushRecovery/G1Residual-v0", "PushRecovery/G1FullBody-v0"),
    ],
)
def test_the_form_of_all_joints_is_of_the_same_robot_and_preset(env_id, form):
    assert full_body_form(env_id) == form


@pytest.mark.parametrize("name", ["Pendulum", "BipedJoint", "BipedJointResidual"])
def test_what_has_no_form_of_all_joints_is_refused(name):
    with pytest.raises(InvalidValueError, match="needs the environment of a robot"):
        full_body_form(f"PushRecovery/{name}-v0")


@pytest.mark.parametrize("env_id", ["PushRecovery/G1-v0", "PushRecovery/Pendulum-v0", "x.robot.json"])
def test_a_preset_file_that_is_not_there_is_named(env_id):
    with pytest.raises(InvalidValueError) as refused:
        preset_digest(f"{env_id}@nofile.json")
    assert str(refused.value) == "cannot read preset file 'nofile.json': No such file or directory"
