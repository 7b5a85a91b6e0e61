"""A policy of one's own, in each of the four ways."""

import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.observation import DCM
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.suites import Suite, get_suite

from push_recovery import compare, evaluate, frontier, load_policy, make_policy, rollout

SUITE = Suite("head", "1", get_suite("standard").scenarios[:6])
PENDULUM = "PushRecovery/Pendulum-v0"


class Pull:
    """The toy's linear policy with nothing but predict(observation)."""

    def __init__(self, gain=8.0):
        self.gain = gain

    def predict(self, observation):
        action = np.zeros(7, np.float32)
        action[:2] = np.clip(-np.float32(self.gain) * observation[DCM].astype(np.float32), -1, 1)
        return action


@pytest.fixture
def file_rows(tmp_path):
    """Rows of the same policy from a file: every way must give these."""
    name = toy.save_policy(tmp_path / "pull.safetensors", 8.0)
    return name, without_name(evaluate(name, SUITE, toy.ENV_ID, out=tmp_path / "file").rows[name])


def without_name(rows):
    return [{key: value for key, value in row.items() if not key.startswith("policy")} for row in rows]


def test_an_object_with_predict_alone_scores_as_its_file(file_rows, tmp_path):
    evaluation = evaluate({"mine": Pull()}, SUITE, toy.ENV_ID, out=tmp_path / "object")
    assert without_name(evaluation.rows["mine"]) == file_rows[1]
    assert evaluation.score("mine").episodes == 6
    report = json.loads((tmp_path / "object" / "report.json").read_text())
    assert report["policies"]["mine"]["episodes"] == 6
    assert all(len(row["policy_sha256"]) == 64 for row in evaluation.rows["mine"])


def test_a_model_of_stable_baselines3_in_memory(tmp_path, monkeypatch):
    sb3 = pytest.importorskip("stable_baselines3")
    torch = pytest.importorskip("torch")
    model = sb3.PPO("MlpPolicy", make_env(PENDULUM), n_steps=8, batch_size=8, device="cpu")
    torch.nn.init.zeros_(model.policy.action_net.weight)
    torch.nn.init.zeros_(model.policy.action_net.bias)

    class Middle:
        def predict(self, observation):
            return np.zeros(7, np.float32)

    monkeypatch.chdir(tmp_path)
    two = Suite("two", "1", SUITE.scenarios[:2])
    evaluation = evaluate({"model": model, "middle": Middle()}, two, PENDULUM)
    assert without_name(evaluation.rows["model"]) == without_name(evaluation.rows["middle"])
    assert evaluation.directory.parts[0] == "runs"


