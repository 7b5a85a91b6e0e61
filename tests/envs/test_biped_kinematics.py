import mujoco
import numpy as np
import pytest
from push_recovery.envs.biped_kinematics import (
    LEG_DOF,
    PELVIS,
    base_angular_velocity,
    com_velocity,
    cross_into,
    sole_motion,
    sole_position,
    upright_error,
)
from push_recovery.envs.biped_model import SOLES, biped_model, mass_matrix_index
from push_recovery.envs.whole_body import dense_mass_matrix

MODEL = biped_model()


def sole_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    J = np.zeros((6, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(SOLES[leg]).id)
    return J


def drift_by_differences(qpos: np.ndarray, qvel: np.ndarray, leg: int, eps: float = 1e-6) -> np.ndarray:
    """(J(q + eps qd) qd - J(q - eps qd) qd) / (2 eps) = Jdot qd."""
    twists = []
    for step in (eps, -eps):
        data = mujoco.MjData(MODEL)
        data.qpos[:] = qpos
        mujoco.mj_integratePos(MODEL, data.qpos, qvel, step)
        mujoco.mj_fwdPosition(MODEL, data)
        twists.append(sole_jacobian(data, leg) @ qvel)
    return (twists[0] - twists[1]) / (2 * eps)


@pytest.mark.parametrize("leg", [0, 1])
def test_sole_motion_is_mujocos_jacobian_twist_and_drift(random_state, robot_in, leg):
    rng = np.random.default_rng(leg)
    for _ in range(20):
        qpos, qvel = random_state(rng, 0.4)
        core, data = robot_in(qpos, qvel)
        foot = sole_motion(core.physics, 0, leg, base_angular_velocity(core.physics, 0))
        J = sole_jacobian(data, leg)
        np.testing.assert_allclose(foot.position, data.site(SOLES[leg]).xpos, atol=1e-12)
        np.testing.assert_allclose(foot.jacobian, J[:, LEG_DOF[leg] : LEG_DOF[leg] + 6], atol=1e-12)
        np.testing.assert_allclose(foot.twist, J @ qvel, atol=1e-12)
        np.testing.assert_allclose(foot.drift, drift_by_differences(qpos, qvel, leg), atol=1e-6)


def test_velocities_are_mujocos(random_state, robot_in):
    rng, index = np.random.default_rng(2), mass_matrix_index()
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.4))
        np.testing.assert_allclose(com_velocity(core.physics, 0, index), data.subtree_linvel[0], atol=1e-12)
        omega = base_angular_velocity(core.physics, 0)
        np.testing.assert_allclose(omega, data.cvel[PELVIS, :3], atol=1e-12)
        for leg in range(2):
            position = sole_position(core.physics, 0, leg)
            np.testing.assert_allclose(position, data.site(SOLES[leg]).xpos, atol=1e-12)


def test_mass_matrix_and_bias_are_mujocos(random_state, robot_in):
    core, data = robot_in(*random_state(np.random.default_rng(3)))
    M, full = np.full((MODEL.nv, MODEL.nv), np.nan), np.zeros((MODEL.nv, MODEL.nv))
    mujoco.mj_fullM(MODEL, data, full)
    dense_mass_matrix(core.physics, 0, mass_matrix_index(), M)
    np.testing.assert_allclose(M, full, atol=1e-12)
    np.testing.assert_allclose(core.physics.bias[0], data.qfrc_bias, atol=1e-9)


def test_cross_product():
    a, b = np.random.default_rng(4).normal(size=(2, 3))
    out = np.empty(3)
    cross_into(a, b, out)
    np.testing.assert_allclose(out, np.cross(a, b), atol=1e-15)


def test_upright_error_is_the_rotation_that_remains():
    rng, error = np.random.default_rng(5), np.empty(3)
    for size in (1e-3, 1e-4):
        turn, heading = rng.normal(0.0, size, 3), rng.uniform(-3, 3)
        quat, rotation, upright = np.empty(4), np.empty(9), np.empty(9)
        mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), heading)
        mujoco.mju_quat2Mat(upright, quat)
        mujoco.mju_axisAngle2Quat(quat, turn / np.linalg.norm(turn), np.linalg.norm(turn))
        mujoco.mju_quat2Mat(rotation, quat)
        tilted = (rotation.reshape(3, 3) @ upright.reshape(3, 3)).ravel()
        upright_error(tilted, heading, error)
        np.testing.assert_allclose(error, -turn, atol=5 * size**2)


def test_heading_error_takes_the_short_way_round():
    error, quat, rotation = np.empty(3), np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), -3.1)
    mujoco.mju_quat2Mat(rotation, quat)
    upright_error(rotation, 3.1, error)
    assert error[2] == pytest.approx(6.2 - 2 * np.pi)
