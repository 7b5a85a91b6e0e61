"""Scenarios for a robot of another size: forces, times, lengths and what follows from them, by hand."""

import numpy as np
import pytest
from push_recovery.controllers.model.robot import SAME, Similarity
from push_recovery.envs.scenario.distribution import ErrorRanges, PushDistribution
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push
from push_recovery.envs.scenario.scenario import EXACT, HARDWARE, Command, CommandChange, Scenario

LARGER = Similarity(2.0, 2.25)  # twice as heavy, 1.5 times as slow
EVENT = GaitEvent(4, "left", 0.25)


def test_a_push_by_hand():
    push = Push((10.0, -20.0, 30.0), 0.1, 2.0, "left_shank", (0.01, 0.02, -0.04), "heading")
    assert push.scaled(LARGER) == Push(
        (20.0, -40.0, 60.0), 0.1 * 1.5, 3.0, "left_shank", (0.0225, 0.045, -0.09), "heading"
    )
    assert push.scaled(LARGER).impulse_magnitude == pytest.approx(3.0 * push.impulse_magnitude)
    assert Push((1.0, 0.0, 0.0), 0.1, EVENT).scaled(LARGER).start == EVENT


def test_a_scenario_by_hand():
    scenario = Scenario(
        "one", (Push((1.0, 0.0, 0.0), 0.2, EVENT),), Command(0.2, -0.1, 0.3), "right", 2.0, 8.0, 7,
        ModelErrors(friction=0.5, payload=3.0), (CommandChange(4.0, Command(0.1)),),
        kicks=(Kick((0.1, 0.2, 0.0), 1.0),),
    )  # fmt: skip
    scaled = scenario.scaled(LARGER)
    assert (scaled.id, scaled.stance_side, scaled.noise_seed) == ("one", "right", 7)
    assert (scaled.settle_time, scaled.duration) == (3.0, 12.0)
    assert scaled.command == Command(0.2 * 1.5, -0.1 * 1.5, 0.3 / 1.5)
    assert scaled.changes == (CommandChange(6.0, Command(0.1 * 1.5)),)
    assert scaled.kicks == (Kick((0.1 * 1.5, 0.2 * 1.5, 0.0), 1.5),)
    assert scaled.errors == ModelErrors(friction=0.5, payload=6.0)
    assert Scenario("open").scaled(LARGER).duration is None
    assert scenario.scaled(SAME) == scenario


def test_what_mirrors_scales():
    scenario = Scenario(
        "one", (Push((1.0, 2.0, 3.0), 0.2, EVENT, "left_foot", (0.1, 0.2, 0.3)),), Command(0.2, -0.1, 0.3)
    )
    assert scenario.mirrored().scaled(LARGER) == scenario.scaled(LARGER).mirrored()


@pytest.mark.parametrize(("turn", "found"), [(0.6, 0.6), (-0.6, -0.6), (0.3, 0.6), (0.2, 0.4), (-0.2, -0.4)])
def test_a_small_robot_turns_faster_up_to_the_bound(turn, found):
    assert Command(turn=turn).scaled(Similarity(1.0, 0.25)).turn == found


def test_errors_by_hand():
    errors = ModelErrors(
        mass=0.1, payload=1.0, trunk_com=(0.01, -0.02, 0.0), friction=0.7, slope_left=0.02, delay=0.004,
        dcm_noise=0.002, joint_noise=0.001, floor_step=0.004, joint_friction=1.0, joint_damping=1.0,
        armature=0.02, collisions=True, motor_power=1000.0, bus_power=2000.0, continuous_torque=0.5,
    )  # fmt: skip
    assert errors.scaled(LARGER) == ModelErrors(
        mass=0.1, payload=2.0, trunk_com=(0.0225, -0.045, 0.0), friction=0.7, slope_left=0.02, delay=0.004,
        dcm_noise=0.002 * 2.25, joint_noise=0.001, floor_step=0.004 * 2.25, joint_friction=4.5,
        joint_damping=6.75, armature=0.02 * 10.125, collisions=True, motor_power=3000.0, bus_power=6000.0,
        continuous_torque=0.5,
    )  # fmt: skip
    assert ModelErrors().scaled(LARGER) == ModelErrors()
    ranges = ErrorRanges(payload=(0.0, 2.0), friction=(0.4, 1.0), trunk_com=(-0.01, 0.02))
    assert ranges.scaled(LARGER) == ErrorRanges(
        payload=(0.0, 4.0), friction=(0.4, 1.0), trunk_com=(-0.0225, 0.045)
    )


def test_a_profile_keeps_its_name_and_senses():
    scaled = HARDWARE.scaled(LARGER)
    assert (scaled.name, scaled.physics, scaled.sensing) == ("hardware", HARDWARE.physics, HARDWARE.sensing)
    assert scaled.errors == HARDWARE.errors.scaled(LARGER)
    assert EXACT.scaled(LARGER) == EXACT


def test_drawing_and_scaling_change_places():
    """To rounding; gait events and seeds are the same ones."""
    ranges = PushDistribution(
        turn=0.3,
        errors=ErrorRanges(payload=(0.0, 5.0)),
        settle_time=2.0,
        push_duration_ratio=4.0,
        pushes_max=3,
    )
    for seed in range(50):
        drawn, later = (
            ranges.scaled(LARGER).sample(np.random.default_rng(seed)),
            ranges.sample(np.random.default_rng(seed)).scaled(LARGER),
        )
        assert (drawn.id, drawn.noise_seed) == (later.id, later.noise_seed)
        assert drawn.stance_side == later.stance_side
        for a, b in zip(drawn.pushes, later.pushes, strict=True):
            assert a.start == b.start
            assert (*a.force, a.duration) == pytest.approx((*b.force, b.duration))
        parts = [(s.command.vx, s.command.vy, s.command.turn, s.settle_time) for s in (drawn, later)]
        assert parts[0] == pytest.approx(parts[1])
        assert drawn.errors.payload == pytest.approx(later.errors.payload)
