"""Options of the physics as values: JSON, bounds, and that the default is what there always was.

Model errors as values: JSON, mirror, bounds, and draws from ranges.
"""

import math
import re
from dataclasses import dataclass, fields

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.distribution import ErrorRanges, PushDistribution
from push_recovery.envs.scenario.model_errors import (
    BOUNDS,
    CONTROL_STEP,
    EXACT_MODEL,
    PLAIN_PHYSICS,
    ModelErrors,
    PhysicsOptions,
)
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.envs.scenario.terrain import Terrain, register_terrain


@register_terrain
@dataclass(frozen=True)
class Ledge(Terrain):
    """A terrain whose model is the plane's, to be written and read."""

    json_name = "ledge"
    left: float

    def mirrored(self):
        return Ledge(-self.left)


FINE = PhysicsOptions(
    time_step=0.0005, integrator="rk4", solver="cg", cone="elliptic", impratio=10.0, contact_time=0.02
)


def test_the_default_is_one_step_of_physics_in_one_of_control():
    assert PLAIN_PHYSICS.time_step == CONTROL_STEP
    assert PLAIN_PHYSICS.steps == 1
    assert PLAIN_PHYSICS.to_dict() == {}
    assert "physics" not in Scenario("a").to_dict()
    assert Scenario.from_dict({"id": "a", "physics": {}}) == Scenario("a")


def test_json_round_trip_names_only_what_differs():
    scenario = Scenario("a", physics=FINE)
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert scenario.mirrored().physics == FINE
    assert PhysicsOptions(cone="pyramidal").to_dict() == {"cone": "pyramidal"}  # said, not assumed


@pytest.mark.parametrize(
    ("time_step", "steps"), [(0.002, 1), (0.001, 2), (0.0005, 4), (0.002 / 3, 3), (1e-4, 20)]
)
def test_a_step_of_control_holds_a_whole_number_of_steps(time_step, steps):
    assert PhysicsOptions(time_step=time_step).steps == steps


@pytest.mark.parametrize("time_step", [0.0015, 0.003, 0.004, 1e-5])
def test_no_other_time_step_is_taken(time_step):
    with pytest.raises(InvalidValueError, match="time_step"):
        PhysicsOptions(time_step=time_step)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"impratio": 0.0}, "PhysicsOptions.impratio must be in [0.1, 1000], got 0"),
        ({"contact_time": 1.0}, "PhysicsOptions.contact_time [s] must be in [0.0001, 0.2], got 1"),
        ({"cone": "eliptic"}, "did you mean 'elliptic'"),
        ({"integrator": 4}, "integrator"),
        ({"time_step": "fast"}, "time_step [s] must be a number"),
    ],
)
def test_bad_values_name_the_bound(values, text):
    with pytest.raises(PushRecoveryError, match=re.escape(text)):
        PhysicsOptions(**values)


def test_a_scenario_takes_options_only():
    with pytest.raises(UnknownNameError, match="did you mean 'impratio'"):
        Scenario.from_dict({"id": "a", "physics": {"imratio": 3}})
    with pytest.raises(InvalidValueError, match=re.escape("Scenario.physics must be a PhysicsOptions")):
        Scenario("a", physics={"impratio": 3})  # type: ignore[arg-type]


ALL = ModelErrors(
    mass=0.1, payload=4.0, trunk_com=(0.01, -0.02, 0.03), friction=0.6, slope_forward=0.05, slope_left=-0.03,
    delay=0.01, dcm_noise=0.01, joint_noise=0.002, floor_step=0.02, joint_friction=1.0, joint_damping=0.5,
    armature=0.03, collisions=True, motor_power=2000.0, bus_power=3000.0,
    continuous_torque=0.4, terrain=Ledge(0.3), floor_known=True,
)  # fmt: skip
RANGES = ErrorRanges(mass=(-0.1, 0.2), friction=(0.4, 1.2), delay=(0.002, 0.01), trunk_com=(-0.02, 0.02))


def test_all_is_all():
    assert ALL.names == tuple(field.name for field in fields(ModelErrors))
    assert EXACT_MODEL.names == ()


