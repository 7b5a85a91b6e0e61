"""Joints that keep their angle while the robot walks.

What is read of a robot's model, beside what its MJCF says.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.robot import BodyPlan
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import ANY_AXES, MEETING_AXES, ROW, columns
from push_recovery.envs.biped.core import BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.posture import leg_geometry, posture
from push_recovery.envs.robots.biped import (
    ANKLE_ROLL_FIRST,
    ARMS_HELD,
    HELD_VARIANTS,
    HIPS_PITCH_ROLL_YAW,
    LEGS_BELOW_A_YAW,
    NO_WAIST_ROLL,
    PLAN,
    ROBOT,
    VARIANTS,
    biped,
    pitch_roll_yaw_hips,
    spec,
)
from push_recovery.envs.robots.compiled_robot import CompiledRobot, compiled_robot, robot_model
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.indices import MISSING
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

ELBOW = -1.2  # [rad]


def with_held(*held):
    return replace(ARMS_HELD, plan=replace(ARMS_HELD.plan, held=held))


def elbow_torque(angle, rate):
    """What the left elbow's motor gives, the robot being told nothing [N m]."""
    model = compiled_robot(ARMS_HELD).model
    data = mujoco.MjData(model)
    data.joint("left_elbow").qpos[0], data.joint("left_elbow").qvel[0] = angle, rate
    mujoco.mj_forward(model, data)
    return data.actuator("left_elbow").force[0]


def test_the_torque_is_that_of_a_critically_damped_spring_within_the_motors():
    """Forearm: 0.008 kg m^2 + 1.2 kg x (0.12 m)^2, rotor 0.01 kg m^2; 60 rad/s."""
    inertia = 0.008 + 1.2 * 0.12**2 + 0.01
    assert elbow_torque(ELBOW, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert elbow_torque(ELBOW + 0.1, 0.0) == pytest.approx(-inertia * 60.0**2 * 0.1)
    assert elbow_torque(ELBOW, -2.0) == pytest.approx(2.0 * inertia * 60.0 * 2.0)
    assert elbow_torque(ELBOW - 1.0, 0.0) == 40.0


def test_arms_keep_their_angles_through_a_push():
    episodes = BipedEpisodes(1, robot=ARMS_HELD)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, "biped")
    episodes.begin(0, Scenario("push", (Push((0.0, 400.0, 0.0), 0.1, 0.5, "trunk"),)))
    wanted, off = [angle for _, angle in ARMS_HELD.plan.held], 0.0
    for _ in range(300):
        episodes.step(policy.predict(episodes.core.observation)[0].astype(np.float32))
        off = max(off, np.abs(episodes.core.physics.qpos[0, 21:] - wanted).max())
    assert 1e-4 < off < 0.1
    assert episodes.core.gait.failure[0] == 0


def test_what_is_believed_of_a_robot_has_its_arms_where_they_are():
    episodes = BipedEpisodes(1, robot=ARMS_HELD)
    episodes.begin(0, Scenario("heavy", errors=ModelErrors(payload=5.0)))
    episodes.step(np.zeros((1, 7), np.float32))
    core = episodes.core
    model, data = core.body.model, mujoco.MjData(core.body.model)  # without the payload
    data.qpos[:], data.qvel[:] = core.simulations.data[0].qpos, core.simulations.data[0].qvel
    mujoco.mj_forward(model, data)
    for j, own in enumerate(core.body.indices.dof):
        if own != MISSING:
            assert core.physics.bias[0, j] == pytest.approx(data.qfrc_bias[own], abs=1e-9)
    assert abs(core.simulations.data[0].qfrc_bias[2] - data.qfrc_bias[2]) > 40.0  # the payload's weight


@pytest.mark.parametrize(
    ("held", "said"),
    [
        (ARMS_HELD.plan.held[:-1], r"joint 'right_elbow' has no role in the BodyPlan; name it in `held`"),
        ((*ARMS_HELD.plan.held[:-1], ("right_elbow", 3.0)), r"'right_elbow' .*\[-2.6.*, 2.6.*\] rad, got 3"),
        ((*ARMS_HELD.plan.held, ("root", 0.0)), "'root' must be a hinge"),
    ],
)
def test_what_cannot_be_held_is_refused(held, said):
    with pytest.raises(InvalidValueError, match=said):
        CompiledRobot(with_held(*held))


