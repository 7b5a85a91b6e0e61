"""Presets of points, searches of a function, races of trials, and whole studies with what their files say."""

import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import PresetFile, load_preset, named_preset
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.rows import Writer
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.tuning import study as tuning
from push_recovery.eval.tuning.pushes import TUNING, Scorer, check_env, preset_episodes, tuning_suite, worth
from push_recovery.eval.tuning.space import Dimension, Space
from push_recovery.eval.tuning.study import CANDIDATE, Search, TuningSettings, best_of, preset_of, race, tune
from push_recovery.eval.tuning.variants import tune_variants

SETTINGS = TuningSettings("PushRecovery/Biped-v0", "two-stage", space="both", scenarios=8)


def test_all_that_is_tuned_becomes_the_variants_own():
    values = {
        "planner": {"beta_dcm": 123.0, "touchdown_delay": 0.007}, "gait": {"apex": 0.05},
        "gains": {"swing_kp": 321.0},
    }  # fmt: skip
    preset = preset_of(SETTINGS, values, {"by": "hand"})
    assert preset.base == "biped"
    assert preset.planner == preset.biped == {}
    robot = {"gait": {"apex": 0.05}, "gains": {"swing_kp": 321.0}}
    assert preset.variants == {"two-stage": {**values["planner"], "biped": robot}}
    assert preset.found == {"by": "hand"}
    assert preset.config("two-stage").beta_dcm == 123.0
    assert preset.config("stage-1") == named_preset("biped").config("stage-1")
    assert preset.robot("stage-1") == named_preset("biped").robot()


def test_the_planner_holds_its_plan_when_the_gait_machine_commits_the_foot():
    preset = preset_of(SETTINGS, {"gait": {"commit": 0.035}})
    assert preset.robot("two-stage")["gait"]["commit"] == preset.config("two-stage").freeze == 0.035
    assert preset.robot()["gait"]["commit"] == preset.config("stage-1").freeze != 0.035


def test_what_the_start_says_of_a_variant_stays_beside_what_is_tuned(tmp_path):
    first = preset_of(SETTINGS, {"planner": {"beta_dcm": 123.0, "beta_trunk": 5.0}, "gait": {"apex": 0.05}})
    first.save(tmp_path / "first.json")
    settings = replace(SETTINGS, preset=str(tmp_path / "first.json"))
    again = preset_of(settings, {"planner": {"beta_dcm": 7.0}, "gait": {"early": 0.01}})
    robot = {"gait": {"apex": 0.05, "early": 0.01}}
    assert again.variants == {"two-stage": {"beta_dcm": 7.0, "beta_trunk": 5.0, "biped": robot}}


def test_a_search_starts_where_the_variant_is(tmp_path):
    own = {"touchdown_delay": 0.009, "biped": {"gait": {"apex": 0.05}}}
    PresetFile("biped", variants={"two-stage": own}).save(tmp_path / "own.json")
    found = {}
    for name in ("two-stage", "stage-1"):
        space = tuning.space_of(replace(SETTINGS, policy=name, preset=str(tmp_path / "own.json")))
        found[name] = space.settings([0.0] * len(space.start))
    assert found["two-stage"]["gait"]["apex"] == 0.05
    assert found["two-stage"]["planner"]["touchdown_delay"] == 0.009
    assert found["stage-1"]["gait"]["apex"] == named_preset("biped").robot()["gait"]["apex"]


BOX = Space(tuple(Dimension("g", f"x{i}", -4.0, 4.0, 1.0) for i in range(4)), (0.0,) * 4)
TARGET = np.array([2.0, -1.0, 0.5, 6.0])  # the last one outside the box


def run(seed: int, trials: int) -> list[np.ndarray]:
    search = Search(BOX, seed)
    points = []
    for _ in range(trials):
        points.append(search.ask())
        search.tell(points[-1], -float(np.sum((points[-1] - TARGET) ** 2)))
    return points


def test_search_finds_the_best_point_of_the_box():
    np.testing.assert_allclose(run(1, 600)[-1], [2.0, -1.0, 0.5, 4.0], atol=0.02)


def test_proposals_are_a_function_of_seed_and_scores():
    first = np.array(run(5, 40))
    assert np.array_equal(first, run(5, 40))
    assert not np.array_equal(first, run(6, 40))
    assert (np.abs(first) <= 4.0).all()


