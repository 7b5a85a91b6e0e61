"""Canonical order and signs of the joints.

PD torques and residuals, held against their formulas on robots in random states.

Steps told by the loads under the feet, on histories of loads written by hand.

The joint observation against MuJoCo's own figures, and in a mirror.
"""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers import joint_control as control
from push_recovery.controllers.joint_control import LIFTED, PHASE, RATES, axial, joint_sign, own_joint, polar
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import COMMAND
from push_recovery.controllers.whole_body.gait_machine import FLOOR, resting_gait
from push_recovery.controllers.whole_body.kinematics import sole_position
from push_recovery.controllers.whole_body.limits import JOINT_TORQUE, NEVER, driving_share
from push_recovery.envs.biped.core import BIPED, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.joint.core import JointCore, JointResidualCore
from push_recovery.envs.robots.biped import biped, biped_model

LEFT, RIGHT = 0, 1
OWN = [biped_model().actuator(i).name for i in range(biped_model().nu)]


@pytest.mark.parametrize(("stance", "sides"), [(LEFT, ("left", "right")), (RIGHT, ("right", "left"))])
def test_joints_are_named_by_the_role_of_their_leg(stance, sides):
    for c, name in enumerate(control.JOINT_NAMES):
        own = name.replace("stance", sides[0]).replace("swing", sides[1])
        assert OWN[own_joint(c, stance)] == own


def test_only_a_robot_on_its_left_foot_is_seen_in_a_mirror():
    """Yaw, roll and the waist's roll change their sign in a mirror, pitch and knee do not."""
    mirror = biped().mirror
    turned = [-1.0 if name.endswith(("yaw", "roll")) else 1.0 for name in control.JOINT_NAMES]
    for c, sign in enumerate(turned):
        assert joint_sign(mirror, own_joint(c, LEFT), LEFT) == sign
        assert joint_sign(mirror, own_joint(c, RIGHT), RIGHT) == 1.0


@pytest.mark.parametrize("stance", [LEFT, RIGHT])
def test_there_and_back_is_where_it_was(stance):
    values = np.random.default_rng(0).normal(size=14)
    own, back = np.empty(14), np.empty(14)
    control.to_own(values, biped().mirror, stance, own)
    control.to_canonical(own, biped().mirror, stance, back)
    np.testing.assert_array_equal(back, values)
    assert (own != values).any()


def test_a_mirror_turns_velocities_aside_and_rates_about_the_axes_of_its_plane():
    velocity, rate, place = np.random.default_rng(1).normal(size=(3, 3))
    mirror = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_array_equal(polar(-1.0, tuple(velocity)), mirror @ velocity)
    turned = np.cross(axial(-1.0, tuple(rate)), mirror @ place)  # the velocity of a mirrored point
    np.testing.assert_allclose(turned, mirror @ np.cross(rate, place), atol=1e-15)
    assert polar(1.0, tuple(velocity)) == tuple(velocity)
    assert axial(1.0, tuple(rate)) == tuple(rate)


@pytest.fixture(scope="module")
def core():
    return JointCore(1, BIPED, BIPED_LIMITS)


@pytest.fixture(scope="module")
def residual():
    core = JointResidualCore(1, BIPED, BIPED_LIMITS)
    core.scale_residual(0.5)
    return core


def put(core, random_state, seed, spread=0.2):
    """Put the robot in a random state; its joint angles and rates (14,)."""
    core.put(0, *random_state(np.random.default_rng(seed), spread))
    return core.physics.qpos[0, 7:].copy(), core.physics.qvel[0, 6:].copy()


def ranges(rates):
    """Least and largest torque of every motor at these rates, (14,) each."""
    top, free = biped().motors
    low = [-t * driving_share(-v, f) for t, v, f in zip(top, rates, free, strict=True)]
    high = [t * driving_share(v, f) for t, v, f in zip(top, rates, free, strict=True)]
    return np.array(low), np.array(high)


def test_an_action_of_one_asks_for_the_full_torque_of_each_motor_that_is_there():
    motors = np.array([[150.0, 80.0, NEVER], [20.0, 10.0, NEVER]])
    largest, stiffness, damping = control.joint_constants(motors)
    np.testing.assert_array_equal(largest, [150.0, 80.0, 0.0])
    np.testing.assert_array_equal(stiffness * 1.0, largest)  # over 1 rad
    np.testing.assert_allclose(damping, [3.0, 1.6, 0.0])