def test_a_held_joint_needs_a_motor_and_a_name_that_exists():
    def unpowered():
        model = ARMS_HELD.spec()
        model.delete(model.actuator("left_elbow"))
        return model

    with pytest.raises(InvalidValueError, match="joint 'left_elbow' must have one motor, got 0"):
        CompiledRobot(replace(ARMS_HELD, spec=unpowered))
    with pytest.raises(UnknownNameError, match="left_elbow"):
        CompiledRobot(with_held(*ARMS_HELD.plan.held, ("left_elbwo", 0.0)))


def test_a_push_on_the_trunk_of_a_robot_in_one_body_is_one_on_its_pelvis():
    """Both bodies are one, so that the same force at the same point has the same outcome, to the last bit."""
    episodes = BipedEpisodes(3, robot=LEGS_BELOW_A_YAW)
    force, offset = (60.0, 40.0, 0.0), (0.0, 0.1, 0.05)
    for k, body in enumerate(("pelvis", "trunk")):
        episodes.begin(k, Scenario("push", (Push(force, 0.1, 0.02, body, offset),)))
    episodes.begin(2, Scenario("none"))
    for _ in range(30):
        episodes.step(np.zeros((3, 7), np.float32))
    pelvis, trunk, none = episodes.core.physics.qpos
    np.testing.assert_array_equal(pelvis, trunk)
    assert np.abs(pelvis - none).max() > 1e-3


SOLES = np.array([[0.05, 0.11, 0.0], [-0.03, -0.09, 0.0]])


def test_the_bipeds_model_has_table_ii():
    model = robot_model(biped().in_reference_posture(), biped().indices, 0.8)
    assert model.mass == pytest.approx(60.0, abs=1e-12)
    assert model.trunk_inertia == pytest.approx(7.0 + 30.0 * 0.18**2, abs=1e-12)  # Table II has 8
    assert (model.trunk_torque_max, model.pelvis_width) == (150.0, 0.2)
    assert model.trunk_angle_max == pytest.approx(np.pi / 3, abs=1e-12)
    assert (model.foot_length, model.foot_width) == (0.2, 0.1)


def test_motors_are_found_by_their_joints_whatever_their_order():
    torque, speed = compiled_robot(HIPS_PITCH_ROLL_YAW).motors
    for leg in (torque[2:8], torque[8:]):
        np.testing.assert_array_equal(leg, [220, 200, 100, 300, 150, 100])  # pitch, roll, yaw hips
    for leg in (speed[2:8], speed[8:]):
        np.testing.assert_array_equal(leg, [23, 23, 23, 14, 9, 9])
    torque, _ = compiled_robot(ANKLE_ROLL_FIRST).motors
    for leg in (torque[2:8], torque[8:]):
        np.testing.assert_array_equal(leg, [100, 200, 220, 300, 100, 150])


def test_mirror_signs_follow_the_axes():
    roll_or_yaw, pitch = -1, 1
    expected = [pitch, roll_or_yaw, roll_or_yaw, pitch, pitch, roll_or_yaw]
    signs = compiled_robot(HIPS_PITCH_ROLL_YAW).mirror
    np.testing.assert_array_equal(signs, [1, -1, *expected, *expected])


@pytest.mark.parametrize(
    ("ranges", "signs"),
    [
        (((-5.0, 150.0), (0.0, 150.0)), [1.0, 1.0]),
        (((-150.0, 5.0), (-150.0, 0.0)), [-1.0, -1.0]),
        (((2.0, 150.0), (-150.0, -2.0)), [0.0, 0.0]),
    ],
)
def test_a_knee_is_bent_towards_the_farther_end_of_its_range(ranges, signs):
    def ranged():
        model = spec()
        for side, (low, high) in zip(("left", "right"), ranges, strict=True):
            model.joint(f"{side}_knee").range = [low, high]  # [degrees]
        return model

    assert CompiledRobot(replace(ROBOT, spec=ranged)).knee_bend.tolist() == signs


def test_the_closed_forms_are_kept_where_they_hold():
    forms = [compiled_robot(robot).leg_form for robot in (ROBOT, *VARIANTS)]
    assert forms == [MEETING_AXES, ANY_AXES, ANY_AXES, MEETING_AXES]
    robots = [compiled_robot(robot) for robot in (ROBOT, *VARIANTS)]
    held = [leg_geometry(robot.model, robot.indices) for robot in robots]
    assert [geometry is None for geometry in held] == [False, True, True, False]


