"""Scaling a preset: what makes two walks alike stays, every number has its unit."""

import json
from dataclasses import fields, replace

import pytest
from push_recovery.controllers import settings
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.robot import natural_frequency
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import SECTIONS

PRESET = settings.PresetFile(
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
    assert settings.load_preset(str(tmp_path / "tuned.json")) == PRESET


def test_a_variant_takes_its_own_values_then_the_common_ones_then_the_base(tmp_path):
    base = settings.preset_config("biped")
    assert PRESET.config() == replace(base, touchdown_delay=0.006)
    own = settings.named_preset("biped").variants["stage-1"]
    assert PRESET.config("stage-1") == replace(base, **{**own, "touchdown_delay": 0.006})
    assert PRESET.config("passive") == PRESET.config()
    assert PRESET.config("two-stage") == replace(base, touchdown_delay=0.007, beta_dcm=900.0)
    assert settings.preset_config(write(tmp_path / "p.json")) == PRESET.config()


def test_a_name_is_a_file_that_changes_nothing():
    for name in settings.preset_names():
        for variant in ("", "two-stage", "stage-1+cop"):
            assert settings.load_preset(name).config(variant) == settings.named_preset(name).config(variant)


def test_policies_take_a_file_for_a_preset(tmp_path):
    policy = make_policy("stage-1", preset=write(tmp_path / "p.json"))
    assert policy.config == replace(PRESET.config("stage-1"), use_cop=False, use_trunk=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "policy"}, r"is no preset file: its 'format' is not 'push-recovery preset'$"),
        ({"format_version": 2}, r"has format_version 2; this version reads 1$"),
        ({"base": "bipd"}, r"^unknown base of a preset file 'bipd'; did you mean 'biped'\? \(valid: apo"),
        ({"plannr": {}}, r"^unknown section of preset file .* 'plannr'; did you mean 'planner'\?"),
        ({"planner": {"beta": 1.0}}, r"^unknown planner field of a preset file 'beta'.*\(valid: alpha_s"),
        ({"arms": {"two-stage": {"beta": 1.0}}}, r"^unknown planner field of a preset file 'beta'"),
        ({"base": ["biped"]}, r"^unknown base of a preset file \['biped'\]"),
        (
            {"arms": {"two-stag": {}}},
            r"^unknown variant of a preset file 'two-stag'; did you mean 'two-stage'\?",
        ),
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
        settings.load_preset(write(tmp_path / "bad.json", **changes))


def test_unreadable_files_and_unknown_names_are_refused(tmp_path):
    (tmp_path / "torn.json").write_text("{")
    for name in ("torn.json", "absent.json"):
        with pytest.raises(InvalidValueError, match=rf"preset file .*{name}"):
            settings.load_preset(str(tmp_path / name))
    with pytest.raises(
        UnknownNameError, match=r"^unknown preset 'bipd'; did you mean 'biped'\?.*FILE\.json\)$"
    ):
        settings.load_preset("bipd")


def test_the_named_presets_hold_the_paper_and_what_was_tuned():
    paper = settings.preset_config("paper")
    assert (paper.form, paper.alpha_step, paper.alpha_duration, paper.alpha_offset) == ("jerk", 1.0, 1.0, 1e3)
    betas = [f"beta_{name}" for name in ("cop", "dcm_acceleration", "trunk", "trunk_rate", "dcm")]
    assert [getattr(paper, name) for name in betas] == [1.0, 1.0, 1.0, 1.0, 1e5]  # Table II
    assert settings.preset_config("double-support") == settings.preset_config("default").replace(
        double_support=0.1, beta_trunk_angle=10.0
    )
    assert settings.named_preset("biped").robot()["gait"]["commit"] == settings.preset_config("biped").freeze


def test_a_file_changes_single_values_of_the_robot_of_its_base():
    sections, base = PRESET.robot(), settings.named_preset("biped").robot()
    assert sections["gains"].pop("swing_kp") == 350.0 != base["gains"].pop("swing_kp")
    assert sections == base
    assert settings.PresetFile("default").robot() == {}


OWN = settings.PresetFile(
    "biped",
    variants={
        "stage-1": {"biped": {"gains": {"swing_kp": 360.0}, "gait": {"apex": 0.05}}},
        "two-stage": {"touchdown_delay": 0.007},
        "raibert": {"push_carry": 0.01},
    },
    biped={"gains": {"swing_kp": 350.0, "swing_kd": 100.0}},
)


def test_a_variant_walks_its_own_robot_then_the_common_one_then_the_bases():
    robot, base = OWN.robot("stage-1"), settings.named_preset("biped").robot()
    assert robot["gains"] == {**base["gains"], "swing_kp": 360.0, "swing_kd": 100.0}
    assert robot["gait"] == {**base["gait"], "apex": 0.05}
    assert robot["limits"] == base["limits"]
    assert OWN.robot("passive") == OWN.robot() == {**base, "gains": {**base["gains"], **OWN.biped["gains"]}}
    assert OWN.config("stage-1") == settings.named_preset("biped").config("stage-1")


