"""All shipped policies by one command, and one by its recipe."""

import dataclasses
import json
import re

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError, shown
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.policies.residual import DEFAULT_FACTOR, default_residual_scale
from push_recovery.envs.scenario.distribution import ErrorRanges, PushDistribution
from push_recovery.eval.cli.main import main, parse
from push_recovery.eval.rollout import load_policy as names
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.kinds import SuiteDistribution
from push_recovery.training import cli
from push_recovery.training.cli import is_complete, train_recipe
from push_recovery.training.run import SILENT, load_checkpoint
from push_recovery.training.settings import RECIPES, TrainingSettings, difference


@pytest.fixture
def recipes(toy, monkeypatch):
    """Two recipes on the toy, in the place of all others."""
    small = TrainingSettings(
        kind="scratch", env_id=toy, timesteps=512, n_envs=4, n_steps=64, hold=1, policy_layers=(8,),
        value_layers=(8,), log_std=-1.0, checkpoint_every=256, evaluate_every=512, evaluation_scenarios=2,
    )  # fmt: skip
    for name in reversed(tuple(RECIPES)):  # undone the other way round, in the order that others look at
        monkeypatch.delitem(RECIPES, name)
    monkeypatch.setitem(RECIPES, "scratch", small)
    monkeypatch.setitem(RECIPES, "joint", dataclasses.replace(small, seed=5))
    return RECIPES


def run(*words):
    parse("policies", [str(word) for word in words]).run()


def test_the_command_trains_what_is_missing(recipes, tmp_path, monkeypatch, capsys):
    run("scratch", "joint", "--out", tmp_path)
    printed = capsys.readouterr().out.split()
    assert printed == [str(tmp_path / f"{name}.json") for name in ("scratch", "joint")]
    content = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert set(content) == {f"{name}.{kind}" for name in recipes for kind in ("json", "safetensors")}
    assert json.loads(content["joint.json"])["training"]["command"] == "push-recovery train --recipe joint"
    monkeypatch.setattr(cli, "train_recipe", None)  # nothing is trained again
    run("scratch", "joint", "--out", tmp_path)
    assert content == {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}


def test_the_folder_is_one_of_shipped_policies(recipes, toy, tmp_path, monkeypatch):
    run("joint", "--out", tmp_path)
    monkeypatch.setattr(names, "FOLDER", tmp_path)
    assert names.shipped_names() == ("joint",)
    assert load_policy("joint", make_env(toy)).observation_size == 36  # type: ignore[attr-defined]


def test_a_run_that_was_stopped_goes_on(recipes, tmp_path, stop_at):
    with pytest.raises(KeyboardInterrupt):
        train_recipe("joint", tmp_path, stop_at(256))
    assert not is_complete(tmp_path, "joint")
    seen = []
    train_recipe("joint", tmp_path, lambda timesteps, words: seen.append(timesteps))
    assert seen == [256, 512]
    assert is_complete(tmp_path, "joint")


def test_a_policy_killed_before_it_was_put_there_is_put_there(recipes, tmp_path):
    train_recipe("joint", tmp_path, SILENT)
    weights = (tmp_path / "joint.safetensors").read_bytes()
    (tmp_path / "joint.json").unlink()
    assert not is_complete(tmp_path, "joint")
    train_recipe("joint", tmp_path, SILENT)
    assert (tmp_path / "joint.safetensors").read_bytes() == weights
    assert is_complete(tmp_path, "joint")


@pytest.mark.parametrize(("shares", "best"), [((0.75, 0.25), 0), ((0.25, 0.75), 512)])
def test_a_recipe_ships_the_best_policy_of_its_curve(recipes, tmp_path, curve_of, shares, best):
    curve_of(*shares)
    train_recipe("joint", tmp_path, SILENT)
    note = json.loads((tmp_path / "joint.json").read_text())["training"]
    assert (note["timesteps"], note["curve"][-1]["timesteps"]) == (best, 512)
    last = (tmp_path / "joint" / "policy.safetensors").read_bytes()
    assert (last == (tmp_path / "joint.safetensors").read_bytes()) == (best == 512)
    assert is_complete(tmp_path, "joint")


