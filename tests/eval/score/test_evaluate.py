import json

import gymnasium as gym
import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.push import Push, polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.outcome import Score, failure_label
from push_recovery.eval.rollout.workers import CHUNKS_A_WORKER, make_chunks
from push_recovery.eval.score.evaluate import compare, evaluate
from push_recovery.eval.score.suites import Suite, standard_suite

SUITE = Suite("head", "1", standard_suite().scenarios[:24])


@pytest.fixture
def policies(tmp_path):
    gains = {"weak": 0.2, "strong": 8.0}
    return [toy.save_policy(tmp_path / f"{name}.safetensors", gain) for name, gain in gains.items()]


def rows_of(directory):
    return [json.loads(line) for line in (directory / "outcomes.jsonl").read_text().splitlines()]


def test_rollout_of_the_three_ends(policies):
    env = make_env(toy.ENV_ID)
    weak, strong = (load_policy(name, env) for name in policies)
    calm = Scenario("calm", (polar_push(1.0, 0.0, 0.1, 1.0),))
    out = rollout(env, weak, calm, "weak")
    assert (out.survived, out.recovered, out.failure_reason) == (True, True, None)
    assert out.end_time == pytest.approx(5.1)
    assert out.env_steps == 102
    assert out.total_reward == 102.0
    out = rollout(env, weak, Scenario("far", (polar_push(800.0, np.pi / 2, 0.1, 1.0),)), "weak")
    assert (out.survived, out.recovered, out.failure_reason) == (False, False, "sideways")
    assert out.end_time < 3.0
    assert (out.impulse, out.psi_deg) == (pytest.approx(80.0), pytest.approx(90.0))
    unsettled = Scenario("late", (Push((220.0, 0.0, 0.0), 0.1, 1.0),), settle_time=0.3)
    out = rollout(env, weak, unsettled, "weak")
    assert (out.survived, out.recovered) == (True, False)
    assert failure_label(out.to_dict()) == "not_settled"
    assert rollout(env, strong, Scenario("none", duration=1.0), "strong").psi_deg is None


def test_rollout_is_bit_identical_in_any_order(policies):
    env = make_env(toy.ENV_ID)
    policy = load_policy(policies[1], env)
    first = [rollout(env, policy, s, "p").to_dict() for s in SUITE.scenarios]
    second = [rollout(env, policy, s, "p").to_dict() for s in reversed(SUITE.scenarios)]
    assert json.dumps(first) == json.dumps(second[::-1])


def test_policy_is_told_of_each_episode(policies):
    class Recorder:
        def __init__(self):
            self.calls = []

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            assert deterministic
            self.calls.append((state, bool(episode_start[0])))
            return np.zeros(7, dtype=np.float32), (state or 0) + 1

    env, recorder = make_env(toy.ENV_ID), Recorder()
    for _ in range(2):
        recorder.calls.clear()
        rollout(env, recorder, Scenario("short", duration=0.2), "recorder")
        assert recorder.calls == [(None, True), (1, False), (2, False), (3, False)]


def test_workers_and_order_change_nothing(policies, tmp_path):
    alone = evaluate(SUITE, toy.ENV_ID, policies, 1, tmp_path / "a")
    many = evaluate(SUITE, toy.ENV_ID, policies[::-1], 2, tmp_path / "b")
    assert alone.rows == {name: many.rows[name] for name in policies}
    a, b = ((tmp_path / d / "outcomes.jsonl").read_text().splitlines() for d in "ab")
    assert sorted(a) == sorted(b)
    content = alone.to_dict()
    assert set(content) == {"suite", "env", "policies", "out"}
    assert content["suite"] == {"name": "head", "version": "1", "sha256": SUITE.sha256, "scenarios": 24}
    for name in policies:
        entry = content["policies"][name]
        assert set(entry) == {"recovered", "survived", "episodes", "rate", "ci95", "failures"}
        assert entry["recovered"] + sum(entry["failures"].values()) == entry["episodes"] == 24
        assert entry["survived"] == sum(row["survived"] for row in alone.rows[name])
        assert entry["ci95"][0] <= entry["rate"] <= entry["ci95"][1]
    assert alone.score(policies[1]).rate > alone.score(policies[0]).rate


@pytest.mark.parametrize("workers", [1, 2, 64])
def test_chunks_hold_every_scenario_once_and_leave_no_worker_idle(workers):
    missing = {"a": SUITE.scenarios, "b": SUITE.scenarios[:5], "done": ()}
    chunks = make_chunks(missing, {"a": 4, "b": 1, "done": 4}, workers)
    for name, scenarios in missing.items():
        parts = [part for policy, part in chunks if policy == name]
        assert tuple(s for part in parts for s in part) == tuple(scenarios)
        assert all(1 <= len(part) <= {"a": 4, "b": 1}[name] for part in parts)
    assert len(chunks) >= min(29, CHUNKS_A_WORKER * workers)


