import dataclasses
import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.policies.residual import DEFAULT_FACTOR, default_residual_scale
from push_recovery.envs.scenario.distribution import ErrorRanges, PushDistribution
from push_recovery.eval.cli.main import main, parse
from push_recovery.training import cli as extras
from push_recovery.training.checkpoint import load_checkpoint
from push_recovery.training.settings import TrainingSettings


def train(kind="scratch", **given):
    """What `push-recovery train` does; its errors are raised."""
    words = [word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    parse("train", [kind, *words]).run()


def test_train_and_resume_from_the_options(tmp_path, toy, capsys):
    out = tmp_path / "run"
    train(env=toy, timesteps=600, n_envs=2, n_steps=256, evaluation_scenarios=2, seed=1, out=out)
    assert "policy.safetensors" in capsys.readouterr().out
    train(resume=out, timesteps=1200)
    assert "1536 timesteps" in capsys.readouterr().out
    about = NetworkPolicy.load(out / "policy").description
    assert about.residual is None
    assert about.hold == 2
    defaults = {"seed": 0}, {"n_envs": 128}  # given is given, even where it repeats the default
    for wrong in (
        *defaults,
        {"kind": "residual"},
        {"seed": 2},
        {"n_envs": 3},
        {"env": "PushRecovery/Biped-v0"},
    ):
        with pytest.raises(InvalidValueError, match="the run in"):
            train(resume=out, **wrong)
    with pytest.raises(InvalidValueError, match="--out"):
        train(resume=out, out=tmp_path)
    with pytest.raises(InvalidValueError, match="--scale"):
        train(resume=out, scale=1.0)


def test_scale_multiplies_the_default(tmp_path, toy):
    train(kind="residual", env=toy, timesteps=0, out=tmp_path / "run", scale=0.5)
    residual = NetworkPolicy.load(tmp_path / "run" / "policy").description.residual
    assert residual is not None
    expected = default_residual_scale(GaitLimits(), 0.5 * DEFAULT_FACTOR)
    np.testing.assert_array_equal(np.float32(residual.scale), expected)


def test_bad_options_are_refused(tmp_path, toy):
    with pytest.raises(InvalidValueError, match="train residual"):
        train(env=toy, scale=1.0)
    with pytest.raises(InvalidValueError, match=r"both.*residual.*scratch"):
        train(kind="both")
    with pytest.raises(InvalidValueError, match="n_envs"):
        train(env=toy, n_envs=0)
    with pytest.raises(InvalidValueError, match="no checkpoint"):
        train(resume=tmp_path)


def test_a_run_keeps_all_its_settings_when_it_goes_on(tmp_path, toy):
    out = tmp_path / "run"
    train(kind="residual", env=toy, timesteps=0, n_envs=2, gamma=0.9, scale=0.5, out=out)
    again = parse("train", ["--resume", str(out), "--timesteps", "7"])
    settings = load_checkpoint(out).settings
    assert (settings.gamma, settings.n_envs) == (0.9, 2)
    assert again.settings == dataclasses.replace(settings, timesteps=7)
    with pytest.raises(InvalidValueError, match=r"the run in .* has gamma 0.9, not 0.99"):
        train(kind="residual", resume=out, gamma=0.99)


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "tensorboard"])
def test_a_missing_extra_names_the_command_that_installs_it(monkeypatch, missing):
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == missing else object())
    with pytest.raises(MissingExtraError, match=r"pip install 'push-recovery\[train\]'"):
        train()