def test_module_and_attribute_on_the_command_line(file_rows, tmp_path):
    """From the working directory, as the installed script has it: with the path of the script first."""
    code = """
        import numpy as np
        class Pull:
            def predict(self, observation):
                from push_recovery.controllers.model.observation import DCM
                action = np.zeros(7, np.float32)
                action[:2] = np.clip(-np.float32(8) * observation[DCM].astype(np.float32), -1, 1)
                return action, None
        class Nest:
            Pull = Pull
        policy = Pull()
        def make():
            return policy
        """
    (tmp_path / "my_policies.py").write_text(textwrap.dedent(code))
    SUITE.save(tmp_path / "head.json")
    names = [f"my_policies:{attribute}" for attribute in ("policy", "Pull", "make", "Nest.Pull")]
    program = (
        f"import sys; sys.path[0] = {str(tmp_path / 'bin')!r}\n"
        f"sys.path.append({str(Path(toy.__file__).parent)!r})\n"
        "from push_recovery.eval.cli.main import main; raise SystemExit(main(sys.argv[1:]))"
    )
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", *names, "--suite", "head.json", "--out", "out"]
    for workers in "1", "2":
        done = subprocess.run(
            [sys.executable, "-c", program, *argv, "--json", "--workers", workers, "--overwrite"],
            cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert list(json.loads(done.stdout)["policies"]) == names
        rows = [json.loads(line) for line in (tmp_path / "out" / "outcomes.jsonl").read_text().splitlines()]
        rows.sort(key=lambda row: [s.id for s in SUITE.scenarios].index(row["scenario_id"]))
        for name in names:
            own = [row for row in rows if row["policy"] == name]
            assert without_name(own) == file_rows[1]
            assert len({row["policy_sha256"] for row in own}) == 1


def test_rows_of_an_object_that_has_learned_since_are_refused(tmp_path):
    policy = Pull()
    evaluate({"mine": policy}, SUITE, toy.ENV_ID, out=tmp_path)
    assert evaluate({"mine": Pull()}, SUITE, toy.ENV_ID, out=tmp_path).wall_time < 1.0
    policy.gain = 1.0
    with pytest.raises(InvalidValueError, match="another content of policy 'mine'"):
        evaluate({"mine": policy}, SUITE, toy.ENV_ID, out=tmp_path)


def test_an_object_that_does_not_pickle_runs_here_and_its_rows_are_never_taken_for_anothers(
    tmp_path, monkeypatch, file_rows
):
    policy = Pull()
    policy.hook = lambda: None
    monkeypatch.chdir(tmp_path)
    first = evaluate({"mine": policy}, SUITE, toy.ENV_ID, workers=2)
    second = evaluate({"mine": policy}, SUITE, toy.ENV_ID)
    assert first.directory != second.directory
    assert without_name(first.rows["mine"]) == without_name(second.rows["mine"]) == file_rows[1]
    assert {row["policy_sha256"] for row in first.rows["mine"]} == {None}
    with pytest.raises(InvalidValueError, match="does not pickle"):
        evaluate({"mine": policy}, SUITE, toy.ENV_ID, out=first.directory)


def test_compare_tells_objects_of_one_class_apart_by_label(tmp_path):
    found = compare({"strong": Pull()}, {"weak": Pull(0.01)}, SUITE, toy.ENV_ID, out=tmp_path)
    assert (found.a, found.b) == ("strong", "weak")
    scores = evaluate({"strong": Pull(), "weak": Pull(0.01)}, SUITE, toy.ENV_ID, out=tmp_path)
    rates = scores.score("strong").rate, scores.score("weak").rate
    assert rates[0] > rates[1]
    assert found.to_dict()["rate_difference"] == pytest.approx(rates[0] - rates[1])
    with pytest.raises(InvalidValueError, match="'Pull' is given more than once"):
        compare(Pull(), Pull(0.0), SUITE, toy.ENV_ID, out=tmp_path)


def test_a_comparison_is_of_two(tmp_path):
    with pytest.raises(InvalidValueError, match="two policies are compared, got 3: a, b, c"):
        compare({"a": Pull(), "b": Pull()}, {"c": Pull()}, SUITE, toy.ENV_ID, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_frontier_and_a_rollout_take_an_object(tmp_path, file_rows):
    found = frontier({"mine": Pull()}, 2, toy.ENV_ID, replicas=2, out=tmp_path / "frontier")
    assert [row["psi_deg"] for row in found.rows["mine"]] == [0.0, 180.0]
    scenario = Scenario("calm", (polar_push(1.0, 0.0, 0.1, 1.0),))
    here = rollout(Pull(), scenario, make_env(toy.ENV_ID))
    assert (here.policy, here.recovered) == ("Pull", True)
    assert rollout(file_rows[0], scenario, toy.ENV_ID, "Pull") == here
    assert rollout(toy.ENV_ID, file_rows[0], scenario, "Pull") == here  # the order of old


def test_make_policy_is_that_of_the_environment():
    env = make_env(PENDULUM)
    assert make_policy("two-stage", env).robot == env.unwrapped.robot
    assert load_policy("two-stage", env).config == make_policy("two-stage", env).config


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        (3, "policy 3 has no method predict"),
        ({}, "no policy is given"),
        ([], "no policy is given"),
        ({"": Pull()}, "label must be a printable name"),
        ({"a\x1b[31m": Pull()}, "label must be a printable name"),
        ("model.zip", r"archive of Stable-Baselines3.*evaluate\(policies="),
        ("mine.py", "MODULE:ATTRIBUTE"),
        ("no_such_module:Policy", "cannot import 'no_such_module'"),
        ("..:x", r"'\.\.' is no name of a module"),
        ("json:dump", "cannot be made without arguments"),
        ("json:decoder", "no method predict"),
        ("toy_gait_env:ToyEnf", "unknown attribute of toy_gait_env 'ToyEnf'; did you mean 'ToyEnv'"),
    ],
)
def test_what_cannot_act_is_refused(policy, words, tmp_path):
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        evaluate(policy, SUITE, toy.ENV_ID, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


ONE = Suite("s", "1", (Scenario("a", duration=0.1),))


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda: evaluate("stage-1", ONE, PENDULUM, workers="2"), "workers must be an integer >= 1, got '2'"),
        (lambda: evaluate("stage-1", ONE, PENDULUM, workers=0), "workers must be an integer >= 1, got 0"),
        (lambda: evaluate("stage-1", ONE, PENDULUM, out=5), "out must be a path, got 5"),
        (lambda: compare("stage-1", "two-stage", ONE, PENDULUM, errors={"mass": 0.1}),
         "errors must be a ModelErrors, got {'mass': 0.1}"),
        (lambda: frontier("stage-1", "4", PENDULUM), "directions must be an integer in [1, 3600], got '4'"),
        (lambda: frontier("stage-1", 1, PENDULUM, replicas="8"), "replicas must be an integer >= 1, got '8'"),
        (lambda: rollout("stage-1", None, PENDULUM), "scenario must be a Scenario, got None"),
        (lambda: rollout("stage-1", {}, PENDULUM), "scenario must be a Scenario, got {}"),
    ],
)  # fmt: skip
def test_arguments_of_another_kind_are_refused(run, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        run()
    assert list(tmp_path.iterdir()) == []
