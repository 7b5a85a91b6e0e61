"""Scaling a preset: what makes two walks alike stays, every number has its unit."""

from dataclasses import fields, replace

import pytest
from push_recovery.controllers.model.robot import natural_frequency
from push_recovery.controllers.settings import UNITS, PlannerConfig, Scale, named_preset, scaled_preset
from push_recovery.envs.biped.core import SECTIONS

BIPED = named_preset("biped")
SAME = Scale(1.0, 1.0, 1.0, 1.0, 1.0)
SMALL = Scale(length=0.5, mass=0.1, foot_length=0.6, foot_width=0.7, leg=0.55, waist=0.2, lean=0.3)
PURE = {  # numbers without a unit, accelerations and shares of the weight, which are alike, and numerics
    "planner": {"alpha_duration", "first_interval_min"},
    "limits": set(),
    "gait": {"forced_phase", "twist_max"},
    "gains": {"damping"},
    "bounds": {"friction", "com_price", "height_price", "swing_price", "row_price"},
}


def test_every_number_has_a_unit_or_none():
    numbers = {field.name for field in fields(PlannerConfig) if isinstance(field.default, float)}
    for section, names in {
        "planner": numbers,
        **{name: set(part) for name, part in SECTIONS.items()},
    }.items():
        assert set(UNITS[section]) | PURE[section] == names
        assert not set(UNITS[section]) & PURE[section]


def test_a_robot_as_large_as_the_biped_has_its_preset():
    same = scaled_preset(BIPED, SAME, {})
    for arm in ("", *BIPED.arms):
        assert same.config(arm) == BIPED.config(arm)
        assert same.robot(arm) == BIPED.robot(arm)


def test_a_smaller_robot_walks_alike():
    """Time in units of 1/omega, lengths in CoM heights, stiffness in omega^2, loads in weights."""
    small, config = scaled_preset(BIPED, SMALL, {}), BIPED.config()
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
    one, other = scaled_preset(BIPED, SMALL, {}).robot()["bounds"], BIPED.robot()["bounds"]
    assert one["waist_price"] * 5.0**2 == pytest.approx(other["waist_price"], rel=1e-5)
    assert one["swing_price"] == other["swing_price"]


def test_slower_legs_step_later_and_swing_less():
    """A quarter of the acceleration takes twice the time for the same way."""
    slow = scaled_preset(BIPED, replace(SAME, swing=0.25), {})
    limits, gains, config = slow.robot()["limits"], slow.robot()["gains"], BIPED.config()
    for name in ("duration_min", "duration_max"):
        assert limits[name] == pytest.approx(2.0 * BIPED.robot()["limits"][name], rel=1e-5)
    assert gains["swing_max"] == pytest.approx(0.25 * BIPED.robot()["gains"]["swing_max"], rel=1e-5)
    assert slow.config().swing_acceleration == pytest.approx(0.25 * config.swing_acceleration, rel=1e-5)
    assert limits["length_max"] == BIPED.robot()["limits"]["length_max"]
    assert slow.config().freeze == config.freeze


def test_arms_keep_what_is_theirs_and_changes_come_last():
    small = scaled_preset(BIPED, SMALL, {"planner": {"alpha_step": 3.0}, "limits": {"width_max": 0.4}})
    raibert, own = small.robot("raibert")["limits"], BIPED.robot("raibert")["limits"]
    assert raibert["duration_max"] == pytest.approx(0.5**0.5 * own["duration_max"], rel=1e-5)
    assert (small.config().alpha_step, small.robot()["limits"]["width_max"]) == (3.0, 0.4)
