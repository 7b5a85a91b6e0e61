"""Archives of Stable-Baselines3 on the command line."""

import json

import pytest
import toy_gait_env as toy
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.suites import Suite, standard_suite


def test_the_command_takes_it_with_trust_alone(tmp_path, capsys):
    sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra train")
    path, suite = tmp_path / "model.zip", tmp_path / "suite.json"
    model = sb3.PPO("MlpPolicy", make_env(toy.ENV_ID), n_steps=8, batch_size=8, device="cpu", seed=3)
    model.save(path)
    Suite("head", "1", standard_suite().scenarios[:4]).save(suite)
    words = ["--env", toy.ENV_ID, "--suite", str(suite), "--workers", "1"]
    given = ["evaluate", "--policies", str(path), *words]
    assert main([*given, "--out", str(tmp_path / "no")]) == 2
    assert "--trust" in capsys.readouterr().err
    assert main([*given, "--trust", "--out", str(tmp_path / "yes"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["policies"][str(path)]["episodes"] == 4
    (first, *_) = (tmp_path / "yes" / "outcomes.jsonl").read_text().splitlines()
    assert len(json.loads(first)["policy_sha256"]) == 64
    other = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    assert main(["compare", str(path), other, *words, "--trust", "--out", str(tmp_path / "two")]) == 0
