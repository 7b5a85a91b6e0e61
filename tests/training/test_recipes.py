"""Recipes of the shipped policies, and what a policy's file says of how it came about."""

import dataclasses
import json
import re
from importlib.metadata import version

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.eval.rollout.environments import code_digest
from push_recovery.eval.rollout.load_policy import NAMES
from push_recovery.training.run import train
from push_recovery.training.settings import (
    RECIPES,
    TrainingSettings,
    command_of,
    difference,
    env_of_kind,
    get_recipe,
)


def test_every_shipped_policy_has_a_recipe_of_its_own():
    assert tuple(RECIPES) == NAMES
    as_text = {json.dumps(settings.to_json()) for settings in RECIPES.values()}
    assert len(as_text) == len(RECIPES)


@pytest.mark.parametrize("name", ["residual", "joint-residual"])
def test_a_correction_on_hardware_begins_as_an_exact_one_and_its_critic_sees_the_sensors_errors(name):
    exact, hardware = RECIPES[name], RECIPES[f"{name}-hardware"]
    assert (exact.initial, hardware.initial) == (None, name)
    assert "sensing" in set(hardware.critic) - set(exact.critic)
    same = ("policy_layers", "inputs", "gate", "gamma", "hold", "log_std")
    assert all(getattr(hardware, setting) == getattr(exact, setting) for setting in same)


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_is_of_the_kind_that_its_name_says(name):
    kind, _, robot = re.fullmatch(r"(.*?)(-hardware)?(?:-(g1|t1|jvrc1))?", name).groups()
    assert RECIPES[name].kind == kind
    assert ("hardware" in RECIPES[name].profile) == name.endswith("-hardware")
    form = {"joint": "Joint", "joint-residual": "JointResidual"}.get(kind, "")
    assert RECIPES[name].env_id == f"PushRecovery/{robot.upper() if robot else 'Biped'}{form}-v0"
    assert command_of(RECIPES[name], "x.json") == f"push-recovery train --recipe {name}"


@pytest.mark.parametrize(
    ("kind", "named", "trained_in"),
    [
        ("residual", "BipedResidual", "Biped"),
        ("residual", "T1Residual", "T1"),
        ("residual", "G1JointResidual", "G1JointResidual"),  # refused later, by what it acts on
        ("scratch", "G1", "G1"),
        ("joint", "Biped", "BipedJoint"),
        ("joint-residual", "Biped", "BipedJointResidual"),
        ("joint-residual", "JVRC1", "JVRC1JointResidual"),
        ("joint-residual", "JVRC1JointResidual", "JVRC1JointResidual"),
        ("joint-residual", "Pendulum", "Pendulum"),
    ],
)
def test_a_kind_is_trained_in_its_own_form_of_the_robot(kind, named, trained_in):
    assert env_of_kind(kind, f"PushRecovery/{named}-v0") == f"PushRecovery/{trained_in}-v0"
    assert env_of_kind(kind, f"their:{named}-v0") == f"their:{named}-v0"


def test_what_a_recipe_leaves_open_is_no_difference():
    settings = RECIPES["scratch"]
    assert settings.scale is None
    settled = dataclasses.replace(settings, log_std=-1.0)
    assert difference(settings, settled) is None
    assert difference(settled, settings) == "log_std"
    assert difference(settings, dataclasses.replace(settled, gamma=0.5)) == "gamma"
    assert command_of(settled, "x.json").endswith("--recipe scratch")
    assert command_of(dataclasses.replace(settled, gamma=0.5), "x.json").endswith("--recipe x.json")


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("residual", {"scale": (0.5,) * 7}),
        ("residual", {"log_std": -5.0}),
        ("residual", {"initial": "scratch"}),
        ("residual", {"wanted_kl": 0.01}),
        ("residual", {"log_std_end": -3.0}),
        ("residual", {"normalise_reward": True}),
        ("residual", {"hold": 5}),
        ("residual", {"inputs": ("observation",)}),
        ("residual", {"starts": "reset"}),
        ("residual", {"reward": "steps"}),
        ("scratch", {"inputs": ("observation",)}),
        ("joint", {"starts": "push"}),
        ("joint-residual", {"reward": "environment"}),
    ],
)
def test_what_no_environment_would_settle_is_a_difference(name, given):
    given = dataclasses.replace(RECIPES[name], **given)
    assert difference(RECIPES[name], given) in given.to_json()
    assert command_of(given, "x.json").endswith("--recipe x.json")