@pytest.mark.parametrize(
    "description", [ROBOT, *VARIANTS, *HELD_VARIANTS], ids=lambda description: description.name
)
def test_a_posture_has_its_com_and_soles_where_asked(description):
    robot = compiled_robot(description)
    com, velocity = np.array([0.01, 0.02, 0.75]), np.array([0.2, -0.1, 0.05])
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = posture(robot, com, velocity, SOLES)
    mujoco.mj_forward(robot.model, data)
    mujoco.mj_subtreeVel(robot.model, data)
    np.testing.assert_allclose(data.subtree_com[0], com, atol=1e-9)
    np.testing.assert_allclose(data.subtree_linvel[0], velocity, atol=1e-9)
    for side, sole in zip(("left", "right"), SOLES, strict=True):
        site = data.site(f"{side}_sole")
        np.testing.assert_allclose(site.xpos, sole, atol=1e-9)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), np.eye(3), atol=1e-9)
        assert data.joint(f"{side}_knee").qpos[0] > 0.1


@pytest.mark.parametrize("description", [*VARIANTS, *HELD_VARIANTS], ids=lambda description: description.name)
def test_control_reads_mujocos_own_mass_matrix_and_axes(description):
    core = BipedEpisodes(1, robot=description).core
    model, data, indices = core.body.model, mujoco.MjData(core.body.model), core.body.indices
    data.qpos[:], data.qvel[:] = posture(core.body, np.array([0.0, 0.0, 0.75]), np.ones(3), SOLES)
    data.qvel[6:] += 0.3
    core.put(0, data.qpos, data.qvel)
    mujoco.mj_forward(model, data)
    dense, phys = np.zeros((model.nv, model.nv)), core.physics
    mujoco.mj_fullM(model, data, dense)
    for j, own in enumerate(indices.dof):
        if own == MISSING:
            assert phys.qvel[0, j] == phys.bias[0, j] == 0.0
        else:
            assert (phys.qvel[0, j], phys.bias[0, j]) == (data.qvel[own], data.qfrc_bias[own])
    places = {j: own for j, own in enumerate(indices.dof) if own != MISSING}
    for j in range(len(indices.dof)):
        for place, i in enumerate(columns(j)):
            entry = phys.mass_matrix[0, ROW[j] + place]
            if j in places and i in places:
                assert entry == dense[places[j], places[i]]
            else:
                assert entry == (1.0 if i == j else 0.0)
    for joint, own in enumerate(indices.joints):
        if own != MISSING:
            np.testing.assert_array_equal(phys.xaxis[0, joint], data.xaxis[own])
            np.testing.assert_array_equal(phys.xanchor[0, joint], data.xanchor[own])


def test_a_missing_waist_axis_gets_no_motor_and_no_acceleration():
    robot = compiled_robot(NO_WAIST_ROLL)
    assert robot.indices.motors[:2] == (0, MISSING)
    assert robot.indices.dof[6:8] == (6, MISSING)
    episodes = BipedEpisodes(1, robot=NO_WAIST_ROLL)
    assert (episodes.robot.trunk_pitch, episodes.robot.trunk_roll) == (True, False)
    assert episodes.limits == replace(BIPED_LIMITS, trunk_roll=False)
    episodes.begin(0, Scenario("a"))
    episodes.step(np.ones((1, 7), np.float32))
    np.testing.assert_array_equal(episodes.core.gait.plan[0, 5:], [BIPED_LIMITS.trunk_acceleration_max, 0.0])


def plan_with(**changes) -> BodyPlan:
    return replace(PLAN, **changes)


def test_names_that_do_not_exist_are_told_with_those_that_do():
    with pytest.raises(UnknownNameError, match=r"body.*'plevis'.*pelvis"):
        CompiledRobot(replace(ROBOT, plan=plan_with(pelvis="plevis")))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"legs": (PLAN.legs[0][::-1], PLAN.legs[1])}, "left leg must be a chain"),
        ({"pelvis": "trunk", "trunk": "pelvis"}, "free joint"),
        ({"waist": ("waist_roll", "waist_pitch")}, "waist"),
        ({"legs": (PLAN.legs[0], PLAN.legs[1][:-1] + ("left_knee",))}, "twice"),
        ({"bend": (0.0,)}, "6 angles"),
        ({"trunk": "pelvis"}, "two bodies"),
        ({"sole_boxes": ("left_foot", "right_ankle")}, "sole 'right_ankle' must be a box, got a sphere"),
    ],
)
def test_a_plan_that_does_not_fit_the_model_is_refused(changes, said):
    with pytest.raises(InvalidValueError, match=said):
        CompiledRobot(replace(ROBOT, plan=plan_with(**changes)))


def test_a_motor_that_does_not_give_the_torque_it_is_told_is_refused():
    def geared() -> mujoco.MjSpec:
        model = spec()
        model.actuator("left_knee").gear[0] = 50.0
        return model

    with pytest.raises(InvalidValueError, match="gear 50"):
        CompiledRobot(replace(ROBOT, spec=geared))


