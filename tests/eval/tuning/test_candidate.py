"""A point's settings as a preset: what becomes the arm's own, every arm's, the robot's."""

from push_recovery.eval.tuning.candidate import preset_of
from push_recovery.eval.tuning.settings import TuningSettings

SETTINGS = TuningSettings("PushRecovery/Biped-v0", "two-stage", space="both", scenarios=8)


def test_each_group_goes_where_it_belongs():
    values = {
        "planner": {"beta_dcm": 123.0}, "shared": {"touchdown_delay": 0.007}, "gait": {"apex": 0.05},
        "gains": {"swing_kp": 321.0},
    }  # fmt: skip
    preset = preset_of(SETTINGS, values, {"by": "hand"})
    assert preset.base == "biped"
    assert dict(preset.planner) == {"touchdown_delay": 0.007}
    assert {name: dict(own) for name, own in preset.arms.items()} == {"two-stage": {"beta_dcm": 123.0}}
    assert preset.biped == {"gait": {"apex": 0.05}, "gains": {"swing_kp": 321.0}}
    assert preset.found == {"by": "hand"}
    assert preset.config("two-stage").beta_dcm == 123.0
    assert preset.config("stage-1").beta_dcm != 123.0
    assert preset.config("stage-1").touchdown_delay == 0.007


def test_the_planner_holds_its_plan_when_the_gait_machine_commits_the_foot():
    preset = preset_of(SETTINGS, {"gait": {"commit": 0.035}})
    assert preset.robot()["gait"]["commit"] == 0.035
    assert preset.config("two-stage").freeze == preset.config("stage-1").freeze == 0.035


def test_what_the_start_says_of_an_arm_stays_beside_what_is_tuned(tmp_path):
    first = preset_of(SETTINGS, {"planner": {"beta_dcm": 123.0, "beta_trunk": 5.0}, "gait": {"apex": 0.05}})
    first.save(tmp_path / "first.json")
    settings = TuningSettings(
        "PushRecovery/Biped-v0", "two-stage", space="both", scenarios=8, preset=str(tmp_path / "first.json")
    )
    again = preset_of(settings, {"planner": {"beta_dcm": 7.0}, "gait": {"early": 0.01}})
    assert dict(again.arms["two-stage"]) == {"beta_dcm": 7.0, "beta_trunk": 5.0}
    assert again.biped["gait"] == {"apex": 0.05, "early": 0.01}
