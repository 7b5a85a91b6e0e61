import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import (
    PELVIS,
    base_angular_velocity,
    sole_motion,
    sole_position,
    upright_error,
)
from push_recovery.envs.robots.biped import PLAN, biped_model

MODEL = biped_model()


def sole_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    J = np.zeros((6, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
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
def test_sole_motion_is_mujocos_twist_and_drift(random_state, robot_in, leg):
    rng = np.random.default_rng(leg)
    for _ in range(20):
        qpos, qvel = random_state(rng, 0.4)
        core, data = robot_in(qpos, qvel)
        foot = sole_motion(core.physics, 0, leg, base_angular_velocity(core.physics, 0))
        J = sole_jacobian(data, leg)
        np.testing.assert_allclose(foot.position, data.site(PLAN.soles[leg]).xpos, atol=1e-12)
        np.testing.assert_allclose([*foot.velocity, *foot.omega], J @ qvel, atol=1e-12)
        drift = drift_by_differences(qpos, qvel, leg)
        np.testing.assert_allclose([*foot.drift, *foot.turn_drift], drift, atol=1e-6)


def test_pelvis_and_soles_are_mujocos(random_state, robot_in):
    rng = np.random.default_rng(2)
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.4))
        omega = base_angular_velocity(core.physics, 0)
        np.testing.assert_allclose(omega, data.cvel[PELVIS, :3], atol=1e-12)
        for leg in range(2):
            position = sole_position(core.physics, 0, leg)
            np.testing.assert_allclose(position, data.site(PLAN.soles[leg]).xpos, atol=1e-12)


def axes(heading: float) -> np.ndarray:
    """Axes (9,) of an upright body at a heading [rad]."""
    quat, rotation = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), heading)
    mujoco.mju_quat2Mat(rotation, quat)
    return rotation


def error_of(rotation: np.ndarray, heading: float) -> tuple[float, float, float]:
    """`upright_error` of a body with the axes `rotation`."""
    return upright_error(rotation.reshape(1, 1, 9), 0, 0, (np.cos(heading), np.sin(heading)))


def test_upright_error_is_the_rotation_that_remains():
    rng = np.random.default_rng(5)
    for size in (1e-3, 1e-4):
        turn, heading = rng.normal(0.0, size, 3), rng.uniform(-3, 3)
        quat, rotation = np.empty(4), np.empty(9)
        mujoco.mju_axisAngle2Quat(quat, turn / np.linalg.norm(turn), np.linalg.norm(turn))
        mujoco.mju_quat2Mat(rotation, quat)
        tilted = (rotation.reshape(3, 3) @ axes(heading).reshape(3, 3)).ravel()
        np.testing.assert_allclose(error_of(tilted, heading), -turn, atol=5 * size**2)


def test_heading_error_takes_the_short_way_round():
    assert error_of(axes(-3.1), 3.1)[2] == pytest.approx(6.2 - 2 * np.pi)
