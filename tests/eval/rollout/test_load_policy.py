"""Policies by name: those that come with the package, present or missing, and those on the joints."""

import fnmatch
import json
import shutil
import tomllib
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription, policy_paths
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout import load_policy as policies
from push_recovery.eval.rollout.environments import make_env, own_form
from push_recovery.eval.rollout.policy_source import policy_sources
from push_recovery.eval.rollout.workers import Runner
from push_recovery.eval.score import suites
from push_recovery.eval.score.suites import Suite, get_suite

from push_recovery import compare, evaluate, frontier, load_policy, make_policy, rollout

SUITE = Suite("head", "1", get_suite("standard").scenarios[:4])
ROOT = Path(__file__).parents[3]


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """A package that comes with a strong `residual` and a weak `scratch`, and with nothing else."""
    folder = tmp_path / "shipped"
    toy.save_policy(folder / "residual", 8.0)
    toy.save_policy(folder / "scratch", 0.5)
    monkeypatch.setattr(policies, "FOLDER", folder)
    return folder


def test_a_name_has_the_rows_of_its_file_under_the_name(shipped, tmp_path):
    file = str(shipped / "residual.safetensors")
    pairs = (("residual", 1), ("residual", 2), (file, 1))
    rows = [
        evaluate(name, SUITE, toy.ENV_ID, workers=workers, out=tmp_path / f"{i}").rows[name]
        for i, (name, workers) in enumerate(pairs)
    ]
    assert rows[0] == rows[1]
    assert [row | {"policy": file} for row in rows[0]] == rows[2]
    assert {row["policy_sha256"] for row in rows[0]} == {policy_sources(file)[file].digest()}


def test_rows_of_a_name_whose_policy_has_changed_are_refused(shipped, tmp_path):
    evaluate("residual", SUITE, toy.ENV_ID, out=tmp_path / "out")
    toy.save_policy(shipped / "residual", 7.0)
    with pytest.raises(InvalidValueError, match="residual"):
        evaluate("residual", SUITE, toy.ENV_ID, out=tmp_path / "out")


def test_every_function_takes_the_name(shipped, tmp_path):
    env = make_env(toy.ENV_ID)
    for made in (load_policy("scratch", env), make_policy("scratch", env)):
        assert made.network.weights[0].min() == -0.5  # type: ignore[attr-defined]
    assert rollout("residual", SUITE.scenarios[0], toy.ENV_ID).policy == "residual"
    labelled = evaluate({"mine": "residual"}, SUITE, toy.ENV_ID, out=tmp_path / "e").rows["mine"]
    assert {row["policy_sha256"] for row in labelled} == {policy_sources("residual")["residual"].digest()}
    assert compare("residual", "scratch", SUITE, toy.ENV_ID, out=tmp_path / "c").b == "scratch"
    found = frontier("residual", 1, toy.ENV_ID, grid=100, replicas=1, out=tmp_path / "f")
    assert set(found.rows) == {"residual"}