def test_a_robot_is_loaded_by_name_or_place():
    assert robot_description("biped") is ROBOT
    place = "push_recovery.envs.robots.biped:NO_WAIST_ROLL"
    assert robot_description(place) is NO_WAIST_ROLL
    with pytest.raises(UnknownNameError, match="biped"):
        robot_description("bipde")
    with pytest.raises(InvalidValueError, match="cannot load"):
        robot_description("push_recovery.nowhere:ROBOT")
    with pytest.raises(InvalidValueError, match="RobotDescription"):
        robot_description("math:pi")


def test_ankle_axes_apart_have_no_closed_form():
    def apart():
        model = spec()
        model.joint("right_ankle_roll").pos = [0.0, 0.0, 0.01]
        return model

    assert CompiledRobot(ROBOT).leg_form == MEETING_AXES
    assert CompiledRobot(replace(ROBOT, spec=apart)).leg_form == ANY_AXES


@pytest.mark.parametrize("part", ["shank", "foot", "sole", "thigh", "one leg"])
def test_legs_that_are_not_plumb_or_not_alike_have_no_closed_form(part):
    """2 cm ahead of the joint above, or one thigh 1 cm shorter."""

    def changed():
        model = spec()
        for side, y in (("left", 0.1), ("right", -0.1)):
            if part == "sole":
                model.site(f"{side}_sole").pos = [0.02, 0.0, -0.06]
            elif part == "thigh":
                model.body(f"{side}_thigh").pos = [0.02, y, -0.05]
            elif part != "one leg":
                model.body(f"{side}_{part}").pos = [0.02, 0.0, -0.36]
            elif side == "left":
                model.body("left_shank").pos = [0.0, 0.0, -0.35]
        return model

    robot = CompiledRobot(replace(ROBOT, spec=changed))
    assert leg_geometry(robot.model, robot.indices) is None


def test_a_posture_beyond_the_range_of_a_knee_is_none():
    def stiff():
        model = pitch_roll_yaw_hips()
        for side in ("left", "right"):
            model.joint(f"{side}_knee").range = [2.0, 20.0]  # [degrees]
        return model

    robot = CompiledRobot(replace(HIPS_PITCH_ROLL_YAW, spec=stiff))
    soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    with pytest.raises(InvalidValueError, match="no posture"):
        posture(robot, np.array([0.0, 0.0, 0.75]), np.zeros(3), soles)


@pytest.mark.parametrize(
    ("part", "of", "values", "said"),
    [
        ("indices", ("actuator", "left_knee"), {"gainprm": [50.0] + 9 * [0.0]}, "gain 50"),
        ("indices", ("actuator", "left_knee"),
         {"biastype": mujoco.mjtBias.mjBIAS_AFFINE, "biasprm": [0.0, -3.0] + 8 * [0.0]}, "bias"),
        ("motors", ("actuator", "left_knee"), {"forcerange": [-100.0, 300.0]}, "as large both ways"),
        ("soles", ("site", "left_sole"), {"quat": [0.995, 0.0, 0.0998, 0.0]}, "not be turned in it"),
        ("mirror", ("joint", "left_knee"), {"axis": [0.0, 0.98, 0.199]}, "mirror images"),
    ],
)  # fmt: skip
def test_a_model_that_control_would_misread_is_refused(part, of, values, said):
    def changed():
        model = spec()
        for field, value in values.items():
            setattr(getattr(model, of[0])(of[1]), field, value)
        return model

    with pytest.raises(InvalidValueError, match=said):
        getattr(CompiledRobot(replace(ROBOT, spec=changed)), part)


def test_a_joint_with_two_motors_is_refused():
    def changed():
        model, joint = spec(), mujoco.mjtTrn.mjTRN_JOINT
        model.add_actuator(name="again", target="left_knee", trntype=joint, forcelimited=True,
                           forcerange=[-9.0, 9.0])  # fmt: skip
        return model

    with pytest.raises(InvalidValueError, match="must have one motor, got 2"):
        _ = CompiledRobot(replace(ROBOT, spec=changed)).indices


def test_torque_and_angle_of_the_trunk_are_the_least_of_the_waists_axes():
    def changed():
        model = spec()
        model.actuator("waist_roll").forcerange = [-80.0, 80.0]
        model.joint("waist_pitch").range = [-40.0, 55.0]  # [degrees]
        return model

    model = CompiledRobot(replace(ROBOT, spec=changed, model=None)).robot
    assert model.trunk_torque_max == 80.0
    assert model.trunk_angle_max == pytest.approx(np.radians(40.0))
