"""The joint observation against MuJoCo's own figures, and in a mirror."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.joint_control import (
    ANGLES,
    BASE_RATE,
    BASE_VELOCITY,
    COMMAND_COLUMN,
    GRAVITY_DIRECTION,
    HEADING_ERROR,
    JOINT_OBSERVATION_NAMES,
    JOINT_OBSERVATION_SIZE,
    LOADS,
    PHASE,
    PREVIOUS_ACTION,
    RATES,
    observe_joints,
)
from push_recovery.envs.biped.core import BIPED, BIPED_GAIT, BIPED_LIMITS
from push_recovery.envs.joint.core import JointCore
from push_recovery.envs.robots.biped import biped, biped_model

THREE = np.arange(3)
QUIET = (0.0, 0.0)


@pytest.fixture(scope="module")
def core():
    return JointCore(1, BIPED, BIPED_LIMITS)


def observed(
    core, qpos, qvel, stance=1, heading=0.0, command=(0.0, 0.0, 0.0), noise=QUIET, elapsed=0.0, loads=QUIET
):
    core.put(0, qpos, qvel)
    core.physics.load[0] = loads
    for field in core.gait:
        field[0] = 0
    core.gait.stance[0], core.gait.heading[0] = stance, heading
    core.gait.plan[0, 2], core.gait.elapsed[0] = 0.4, elapsed
    out = np.full(JOINT_OBSERVATION_SIZE, np.nan)
    observe_joints(core.physics, core.gait, 0, BIPED_GAIT, core.joints, np.array(command), noise, out)
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
    assert len(set(JOINT_OBSERVATION_NAMES)) == JOINT_OBSERVATION_SIZE == 58


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
    np.testing.assert_allclose(seen[BASE_RATE + THREE], twist[:3], atol=1e-9)
    np.testing.assert_allclose(seen[BASE_VELOCITY + THREE], twist[3:], atol=1e-9)
    down = data.body(pelvis).xmat.reshape(3, 3).T @ biped_model().opt.gravity / 9.81
    np.testing.assert_allclose(seen[GRAVITY_DIRECTION + THREE], down, atol=1e-9)


def test_joints_are_told_off_the_standing_posture(core, random_state):
    """On the right foot, as they are: waist, right leg, left leg."""
    qpos, qvel = random_state(np.random.default_rng(3))
    order = [0, 1, *range(8, 14), *range(2, 8)]
    seen = observed(core, qpos, qvel)
    np.testing.assert_allclose(seen[ANGLES:RATES], (qpos[7:] - core.joints.posture)[order], atol=1e-12)
    np.testing.assert_allclose(seen[RATES:PREVIOUS_ACTION], qvel[6:][order], atol=1e-12)


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
    assert np.abs(seen[0][PREVIOUS_ACTION:]).min() > 0.0


@pytest.mark.parametrize(("stance", "sign"), [(0, -1.0), (1, 1.0)])
def test_command_and_heading_are_told_towards_the_swing_side(core, stance, sign):
    """A robot that looks 0.3 rad to the left of its heading of 0.5 rad."""
    qpos = np.zeros(21)
    qpos[2], qpos[3], qpos[6], qpos[7:] = 0.75, np.cos(0.4), np.sin(0.4), core.joints.posture
    seen = observed(core, qpos, np.zeros(20), stance, 0.5, (0.2, 0.1, 0.4))
    assert seen[HEADING_ERROR] == pytest.approx(0.3 * sign)
    np.testing.assert_allclose(seen[COMMAND_COLUMN + THREE], [0.2, 0.1 * sign, 0.4 * sign], atol=1e-15)


def test_noise_of_the_velocity_is_turned_into_the_axes_of_the_base(core):
    """A robot that looks a quarter turn to the left of its heading has noise along that at its right."""
    qpos = np.zeros(21)
    qpos[2], qpos[3], qpos[6], qpos[7:] = 0.75, np.cos(np.pi / 4), np.sin(np.pi / 4), core.joints.posture
    seen = observed(core, qpos, np.zeros(20), noise=(0.1, 0.0))
    np.testing.assert_allclose(seen[BASE_VELOCITY + THREE], [0.0, -0.1, 0.0], atol=1e-12)


def test_loads_are_shares_of_the_weight_and_the_clock_one_of_the_step(core):
    qpos = np.zeros(21)
    qpos[2], qpos[3], qpos[7:] = 0.75, 1.0, core.joints.posture
    loads = 60.0 * 9.81, 0.5 * 60.0 * 9.81
    for elapsed, phase in ((0.1, 0.25), (0.4, 1.0), (9.0, 2.0)):
        seen = observed(core, qpos, np.zeros(20), stance=0, elapsed=elapsed, loads=loads)
        np.testing.assert_allclose(seen[LOADS:PHASE], [1.0, 0.5], atol=1e-12)
        assert seen[PHASE] == pytest.approx(phase)
