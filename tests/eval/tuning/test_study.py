import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.settings import load_preset
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.rows import Writer
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.tuning.pushes import TUNING, tuning_suite
from push_recovery.eval.tuning.scorer import Scorer, preset_episodes, preset_policy, worth
from push_recovery.eval.tuning.study import CANDIDATE, TuningSettings, tune
from push_recovery.eval.tuning.variants import tune_arms

PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
SETTINGS = TuningSettings(
    PENDULUM,
    "stage-1+cop",
    seed=3,
    scenarios=8,
    held_out=9,
    only=("planner.alpha_offset", "planner.beta_dcm"),
)
TRIALS = 8  # more than a generation


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return tune(SETTINGS, TRIALS, directory=tmp_path_factory.mktemp("study"))


def rows(directory):
    return [json.loads(line) for line in (directory / "outcomes.jsonl").read_text().splitlines()]


def test_the_same_seed_gives_the_same_study(study, tmp_path):
    again = tune(SETTINGS, TRIALS, directory=tmp_path)
    assert rows(tmp_path) == rows(study.directory)
    assert again.path.read_bytes() == study.path.read_bytes()
    other = tune(TuningSettings(**{**vars(SETTINGS), "seed": 4}), 1, directory=tmp_path / "other")
    assert other.trials[1]["point"] != study.trials[1]["point"]


@pytest.mark.parametrize("kept", [1, 4, 8])
def test_a_killed_study_goes_on_to_the_same_end(study, tmp_path, kept):
    """Rows before the kill, a torn last line, and the preset that was being run are all that is left."""
    lines = (study.directory / "outcomes.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "outcomes.jsonl").write_bytes(b"".join(lines[:kept]) + lines[kept][:40])
    (tmp_path / "config.json").write_bytes((study.directory / "config.json").read_bytes())
    (tmp_path / CANDIDATE).write_text("{")
    tune(SETTINGS, TRIALS, directory=tmp_path)
    assert rows(tmp_path) == rows(study.directory)
    assert (tmp_path / "preset.json").read_bytes() == study.path.read_bytes()
    assert not (tmp_path / CANDIDATE).exists()


def test_more_trials_go_on_where_fewer_ended(study, tmp_path):
    tune(SETTINGS, 3, directory=tmp_path)
    whole = tune(SETTINGS, TRIALS, directory=tmp_path)
    assert whole.trials == study.trials
    assert whole.path.read_bytes() == study.path.read_bytes()


def test_the_preset_file_scores_what_the_study_says(study):
    """Loaded by name, the file gives the episodes of the best trial."""
    scenarios = tuning_suite(TUNING, 8).scenarios
    for trial, path in ((study.best, str(study.path)), (study.start, "default")):
        episodes = preset_episodes(PENDULUM, 3, path, SETTINGS.policy)
        policy = preset_policy(SETTINGS.policy, episodes, path)
        found = {o.scenario_id: worth(o) for o in rollout_batch(episodes, policy, scenarios, "p")}
        assert [found[s.id] for s in scenarios] == trial["values"]
    preset = load_preset(str(study.path))
    assert preset.config(SETTINGS.policy).beta_dcm == study.best["settings"]["planner"]["beta_dcm"]
    assert preset.config("two-stage") == load_preset("default").config()


def test_the_file_says_how_it_was_found(study):
    found = study.preset.found
    assert found["trials"] == TRIALS
    assert found["tune"]["seed"] == 3
    assert [suite["name"] for suite in found["suites"]] == ["tuning", "tuning-held-out"]
    assert found["episodes"] == sum(row["scenarios"] for row in rows(study.directory))
    for name, number in (("start", 0), ("best", study.best["trial"])):
        assert found["tuning"][name]["score"] == np.mean(study.trials[number]["values"])
    assert found["held_out"]["scenarios"] == 9


def test_workers_change_nothing(study):
    """Scenarios shared out among three and put together again, whichever of them is done first."""

    class LastFirst:
        """Stands for the processes."""

        def run(self, task, jobs):
            return reversed([(number, task(None, job)) for number, job in enumerate(jobs)])

    scorer = Scorer(PENDULUM, SETTINGS.policy, 3)
    scorer._pool = LastFirst()  # type: ignore[assignment]
    scenarios = tuning_suite(TUNING, 8).scenarios
    assert scorer.values(study.path, scenarios) == study.best["values"]


def test_a_directory_of_another_study_is_refused(study):
    other = TuningSettings(**{**vars(SETTINGS), "seed": 4})
    with pytest.raises(
        InvalidValueError, match=r"holds results of another configuration \(differs in: tune\)"
    ):
        tune(other, 1, directory=study.directory)


def test_a_trial_at_another_point_is_refused(study, tmp_path):
    (tmp_path / "config.json").write_bytes((study.directory / "config.json").read_bytes())
    changed = rows(study.directory)[:2]
    changed[1]["point"][0] += 0.5
    (tmp_path / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in changed))
    with pytest.raises(InvalidValueError, match="has trial 1 at another point than this search asks for"):
        tune(SETTINGS, TRIALS, directory=tmp_path)