def test_every_command_takes_the_name(shipped, tmp_path, capsys):
    SUITE.save(tmp_path / "suite.json")
    suite = ["--suite", str(tmp_path / "suite.json"), "--env", toy.ENV_ID]
    run = [*suite, "--workers", "1", "--out"]
    assert main(["evaluate", "--policies", "residual", "scratch", *run, str(tmp_path / "e"), "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["policies"]) == {"residual", "scratch"}
    assert main(["compare", "residual", "scratch", *run, str(tmp_path / "c")]) == 0
    assert main(["play", "--policy", "residual", *suite, "--out", str(tmp_path / "p.png")]) == 0


def test_a_name_stands_for_the_package_s_policy_and_not_for_a_file_that_lies_about(
    shipped, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    toy.save_policy(tmp_path / "residual", 3.0)
    env = make_env(toy.ENV_ID)
    for name, gain in (("residual", 8.0), ("residual.safetensors", 3.0)):
        assert load_policy(name, env).network.weights[0].min() == -gain  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "words",
    [
        *((command, "--policies", "joint") for command in ("evaluate", "frontier", "sensitivity", "ceiling")),
        ("compare", "residual", "joint"),
        ("play", "--policy", "joint", "--out", "p.png"),
    ],
)
def test_a_name_without_a_file_says_what_is_there(shipped, tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    said = capsys.readouterr().err
    there = "policy 'joint' does not come with this version", "trained policies are: residual, scratch;"
    assert all(words in said for words in there)
    assert not (tmp_path / "runs").exists()


def test_a_copied_pair_is_shipped_and_half_a_policy_is_none(shipped, monkeypatch):
    assert policies.shipped_names() == ("residual", "scratch")
    copied = [
        shutil.copy(path, shipped / f"joint{path.suffix}") for path in policy_paths(shipped / "scratch")
    ]
    assert policies.shipped_names() == ("residual", "scratch", "joint")
    for path in copied:
        path.unlink()
    (shipped / "scratch.json").unlink()
    assert policies.shipped_names() == ("residual",)
    monkeypatch.setattr(policies, "FOLDER", shipped / "nowhere")
    assert policies.shipped_names() == ()
    with pytest.raises(InvalidValueError, match="are: none; train it with: push-recovery policies joint"):
        make_policy("joint", None)


def test_the_names_that_are_there_are_listed(shipped, capsys, monkeypatch):
    monkeypatch.setattr(suites, "SUITES", {})  # to draw them all takes seconds
    assert main(["list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["policies"]
    assert listed[-2:] == ["residual", "scratch"]
    with pytest.raises(UnknownNameError, match=r"'scratches'; did you mean 'scratch'.*two-stage.*residual"):
        make_policy("scratches", make_env(toy.ENV_ID))


JOINT, RESIDUAL, BIPED_ENV = (f"PushRecovery/Biped{form}-v0" for form in ("Joint", "JointResidual", ""))
SIZES = {JOINT: 58, RESIDUAL: 94, BIPED_ENV: 36}


def save_zero_policy(path, env_id) -> str:
    """A policy file whose action is zero everywhere."""
    inputs, outputs = SIZES.get(env_id, 94), 7 if env_id == BIPED_ENV else 14
    network = Mlp((np.zeros((outputs, inputs), np.float32),), (np.zeros(outputs, np.float32),))
    normalisation = Normalisation(np.zeros(inputs), np.ones(inputs))
    about = PolicyDescription(env_id, BIPED, BIPED_LIMITS)
    return str(NetworkPolicy(network, normalisation, about).save(path))


def test_a_named_policy_on_joints_acts_in_its_own_form_of_the_biped(tmp_path, monkeypatch):
    """A joint residual of zero is the planner, in every field of its row but the name."""
    monkeypatch.setattr(policies, "FOLDER", tmp_path)
    save_zero_policy(tmp_path / "joint-residual", RESIDUAL)
    runner, walk = Runner("PushRecovery/Biped-v0"), Scenario("walk", duration=0.3)
    rows = [runner.run((name, walk)).to_dict() | {"policy": ""} for name in ("two-stage", "joint-residual")]
    runner.close()
    assert rows[0] == rows[1]


def test_a_wheel_carries_both_files_of_every_policy():
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    folder = policies.FOLDER.relative_to(policies.FOLDER.parent)
    for name in policies.NAMES:
        for path in policy_paths(folder / name):
            assert any(fnmatch.fnmatch(str(path), each) for each in patterns["push_recovery.eval.rollout"])


def test_the_folder_holds_policies_of_these_names_only():
    stems = {path.stem for path in policies.FOLDER.glob("*") if not path.name.startswith(".")}
    assert stems == set(policies.shipped_names())
    for name in policies.shipped_names():
        assert sum(path.stat().st_size for path in policy_paths(policies.FOLDER / name)) < 2**20


def test_the_digest_is_of_names_and_files(shipped):
    before = policies.shipped_digest()
    assert before == policies.shipped_digest()
    toy.save_policy(shipped / "residual", 7.0)
    other = policies.shipped_digest()
    toy.save_policy(shipped / "residual", 8.0)
    assert policies.shipped_digest() == before != other
    for path in policy_paths(shipped / "scratch"):
        path.rename(shipped / path.name.replace("scratch", "joint"))
    assert policies.shipped_digest() not in (before, other)


G1 = "PushRecovery/G1JointResidual-v0"
PUSHED = Scenario("pushed", (Push((60.0, 90.0, 0.0), 0.1, 0.4),), duration=1.2)


@pytest.mark.parametrize("env_id", [JOINT, RESIDUAL])
def test_the_random_policy_fits_single_and_vector_form(env_id):
    env = make_env(env_id)
    observation, _ = env.reset(seed=0)
    policy = make_policy("random", env)
    one, _ = policy.predict(observation)
    assert env.action_space.contains(one)
    vector = gym.make_vec(env_id, num_envs=2, vectorization_mode="vector_entry_point")
    both, _ = make_policy("random", vector).predict(np.stack([observation, observation + 1.0]))
    np.testing.assert_array_equal(both[0], one)
    assert (both[1] != one).all()


@pytest.mark.parametrize("env_id", [JOINT, RESIDUAL])
def test_variants_give_no_actions_of_joints(env_id):
    with pytest.raises(InvalidValueError, match=rf"'two-stage' gives gait actions, but {env_id} takes 14"):
        make_policy("two-stage", make_env(env_id))


def test_each_robot_has_forms_of_its_own(tmp_path):
    file = save_zero_policy(tmp_path / "g1", G1)
    assert own_form(file, "PushRecovery/G1-v0") == G1
    assert own_form(file, "PushRecovery/G1-v0@g1") == f"{G1}@g1"
    for other in (G1, BIPED_ENV, "PushRecovery/G1Residual-v0", "PushRecovery/T1-v0", f"my_robot:{BIPED_ENV}"):
        assert own_form(file, other) is None


def test_a_file_stands_beside_the_planner_in_the_form_that_it_acts_in(tmp_path):
    """On the same scenario; a residual of zero has the planner's outcome in every field but its name."""
    names = {env_id: save_zero_policy(tmp_path / f"{i}", env_id) for i, env_id in enumerate(SIZES)}
    assert own_form(names[BIPED_ENV], BIPED_ENV) is None
    assert own_form("two-stage", BIPED_ENV) is None
    assert own_form(names[JOINT], "PushRecovery/Pendulum-v0") is None
    assert own_form(names[JOINT], f"{BIPED_ENV}@biped") == f"{JOINT}@biped"
    runner = Runner(BIPED_ENV)
    rows = {}
    for name in ("two-stage", names[JOINT], names[RESIDUAL]):
        (outcome,) = runner.run_all(name, [PUSHED])
        assert outcome == runner.run((name, PUSHED))
        rows[name] = outcome.to_dict() | {"policy": ""}
    runner.close()
    assert rows[names[RESIDUAL]] == rows["two-stage"]
    assert rows[names[JOINT]] != rows["two-stage"]
    assert {row["scenario_id"] for row in rows.values()} == {"pushed"}
