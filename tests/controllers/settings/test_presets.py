import json
from dataclasses import replace

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import (
    PlannerConfig,
    PresetFile,
    load_preset,
    named_preset,
    preset_config,
    preset_names,
)

PRESET = PresetFile(
    "biped",
    {"touchdown_delay": 0.006},
    {"two-stage": {"beta_dcm": 900.0, "touchdown_delay": 0.007}},
    {"gains": {"swing_kp": 350.0}},
    {"trials": 3},
)


def write(path, **changes):
    path.write_text(json.dumps({**PRESET.to_dict(), **changes}))
    return str(path)


def test_a_file_is_read_as_it_was_written(tmp_path):
    PRESET.save(tmp_path / "tuned.json")
    assert load_preset(str(tmp_path / "tuned.json")) == PRESET


def test_an_arm_takes_its_own_values_then_the_common_ones_then_the_base(tmp_path):
    base = preset_config("biped")
    assert PRESET.config() == replace(base, touchdown_delay=0.006)
    own = named_preset("biped").arms["stage-1"]
    assert PRESET.config("stage-1") == replace(base, **{**own, "touchdown_delay": 0.006})
    assert PRESET.config("passive") == PRESET.config()
    assert PRESET.config("two-stage") == replace(base, touchdown_delay=0.007, beta_dcm=900.0)
    assert preset_config(write(tmp_path / "p.json")) == PRESET.config()


def test_a_name_is_a_file_that_changes_nothing():
    for name in preset_names():
        for arm in ("", "two-stage", "stage-1+cop"):
            assert load_preset(name).config(arm) == named_preset(name).config(arm)


def test_policies_take_a_file_for_a_preset(tmp_path):
    policy = make_policy("stage-1", preset=write(tmp_path / "p.json"))
    assert policy.config == replace(PRESET.config("stage-1"), use_cop=False, use_trunk=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "policy"}, r"is no preset file: its 'format' is not 'push-recovery preset'$"),
        ({"format_version": 2}, r"has format_version 2; this version reads 1$"),
        ({"base": "bipd"}, r"^unknown base of a preset file 'bipd'; did you mean 'biped'\? \(valid: biped, "),
        ({"plannr": {}}, r"^unknown section of preset file .* 'plannr'; did you mean 'planner'\?"),
        ({"planner": {"beta": 1.0}}, r"^unknown planner field of a preset file 'beta'.*\(valid: alpha_s"),
        ({"arms": {"two-stage": {"beta": 1.0}}}, r"^unknown planner field of a preset file 'beta'"),
        ({"base": ["biped"]}, r"^unknown base of a preset file \['biped'\]"),
        ({"arms": {"two-stag": {}}}, r"^unknown arm of a preset file 'two-stag'; did you mean 'two-stage'\?"),
        ({"planner": {"sampling_time": 1e-12}}, r"^PlannerConfig.sampling_time must be at least 0.001 s"),
        ({"planner": {"tail_intervals": 10**9}}, r"^PlannerConfig.tail_intervals must be an integer from"),
        ({"planner": {"beta_dcm": -1.0}}, r"^PlannerConfig.beta_dcm must be finite and >= 0, got -1.0$"),
        ({"arms": {"two-stage": 3}}, r"^arms.two-stage of a preset file must be an object, got 3$"),
        ({"biped": []}, r"^biped of a preset file must be an object, got \[\]$"),
        ({"biped": {"gait": 1}}, r"^biped.gait of a preset file must be an object, got 1$"),
        ({"arms": {"two-stage": {"biped": 4}}}, r"^arms.two-stage.biped of a preset file must be an object"),
        (
            {"arms": {"two-stage": {"biped": {"gait": 5}}}},
            r"^arms.two-stage.biped.gait of a preset file must be an object, got 5$",
        ),
    ],
)  # fmt: skip
def test_bad_files_are_refused(tmp_path, changes, message):
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        load_preset(write(tmp_path / "bad.json", **changes))


def test_unreadable_files_and_unknown_names_are_refused(tmp_path):
    (tmp_path / "torn.json").write_text("{")
    for name in ("torn.json", "absent.json"):
        with pytest.raises(InvalidValueError, match=rf"preset file .*{name}"):
            load_preset(str(tmp_path / name))
    with pytest.raises(
        UnknownNameError, match=r"^unknown preset 'bipd'; did you mean 'biped'\?.*FILE\.json\)$"
    ):
        load_preset("bipd")


def test_the_named_presets_hold_the_paper_and_what_was_tuned():
    paper = preset_config("paper")
    assert (paper.form, paper.alpha_offset, paper.beta_dcm, paper.beta_trunk) == ("jerk", 1000.0, 1e5, 1.0)
    assert preset_config("double-support") == preset_config("default").replace(
        double_support=0.1, beta_trunk_angle=10.0
    )
    assert named_preset("biped").robot()["gait"]["commit"] == preset_config("biped").freeze


def test_a_file_changes_single_values_of_the_robot_of_its_base():
    sections, base = PRESET.robot(), named_preset("biped").robot()
    assert sections["gains"].pop("swing_kp") == 350.0 != base["gains"].pop("swing_kp")
    assert sections == base
    assert PresetFile("default").robot() == {}


OWN = PresetFile(
    "biped",
    arms={
        "stage-1": {"biped": {"gains": {"swing_kp": 360.0}, "gait": {"apex": 0.05}}},
        "two-stage": {"touchdown_delay": 0.007},
        "raibert": {"push_carry": 0.01},
    },
    biped={"gains": {"swing_kp": 350.0, "swing_kd": 100.0}},
)


def test_an_arm_walks_its_own_robot_then_the_common_one_then_the_bases():
    robot, base = OWN.robot("stage-1"), named_preset("biped").robot()
    assert robot["gains"] == {**base["gains"], "swing_kp": 360.0, "swing_kd": 100.0}
    assert robot["gait"] == {**base["gait"], "apex": 0.05}
    assert robot["limits"] == base["limits"]
    assert OWN.robot("passive") == OWN.robot() == {**base, "gains": {**base["gains"], **OWN.biped["gains"]}}
    assert OWN.config("stage-1") == named_preset("biped").config("stage-1")


def test_an_own_robot_is_one_that_differs_or_touches_down_at_another_time():
    assert [OWN.has_own_robot(arm) for arm in ("stage-1", "two-stage", "stage-1+cop", "passive", "")] == [
        True, True, False, False, False,
    ]  # fmt: skip
    base = named_preset("biped")
    own = [arm for arm in ("raibert", "stage-1", "two-stage") if base.has_own_robot(arm)]
    assert own == ["raibert"]  # whose steps are shorter


def test_replace_names_the_nearest_field():
    config = PlannerConfig()
    assert config.replace(beta_dcm=5.0) == replace(config, beta_dcm=5.0)
    with pytest.raises(
        UnknownNameError, match=r"^unknown field of PlannerConfig 'beta_dmc'; did you mean 'beta_dcm'\?"
    ):
        config.replace(beta_dmc=5.0)
    with pytest.raises(InvalidValueError, match=r"^PlannerConfig.beta_dcm must be finite"):
        config.replace(beta_dcm=-5.0)