def test_the_help_tells_the_defaults_of_the_settings(capsys):
    assert main(["train", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", "").split())
    settings = TrainingSettings()
    for value in (settings.env_id, settings.timesteps, settings.seed, settings.n_envs):
        assert f"(default: {value})" in text
    assert "planning periods of 10 ms" in text


def test_every_setting_is_an_option():
    words = "residual --pushes.impulse-max 90 --easy 1 2 --errors friction 0.4 0.9 --inputs observation gate"
    settings = parse("train", words.split()).settings
    assert settings.pushes == dataclasses.replace(TrainingSettings().pushes, impulse_max=90.0)
    assert settings.inputs == ("observation", "gate")
    drawn, easy = settings.drawn_pushes, settings.easy_pushes
    assert drawn.errors == easy.errors == ErrorRanges(friction=(0.4, 0.9))
    assert (drawn.impulse_max, easy.impulse_min, easy.impulse_max) == (90.0, 1.0, 2.0)
    assert TrainingSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


@pytest.mark.parametrize("log_std", [None, -2.0, (-1.0,) * 7])
def test_settings_survive_json(log_std):
    pushes = PushDistribution(impulse_max=30.0)
    settings = TrainingSettings(scale=(0.5,) * 7, seed=4, pushes=pushes, gate=(0.01, 0.1), log_std=log_std)
    assert TrainingSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings


def test_settings_say_what_is_wrong():
    good = TrainingSettings().to_json()
    for wrong in (
        {"gamma": 1.5},
        {"learning_rate": -1.0},
        {"timesteps": 1.5},
        {"seed": -1},
        {"policy_layers": [0]},
        {"log_std": [0.0, float("nan")]},
        {"pushes": None},
        {"easy_share": 1.1},
        {"least_acceptance": 0.0},
        {"walks": 0},
        {"gate": [0.1, 0.0]},
    ):
        with pytest.raises(InvalidValueError, match=next(iter(wrong))):
            TrainingSettings.from_json(good | wrong)
    for wrong in ({"starts": "walk"}, {"reward": "none"}, {"profile": "real"}):
        with pytest.raises(UnknownNameError, match=next(iter(wrong))):
            TrainingSettings.from_json(good | wrong)
    with pytest.raises(UnknownNameError, match="frictoin"):
        TrainingSettings.from_json(good | {"errors": [["frictoin", 0.4, 1.0]]})
    with pytest.raises(InvalidValueError, match="impulse_max"):
        TrainingSettings.from_json(good | {"easy": [80.0, 5.0]})
    with pytest.raises(
        InvalidValueError, match=r"'observation' and then others, each once, got \['margin'\]"
    ):
        TrainingSettings.from_json(good | {"inputs": ["margin"]})
    for wrong in ({}, [], good | {"extra": 1}, good | {"gamma": "high"}):
        with pytest.raises(InvalidValueError, match="training settings"):
            TrainingSettings.from_json(wrong)


def test_a_residual_run_takes_the_plain_environment():
    assert TrainingSettings(env_id="PushRecovery/BipedResidual-v0").env_id == "PushRecovery/Biped-v0"
    scratch = TrainingSettings(kind="scratch", env_id="PushRecovery/BipedResidual-v0")
    assert scratch.env_id == "PushRecovery/BipedResidual-v0"


@pytest.mark.parametrize(("n_envs", "batch"), [(16, 1024), (4, 1024), (1, 256), (3, 768), (5, 640)])
def test_minibatches_divide_the_rollout(n_envs, batch):
    settings = TrainingSettings(n_envs=n_envs, n_steps=256, batch_size=1024)
    assert settings.minibatch == batch


def test_a_checkpoint_imports_no_module_that_the_user_did_not_name(tmp_path, toy, monkeypatch):
    out = tmp_path / "run"
    train(env=toy, timesteps=0, n_envs=2, out=out)
    (tmp_path / "evilmod.py").write_text("raise RuntimeError('code of the checkpoint has run')")
    monkeypatch.syspath_prepend(tmp_path)
    state = next((out / "checkpoints").glob("*/state.json"))
    state.write_text(state.read_text().replace(toy, "evilmod:X-v0"))
    with pytest.raises(InvalidValueError, match="run the code of 'evilmod': say --env evilmod:X-v0"):
        train(resume=out)
    with pytest.raises(RuntimeError, match="code of the checkpoint has run"):
        train(resume=out, env="evilmod:X-v0")
