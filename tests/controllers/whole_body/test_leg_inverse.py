"""The closed-form inverse of a leg against MuJoCo's Jacobian."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import LEG_DOF, LEG_QPOS, NU, sole_position
from push_recovery.controllers.whole_body.leg_inverse import (
    KNEE,
    LegInverses,
    subtract_leg_torques,
    write_leg_inverse,
)
from push_recovery.envs.biped.robots.biped.robot import PLAN, biped_model

MODEL = biped_model()


def leg_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    """Jacobian (6, 6) of a sole, linear part first."""
    J = np.zeros((6, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
    return J[:, LEG_DOF[leg] : LEG_DOF[leg] + 6]


def leg_inverse(core, leg: int, damping: float) -> np.ndarray:
    """J^-1 (6, 6) of a leg; nothing of the other leg's is written."""
    inverses = LegInverses(np.full((2, 6, 3), np.nan), np.full((2, 6, 3), np.nan))
    write_leg_inverse(core.physics, 0, leg, sole_position(core.physics, 0, leg), damping, inverses)
    assert np.isnan(inverses.velocity[1 - leg]).all()
    return np.hstack([inverses.velocity[leg], inverses.omega[leg]])


@pytest.mark.parametrize("leg", [0, 1])
def test_it_is_the_inverse_of_mujocos_jacobian(random_state, robot_in, leg):
    rng = np.random.default_rng(leg)
    for _ in range(30):
        core, data = robot_in(*random_state(rng, 0.3))
        J = leg_jacobian(data, leg)
        error = leg_inverse(core, leg, 0.0) @ J - np.eye(6)
        assert np.abs(error).max() < 1e-13 * np.linalg.cond(J)


@pytest.mark.parametrize("knee", [0.0, 1e-6, 1e-3])
def test_damping_bounds_the_rates_of_a_straight_leg(robot_in, random_state, knee):
    """|c / (c^2 + damping)| <= 1 / (2 sqrt(damping)), the knee's rate per velocity along the leg [rad/m]."""
    qpos, qvel = random_state(np.random.default_rng(3), 0.0)
    qpos[LEG_QPOS[0] + KNEE] = knee
    inverse = leg_inverse(robot_in(qpos, qvel)[0], 0, 1e-6)
    assert np.linalg.norm(inverse[KNEE, :3]) <= 500.0 + 1e-9
    assert np.isfinite(inverse).all()


@pytest.mark.parametrize("leg", [0, 1])
def test_torques_of_a_wrench_on_the_sole_are_the_transposed_jacobian(random_state, robot_in, leg):
    rng = np.random.default_rng(10 + leg)
    for _ in range(10):
        core, data = robot_in(*random_state(rng, 0.3))
        wrench, before = rng.normal(0.0, 100.0, 6), rng.normal(0.0, 10.0, NU)
        torque, expected = before.copy(), before.copy()
        first = LEG_DOF[leg] - 6
        expected[first : first + 6] -= leg_jacobian(data, leg).T @ wrench
        subtract_leg_torques(core.physics, 0, leg, sole_position(core.physics, 0, leg), wrench, torque)
        np.testing.assert_allclose(torque, expected, atol=1e-11)
