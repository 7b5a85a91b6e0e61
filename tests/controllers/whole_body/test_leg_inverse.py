"""The inverse of a leg, in closed form and from all its columns, against MuJoCo's Jacobian."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import (
    KNEE,
    LEG_DOF,
    LEG_QPOS,
    NU,
    LegInverses,
    base_angular_velocity,
    sole_motion,
    sole_position,
    subtract_leg_torques,
    write_inverse_of_any_axes,
    write_leg_inverse,
)
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import PLAN, biped_model
from push_recovery.envs.robots.variants import VARIANTS

MODEL = biped_model()


def leg_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    """Jacobian (6, 6) of a sole, linear part first."""
    J = np.zeros((6, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
    return J[:, LEG_DOF[leg] : LEG_DOF[leg] + 6]


def leg_inverse(core, leg: int, damping: float, write=write_leg_inverse) -> np.ndarray:
    """J^-1 (6, 6) of a leg; nothing of the other leg's is written."""
    inverses = LegInverses(np.full((2, 6, 3), np.nan), np.full((2, 6, 3), np.nan))
    write(core.physics, 0, leg, sole_position(core.physics, 0, leg), damping, inverses)
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


@pytest.mark.parametrize("leg", [0, 1])
@pytest.mark.parametrize("damping", [0.0, 1e-4])
def test_all_columns_give_what_the_closed_form_gives(random_state, robot_in, leg, damping):
    rng = np.random.default_rng(20 + leg)
    for _ in range(30):
        core, data = robot_in(*random_state(rng, 0.3))
        closed = leg_inverse(core, leg, damping)
        columns = leg_inverse(core, leg, damping, write_inverse_of_any_axes)
        scale = np.linalg.cond(leg_jacobian(data, leg)) * np.abs(closed).max()
        assert np.abs(columns - closed).max() < 1e-13 * scale


def test_rates_of_a_singular_leg_stay_finite(robot_in, random_state):
    qpos, qvel = random_state(np.random.default_rng(3), 0.0)
    qpos[LEG_QPOS[0] + KNEE] = 0.0
    inverse = leg_inverse(robot_in(qpos, qvel)[0], 0, 1e-6, write_inverse_of_any_axes)
    assert np.isfinite(inverse).all()
    assert np.linalg.norm(inverse[KNEE, :3]) <= 500.0 + 1e-9


@pytest.mark.parametrize("description", VARIANTS, ids=lambda description: description.name)
def test_it_is_the_inverse_for_legs_of_other_axes(description):
    episodes, rng = BipedEpisodes(1, robot=description), np.random.default_rng(5)
    core, model = episodes.core, episodes.core.body.model
    for _ in range(10):
        soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]) + rng.uniform(-0.05, 0.05, (2, 3)) * [1, 1, 0]
        qpos, qvel = posture(core.body, np.array([0.0, 0.0, 0.76]), rng.normal(0.0, 0.3, 3), soles)
        mujoco.mj_integratePos(model, qpos, rng.normal(0.0, 0.2, model.nv), 1.0)
        core.put(0, qpos, qvel)
        data, J = core.simulations.data[0], np.zeros((6, model.nv))
        for leg in range(2):
            mujoco.mj_jacSite(model, data, J[:3], J[3:], core.body.indices.soles[leg])
            own = J[:, list(core.body.indices.dof[LEG_DOF[leg] : LEG_DOF[leg] + 6])]
            error = leg_inverse(core, leg, 0.0) @ own - np.eye(6)
            assert np.abs(error).max() < 1e-12 * np.linalg.cond(own)
            foot = sole_motion(core.physics, 0, leg, base_angular_velocity(core.physics, 0))
            np.testing.assert_allclose([*foot.velocity, *foot.omega], J @ data.qvel, atol=1e-12)


@pytest.mark.parametrize("knee", [0.0, 1e-6, 1e-3])
def test_damping_bounds_the_rates_of_a_straight_leg(robot_in, random_state, knee):
    """|c / (c^2 + damping)| <= 1 / (2 sqrt(damping)), the knee's rate per velocity along the leg [rad/m]."""
    qpos, qvel = random_state(np.random.default_rng(3), 0.0)
    qpos[LEG_QPOS[0] + KNEE] = knee
    inverse = leg_inverse(robot_in(qpos, qvel)[0], 0, 1e-6)
    assert np.linalg.norm(inverse[KNEE, :3]) <= 500.0 + 1e-9
    assert np.isfinite(inverse).all()


@pytest.mark.parametrize("write", [write_leg_inverse, write_inverse_of_any_axes])
@pytest.mark.parametrize(("bend", "sign"), [(1.0, 1.0), (-1.0, -1.0), (0.0, -1.0)])
@pytest.mark.parametrize("leg", [0, 1])
def test_a_knee_beyond_straight_bends_to_shorten_its_leg(
    robot_in, random_state, monkeypatch, leg, bend, sign, write
):
    """The leg is 0.72 cos(knee / 2) m long, so a bent knee turns at 1 / (0.36 sin(knee / 2)) rad a metre.

    At -0.04 rad a knee that bends by positive angles is beyond straight, one that bends by negative is bent.
    """
    qpos, qvel = random_state(np.random.default_rng(6), 0.1)
    qpos[LEG_QPOS[leg] + KNEE] = -0.04
    core, data = robot_in(qpos, qvel)
    monkeypatch.setattr(core, "physics", core.physics._replace(knee_bend=np.full(2, bend)))
    hip, ankle = (data.joint(f"{PLAN.legs[leg][i]}").xanchor for i in (0, 4))
    shorter = (hip - ankle) / np.linalg.norm(hip - ankle)
    rate = leg_inverse(core, leg, 0.0, write)[KNEE] @ [*shorter, 0.0, 0.0, 0.0]
    assert rate == pytest.approx(sign / (0.36 * np.sin(0.02)), rel=1e-9)


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