def test_search_needs_two_fields_and_its_package(monkeypatch):
    with pytest.raises(InvalidValueError, match=r"^a search needs at least 2 fields, got 1$"):
        Search(Space(BOX.dimensions[:1], (0.0,)), 0)
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(MissingExtraError, match=r"^cmaes is not installed.*'push-recovery\[tune\]'$"):
        Search(BOX, 0)


def test_estimate_is_exact_for_a_constant_difference():
    best = np.linspace(0.0, 0.9, 64)
    assert tuning.estimate(best[:16] - 0.1, best) == pytest.approx(best.mean() - 0.1)
    assert tuning.estimate(best, ()) == pytest.approx(best.mean())


def test_clearly_worse_is_the_one_sided_bound_of_the_paired_difference():
    """k losses in n pairs: mean -k/n, sample variance (k/n)(1 - k/n) n/(n-1)."""
    n, best = 64, np.ones(128)
    for losses in range(8):
        values = np.ones(n)
        values[:losses] = 0.0
        p = losses / n
        bound = -p + tuning.Z * np.sqrt(p * (1 - p) / (n - 1))
        assert tuning.clearly_worse(values, best) == (bound < 0.0), losses
    assert not tuning.clearly_worse(np.zeros(128), best)  # nothing is left to save


def test_race_stops_at_the_rung_where_a_trial_is_clearly_worse():
    assert tuning.rungs(256) == [64, 128, 256]
    best = [1.0] * 256
    assert len(race(lambda a, b: [0.0] * (b - a), 256, best)) == 64
    assert len(race(lambda a, b: [1.0] * (b - a), 256, best)) == 256
    assert len(race(lambda a, b: [0.0] * (b - a), 256, [])) == 256  # no best yet
    asked = []
    race(lambda a, b: asked.append((a, b)) or best[a:b], 256, best)
    assert asked == [(0, 64), (64, 128), (128, 256)]


def row(number, values, stopped=False):
    return {
        "trial": number, "values": values, "score": sum(values) / len(values), "stopped": stopped,
        "scenarios": len(values),
    }  # fmt: skip


def test_the_best_has_met_every_scenario_and_of_equal_ones_came_first():
    rows = [row(0, [0.4]), row(1, [0.6]), row(2, [0.9], stopped=True), row(3, [0.6]), row(4, [0.5])]
    assert best_of(rows)["trial"] == 1
    assert best_of(rows[2:])["trial"] == 3


# recovered by both, by the best alone (three times), by the start alone, by neither (0.5 stands unsettled)
START = row(0, [1.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0])
BEST = row(2, [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.0])


def test_recoveries_are_paired_and_scores_are_not_recoveries():
    found = tuning.comparison(START, BEST)
    assert found["start"] == {"score": 3.0 / 8.0, "recovered": 2}
    assert found["best"] == {"score": 5.5 / 8.0, "recovered": 4}
    assert (found["scenarios"], found["only_best"], found["only_start"]) == (8, 3, 1)
    assert found["rate_difference"] == pytest.approx(0.25)
    assert found["mcnemar_p"] == pytest.approx(2 * (4 + 1) / 2**4)  # at least 3 of 4, both tails
    low, high = found["ci95"]
    assert low < 0.25 < high


def test_held_out_compares_start_with_best_and_episodes_are_added_up():
    rows = [START, row(1, [0.0, 0.0], stopped=True), BEST]
    config = {"tune": {"seed": 3}, "suites": [], "code": "c", "space": {}}
    found = tuning.findings(config, 6, rows, {0: row(0, [1.0, 0.0]), 2: row(2, [0.0, 0.0])})
    assert (found["trials"], found["stopped_early"], found["episodes"], found["trial"]) == (2, 1, 22, 2)
    assert found["tuning"] == tuning.comparison(START, BEST)
    assert (found["held_out"]["start"]["recovered"], found["held_out"]["best"]["recovered"]) == (1, 0)
    assert (found["tune"], found["code"]) == ({"seed": 3}, "c")
    assert ", 6 trials a generation" in found["by"]


PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
FIELDS = ("planner.alpha_offset", "planner.beta_dcm")
SETTINGS_STUDY = TuningSettings(PENDULUM, "stage-1+cop", seed=3, scenarios=8, held_out=9, only=FIELDS)
TRIALS = 8  # more than a generation


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return tune(SETTINGS_STUDY, TRIALS, directory=tmp_path_factory.mktemp("study"))


