"""A point's settings as a preset, and the space that a preset starts."""

from push_recovery.controllers.settings import PresetFile, named_preset
from push_recovery.eval.tuning.study import TuningSettings, preset_of, space_of

SETTINGS = TuningSettings("PushRecovery/Biped-v0", "two-stage", space="both", scenarios=8)


def test_all_that_is_tuned_becomes_the_arms_own():
    values = {
        "planner": {"beta_dcm": 123.0, "touchdown_delay": 0.007}, "gait": {"apex": 0.05},
        "gains": {"swing_kp": 321.0},
    }  # fmt: skip
    preset = preset_of(SETTINGS, values, {"by": "hand"})
    assert preset.base == "biped"
    assert preset.planner == preset.biped == {}
    robot = {"gait": {"apex": 0.05}, "gains": {"swing_kp": 321.0}}
    assert preset.arms == {"two-stage": {**values["planner"], "biped": robot}}
    assert preset.found == {"by": "hand"}
    assert preset.config("two-stage").beta_dcm == 123.0
    assert preset.config("stage-1") == named_preset("biped").config("stage-1")
    assert preset.robot("stage-1") == named_preset("biped").robot()


def test_the_planner_holds_its_plan_when_the_gait_machine_commits_the_foot():
    preset = preset_of(SETTINGS, {"gait": {"commit": 0.035}})
    assert preset.robot("two-stage")["gait"]["commit"] == preset.config("two-stage").freeze == 0.035
    assert preset.robot()["gait"]["commit"] == preset.config("stage-1").freeze != 0.035


def test_what_the_start_says_of_an_arm_stays_beside_what_is_tuned(tmp_path):
    first = preset_of(SETTINGS, {"planner": {"beta_dcm": 123.0, "beta_trunk": 5.0}, "gait": {"apex": 0.05}})
    first.save(tmp_path / "first.json")
    settings = TuningSettings(
        "PushRecovery/Biped-v0", "two-stage", space="both", scenarios=8, preset=str(tmp_path / "first.json")
    )
    again = preset_of(settings, {"planner": {"beta_dcm": 7.0}, "gait": {"early": 0.01}})
    robot = {"gait": {"apex": 0.05, "early": 0.01}}
    assert again.arms == {"two-stage": {"beta_dcm": 7.0, "beta_trunk": 5.0, "biped": robot}}


def test_a_search_starts_where_the_arm_is(tmp_path):
    own = {"touchdown_delay": 0.009, "biped": {"gait": {"apex": 0.05}}}
    PresetFile("biped", arms={"two-stage": own}).save(tmp_path / "own.json")
    start = {"space": "both", "scenarios": 8, "preset": str(tmp_path / "own.json")}
    found = {}
    for name in ("two-stage", "stage-1"):
        space = space_of(TuningSettings("PushRecovery/Biped-v0", name, **start))
        found[name] = space.settings([0.0] * len(space.start))
    assert found["two-stage"]["gait"]["apex"] == 0.05
    assert found["two-stage"]["planner"]["touchdown_delay"] == 0.009
    assert found["stage-1"]["gait"]["apex"] == named_preset("biped").robot()["gait"]["apex"]
