"""A robot of another size, and without a waist: what is searched, on which pushes, and whose preset it is."""

import json
from importlib.util import find_spec

import gymnasium as gym
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.settings import PresetFile, load_preset
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.eval.protocols.run import biped_of
from push_recovery.eval.rollout.environments import robot_of
from push_recovery.eval.tuning.pushes import check_env, punched_suite, tuning_suite
from push_recovery.eval.tuning.study import TuningSettings, preset_of, space_of
from push_recovery.eval.tuning.variants import tune_variants

pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in PACKAGES), reason="needs pip install 'push-recovery[robots]'"
)
T1 = "PushRecovery/T1-v0"
MASS, HEIGHT = 31.614357 / 60.0, 0.54 / 0.8  # of T1, over the biped's


@pytest.fixture(scope="module")
def both():
    fields = "planner", "limits", "gait", "gains", "bounds"
    settings = [TuningSettings(env, "two-stage", "both", fields) for env in (T1, "PushRecovery/Biped-v0")]
    return [{dimension.label: dimension for dimension in space_of(own).dimensions} for own in settings]


def test_it_starts_at_its_own_preset():
    settings = TuningSettings(T1, "two-stage", "both")
    assert (settings.preset, settings.suite) == ("t1", "tuning-varied")
    space = space_of(settings)
    start = space.settings([0.0] * len(space.dimensions))
    assert start["gains"]["swing_max"] == load_preset("t1").robot()["gains"]["swing_max"]
    assert start["planner"]["alpha_duration"] == load_preset("t1").config("two-stage").alpha_duration


def test_bounds_and_units_are_as_much_larger_as_its_own_values(both):
    t1, biped = both
    apex = load_preset("t1").robot()["gait"]["apex"] / load_preset("biped").robot()["gait"]["apex"]
    found = [getattr(t1["gait.apex"], name) for name in ("low", "high", "unit")]
    assert found == pytest.approx([apex * 0.02, apex * 0.12, apex * 0.006], rel=1e-6)
    shortest = [load_preset(name).robot()["limits"]["length_min"] for name in ("t1", "biped")]
    assert t1["limits.length_min"].low == pytest.approx(shortest[0] / shortest[1] * -0.55, rel=1e-6)
    assert t1["gains.swing_kp"].unit == biped["gains.swing_kp"].unit == 1.2  # a factor


def test_a_field_that_is_zero_keeps_the_bipeds_bounds(both, tmp_path):
    PresetFile("t1", biped={"gait": {"early": 0.0}}).save(tmp_path / "late.json")
    settings = TuningSettings(T1, "two-stage", "both", ("gait.early",), str(tmp_path / "late.json"))
    assert space_of(settings).dimensions == (both[1]["gait.early"],)


def test_without_a_waist_nothing_of_a_trunk_is_searched(both):
    t1, biped = both
    assert set(biped) - set(t1) == {
        "planner.beta_trunk", "planner.beta_trunk_rate", "planner.beta_trunk_angle",
        "planner.beta_trunk_limit", "planner.trunk_gravity", "planner.tail_sampling_time",
        "bounds.waist_price",
    }  # fmt: skip
    assert set(t1) < set(biped)


def test_what_is_found_is_its_own_on_pushes_of_its_size(tmp_path):
    settings = TuningSettings(
        T1, "stage-1", only=("planner.push_threshold", "planner.push_carry"), scenarios=8, held_out=8
    )
    found = tune_variants(settings, ["stage-1"], 1, directory=tmp_path)
    config = json.loads((tmp_path / "stage-1" / "config.json").read_text())
    names = [suite["name"] for suite in config["suites"]]
    assert names == ["tuning-varied@t1", "tuning-varied-held-out@t1"]
    gym.make(f"push_recovery:{T1}", preset=str(found.path)).close()
    for path in (found.path, found.studies["stage-1"].path):
        with pytest.raises(InvalidValueError, match=r"mass 31.61 there and 60 here"):
            gym.make("push_recovery:PushRecovery/Biped-v0", preset=str(path))
    again = TuningSettings(T1, "stage-1", preset=str(found.path), scenarios=8)
    assert preset_of(again, {}).made_for == load_preset("t1").made_for


def test_pushes_go_with_mass_and_times_with_the_root_of_the_height():
    ours, theirs = tuning_suite("tuning", 8), tuning_suite("tuning", 8, robot=robot_of(T1))
    for a, b in zip(ours.scenarios, theirs.scenarios, strict=True):
        assert b.pushes[0].force == pytest.approx([MASS * force for force in a.pushes[0].force])
        assert b.pushes[0].duration == pytest.approx(HEIGHT**0.5 * a.pushes[0].duration)
        assert b.settle_time == pytest.approx(HEIGHT**0.5 * a.settle_time)


def test_forms_without_a_planner_of_their_own_and_presets_in_the_name_are_refused():
    for env_id in ("PushRecovery/T1Residual-v0", "PushRecovery/BipedJoint-v0"):
        with pytest.raises(UnknownNameError, match=f"environment to tune '{env_id}'"):
            check_env(env_id)
    with pytest.raises(InvalidValueError, match=r"^a study starts at a preset of its own: say --preset t1$"):
        check_env(f"{T1}@t1")


def test_it_is_tuned_on_punches_of_the_tour(tmp_path):
    fields, suite = ("planner.push_carry", "planner.push_threshold"), "tuning-punches"
    settings = TuningSettings(T1, "stage-1", only=fields, suite=suite, scenarios=8, held_out=8)
    found = tune_variants(settings, ["stage-1"], 1, directory=tmp_path).studies["stage-1"]
    config = json.loads((tmp_path / "stage-1" / "config.json").read_text())
    suites = [punched_suite(name, 8, biped_of(T1)) for name in (suite, f"{suite}-held-out")]
    assert [(own["name"], own["sha256"]) for own in config["suites"]] == [(s.name, s.sha256) for s in suites]
    assert found.start["score"] <= found.best["score"]