@pytest.mark.parametrize(
    ("name", "settled"),
    [
        ("residual", {"hold": 2, "inputs": ("observation", "base", "gate", "margin"), "starts": "push",
                      "reward": "recovery", "log_std": -2.0}),
        ("scratch", {"hold": 2, "inputs": ("observation", "margin"), "starts": "push", "reward": "recovery"}),
        ("joint", {"hold": 1, "inputs": ("observation",), "starts": "reset", "log_std": -1.5}),
        ("joint-residual", {"hold": 1, "inputs": ("observation",), "starts": "push", "reward": "recovery"}),
    ],
)  # fmt: skip
def test_what_the_environment_of_a_recipe_settles_is_none(name, settled):
    assert difference(RECIPES[name], dataclasses.replace(RECIPES[name], **settled)) is None


def test_minibatches_have_more_than_one_timestep():
    with pytest.raises(InvalidValueError, match="minibatches of more than 1, got 1 for 8192 timesteps"):
        TrainingSettings(batch_size=1)
    with pytest.raises(InvalidValueError, match="minibatches of more than 1, got 64 for 67 timesteps"):
        TrainingSettings(n_envs=1, n_steps=67, batch_size=64)
    assert TrainingSettings(n_envs=1, n_steps=67, batch_size=67).minibatch == 67


@pytest.mark.parametrize("given", [{"env_id": "PushRecovery/G1-v0"}, {"hold": 2}])
def test_a_teacher_shows_the_biped_at_every_period_alone(given):
    with pytest.raises(InvalidValueError, match=r"a teacher shows the joints of PushRecovery/BipedJoint-v0"):
        TrainingSettings("joint", teacher=True, **given)
    assert TrainingSettings("joint", teacher=True, env_id="PushRecovery/Biped-v0").teacher


@pytest.fixture
def trained(tmp_path, toy):
    """A policy file of a run with settings that are no recipe's, and these settings."""
    settings = TrainingSettings(
        kind="scratch", env_id=toy, timesteps=0, n_envs=2, seed=7, gamma=0.9, evaluation_scenarios=2
    )
    return train(settings, tmp_path / "run").policy, settings


def test_a_file_tells_how_it_came_about(trained):
    path, settings = trained
    note = json.loads(path.with_suffix(".json").read_text())["training"]
    assert difference(settings, TrainingSettings.from_json(note["settings"])) is None
    assert note["command"] == "push-recovery train --recipe policy.json"
    assert note["timesteps"] == 0
    assert 0 < note["seconds"] < 600
    (point,) = note["curve"]
    assert (point["timesteps"], point["scenarios"]) == (0, settings.evaluation_scenarios)
    assert note["code"] == code_digest()
    assert {"push-recovery", "python", "torch", "stable-baselines3", "mujoco", "numpy"} <= set(
        note["versions"]
    )
    assert note["versions"]["numpy"] == version("numpy")


def test_a_file_is_a_recipe(trained):
    path, settings = trained
    for name in (path, path.with_suffix(".json"), path.with_suffix("")):
        assert difference(settings, get_recipe(str(name))) is None


def test_what_is_no_recipe_is_refused(trained, tmp_path):
    path = trained[0].with_suffix(".json")
    with pytest.raises(UnknownNameError, match=r"unknown recipe 'residal'; did you mean 'residual'"):
        get_recipe("residal")
    for text, said in (
        ("{", "not valid JSON"),
        ("[]", "was trained with"),
        ('{"training": {}}', "was trained with"),
    ):
        path.write_text(text)
        with pytest.raises(InvalidValueError, match=said):
            get_recipe(str(path))
    path.write_text(json.dumps({"training": {"settings": {"kind": "scratch"}}}))
    with pytest.raises(InvalidValueError, match="must have the keys"):
        get_recipe(str(path))
