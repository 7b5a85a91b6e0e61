"""Evaluations: workers, order, resuming, limits met, and pairs on rows written by hand."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.disturbances import Payload, Slip
from push_recovery.envs.scenario.model_errors import ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout, rollout_batch
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.outcome import failure_label
from push_recovery.eval.rollout.workers import CHUNKS_A_WORKER, Runner, make_chunks
from push_recovery.eval.score.evaluate import compare, evaluate
from push_recovery.eval.score.frontier import FrontierSettings, ScanJob, scan
from push_recovery.eval.score.suites import Suite, get_suite


def test_an_outcome_says_what_was_met_and_when_the_same_alone_and_in_a_batch():
    env = make_env("PushRecovery/Biped-v0")
    policy = load_policy("two-stage", env)
    pushes = {"weak": 1.0, "strong": 250.0, "far too strong": 900.0}
    scenarios = [Scenario(n, (polar_push(f, 1.0, 0.1, 0.5),), settle_time=0.6) for n, f in pushes.items()]
    batch = {out.scenario_id: out for out in rollout_batch(BipedEpisodes(3), policy, scenarios, "two-stage")}
    for scenario in scenarios:
        assert rollout(env, policy, scenario, "two-stage").to_dict() == batch[scenario.id].to_dict()
    weak, strong, lost = (batch[name] for name in pushes)
    assert (weak.first_limit, weak.limits_met, weak.limit_shares) == (None, {}, {})
    assert strong.limits_met[strong.first_limit] == min(strong.limits_met.values()) >= 0.5
    assert sum(lost.limit_shares.values()) > sum(strong.limit_shares.values())
    assert len(lost.limits_met) >= len(strong.limits_met)


def test_an_environment_without_a_record_meets_nothing():
    env = make_env("PushRecovery/Pendulum-v0")
    scenario = Scenario("hard", (polar_push(900.0, 1.0, 0.1, 0.5),), settle_time=0.5)
    out = rollout(env, load_policy("two-stage", env), scenario, "two-stage")
    assert (out.first_limit, out.limits_met, out.limit_shares) == (None, {}, {})


SUITE = Suite("head", "1", get_suite("standard").scenarios[:24])


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
    assert (out.end_time, out.env_steps, out.total_reward) == (pytest.approx(5.1), 102, 102.0)
    out = rollout(env, weak, Scenario("far", (polar_push(800.0, np.pi / 2, 0.1, 1.0),)), "weak")
    assert (out.survived, out.recovered, out.failure_reason) == (False, False, "sideways")
    assert out.end_time < 3.0
    assert (out.impulse, out.psi_deg) == (pytest.approx(80.0), pytest.approx(90.0))
    unsettled = Scenario("late", (Push((220.0, 0.0, 0.0), 0.1, 1.0),), settle_time=0.3)
    out = rollout(env, weak, unsettled, "weak")
    assert (out.survived, out.recovered) == (True, False)
    assert failure_label(out.to_dict()) == "not_settled"
    assert rollout(env, strong, Scenario("none", duration=1.0), "strong").psi_deg is None


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
        rollout(env, recorder, Scenario("short", duration=0.2), "recorder")
    assert recorder.calls == 2 * [(None, True), (1, False), (2, False), (3, False)]


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
    keys = ("scenario_id", "impulse", "psi_deg", "command")
    pushed = [[[row[key] for key in keys] for row in alone.rows[name]] for name in policies]
    assert pushed[0] == pushed[1]  # every variant meets the same pushes


@pytest.mark.parametrize("workers", [1, 2, 64])
def test_chunks_hold_every_scenario_once_and_leave_no_worker_idle(workers):
    missing = {"a": SUITE.scenarios, "b": SUITE.scenarios[:5], "done": ()}
    chunks = make_chunks(missing, {"a": 4, "b": 1, "done": 4}, workers)
    for name, scenarios in missing.items():
        parts = [part for policy, part in chunks if policy == name]
        assert tuple(s for part in parts for s in part) == tuple(scenarios)
        assert all(1 <= len(part) <= {"a": 4, "b": 1}[name] for part in parts)
    assert len(chunks) >= min(29, CHUNKS_A_WORKER * workers)


def test_a_killed_run_resumes_to_the_same_content(policies, tmp_path, interrupted):
    whole = evaluate(SUITE, toy.ENV_ID, policies, 1, tmp_path / "whole")
    path = tmp_path / "killed" / "outcomes.jsonl"
    interrupted(17, evaluate, SUITE, toy.ENV_ID, policies, 1, path.parent)
    kept = path.read_text()
    assert len(kept.splitlines()) == 17
    path.write_text(kept + '{"scenario_id": "standard-00')  # torn by the kill
    assert evaluate(SUITE, toy.ENV_ID, policies, 1, path.parent).rows == whole.rows
    assert path.read_text().startswith(kept)
    lines = [
        (folder / "outcomes.jsonl").read_text().splitlines() for folder in (path.parent, whole.directory)
    ]
    assert sorted(lines[0]) == sorted(lines[1])


def test_a_directory_of_another_configuration_or_of_corrupt_rows_is_refused(policies, tmp_path):
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
    path = tmp_path / "a" / "outcomes.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], "{nonsense", *lines[2:]]) + "\n")
    with pytest.raises(InvalidValueError, match="line 2"):
        evaluate(other, toy.ENV_ID, policies[:1], 1, tmp_path / "a")


def test_compare_pairs_outcomes(policies, tmp_path):
    content = compare(policies[1], policies[0], SUITE, toy.ENV_ID, 1, tmp_path / "c").to_dict()
    keys = "a b suite pairs both only_a only_b neither mcnemar_p rate_difference ci95 survived_a survived_b"
    assert set(content) == set(keys.split())
    assert sum(content[key] for key in ("both", "only_a", "only_b", "neither")) == content["pairs"] == 24
    assert content["rate_difference"] == pytest.approx((content["only_a"] - content["only_b"]) / 24)
    assert content["ci95"][0] <= content["rate_difference"] <= content["ci95"][1]


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


SUITE_COMPARE = Suite("ten", "1", get_suite("standard").scenarios[:10])
#        both  only a    only b  neither
OF_A = [1, 1, 1, 1, 1, 1, 0, 0, 0, 0]  # recovered
OF_B = [1, 1, 0, 0, 0, 0, 1, 0, 0, 0]
A_STOOD = [1, 1, 1, 1, 1, 1, 1, 1, 0, 0]  # survived
B_STOOD = [1, 1, 1, 1, 1, 1, 1, 1, 1, 0]


def test_pairs_are_counted_by_what_recovered(policies, tmp_path):
    a, b = policies
    evaluate(SUITE_COMPARE, toy.ENV_ID, [a, b], 1, tmp_path / "out")
    path = tmp_path / "out" / "outcomes.jsonl"
    place = {scenario.id: i for i, scenario in enumerate(SUITE_COMPARE.scenarios)}
    rows = rows_of(path.parent)
    for row in rows:
        i = place[row["scenario_id"]]
        recovered, survived = {a: (OF_A, A_STOOD), b: (OF_B, B_STOOD)}[row["policy"]]
        row["recovered"], row["survived"] = bool(recovered[i]), bool(survived[i])
        row["failure_reason"] = None if survived[i] else "height"
    path.write_text("".join(json.dumps(row) + "\n" for row in reversed(rows)))
    found = compare(a, b, SUITE_COMPARE, toy.ENV_ID, directory=tmp_path / "out").to_dict()
    assert (found["a"], found["b"], found["suite"], found["pairs"]) == (a, b, "ten", 10)
    assert [found[key] for key in ("both", "only_a", "only_b", "neither")] == [2, 4, 1, 3]
    assert found["rate_difference"] == pytest.approx(0.3)
    assert found["mcnemar_p"] == pytest.approx(2 * (5 + 1) / 2**5)  # at least 4 of 5, both tails
    assert (found["survived_a"], found["survived_b"]) == (8, 9)
    low, high = found["ci95"]
    assert low < 0.3 < high
    turned = compare(b, a, SUITE_COMPARE, toy.ENV_ID, directory=tmp_path / "out").to_dict()
    assert (turned["only_a"], turned["only_b"], turned["rate_difference"]) == (1, 4, pytest.approx(-0.3))
    assert turned["ci95"] == pytest.approx([-high, -low], abs=0.11)  # of a grid of tenths


PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
SUITE_BIPED = Suite("head", "1", get_suite("standard").scenarios[:3])


def test_workers_and_order_change_nothing_on_the_biped(tmp_path):
    names = ["stage-1", "two-stage"]
    alone = evaluate(SUITE_BIPED, BIPED, names, 1, tmp_path / "a").rows
    assert evaluate(SUITE_BIPED, BIPED, names[::-1], 2, tmp_path / "b").rows == alone


def test_bench_has_the_keys_of_the_contract(capsys):
    assert main(["bench", "--seconds", "1", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["raw_physics_rtf"] > 0
    assert content["single_env_rtf"] > 0
    for key in ("stage_1_us", "stage_2_us", "plan_us", "whole_body_us"):
        assert 0 < content[key]["median"] <= content[key]["p99"]


SUITE_PENDULUM = Suite("head", "1", get_suite("standard").scenarios[:12])


@pytest.fixture(scope="module")
def runner():
    return Runner(PENDULUM)


@pytest.mark.parametrize("name", ["two-stage", "random"])
def test_order_changes_nothing(runner, name):
    jobs = [(name, scenario) for scenario in SUITE_PENDULUM.scenarios[:6]]
    first, second = ([runner.run(job).to_dict() for job in order] for order in (jobs, jobs[::-1]))
    assert json.dumps(first) == json.dumps(second[::-1])


def test_two_stage_recovers_more_than_passive(runner):
    def recovered(name):
        return sum(runner.run((name, scenario)).recovered for scenario in SUITE_PENDULUM.scenarios)

    assert recovered("two-stage") > recovered("passive")


@pytest.mark.parametrize("psi", [-90.0, 30.0, 90.0])
def test_mirrored_scenario_has_the_mirrored_outcome(runner, psi):
    push = polar_push(300.0, np.radians(psi), 0.1, GaitEvent(4, "left", 0.3))
    scenario = Scenario("push", (push,), Command(0.2, 0.1))
    a, b = (runner.run(("two-stage", s)) for s in (scenario, scenario.mirrored()))
    for field in ("survived", "recovered", "failure_reason", "env_steps"):
        assert getattr(a, field) == getattr(b, field)
    assert a.total_reward == pytest.approx(b.total_reward, rel=1e-9)


def test_an_unpushed_walk_recovers_at_every_command(runner):
    for vx, vy in [(0.0, 0.0), (0.5, 0.0), (-0.25, 0.0), (0.0, 0.2), (0.0, -0.2)]:
        outcome = runner.run(("two-stage", Scenario("calm", (), Command(vx, vy), duration=6.0)))
        assert outcome.recovered
        assert outcome.end_time == pytest.approx(6.0, abs=0.011)


def test_frontier_lies_under_the_limit(runner):
    for psi in (-90.0, 90.0):
        row = scan(runner, ScanJob(FrontierSettings(PENDULUM, 50.0), "two-stage", psi))
        limit = max_recoverable_force(runner.env.unwrapped.robot, np.radians(psi))  # type: ignore[attr-defined]
        assert 0.5 * limit < row["survived_N"] <= limit


@pytest.fixture
def preset(tmp_path):
    path, robot = tmp_path / "tuned.json", {"limits": {"duration_max": 0.7}, "gait": {"apex": 0.08}}
    PresetFile("biped", {}, {"two-stage": {"beta_dcm": 900.0}}, robot).save(path)
    return path


def test_an_id_with_a_preset_makes_robot_and_variant_of_the_file(preset):
    env = make_env(f"{BIPED}@{preset}")
    assert env.unwrapped.limits.duration_max == 0.7
    assert env.unwrapped.core.gait_settings.apex == 0.08
    policy = load_policy("two-stage", env)
    assert (policy.config.beta_dcm, policy.limits.duration_max) == (900.0, 0.7)
    base = make_policy("stage-1", preset="biped")
    assert load_policy("stage-1", env).config.beta_dcm == base.config.beta_dcm


def test_rows_of_a_preset_that_has_changed_are_refused(tmp_path, preset, capsys):
    suite, out = str(tmp_path / "suite.json"), str(tmp_path / "out")
    Suite("two", "1", get_suite("standard").scenarios[:2]).save(Path(suite))
    options = ["evaluate", "--env", PENDULUM, "--policies", "stage-1", "--workers", "1", "--json"]
    options += ["--suite", suite, "--preset", str(preset), "--out", out]
    assert main(options) == 0
    assert json.loads(capsys.readouterr().out)["env"] == f"{PENDULUM}@{preset}"
    assert main(options) == 0
    preset.write_text(preset.read_text().replace("900.0", "901.0"))
    assert main(options) == 2
    assert "differs in: preset_sha256" in capsys.readouterr().err


def test_bad_presets_are_bad_input(tmp_path, capsys):
    assert main(["evaluate", "--preset", "bipd"]) == 2
    assert "unknown preset 'bipd'; did you mean 'biped'?" in capsys.readouterr().err
    assert main(["frontier", "--preset", str(tmp_path / "absent.json")]) == 2
    assert "cannot read preset file" in capsys.readouterr().err
    (tmp_path / "p.json").write_text("{}")
    with pytest.raises(InvalidValueError, match="is no preset file"):
        make_env(f"{PENDULUM}@{tmp_path / 'p.json'}")


def test_a_row_of_the_wrong_kind_is_refused_before_anything_is_run(tmp_path):
    suite = Suite("s", "1", (Scenario("x", duration=0.1),))
    evaluate(suite, PENDULUM, "two-stage", directory=tmp_path)
    path = tmp_path / "outcomes.jsonl"
    (row,) = rows_of(tmp_path)
    text = json.dumps({**row, "recovered": "yes"}) + "\n"
    path.write_text(text)
    for run, words in ((evaluate, (suite, PENDULUM, "two-stage")),
                       (compare, ("stage-1", "two-stage", suite, PENDULUM))):  # fmt: skip
        with pytest.raises(InvalidValueError) as refused:
            run(*words, directory=tmp_path)
        assert str(refused.value) == (
            f"'{path}' line 1 is no outcome: recovered must be true or false, got 'yes'"
        )
        assert path.read_text() == text


def test_a_label_of_another_planner_is_other_content(tmp_path):
    suite, env_id = Suite("s", "1", (Scenario("x", duration=0.1),)), "PushRecovery/Pendulum-v0"
    evaluate(suite, env_id, {"mine": "two-stage"}, directory=tmp_path)
    evaluate(suite, env_id, {"mine": "two-stage"}, directory=tmp_path)
    with pytest.raises(InvalidValueError, match="another content"):
        evaluate(suite, env_id, {"mine": "stage-1"}, directory=tmp_path)


PUSHED = Scenario("a", (Push((50.0, 0.0, 0.0), 0.1, 0.5),), settle_time=1.0)


@pytest.mark.parametrize(
    ("robot", "changes", "words"),
    [
        ("Biped", {"pushes": (Push((1.0, 0.0, 0.0), 0.1, 0.5, "link:left_elbow"),)},
         "unknown push body 'link:left_elbow'"),
        ("Biped", {"disturbances": (Payload(1.0, 0.1, 0.5, "link:nothing"),)},
         "unknown push body 'link:nothing'"),
        ("Biped", {"errors": ModelErrors(delay=0.003)}, r"ModelErrors.delay \[s\] must be a multiple"),
        ("Pendulum", {"kicks": (Kick((0.1, 0.0, 0.0), 0.1),)}, "PushRecovery/Pendulum-v0 takes no kicks"),
        ("Pendulum", {"command": Command(turn=0.1)}, "PushRecovery/Pendulum-v0 does not turn"),
        ("Pendulum", {"disturbances": (Slip("left", 0.1, 0.5, 0.1),)},
         "PushRecovery/Pendulum-v0 takes no slip"),
        ("Pendulum", {"errors": ModelErrors(payload=5.0)}, "the pendulum has no model error 'payload'"),
        ("Pendulum", {"physics": PhysicsOptions(integrator="rk4")}, "the pendulum is integrated exactly"),
        ("Pendulum", {"sensing": "onboard"}, "the pendulum has no sensors"),
    ],
)  # fmt: skip
def test_a_scenario_that_a_robot_cannot_have_leaves_nothing_behind(robot, changes, words, tmp_path):
    """It is the last one of the suite, and the others are possible."""
    scenarios = PUSHED, replace(PUSHED, id="b"), replace(PUSHED, id="c", **changes)
    with pytest.raises(PushRecoveryError, match=f"^{words}"):
        evaluate(Suite("s", "1", scenarios), f"PushRecovery/{robot}-v0", "stage-1", directory=tmp_path)
    assert list(tmp_path.iterdir()) == []