def test_an_own_robot_is_one_that_differs_or_touches_down_at_another_time():
    names = "stage-1", "two-stage", "stage-1+cop", "passive", ""
    assert [OWN.has_own_robot(name) for name in names] == [True, True, False, False, False]
    base = settings.named_preset("biped")
    own = [variant for variant in ("raibert", "stage-1", "two-stage") if base.has_own_robot(variant)]
    assert own == ["raibert"]  # whose steps are shorter


def test_replace_names_the_nearest_field():
    config = settings.PlannerConfig()
    assert config.replace(beta_dcm=5.0) == replace(config, beta_dcm=5.0)
    with pytest.raises(
        UnknownNameError, match=r"^unknown field of PlannerConfig 'beta_dmc'; did you mean 'beta_dcm'\?"
    ):
        config.replace(beta_dmc=5.0)
    with pytest.raises(InvalidValueError, match=r"^PlannerConfig.beta_dcm must be finite"):
        config.replace(beta_dcm=-5.0)


BIPED = settings.named_preset("biped")
SAME = settings.Scale(1.0, 1.0, 1.0, 1.0, 1.0)
SMALL = settings.Scale(length=0.5, mass=0.1, foot_length=0.6, foot_width=0.7, leg=0.55, waist=0.2, lean=0.3)
PURE = {  # numbers without a unit, accelerations and shares of the weight, which are alike, and numerics
    "planner": {"alpha_duration", "first_interval_min"},
    "limits": set(),
    "gait": {"forced_phase", "twist_max", "turn_back"},
    "gains": {"damping"},
    "bounds": {"friction", "com_price", "height_price", "swing_price", "row_price"},
}


def test_every_number_has_a_unit_or_none():
    numbers = {field.name for field in fields(settings.PlannerConfig) if isinstance(field.default, float)}
    for section, names in {
        "planner": numbers,
        **{name: set(part) for name, part in SECTIONS.items()},
    }.items():
        assert set(settings.UNITS[section]) | PURE[section] == names
        assert not set(settings.UNITS[section]) & PURE[section]


def test_a_robot_as_large_as_the_biped_has_its_preset():
    same = settings.scaled_preset(BIPED, SAME, {})
    for variant in ("", *BIPED.variants):
        assert same.config(variant) == BIPED.config(variant)
        assert same.robot(variant) == BIPED.robot(variant)


def test_a_smaller_robot_walks_alike():
    """Time in units of 1/omega, lengths in CoM heights, stiffness in omega^2, loads in weights."""
    small, config = settings.scaled_preset(BIPED, SMALL, {}), BIPED.config()
    one, other = small.robot(), BIPED.robot()
    faster = natural_frequency(0.4) / natural_frequency(0.8)
    assert one["limits"]["duration_min"] * faster == pytest.approx(other["limits"]["duration_min"], rel=1e-5)
    assert small.config().touchdown_delay * faster == pytest.approx(config.touchdown_delay, rel=1e-5)
    assert one["gains"]["swing_kp"] == pytest.approx(faster**2 * other["gains"]["swing_kp"], rel=1e-5)
    assert one["gains"]["pelvis_kd"] == pytest.approx(faster * other["gains"]["pelvis_kd"], rel=1e-5)
    assert one["limits"]["length_max"] == pytest.approx(0.5 * other["limits"]["length_max"], rel=1e-5)
    assert one["gait"]["descent"] * faster == pytest.approx(other["gait"]["descent"], rel=1e-5)
    assert one["gait"]["forced_load"] == pytest.approx(0.1 * other["gait"]["forced_load"], rel=1e-5)
    assert small.config().beta_dcm * 0.5**2 == pytest.approx(config.beta_dcm, rel=1e-5)
    assert one["bounds"]["cop_y_max"] == pytest.approx(0.7 * other["bounds"]["cop_y_max"], rel=1e-5)


def test_what_leaning_spares_the_com_sets_its_price():
    """A trunk of a fifth of the effect may turn five times as fast for the same price."""
    one, other = settings.scaled_preset(BIPED, SMALL, {}).robot()["bounds"], BIPED.robot()["bounds"]
    assert one["waist_price"] * 5.0**2 == pytest.approx(other["waist_price"], rel=1e-5)
    assert one["swing_price"] == other["swing_price"]


def test_slower_legs_step_later_and_swing_less():
    """A quarter of the acceleration takes twice the time for the same way."""
    slow = settings.scaled_preset(BIPED, replace(SAME, swing=0.25), {})
    limits, gains, config = slow.robot()["limits"], slow.robot()["gains"], BIPED.config()
    for name in ("duration_min", "duration_max"):
        assert limits[name] == pytest.approx(2.0 * BIPED.robot()["limits"][name], rel=1e-5)
    assert gains["swing_max"] == pytest.approx(0.25 * BIPED.robot()["gains"]["swing_max"], rel=1e-5)
    assert slow.config().swing_acceleration == pytest.approx(0.25 * config.swing_acceleration, rel=1e-5)
    assert limits["length_max"] == BIPED.robot()["limits"]["length_max"]
    assert slow.config().freeze == config.freeze


