"""What a robot's legs and motors let its steps be, by the inertias of the bodies themselves."""

import pytest
from push_recovery.controllers.settings import named_preset
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot
from push_recovery.envs.robots.description import RobotDescription, robot_description
from push_recovery.eval.robot_tools.new_robot import scale_of, scaled_settings, sole_acceleration

ROLL, PITCH = 1, 2  # of the biped's hip, which turns first
LEG = "left_thigh", "left_shank", "left_foot"


def weaker(factor: float) -> CompiledRobot:
    """The biped, its hip motors with a share of their torque."""
    base = robot_description("biped")

    def spec():
        made = base.spec()
        for motor in made.actuators:
            if "hip" in motor.name:
                motor.forcerange = [factor * bound for bound in motor.forcerange]
        return made

    return compiled_robot(RobotDescription(f"weaker {factor}", spec, base.plan, base.com_height))


def test_a_hip_swings_all_that_hangs_from_it():
    """By the parallel axes of thigh, shank and foot, and the motor's armature."""
    body = biped()
    model, data = body.model, body.in_reference_posture()
    found = []
    for place in (ROLL, PITCH):
        joint = body.indices.legs[0][place]
        axis, anchor = data.xaxis[joint], data.xanchor[joint]
        inertia = model.dof_armature[model.jnt_dofadr[joint]]
        for name in LEG:
            part = model.body(name).id
            arm, frame = data.xipos[part] - anchor, data.ximat[part].reshape(3, 3)
            inertia += model.body_inertia[part] @ (frame.T @ axis) ** 2
            inertia += model.body_mass[part] * (arm @ arm - (arm @ axis) ** 2)
        height = anchor[2] - data.site_xpos[body.indices.soles[0], 2]
        found.append(body.motors[0, 2 + place] * height / inertia)
    assert sole_acceleration(body) == pytest.approx(min(found), rel=1e-9)


def test_weak_hips_make_the_shortest_step_longer_and_leave_the_nominal_one():
    weak, own = weaker(0.25), named_preset("biped").robot()
    assert scale_of(weak).swing == pytest.approx(0.25)
    box, other = scaled_settings(weak).robot(), own["limits"]
    assert box["limits"]["duration_min"] == pytest.approx(2.0 * other["duration_min"], rel=1e-4)
    assert box["limits"]["duration_min"] + box["limits"]["duration_max"] == pytest.approx(
        other["duration_min"] + other["duration_max"], abs=1e-3
    )
    assert box["gains"]["swing_max"] == pytest.approx(0.25 * own["gains"]["swing_max"], rel=1e-4)


def test_very_weak_hips_leave_room_between_the_shortest_and_the_longest_step():
    limits = scaled_settings(weaker(0.04)).robot()["limits"]  # five times the shortest step
    assert limits["duration_min"] == pytest.approx(5.0 * 0.115, rel=1e-4)
    assert limits["duration_max"] == pytest.approx(1.2 * limits["duration_min"], abs=1e-3)
