"""All shipped policies by one command, and one by its recipe."""

import dataclasses
import json

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.eval.cli.main import parse
from push_recovery.eval.rollout import load_policy as names
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.training import cli as policies
from push_recovery.training import ppo
from push_recovery.training.checkpoint import load_checkpoint
from push_recovery.training.cli import is_complete, train_recipe
from push_recovery.training.recipes import RECIPES, difference
from push_recovery.training.settings import TrainingSettings


@pytest.fixture
def recipes(toy, monkeypatch):
    """Two recipes on the toy, in the place of all others."""
    small = TrainingSettings(
        kind="scratch", env_id=toy, timesteps=512, n_envs=4, n_steps=64, hold=1, policy_layers=(8,),
        value_layers=(8,), log_std=-1.0, checkpoint_every=256, evaluate_every=512, evaluation_scenarios=2,
    )  # fmt: skip
    for name in tuple(RECIPES):
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
    monkeypatch.setattr(policies, "train_recipe", None)  # nothing is trained again
    run("scratch", "joint", "--out", tmp_path)
    assert content == {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}


def test_the_folder_is_one_of_shipped_policies(recipes, toy, tmp_path, monkeypatch):
    run("joint", "--out", tmp_path)
    monkeypatch.setattr(names, "FOLDER", tmp_path)
    assert names.shipped_names() == ("joint",)
    assert load_policy("joint", make_env(toy)).observation_size == 36  # type: ignore[attr-defined]


def test_a_run_that_was_stopped_goes_on(recipes, tmp_path):
    def stop(timesteps, recovered):
        if timesteps >= 256:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_recipe("joint", tmp_path, stop)
    assert not is_complete(tmp_path, "joint")
    seen = []
    train_recipe("joint", tmp_path, lambda timesteps, recovered: seen.append(timesteps))
    assert seen == [256, 512]
    assert is_complete(tmp_path, "joint")


def test_a_policy_killed_before_it_was_put_there_is_put_there(recipes, tmp_path):
    train_recipe("joint", tmp_path, ppo.silent)
    weights = (tmp_path / "joint.safetensors").read_bytes()
    (tmp_path / "joint.json").unlink()
    assert not is_complete(tmp_path, "joint")
    train_recipe("joint", tmp_path, ppo.silent)
    assert (tmp_path / "joint.safetensors").read_bytes() == weights
    assert is_complete(tmp_path, "joint")


def test_a_policy_of_another_recipe_is_not_complete_and_its_run_stays(recipes, tmp_path, monkeypatch):
    train_recipe("joint", tmp_path, ppo.silent)
    monkeypatch.setitem(recipes, "joint", dataclasses.replace(recipes["joint"], gamma=0.5))
    assert not is_complete(tmp_path, "joint")
    with pytest.raises(
        InvalidValueError, match=r"joint has gamma 0.99, its recipe 0.5: choose another --out"
    ):
        train_recipe("joint", tmp_path, ppo.silent)


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