def test_a_policy_of_another_recipe_is_not_complete_and_its_run_stays(recipes, tmp_path, monkeypatch):
    train_recipe("joint", tmp_path, SILENT)
    monkeypatch.setitem(recipes, "joint", dataclasses.replace(recipes["joint"], gamma=0.5))
    assert not is_complete(tmp_path, "joint")
    with pytest.raises(
        InvalidValueError, match=r"joint has gamma 0.99, its recipe 0.5: choose another --out"
    ):
        train_recipe("joint", tmp_path, SILENT)


def test_unknown_names_are_refused_before_any_training(recipes, tmp_path):
    with pytest.raises(UnknownNameError, match="'joints'; did you mean 'joint'"):
        run("scratch", "joints", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_train_takes_a_recipe_by_name_and_by_file(recipes, tmp_path):
    out = tmp_path / "run"
    parse("train", ["--recipe", "joint", "--timesteps", "0", "--out", str(out)]).run()
    settings = load_checkpoint(out).settings
    assert difference(dataclasses.replace(recipes["joint"], timesteps=0), settings) is None
    again = parse("train", ["--recipe", str(out / "policy.json"), "--seed", "6"])
    assert again.settings == dataclasses.replace(settings, seed=6)  # type: ignore[attr-defined]
    with pytest.raises(InvalidValueError, match="--recipe is for a new run"):
        parse("train", ["--recipe", "joint", "--resume", str(out)]).run()


def test_a_recipe_imports_no_module_that_the_user_did_not_name(recipes, toy, tmp_path, monkeypatch):
    out = tmp_path / "run"
    parse("train", ["--recipe", "joint", "--timesteps", "0", "--out", str(out)]).run()
    (tmp_path / "evilmod.py").write_text("raise RuntimeError('code of the file has run')")
    monkeypatch.syspath_prepend(tmp_path)
    path = out / "policy.json"
    path.write_text(path.read_text().replace(toy, "evilmod:X-v0"))
    words = ["--recipe", str(path), "--out", str(tmp_path / "other")]
    with pytest.raises(InvalidValueError, match="run the code of 'evilmod': say --env evilmod:X-v0"):
        parse("train", words).run()
    with pytest.raises(RuntimeError, match="code of the file has run"):
        parse("train", [*words, "--env", "evilmod:X-v0"]).run()


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
    monkeypatch.setattr(cli, "find_spec", lambda name: None if name == missing else object())
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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("residual --like terrain", "walks keep their robot"),
        ("residual --like quick shift-floor", "walks keep their robot"),
        ("joint-residual --starts reset --like disturbances", "kinds that push"),
    ],
)
def test_kinds_that_training_cannot_draw_are_refused_in_one_line(words, told, tmp_path, capsys):
    assert main(["train", *words.split(), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_pushes_like_those_of_suites_are_on_the_robots_of_the_run_for_its_time():
    words = "joint-residual --like quick hard --errors friction 0.4 0.9 --pushes.settle-time 1.5 --retries 2"
    settings = parse("train", words.split()).settings
    assert settings.drawn_like == SuiteDistribution(("quick", "hard"), 1.5, ErrorRanges(friction=(0.4, 0.9)))
    assert TrainingSettings().drawn_like is None
    assert TrainingSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings
    new = {"like", "retries", "target_kl", "wanted_kl", "log_std_end", "threads"}
    older = {name: value for name, value in TrainingSettings().to_json().items() if name not in new}
    assert TrainingSettings.from_json(older) == TrainingSettings()


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
        {"retries": -1},
        {"target_kl": 0.0},
        {"wanted_kl": float("inf")},
        {"threads": 0},
        {"log_std_end": float("nan")},
        {"device": "gpu"},
        {"profile": []},
        {"gate": [0.1, 0.0]},
        {"gamma": "high"},
    ):
        with pytest.raises(InvalidValueError, match=next(iter(wrong))):
            TrainingSettings.from_json(good | wrong)
    for wrong in ({"starts": "walk"}, {"reward": "none"}, {"profile": "real"}):
        with pytest.raises(UnknownNameError, match=next(iter(wrong))):
            TrainingSettings.from_json(good | wrong)
    with pytest.raises(UnknownNameError, match="'hrad'"):
        TrainingSettings.from_json(good | {"like": ["hard", "hrad"]})
    with pytest.raises(UnknownNameError, match="frictoin"):
        TrainingSettings.from_json(good | {"errors": [["frictoin", 0.4, 1.0]]})
    with pytest.raises(InvalidValueError, match="impulse_max"):
        TrainingSettings.from_json(good | {"easy": [80.0, 5.0]})
    with pytest.raises(
        InvalidValueError, match=r"'observation' and then others, each once, got \['margin'\]"
    ):
        TrainingSettings.from_json(good | {"inputs": ["margin"]})
    for wrong in ({}, [], good | {"extra": 1}):
        with pytest.raises(InvalidValueError, match="training settings"):
            TrainingSettings.from_json(wrong)


PAIR, HUGE = "[a finite number, a finite number]", 10**400
TRIPLES = "[[a name, a finite number, a finite number], ...]"


@pytest.mark.parametrize(
    ("wrong", "wanted"),
    [
        *(({"easy": given}, PAIR) for given in ([5], [1, 2, 3])),
        *(({"errors": given}, TRIPLES) for given in ([["friction", 0.4]], "abc")),
        ({"log_std": "x"}, "a finite number or [a finite number, ...] or None"),
        *(({"env_id": given}, "a name") for given in (5, None)),
        *(({"gamma": given}, "a finite number") for given in (True, "0.99")),
        *(({name: HUGE}, "a finite number") for name in ("learning_rate", "easy_share")),
        ({"log_std_end": HUGE}, "a finite number or None"),
        ({"policy_layers": [True]}, "[an integer, ...]"),
        ({"policy_layers": []}, "one number or more"),
        ({"teacher": 1}, "True or False"),
        ({"normalise_reward": "yes"}, "True or False or None"),
        ({"initial": 5}, "a name or None"),
        ({"policy": 5}, "a name"),
        ({"starts": 5}, "push or reset or None"),
        ({"like": "hard"}, "[a name, ...]"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_named(wrong, wanted):
    ((name, value),) = wrong.items()
    got = shown(tuple(value) if isinstance(value, list) else value)
    said = re.escape(f"training setting {name} must be {wanted}, got {got}")
    with pytest.raises(InvalidValueError, match=f"^{said}$"):
        TrainingSettings.from_json(TrainingSettings().to_json() | wrong)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--n-envs 1000000000", "n_envs must be an integer in [1, 100000], got 1000000000"),
        ("--batch-size 1000000000000", "batch_size must be an integer in [1, 10000000], got 1000000000000"),
        ("--walks 1000000000", "walks must be an integer in [1, 1000000], got 1000000000"),
        ("--policy-layers 8 1000000", "policy_layers must be an integer in [1, 65536], got 1000000"),
        ("--policy-layers", "policy_layers must be one number or more, got ()"),
        ("--log-std 1e300", "log_std must be in [-20, 20], got 1e+300"),
        ("--n-envs 1 --n-steps 1", "n_steps x n_envs must be an integer >= 2, got 1"),
    ],
)
def test_options_beyond_what_a_run_can_do_are_refused_in_one_line(words, said, tmp_path, capsys):
    assert main(["train", *words.split(), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert f"training setting {said}\n" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_gate_of_a_recipe_that_no_float_holds_is_refused():
    with pytest.raises(
        InvalidValueError, match=r"^a residual gate is two numbers 0 <= shut < open \[m\], got"
    ):
        TrainingSettings.from_json(TrainingSettings().to_json() | {"gate": [0, HUGE]})


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


def test_shares_and_discounts_may_be_one():
    ones = dict.fromkeys(("gamma", "gae_lambda", "least_acceptance", "easy_share"), 1.0)
    assert all(getattr(TrainingSettings(**ones), name) == 1.0 for name in ones)