def test_pushes_are_the_same_for_every_arm(policies, tmp_path):
    rows = evaluate(SUITE, toy.ENV_ID, policies, 1, tmp_path / "a").rows
    keys = ("scenario_id", "impulse", "psi_deg", "command")
    pushed = [[tuple(map(str, (row[k] for k in keys))) for row in rows[name]] for name in policies]
    assert pushed[0] == pushed[1]


def test_a_killed_run_resumes_to_the_same_content(policies, tmp_path):
    whole = evaluate(SUITE, toy.ENV_ID, policies, 1, tmp_path / "whole")
    path = tmp_path / "killed" / "outcomes.jsonl"
    seen = []

    def stop(row):
        seen.append(row)
        if len(seen) == 17:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(SUITE, toy.ENV_ID, policies, 1, path.parent, on_row=stop)
    assert len(path.read_text().splitlines()) == 17
    with path.open("a") as file:
        file.write('{"scenario_id": "standard-00')  # torn by the kill
    added = []
    again = evaluate(SUITE, toy.ENV_ID, policies, 1, path.parent, on_row=added.append)
    assert len(added) == 48 - 17
    assert again.rows == whole.rows
    assert sorted(path.read_text().splitlines()) == sorted(
        (tmp_path / "whole" / "outcomes.jsonl").read_text().splitlines()
    )


def test_directory_of_another_configuration_is_refused(policies, tmp_path):
    evaluate(SUITE, toy.ENV_ID, policies[:1], 1, tmp_path / "a")
    other = Suite("other", "1", SUITE.scenarios[:3])
    with pytest.raises(InvalidValueError, match=r"another configuration.*suite"):
        evaluate(other, toy.ENV_ID, policies[:1], 1, tmp_path / "a")
    assert len(rows_of(tmp_path / "a")) == 24
    toy.save_policy(policies[0], 3.0)
    with pytest.raises(InvalidValueError, match="another content"):
        evaluate(SUITE, toy.ENV_ID, policies[:1], 1, tmp_path / "a")
    evaluate(other, toy.ENV_ID, policies[:1], 1, tmp_path / "a", overwrite=True)
    assert len(rows_of(tmp_path / "a")) == 3


def test_corrupt_rows_are_named(policies, tmp_path):
    evaluate(SUITE, toy.ENV_ID, policies[:1], 1, tmp_path / "a")
    path = tmp_path / "a" / "outcomes.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], "{nonsense", *lines[2:]]) + "\n")
    with pytest.raises(InvalidValueError, match="line 2"):
        evaluate(SUITE, toy.ENV_ID, policies[:1], 1, tmp_path / "a")


def test_compare_pairs_outcomes(policies, tmp_path):
    content = compare(policies[1], policies[0], SUITE, toy.ENV_ID, 1, tmp_path / "c").to_dict()
    keys = "a b suite pairs both only_a only_b neither mcnemar_p rate_difference ci95 survived_a survived_b"
    assert set(content) == set(keys.split())
    assert sum(content[key] for key in ("both", "only_a", "only_b", "neither")) == content["pairs"] == 24
    assert content["rate_difference"] == pytest.approx((content["only_a"] - content["only_b"]) / 24)
    assert content["ci95"][0] <= content["rate_difference"] <= content["ci95"][1]


def test_score_counts_reasons():
    row = {"recovered": False, "survived": False, "failure_reason": "height"}
    unsettled = {**row, "survived": True, "failure_reason": None}
    score = Score.of([row, row, unsettled, {**unsettled, "recovered": True}])
    assert (score.recovered, score.survived, score.failures) == (1, 2, {"height": 2, "not_settled": 1})
    assert Score.of([]).rate == 0.0


def test_bad_names_fail_before_any_work(policies, tmp_path):
    with pytest.raises(UnknownNameError, match="PushRecovery/Biped-v0"):
        evaluate(SUITE, "PushRecovery/Bipedal-v0", policies, 1, tmp_path / "a")
    with pytest.raises(InvalidValueError, match="given more than once"):
        evaluate(SUITE, toy.ENV_ID, policies[:1] * 2, 1, tmp_path / "a")
    with pytest.raises(PushRecoveryError, match="absent"):
        evaluate(SUITE, toy.ENV_ID, [str(tmp_path / "absent.safetensors")], 1, tmp_path / "a")
    small = toy.save_policy(tmp_path / "small.safetensors", 1.0, inputs=5)
    with pytest.raises(InvalidValueError, match=r"made for 5 observations.*\(36,\)"):
        evaluate(SUITE, toy.ENV_ID, [small], 1, tmp_path / "a")
    with pytest.raises(InvalidValueError, match=r"robot, limits, preset"):
        make_env("gymnasium:CartPole-v1")
    assert not (tmp_path / "a").exists()
    assert isinstance(make_env(toy.ENV_ID), gym.Env)