def test_a_scenario_without_errors_is_written_as_ever():
    scenario = Scenario("a")
    assert scenario.to_json() == (
        '{"command":{"vx":0.0,"vy":0.0},"duration":null,"id":"a","noise_seed":0,"pushes":[],'
        '"settle_time":4.0,"stance_side":"left"}'
    )
    assert Scenario.from_dict({**scenario.to_dict(), "errors": {}}) == scenario
    assert "errors" not in PushDistribution().to_dict()


def test_json_round_trip_names_only_what_is_off():
    scenario = Scenario("a", errors=ALL)
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert ModelErrors(friction=0.6).to_dict() == {"friction": 0.6}
    assert ModelErrors.from_json('{"trunk_com": [0, 0.01, 0]}') == ModelErrors(trunk_com=(0.0, 0.01, 0.0))
    assert ModelErrors(friction=0.9).to_dict() == {"friction": 0.9}  # said, not assumed


def test_the_mirror_is_an_involution_that_keeps_what_has_no_side():
    mirror = ALL.mirrored()
    assert mirror.trunk_com == (0.01, 0.02, 0.03)
    assert (mirror.slope_forward, mirror.slope_left, mirror.terrain) == (0.05, 0.03, Ledge(-0.3))
    assert mirror.mirrored() == ALL
    assert Scenario("a", errors=ALL).mirrored().errors == mirror
    assert math.copysign(1.0, EXACT_MODEL.mirrored().slope_left) == 1.0
    assert EXACT_MODEL.mirrored() == EXACT_MODEL


@pytest.mark.parametrize("name", BOUNDS)
def test_values_out_of_bounds_name_the_bound(name):
    unit, low, high = BOUNDS[name]
    ModelErrors(**{name: low}), ModelErrors(**{name: high})
    for bad in (low - 0.01, high + 0.01):
        text = f"ModelErrors.{name}{unit} must be in [{low:g}, {high:g}], got {bad:g}"
        with pytest.raises(InvalidValueError, match=re.escape(text)):
            ModelErrors(**{name: bad})
    with pytest.raises(InvalidValueError, match="must be finite"):
        ModelErrors(**{name: math.nan})


def test_other_bad_values_name_themselves():
    with pytest.raises(InvalidValueError, match=r"trunk_com y \[m\] must be in \[-0.1, 0.1\], got 0.2"):
        ModelErrors(trunk_com=(0.0, 0.2, 0.0))
    with pytest.raises(UnknownNameError, match="did you mean 'friction'"):
        ModelErrors.from_dict({"fricton": 0.5})
    for text in ("{", "[]", "3", '{"mass": "heavy"}', '{"trunk_com": 3}'):
        with pytest.raises(PushRecoveryError):
            ModelErrors.from_json(text)
    with pytest.raises(InvalidValueError, match="errors must be ModelErrors, got 3"):
        Scenario("a", errors=3)  # type: ignore[arg-type]


def test_ranges_are_kept_and_filled():
    rng = np.random.default_rng(0)
    drawn = [RANGES.sample(rng) for _ in range(400)]
    for name, (low, high) in (("mass", (-0.1, 0.2)), ("friction", (0.4, 1.2))):
        values = np.array([getattr(errors, name) for errors in drawn])
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() <= high
        assert abs(values.mean() - (low + high) / 2) < 0.06 * (high - low)
    offsets = np.array([errors.trunk_com for errors in drawn])
    assert np.abs(offsets).max() <= 0.02
    assert np.abs(np.corrcoef(offsets.T) - np.eye(3)).max() < 0.2
    steps = {round(errors.delay / CONTROL_STEP, 9) for errors in drawn}
    assert steps == {1.0, 2.0, 3.0, 4.0, 5.0}
    assert all(errors.slope_left == errors.dcm_noise == 0.0 for errors in drawn)


def test_one_more_range_changes_no_other_draw():
    more = ErrorRanges(**{**vars(RANGES), "payload": (0.0, 5.0), "slope_left": (-0.05, 0.05)})
    for seed in range(5):
        a, b = (ranges.sample(np.random.default_rng(seed)) for ranges in (RANGES, more))
        assert (a.mass, a.friction, a.delay, a.trunk_com) == (b.mass, b.friction, b.delay, b.trunk_com)
        assert b.payload > 0.0