@pytest.mark.parametrize("seed", range(4))
def test_torques_are_those_of_pd_control_within_the_motors_range(core, random_state, seed):
    angles, rates = put(core, random_state, seed)
    joints, wanted = core.joints, np.random.default_rng(seed).uniform(-1.0, 1.0, 14)
    joints.held[0] = wanted
    asked = joints.stiffness * (joints.posture + wanted - angles) - joints.damping * rates
    low, high = ranges(rates)
    met = control.follow_targets(core.physics, 0, joints, core._bounds[0][0])
    np.testing.assert_allclose(core.physics.ctrl[0], np.clip(asked, low, high), atol=1e-10)
    assert bool(met) == bool(((asked <= low) | (asked >= high)).any())


def test_a_robot_at_its_targets_and_at_rest_is_asked_for_nothing(core, random_state):
    qpos, qvel = random_state(np.random.default_rng(0))
    qpos[7:], qvel[6:] = core.joints.posture, 0.0
    core.put(0, qpos, qvel)
    core.joints.held[0] = 0.0
    assert control.follow_targets(core.physics, 0, core.joints, core._bounds[0][0]) == 0
    np.testing.assert_array_equal(core.physics.ctrl[0], np.zeros(14))


def test_without_a_residual_torques_keep_their_bits_even_beyond_the_range(residual, random_state):
    put(residual, random_state, 1)
    torque = np.random.default_rng(2).normal(0.0, 500.0, 14)
    residual.physics.ctrl[0], residual.joints.held[0] = torque, 0.0
    assert control.add_residual(residual.physics, 0, residual.joints, residual._bounds[0][0]) == 0
    assert residual.physics.ctrl[0].tobytes() == torque.tobytes()


@pytest.mark.parametrize(("share", "met"), [(0.1, 0), (1.0, JOINT_TORQUE)])
def test_a_residual_is_a_share_of_the_largest_torque_and_the_sum_stays_in_range(
    residual, random_state, share, met
):
    _, rates = put(residual, random_state, 3, 0.01)
    low, high = ranges(rates)
    residual._bounds[0][0].torque_range[:] = low, high
    torque = 0.6 * high
    residual.physics.ctrl[0], residual.joints.held[0] = torque, share
    assert control.add_residual(residual.physics, 0, residual.joints, residual._bounds[0][0]) == met
    expected = np.minimum(torque + share * 0.5 * biped().motors[0], high)
    np.testing.assert_allclose(residual.physics.ctrl[0], expected, atol=1e-12)


def test_effort_is_the_mean_square_of_the_shares_of_the_torques(residual):
    residual.joints.effort[0] = 0.0
    for share in (0.5, 1.0):
        residual.physics.ctrl[0] = share * biped().motors[0] * np.where(np.arange(14) % 2, 1.0, -1.0)
        control.count_effort(residual.physics, 0, residual.joints, 0.5)
    assert residual.joints.effort[0] == pytest.approx(14 * 0.5 * (0.25 + 1.0))


T, DT = 0.3, 0.002
STANDS, SHARED, FREE = 590.0, 295.0, 0.0  # loads [N]


def standing(core, yaw=0.0):
    """Coordinates (21,) of a robot that stands at a yaw."""
    return np.array([0.0, 0.0, 0.75, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2), *core.joints.posture])


def steps(core, loads, turn=0.0):
    """Times of touchdowns [s] under a history of loads (left, right) [N], a row a physics step."""
    core.put(0, standing(core), np.zeros(20))
    gait, found = resting_gait(1), []
    gait.plan[0, 2], gait.turn[0] = T, turn
    core.joints.lifted[0], core.joints.air[0] = 0, 0
    for i, row in enumerate(loads):
        core.physics.load[0] = row
        before = gait.steps.item(0)
        control.follow_contacts(core.physics, gait, 0, BIPED_GAIT, core.joints)
        if gait.steps.item(0) != before:
            found.append(i * DT)
        gait.elapsed[0] += DT
    return found, gait


def held(left, right, seconds):
    return [(left, right)] * round(seconds / DT)


def test_a_robot_that_stands_on_both_feet_makes_no_steps(core):
    assert steps(core, held(SHARED, SHARED, 3.0))[0] == []


def test_a_foot_that_was_lifted_and_lands_near_t_ends_the_step(core):
    lands = held(SHARED, SHARED, 0.05) + held(STANDS, FREE, 0.25) + held(SHARED, SHARED, 0.5)
    found, gait = steps(core, lands)
    assert found == [pytest.approx(0.3)]
    assert gait.stance[0] == 1


def test_the_new_swing_foot_has_to_be_lifted_in_its_turn(core):
    one = held(STANDS, FREE, 0.3) + held(SHARED, SHARED, 0.1)
    two = held(FREE, STANDS, 0.25) + held(SHARED, SHARED, 0.5)
    assert steps(core, one + two)[0] == [pytest.approx(0.3), pytest.approx(0.65)]