def rows(directory):
    return [json.loads(line) for line in (directory / "outcomes.jsonl").read_text().splitlines()]


def test_the_same_seed_gives_the_same_study(study, tmp_path):
    again = tune(SETTINGS_STUDY, TRIALS, directory=tmp_path)
    assert rows(tmp_path) == rows(study.directory)
    assert again.path.read_bytes() == study.path.read_bytes()
    other = tune(replace(SETTINGS_STUDY, seed=4), 1, directory=tmp_path / "other")
    assert other.trials[1]["point"] != study.trials[1]["point"]


@pytest.mark.parametrize("kept", [1, 4, 8])
def test_a_killed_study_goes_on_to_the_same_end(study, tmp_path, kept):
    """Rows before the kill, a torn last line, and the preset that was being run are all that is left."""
    lines = (study.directory / "outcomes.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "outcomes.jsonl").write_bytes(b"".join(lines[:kept]) + lines[kept][:40])
    (tmp_path / "config.json").write_bytes((study.directory / "config.json").read_bytes())
    (tmp_path / CANDIDATE).write_text("{")
    tune(SETTINGS_STUDY, TRIALS, directory=tmp_path)
    assert rows(tmp_path) == rows(study.directory)
    assert (tmp_path / "preset.json").read_bytes() == study.path.read_bytes()
    assert not (tmp_path / CANDIDATE).exists()


def test_more_trials_go_on_where_fewer_ended(study, tmp_path):
    tune(SETTINGS_STUDY, 3, directory=tmp_path)
    whole = tune(SETTINGS_STUDY, TRIALS, directory=tmp_path)
    assert whole.trials == study.trials
    assert whole.path.read_bytes() == study.path.read_bytes()


def test_the_preset_file_scores_what_the_study_says(study):
    """Loaded by name, the file gives the episodes of the best trial."""
    scenarios = tuning_suite(TUNING, 8).scenarios
    for trial, path in ((study.best, str(study.path)), (study.start, "default")):
        episodes = preset_episodes(PENDULUM, 3, path, SETTINGS_STUDY.policy)
        policy = make_policy(SETTINGS_STUDY.policy, episodes.robot, episodes.limits, path)
        found = {o.scenario_id: worth(o) for o in rollout_batch(episodes, policy, scenarios, "p")}
        assert [found[s.id] for s in scenarios] == trial["values"]
    preset = load_preset(str(study.path))
    assert preset.config(SETTINGS_STUDY.policy).beta_dcm == study.best["settings"]["planner"]["beta_dcm"]
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

    def last_first(task, jobs):
        return reversed([(number, task(None, job)) for number, job in enumerate(jobs)])

    scorer = Scorer(PENDULUM, SETTINGS_STUDY.policy, 3)
    scorer._pool = SimpleNamespace(run=last_first)  # type: ignore[assignment]
    scenarios = tuning_suite(TUNING, 8).scenarios
    assert scorer.values(study.path, scenarios) == study.best["values"]


def test_a_directory_of_another_study_is_refused(study):
    message = r"holds results of another configuration \(differs in: tune\)"
    with pytest.raises(InvalidValueError, match=message):
        tune(replace(SETTINGS_STUDY, seed=4), 1, directory=study.directory)


def stored(study, directory, settings=None):
    """A directory of the study's first two trials, the second of which has moved by half a unit."""
    (directory / "config.json").write_bytes((study.directory / "config.json").read_bytes())
    moved = rows(study.directory)[:2]
    moved[1]["point"][0] += 0.5
    moved[1]["settings"] = settings or study.space.settings(moved[1]["point"])
    (directory / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in moved))
    return moved[1]["point"]


def test_a_study_goes_on_from_points_that_another_machine_has_proposed(study, tmp_path):
    point = stored(study, tmp_path)
    other = tune(SETTINGS_STUDY, TRIALS, directory=tmp_path)
    assert other.trials[1]["point"] == point
    assert len(other.trials) == TRIALS + 1


def test_a_trial_whose_settings_are_not_those_of_its_point_is_refused(study, tmp_path):
    stored(study, tmp_path, study.trials[1]["settings"])
    with pytest.raises(
        InvalidValueError, match="has trial 1 with other settings than those of its point: choose another"
    ):
        tune(SETTINGS_STUDY, TRIALS, directory=tmp_path)