def test_losses_draw_from_a_generator_of_their_own():
    """Fields that came later take no number of the one that goes on to the next scenario."""
    more = ErrorRanges(**{**vars(RANGES), "joint_friction": (0.5, 2.0), "bus_power": (1000.0, 3000.0)})
    rngs = [np.random.default_rng(3) for _ in range(2)]
    a, b = (ranges.sample(rng) for ranges, rng in zip((RANGES, more), rngs, strict=True))
    assert a == ModelErrors(**{name: getattr(b, name) for name in a.names})
    assert rngs[0].random() == rngs[1].random()
    drawn = [more.sample(rngs[0]) for _ in range(400)]
    friction, power = (
        np.array([getattr(e, name) for e in drawn]) for name in ("joint_friction", "bus_power")
    )
    assert 0.5 <= friction.min() < 0.53
    assert 1.97 < friction.max() <= 2.0
    assert abs(power.mean() - 2000.0) < 100.0
    assert abs(np.corrcoef(friction, power)[0, 1]) < 0.2


def test_as_many_numbers_are_drawn_as_before_there_were_losses():
    rngs = [np.random.default_rng(3) for _ in range(2)]
    RANGES.sample(rngs[0])
    rngs[1].random(12)
    assert rngs[0].random() == rngs[1].random()


@pytest.mark.parametrize("value", [1, "yes", None])
def test_switches_are_on_or_off(value):
    with pytest.raises(InvalidValueError, match="collisions must be true or false"):
        ModelErrors(collisions=value)


def test_a_distribution_draws_the_same_pushes_with_and_without_errors():
    plain, off = PushDistribution(), PushDistribution(errors=RANGES)
    a, b = plain.sample(np.random.default_rng(4)), off.sample(np.random.default_rng(4))
    assert a.errors == EXACT_MODEL
    assert b.errors.names == ("mass", "trunk_com", "friction", "delay")
    assert (a.id, a.pushes, a.command, a.noise_seed) == (b.id, b.pushes, b.command, b.noise_seed)
    rngs = [np.random.default_rng(4) for _ in range(2)]
    plain.sample(rngs[0])
    rngs[1].random(8), rngs[1].integers(2**31)
    assert rngs[0].random() == rngs[1].random()  # no draw more than before there were errors


def test_ranges_as_json():
    distribution = PushDistribution(impulse_max=40.0, errors=RANGES)
    data = distribution.to_dict()
    assert data["errors"] == {
        "mass": [-0.1, 0.2], "friction": [0.4, 1.2], "delay": [0.002, 0.01], "trunk_com": [-0.02, 0.02],
    }  # fmt: skip
    assert PushDistribution.from_dict(data) == distribution


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"mass": (0.1, -0.1)}, "mass must have low <= high, got 0.1 > -0.1"),
        ({"mass": (0.0, 3.0)}, "mass must be in [-0.5, 0.5], got 3"),
        ({"mass": 0.1}, "mass must be (low, high), got 0.1"),
        ({"friction": (0.1, 1.0)}, "friction must be in [0.2, 2], got 0.1"),
        ({"delay": (0.0005, 0.001)}, "delay must hold a multiple of 0.002 s, got (0.0005, 0.001)"),
    ],
)
def test_bad_ranges_name_the_bound(values, text):
    with pytest.raises(InvalidValueError, match=re.escape(text)):
        ErrorRanges(**values)
    with pytest.raises(InvalidValueError, match="errors must be ErrorRanges"):
        PushDistribution(errors=0.1)  # type: ignore[arg-type]


def test_the_bounds_are_those_of_the_page():
    five = math.radians(5.0)
    assert {name: bounds[1:] for name, bounds in BOUNDS.items()} == {
        "mass": (-0.5, 0.5), "payload": (0.0, 30.0), "friction": (0.2, 2.0), "slope_forward": (-five, five),
        "slope_left": (-five, five), "delay": (0.0, 0.05), "dcm_noise": (0.0, 0.1),
        "joint_noise": (0.0, 0.05), "floor_step": (0.0, 0.05), "joint_friction": (0.0, 20.0),
        "joint_damping": (0.0, 20.0),
        "armature": (0.0, 1.0), "motor_power": (1.0, 1e6), "bus_power": (1.0, 1e6),
        "continuous_torque": (0.1, 1.0),
    }  # fmt: skip