def test_light_load_long_before_t_is_no_touchdown_and_heavy_load_late_is(core):
    graze, landing = 0.5 * BIPED_GAIT.forced_load, 2.0 * BIPED_GAIT.forced_load
    late = BIPED_GAIT.forced_phase * T
    rest = held(STANDS, FREE, 0.02)
    grazes = held(STANDS, FREE, 0.1) + held(STANDS, graze, 0.1) + rest
    assert steps(core, grazes)[0] == []
    early = held(STANDS, FREE, 0.1) + held(STANDS, landing, 0.2)
    assert steps(core, early)[0] == [pytest.approx(late, abs=DT)]


def test_a_foot_that_loses_its_load_for_a_moment_was_not_lifted(core):
    for count, made in ((LIFTED - 1, 0), (LIFTED, 1)):
        loads = held(SHARED, SHARED, 0.1) + [(STANDS, FREE)] * count + held(SHARED, SHARED, 0.5)
        assert len(steps(core, loads)[0]) == made


def test_a_robot_that_lifts_its_stance_foot_stands_on_the_other(core):
    found, gait = steps(core, held(SHARED, SHARED, 0.1) + held(FREE, STANDS, 0.4))
    assert found == [pytest.approx(BIPED_GAIT.forced_phase * T, abs=DT)]
    assert gait.stance[0] == 1


def test_the_heading_goes_on_by_what_the_command_asked_for_in_the_step(core):
    _, gait = steps(core, held(STANDS, FREE, 0.3) + held(SHARED, SHARED, 0.1), turn=0.5)
    assert gait.heading[0] == pytest.approx(0.15)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.1)])