def test_variants_keep_what_is_theirs_and_changes_come_last():
    small = settings.scaled_preset(
        BIPED, SMALL, {"planner": {"alpha_step": 3.0}, "limits": {"width_max": 0.4}}
    )
    raibert, own = small.robot("raibert")["limits"], BIPED.robot("raibert")["limits"]
    assert raibert["duration_max"] == pytest.approx(0.5**0.5 * own["duration_max"], rel=1e-5)
    assert (small.config().alpha_step, small.robot()["limits"]["width_max"]) == (3.0, 0.4)


def test_numbers_of_a_robot_four_times_as_high_have_the_factors_of_their_units():
    """Times double; its other ratios are primes, so that each says what a number goes with."""
    scale = settings.Scale(4.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0)
    factors = {
        "planner": {
            "alpha_offset": 1 / 16, "freeze": 2.0, "push_threshold": 4.0, "swing_acceleration": 29.0,
            "beta_dcm_acceleration": 1.0, "beta_trunk": 1 / 169, "beta_trunk_rate": 1 / (13 * 17),
            "beta_trunk_limit": 1 / 289, "trunk_gravity": 12.0, "cop_margin_x": 5.0, "cop_margin_y": 7.0,
            "mpc_velocity": 4.0, "mpc_jerk": 64.0, "mpc_step": 2.0, "standing_horizon": 2.0,
            "upright_stiffness": 1 / 4, "upright_damping": 1 / 2,
        },
        "limits": {"width_min": 7.0, "width_max": 4.0, "cop_x_max": 5.0, "trunk_acceleration_max": 13.0},
        "gait": {"apex": 4.0, "landing_delay": 2.0, "early_load": 3.0, "descent": 2.0, "reach": 11.0},
        "gains": {"swing_turn_kp": 1 / 4, "height_kd": 1 / 2},
        "bounds": {
            "yaw_friction": 5.0, "force_min": 3.0, "waist_price": 361.0, "pelvis_price": 529.0,
            "heading_price": 16.0, "swing_turn_price": 16.0,
        },
    }  # fmt: skip
    for section, expected in factors.items():
        found = {name: scale.factor(settings.UNITS[section][name]) for name in expected}
        assert found == pytest.approx(expected)


def test_what_a_variant_changes_is_scaled_as_what_is_common():
    small, time = settings.scaled_preset(BIPED, SMALL, {}), 0.5**0.5
    for variant in ("raibert", "herdt", "stage-1+momentum"):
        one, other = small.config(variant), BIPED.config(variant)
        assert one.push_carry == pytest.approx(time * other.push_carry, rel=1e-5)
        assert one.push_threshold == pytest.approx(0.5 * other.push_threshold, rel=1e-5)
        assert one.trunk_gravity == pytest.approx(0.1 * 0.5 * other.trunk_gravity, rel=1e-5)


def test_under_froudes_similarity_every_number_goes_with_its_dimension():
    """Lengths times 4, masses times 64, g the same: metres by 4, seconds by 2, weights by 64 and so on."""
    scale = settings.Scale(4.0, 64.0, 4.0, 4.0, 4.0, trunk_acceleration=0.25, waist=4.0, lean=4.0)
    powers = {  # of 4
        "planner": {
            -2.0: "alpha_step alpha_offset beta_cop beta_dcm", -1.0: "upright_stiffness",
            -0.5: "upright_damping",
            0.0: "swing_acceleration beta_dcm_acceleration beta_trunk_angle beta_trunk_limit",
            0.5: "duration_margin freeze touchdown_delay double_support push_carry sampling_time "
            "tail_sampling_time mpc_step standing_carry standing_horizon",
            1.0: "push_threshold beta_trunk_rate cop_margin_x cop_margin_y mpc_velocity",
            2.0: "beta_trunk", 3.0: "mpc_jerk", 4.0: "trunk_gravity",
        },
        "limits": {
            1.0: "length_min length_max width_min width_max cop_x_max cop_y_max",
            0.5: "duration_min duration_max", -1.0: "trunk_acceleration_max",
        },
        "gait": {
            1.0: "apex height_drop reach", 3.0: "early_load forced_load",
            0.5: "landing_delay commit early settled height_lead height_time descent",
        },
        "gains": {
            0.0: "swing_max", -1.0: "stance_kp swing_kp swing_turn_kp pelvis_kp heading_kp height_kp",
            -0.5: "stance_kd swing_kd swing_turn_kd pelvis_kd heading_kd height_kd",
        },
        "bounds": {
            1.0: "cop_x_max cop_y_max yaw_friction", 3.0: "force_min",
            2.0: "waist_price pelvis_price heading_price swing_turn_price",
        },
    }  # fmt: skip
    for section, by_power in powers.items():
        expected = {name: 4.0**power for power, names in by_power.items() for name in names.split()}
        found = {name: scale.factor(unit) for name, unit in settings.UNITS[section].items()}
        assert found == pytest.approx(expected)
