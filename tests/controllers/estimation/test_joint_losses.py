"""Friction and rotors of the legs' joints: least squares on made-up motion, the biped's rows, its walk."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.estimation.self_model import (
    BEFORE,
    FRICTION,
    LOSS_SIZE,
    LOST,
    ROTOR,
    add_losses,
    conclude,
    direction,
    feel_joints,
    feel_swing,
    keep_leg,
    take_in,
)
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import LEG_DOF
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.scenario import HARDWARE, Command, Scenario
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.tuning.scorer import preset_episodes
from scipy.signal import lfilter

DT, RATE, MEMORY = 0.002, 100.0, 2.0
MODEL = biped_model()


def motion(seconds: float = 0.6, seed: int = 3):
    """Rates and accelerations of a joint that never rests."""
    t, phase = np.arange(0.0, seconds, DT), np.random.default_rng(seed).uniform(0.0, 6.0)
    rate = 2.0 * np.sin(9.0 * t + phase) + 0.7 * np.sin(31.0 * t)
    return np.where(np.abs(rate) < 0.03, 0.03, rate), np.gradient(rate, DT)


def told(rate, acceleration, lost) -> np.ndarray:
    """Row of a joint that has moved so."""
    joint = np.zeros(LOSS_SIZE)
    for v, a, r in zip(rate, acceleration, lost, strict=True):
        take_in(joint, r, v, a, DT)
    return joint


@pytest.mark.parametrize(("friction", "rotor"), [(1.0, 0.0), (0.0, 0.03), (0.7, 0.05), (4.0, 0.01)])
def test_the_least_squares_are_those_of_scipys_filter_and_numpys_solution(friction, rotor):
    rate, acceleration = motion()
    sign = np.clip(rate / 0.1, -1.0, 1.0)
    noise = np.random.default_rng(1).normal(0.0, 0.5, len(rate))
    lost = friction * sign + rotor * acceleration + noise
    joint = told(rate, acceleration, lost)
    conclude(joint)

    share = 1.0 - np.exp(-RATE * DT)
    r, s, a = (lfilter([share], [1.0, share - 1.0], x) for x in (lost, sign, acceleration))
    weight = np.sqrt(DT * np.exp(-DT / MEMORY * np.arange(len(rate))[::-1]))
    rows = np.vstack([np.column_stack([s, a]) * weight[:, None], np.diag(np.sqrt([0.02, 2.0]))])
    expected = np.linalg.lstsq(rows, np.append(r * weight, [0.0, 0.0]), rcond=None)[0]
    expected = np.where(expected < [0.2, 0.005], 0.0, expected)
    np.testing.assert_allclose(joint[[FRICTION, ROTOR]], expected, rtol=1e-9)
    np.testing.assert_allclose(joint[[FRICTION, ROTOR]], [friction, rotor], rtol=0.08, atol=0.002)
    assert not joint[:3].any()  # the next swing's filters begin anew


@pytest.mark.parametrize(
    ("friction", "rotor", "believed"),
    [
        (0.15, 0.004, (0.0, 0.0)),
        (-1.0, -0.05, (0.0, 0.0)),
        (7.0, 0.0, (5.0, 0.0)),
        (0.0, 0.4, (0.0, 0.2)),
    ],
)
def test_too_little_and_less_than_nothing_count_as_none_and_too_much_as_the_most(friction, rotor, believed):
    rate, acceleration = motion()
    acceleration = np.clip(acceleration, -20.0, 20.0)  # below the torque of a blow
    joint = told(rate, acceleration, friction * np.sign(rate) + rotor * acceleration)
    conclude(joint)
    assert (joint[FRICTION], joint[ROTOR]) == pytest.approx(believed, abs=1e-12)


def test_a_blow_and_a_joint_at_rest_tell_nothing():
    joint = told([1.0] * 20, [5.0] * 20, [1.0] * 20)
    before = joint.copy()
    take_in(joint, 2.0, 0.019, 50.0, DT)
    np.testing.assert_array_equal(joint[3:], before[3:])  # but the filters go on
    assert joint[LOST] > before[LOST]
    take_in(joint, 1e3, 1.0, 5.0, DT)
    np.testing.assert_array_equal(joint[3:], before[3:])
    assert not joint[:3].any()


def test_the_direction_of_a_rate_is_its_sign_but_for_slow_ones():
    assert [direction(v) for v in (-3.0, -0.1, -0.05, 0.0, 0.02, 0.1, 5.0)] == pytest.approx(
        [-1.0, -1.0, -0.5, 0.0, 0.2, 1.0, 1.0]
    )


@pytest.mark.parametrize("leg", [0, 1])
def test_what_a_leg_loses_is_what_its_motors_give_beyond_mujocos_m_and_h(random_state, robot_in, leg):
    rng = np.random.default_rng(8 + leg)
    core, data = robot_in(*random_state(rng))
    physics, qdd, lost = core.physics, rng.normal(0.0, 20.0, 20), rng.uniform(-3.0, 3.0, 6)
    needed, joints, before = np.empty(20), np.zeros((1, 14, LOSS_SIZE)), np.zeros((1, BEFORE))
    mujoco.mj_mulM(MODEL, data, needed, qdd)
    needed += data.qfrc_bias
    rows = slice(LEG_DOF[leg] - 6, LEG_DOF[leg])
    keep_leg(before, physics, 0, leg)
    physics.ctrl[0] = needed[6:]
    physics.ctrl[0, rows] += lost
    physics.qvel[0] += DT * qdd
    feel_swing(joints, before, physics, 0, leg, DT)
    share = 1.0 - np.exp(-RATE * DT)
    np.testing.assert_allclose(joints[0, rows, LOST], share * lost, atol=1e-8)
    np.testing.assert_allclose(joints[0, rows, 2], share * qdd[LEG_DOF[leg] : LEG_DOF[leg] + 6], rtol=1e-9)
    assert np.count_nonzero(joints.any(axis=2)) == 6


def test_losses_are_added_to_mass_matrix_and_bias(random_state, robot_in):
    core, data = robot_in(*random_state(np.random.default_rng(5)))
    physics, joints = core.physics, np.zeros((1, 14, LOSS_SIZE))
    joints[0, :, FRICTION], joints[0, :, ROTOR] = np.arange(14.0), 0.01 * np.arange(14.0)
    add_losses(joints, physics, 0)
    mass, full = np.empty((20, 20)), np.empty((20, 20))
    mujoco.mj_fullM(MODEL, data, mass)
    data.M[:] = physics.mass_matrix[0]
    mujoco.mj_fullM(MODEL, data, full)
    legs = np.r_[np.zeros(8), np.arange(2.0, 14.0)]  # the waist's are left out
    np.testing.assert_allclose(full - mass, np.diag(0.01 * legs), atol=1e-12)
    sign = np.clip(data.qvel / 0.1, -1.0, 1.0)
    np.testing.assert_allclose(physics.bias[0] - data.qfrc_bias, legs * sign, atol=1e-9)


def test_a_leg_tells_only_in_the_air_and_concludes_as_it_has_landed(random_state, robot_in):
    core, _ = robot_in(*random_state(np.random.default_rng(6)), stance=1)
    physics, gait = core.physics, core.gait
    joints, before = np.zeros((1, 14, LOSS_SIZE)), np.zeros((1, BEFORE))
    gait.elapsed[0], physics.load[0] = 0.1, (30.0, 500.0)
    feel_joints(joints, before, physics, gait, 0, DT)
    assert not joints.any()
    physics.load[0, 0] = 0.0
    feel_joints(joints, before, physics, gait, 0, DT)
    assert joints[0, 2:8, :3].any(axis=1).all()
    assert not joints[0, 8:].any()
    joints[0, :, 0] = 1.0
    gait.stance[0], gait.elapsed[0] = 0, DT
    feel_joints(joints, before, physics, gait, 0, DT)
    assert joints[0, :, 0].tolist() == [1.0] * 2 + [0.0] * 6 + [1.0] * 6


def walk(errors: ModelErrors, seconds: float = 6.0):
    """What a walk at 0.3 m/s finds, (14,) frictions and rotors, and its speed over the second half [m/s]."""
    episodes = preset_episodes("PushRecovery/Biped-v0", 1, "biped", "two-stage")
    policy, places = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped"), []
    episodes.core.after_physics_step = lambda: places.append(float(episodes.core.judged.qpos[0, 0]))
    scenario = Scenario("walk", command=Command(0.3), duration=seconds, errors=errors)
    (outcome,) = rollout_batch(episodes, policy, [scenario], "two-stage")
    assert outcome.survived
    half = len(places) // 2
    known = episodes.core.known.joints[0]
    return known[:, FRICTION], known[:, ROTOR], (places[-1] - places[half]) / (DT * (len(places) - 1 - half))


def test_an_exact_robot_finds_nothing():
    friction, rotor, speed = walk(ModelErrors())
    assert not friction.any()
    assert not rotor.any()
    assert speed == pytest.approx(0.3, abs=0.03)


def test_a_walk_finds_the_friction_of_hip_knee_and_ankle_and_keeps_its_speed():
    friction, _, speed = walk(ModelErrors(joint_friction=1.0))
    for first in (2, 8):
        np.testing.assert_allclose(friction[first + 1 : first + 5], 1.0, atol=0.1)
    assert not friction[:2].any()
    assert speed == pytest.approx(0.3, abs=0.05)  # 0.15 m/s where nothing is found


def test_a_walk_finds_a_heavier_rotor():
    _, rotor, speed = walk(ModelErrors(armature=0.03))
    for first in (2, 8):
        np.testing.assert_allclose(rotor[first + 2 : first + 5], 0.03, atol=0.003)
    assert speed == pytest.approx(0.3, abs=0.03)


def test_on_the_hardware_profile_it_walks_within_what_recovered_allows():
    friction, _, speed = walk(HARDWARE.applied(Scenario("x")).errors)
    np.testing.assert_allclose(friction[[3, 5, 6, 9, 11, 12]], 1.0, atol=0.15)
    assert speed == pytest.approx(0.3, abs=0.06)
