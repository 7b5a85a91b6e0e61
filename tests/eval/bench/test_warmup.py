"""What is run to compile all kernels, and the command that does it."""

import json
import re

import gymnasium as gym
import pytest
from push_recovery.controllers.settings import VARIANTS
from push_recovery.eval.bench import run as warmup
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import make_env


def test_every_environment_and_double_support_are_run():
    for name in warmup.names():
        make_env(name).close()
    left_out = set(warmup.env_ids()) - {name.partition("@")[0] for name in warmup.names()}
    robots = {gym.spec(name).kwargs["robot"] for name in left_out}
    assert robots == {"g1", "t1", "jvrc1", "apollo", "berkeley", "op3"}
    assert "PushRecovery/Pendulum-v0@double-support" in warmup.names()


def test_every_variant_runs_alone_and_side_by_side_with_the_errors_of_its_robot(monkeypatch):
    runs = []
    monkeypatch.setattr(warmup, "rollout", lambda env, policy, scenario, name: runs.append((name, 1)))

    def batch(env, policy, scenarios, name, slots):
        runs.append((name, len(scenarios)))
        assert scenarios[1].errors == warmup.ERRORS["Pendulum"]

    monkeypatch.setattr(warmup, "rollout_all", batch)
    warmup._run("PushRecovery/Pendulum-v0")
    assert sorted(runs) == sorted([(variant, count) for variant in VARIANTS for count in (1, 2)])


GAITS = [name for name in warmup.names() if not re.search("Residual|Joint|FullBody", name)]


@pytest.mark.parametrize("name", GAITS)
def test_every_variant_that_is_run_can_be_made(name):
    env = make_env(name)
    for variant in warmup.variants(name):
        warmup.make_policy(variant, env)
    env.close()
    without = {"two-stage-paper", "herdt"} if "double" in name else set()
    assert set(VARIANTS) - set(warmup.variants(name)) == without


@pytest.mark.parametrize("name", ["BipedResidual", "BipedJoint", "BipedJointResidual", "BipedFullBody"])
def test_what_no_variant_acts_in_runs_alone_and_side_by_side(monkeypatch, name):
    done = []
    for call in ("rollout", "rollout_all"):
        run = getattr(warmup, call)
        monkeypatch.setattr(warmup, call, lambda *given, run=run: done.append(run(*given)))
    warmup._run(f"PushRecovery/{name}-v0")
    alone, together = done
    assert alone.policy == "random"
    assert len(list(together)) == warmup.TOGETHER


def test_the_command_runs_each_once_and_names_the_place(monkeypatch, capsys, tmp_path):
    ran = []
    monkeypatch.setattr(warmup, "_run", ran.append)
    assert main(["warmup", "--json"]) == 0
    out, err = capsys.readouterr()
    assert list(json.loads(out)) == ["cache"]
    assert ran == warmup.names()
    assert f"{len(ran)}/{len(ran)}" in err


@pytest.mark.parametrize("kind", warmup.ERRORS)
def test_two_stage_walks_on_through_its_push_so_that_all_is_reached(kind):
    env = make_env(f"PushRecovery/{kind}-v0")
    outcome = warmup.rollout(env, warmup.make_policy("two-stage", env), warmup.WALK, "two-stage")
    assert outcome.survived
    env.close()