@pytest.mark.parametrize(
    ("recovered", "survived", "expected"), [(True, True, 1.0), (False, True, 0.5), (False, False, 0.0)]
)
def test_standing_unsettled_is_worth_half(recovered, survived, expected):
    assert worth(SimpleNamespace(recovered=recovered, survived=survived)) == expected  # type: ignore[arg-type]


def test_environments_are_named_with_and_without_their_module():
    assert check_env(f"push_recovery:{PENDULUM}") == PENDULUM
    with pytest.raises(UnknownNameError, match=r"PushRecovery/Biped-v0"):
        check_env("PushRecovery/G2-v0")


SUITES = "tuning", "tuning-varied", "tuning-quick", "tuning-punches"


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
        replace(SETTINGS_STUDY, **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"errors": ModelErrors(payload=5.0)}, "the pendulum has no model error 'payload'"),
        ({"env_id": "PushRecovery/G1-v0", "preset": "biped"}, "preset 'biped' is for a sole of 0.2 x 0.1 m"),
    ],
)
def test_a_study_that_cannot_begin_leaves_nothing_behind(changes, words, tmp_path):
    with pytest.raises(InvalidValueError, match=f"^{words}"):
        tune(replace(SETTINGS_STUDY, **changes), 1, directory=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_pushes_are_of_every_kind_where_the_robot_takes_them():
    assert SETTINGS_STUDY.suite == "tuning"
    assert TuningSettings(BIPED, "stage-1").suite == "tuning-varied"
    spoilt = {"errors": ModelErrors(mass=0.1)}
    assert TuningSettings(BIPED, "stage-1", **spoilt).suite == "tuning"  # type: ignore[arg-type]
    for suite in ("tuning-varied", "tuning-quick"):
        with pytest.raises(
            InvalidValueError, match=rf"suite '{suite}' has .* got \{{'mass': 0.1\}}: leave th"
        ):
            TuningSettings(BIPED, "stage-1", suite=suite, **spoilt)  # type: ignore[arg-type]


def test_command_prints_one_object(tmp_path, capsys):
    options = ["--env", PENDULUM, "--policies", "stage-1", "--trials", "1", "--scenarios", "8"]
    options += ["--held-out", "8", "--workers", "1"]
    assert main(["tune", *options, "--out", str(tmp_path), "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    variant = out["variants"]["stage-1"]
    assert variant["trials"] == 1
    for path in (out["preset"], variant["preset"]):
        assert load_preset(path).variants["stage-1"] == variant["settings"]["planner"]
    assert main(["tune", *options, "--out", str(tmp_path)]) == 0
    assert "held out" in capsys.readouterr().out
    assert main(["tune", "--policies", "stage-1", "random"]) == 2
    assert "unknown policy to tune 'random'" in capsys.readouterr().err


def test_a_second_search_in_a_directory_is_refused(study, tmp_path):
    """Either would score what the other had written as the preset that is being run."""
    before = (study.directory / "outcomes.jsonl").read_bytes()
    with Writer(study.directory), pytest.raises(InvalidValueError, match="another run"):
        tune(SETTINGS_STUDY, TRIALS, directory=study.directory, overwrite=True)
    with Writer(tmp_path), pytest.raises(InvalidValueError, match="another run"):
        tune_variants(SETTINGS_STUDY, [SETTINGS_STUDY.policy], TRIALS, directory=tmp_path)
    assert (study.directory / "outcomes.jsonl").read_bytes() == before


def test_two_losses_of_64_may_be_chance_and_three_are_not():
    """The mean of k losses is sqrt(63 k / (64 - k)) standard errors below 0: 1.43 of two, 1.76 of three."""
    for losses, worse in ((2, False), (3, True)):
        values = np.ones(64)
        values[:losses] = 0.0
        assert tuning.clearly_worse(values, np.ones(128)) == worse
    assert tuning.clearly_worse([0.0, 0.0], np.ones(8))  # two that do not differ are enough
    assert not tuning.clearly_worse([0.0], np.ones(8))


def test_the_first_generation_is_one_unit_wide():
    """400 normal numbers: their standard deviation is off by 0.035, four of which are let pass."""
    first = np.array([Search(BOX, seed).ask() for seed in range(100)])
    assert first.std() == pytest.approx(1.0, abs=0.15)
    assert abs(first.mean()) < 0.2