SUITES = "tuning", "tuning-varied", "tuning-punches"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_id": "PushRecovery/BipedResidual-v0"}, "unknown environment to tune 'PushRecovery/BipedRes"),
        ({"space": "all"}, r"^unknown space to tune 'all' \(valid: planner, robot, both\)$"),
        ({"space": "both"}, f"^space 'both' is that of robots; {PENDULUM} has the space 'planner' only$"),
        ({"scenarios": 4}, r"scenarios must be in \[8, 1024\], got 4"),
        ({"held_out": 1025}, r"held_out must be in \[8, 1024\], got 1025"),
        ({"suite": "hard"}, rf"^unknown tuning suite 'hard' \(valid: {', '.join(SUITES)}\)$"),
        ({"suite": "tuning-punches"}, f"^suite 'tuning-punches' is that of robots; {PENDULUM} takes 't"),
        ({"suite": "tuning-varied"}, f"^suite 'tuning-varied' is that of robots; {PENDULUM} takes 'tu"),
        ({"seed": -1}, "seed must be an integer >= 0, got -1"),
    ],
)  # fmt: skip
def test_bad_settings_are_refused(changes, message):
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        TuningSettings(**{**vars(SETTINGS), **changes})


def test_pushes_are_of_every_kind_where_the_robot_takes_them():
    assert SETTINGS.suite == "tuning"
    assert TuningSettings(BIPED, "stage-1").suite == "tuning-varied"
    spoilt = {"errors": ModelErrors(mass=0.1)}
    assert TuningSettings(BIPED, "stage-1", **spoilt).suite == "tuning"  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=r"got \{'mass': 0.1\}: leave them out"):
        TuningSettings(BIPED, "stage-1", suite="tuning-varied", **spoilt)  # type: ignore[arg-type]


def test_command_prints_one_object(tmp_path, capsys):
    options = ["--env", PENDULUM, "--policies", "stage-1", "--trials", "1", "--scenarios", "8"]
    options += ["--held-out", "8", "--workers", "1"]
    assert main(["tune", *options, "--out", str(tmp_path), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    arm = out["arms"]["stage-1"]
    assert arm["trials"] == 1
    for path in (out["preset"], arm["preset"]):
        assert load_preset(path).arms["stage-1"] == arm["settings"]["planner"]
    assert main(["tune", *options, "--out", str(tmp_path)]) == 0
    assert "held out" in capsys.readouterr().out
    assert main(["tune", "--policies", "stage-1", "random"]) == 2
    assert "unknown policy to tune 'random'" in capsys.readouterr().err


def test_a_second_search_in_a_directory_is_refused(study, tmp_path):
    """Either would score what the other had written as the preset that is being run."""
    before = (study.directory / "outcomes.jsonl").read_bytes()
    with Writer(study.directory), pytest.raises(InvalidValueError, match="another run"):
        tune(SETTINGS, TRIALS, directory=study.directory, overwrite=True)
    with Writer(tmp_path), pytest.raises(InvalidValueError, match="another run"):
        tune_arms(SETTINGS, [SETTINGS.policy], TRIALS, directory=tmp_path)
    assert (study.directory / "outcomes.jsonl").read_bytes() == before