def test_the_plan_that_is_held_is_the_nominal_gait_of_the_command(core, velocity):
    gait, observation = resting_gait(1), np.zeros(36)
    observation[COMMAND], gait.plan[0] = velocity, 1.0
    control.hold_nominal(gait, 0, observation, core.joints.gait)
    delay = core.joints.gait[2]
    nominal = nominal_gait(BIPED, BIPED_LIMITS, velocity, delay)
    expected = [nominal.length, nominal.width, nominal.duration, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(gait.plan[0], expected, atol=1e-15)


THREE = np.arange(3)
QUIET = (0.0, 0.0)


def observed(
    core, qpos, qvel, stance=1, heading=0.0, command=(0.0, 0.0, 0.0), noise=QUIET, elapsed=0.0, loads=QUIET
):
    core.put(0, qpos, qvel)
    core.physics.load[0] = loads
    for field in core.gait:
        field[0] = 0
    core.gait.stance[0], core.gait.heading[0] = stance, heading
    core.gait.plan[0, 2], core.gait.elapsed[0] = 0.4, elapsed
    out = np.full(control.JOINT_OBSERVATION_SIZE, np.nan)
    control.observe_joints(core.physics, core.gait, 0, BIPED_GAIT, core.joints, np.array(command), noise, out)
    assert np.isfinite(out).all()
    return out


def mirrored_state(qpos, qvel):
    """The state seen in a mirror, left to right."""
    signs, q, v = biped().mirror, qpos.copy(), qvel.copy()
    q[1], v[1] = -q[1], -v[1]
    q[4], q[6] = -q[4], -q[6]  # a mirror turns a rotation about x and z round
    v[3], v[5] = -v[3], -v[5]
    for first, rows in ((7, q), (6, v)):
        joints = rows[first:] * signs
        rows[first:] = np.concatenate([joints[:2], joints[8:], joints[2:8]])
    return q, v


def test_every_entry_has_a_name_of_its_own():
    assert len(set(control.JOINT_OBSERVATION_NAMES)) == control.JOINT_OBSERVATION_SIZE == 58


@pytest.mark.parametrize("seed", range(3))
def test_the_base_moves_as_mujoco_has_it_in_the_axes_of_the_body(core, random_state, seed):
    qpos, qvel = random_state(np.random.default_rng(seed))
    data, twist = mujoco.MjData(biped_model()), np.zeros(6)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(biped_model(), data)
    pelvis = biped_model().body("pelvis").id
    kind = mujoco.mjtObj.mjOBJ_XBODY.value
    mujoco.mj_objectVelocity(biped_model(), data, kind, pelvis, twist, 1)
    seen = observed(core, qpos, qvel)
    np.testing.assert_allclose(seen[control.BASE_RATE + THREE], twist[:3], atol=1e-9)
    np.testing.assert_allclose(seen[control.BASE_VELOCITY + THREE], twist[3:], atol=1e-9)
    down = data.body(pelvis).xmat.reshape(3, 3).T @ biped_model().opt.gravity / 9.81
    np.testing.assert_allclose(seen[control.GRAVITY_DIRECTION + THREE], down, atol=1e-9)


def test_joints_are_told_off_the_standing_posture(core, random_state):
    """On the right foot, as they are: waist, right leg, left leg."""
    qpos, qvel = random_state(np.random.default_rng(3))
    order = [0, 1, *range(8, 14), *range(2, 8)]
    seen = observed(core, qpos, qvel)
    np.testing.assert_allclose(
        seen[control.ANGLES : RATES], (qpos[7:] - core.joints.posture)[order], atol=1e-12
    )
    np.testing.assert_allclose(seen[RATES : control.PREVIOUS_ACTION], qvel[6:][order], atol=1e-12)


def test_a_mirrored_robot_on_its_other_foot_sees_the_same(core, random_state):
    qpos, qvel = random_state(np.random.default_rng(4))
    action, loads = np.random.default_rng(5).uniform(-1.0, 1.0, 14), (400.0, 100.0)
    seen = []
    for side in range(2):
        if side:
            qpos, qvel = mirrored_state(qpos, qvel)
            signs = biped().mirror
            action = np.concatenate([(action * signs)[:2], (action * signs)[8:], (action * signs)[2:8]])
        core.joints.held[0] = action
        sign = 1.0 - 2.0 * side
        command, noise = (0.3, 0.1 * sign, 0.2 * sign), (0.02, 0.03)
        told = loads if side == 0 else loads[::-1]
        seen.append(observed(core, qpos, qvel, 1 - side, 0.4 * sign, command, noise, 0.1, told))
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    assert np.abs(seen[0][control.PREVIOUS_ACTION :]).min() > 0.0


@pytest.mark.parametrize(("stance", "sign"), [(0, -1.0), (1, 1.0)])
def test_command_and_heading_are_told_towards_the_swing_side(core, stance, sign):
    """A robot that looks 0.3 rad to the left of its heading of 0.5 rad."""
    seen = observed(core, standing(core, 0.8), np.zeros(20), stance, 0.5, (0.2, 0.1, 0.4))
    assert seen[control.HEADING_ERROR] == pytest.approx(0.3 * sign)
    np.testing.assert_allclose(
        seen[control.COMMAND_COLUMN + THREE], [0.2, 0.1 * sign, 0.4 * sign], atol=1e-15
    )


def test_noise_of_the_velocity_is_turned_into_the_axes_of_the_base(core):
    """A robot that looks a quarter turn to the left of its heading has noise along that at its right."""
    seen = observed(core, standing(core, np.pi / 2), np.zeros(20), noise=(0.1, 0.0))
    np.testing.assert_allclose(seen[control.BASE_VELOCITY + THREE], [0.0, -0.1, 0.0], atol=1e-12)


def test_loads_are_shares_of_the_weight_and_the_clock_one_of_the_step(core):
    loads = 60.0 * 9.81, 0.5 * 60.0 * 9.81
    for elapsed, phase in ((0.1, 0.25), (0.4, 1.0), (9.0, 2.0)):
        seen = observed(core, standing(core), np.zeros(20), stance=0, elapsed=elapsed, loads=loads)
        np.testing.assert_allclose(seen[control.LOADS : PHASE], [1.0, 0.5], atol=1e-12)
        assert seen[PHASE] == pytest.approx(phase)


@pytest.mark.parametrize(("load", "made"), [(1.0, 1), (1.01, 0)])
def test_a_foot_is_off_the_floor_up_to_a_load_of_one_newton(core, load, made):
    loads = held(SHARED, SHARED, 0.1) + held(STANDS, load, 0.1) + held(SHARED, SHARED, 0.5)
    assert len(steps(core, loads)[0]) == made


def test_the_floor_is_as_high_as_the_sole_that_has_come_to_stand(core):
    qpos, gait = standing(core), resting_gait(1)
    qpos[2] += 0.1
    core.put(0, qpos, np.zeros(20))
    gait.plan[0, 2] = gait.elapsed[0] = T
    core.joints.lifted[0], core.physics.load[0] = 1, SHARED
    control.follow_contacts(core.physics, gait, 0, BIPED_GAIT, core.joints)
    assert gait.stance[0] == 1
    assert gait.height[0, FLOOR] == pytest.approx(sole_position(core.physics, 0, 1)[2])
    assert gait.height[0, FLOOR] == pytest.approx(0.1, abs=0.01)


def test_a_foot_counts_as_lifted_after_20_ms_without_load(core):
    for milliseconds, made in ((18, 0), (20, 1)):
        off = held(STANDS, FREE, 1e-3 * milliseconds)
        loads = held(SHARED, SHARED, 0.1) + off + held(SHARED, SHARED, 0.5)
        assert len(steps(core, loads)[0]) == made
