"""The inverse of a leg, in closed form and from all its columns, against MuJoCo's Jacobian.

Each column of the maps is a motion that deviates from one task alone, by one unit.
"""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.whole_body import kinematics
from push_recovery.controllers.whole_body.kinematics import KNEE, LEG_DOF, NU, NV, ROW, TASKS, sole_position
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import PLAN, VARIANTS, biped_model

LEG_QPOS = (9, 15)  # first joint coordinate of the left and the right leg

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
        omega = kinematics.base_angular_velocity(core.physics, 0)
        np.testing.assert_allclose(omega, data.cvel[kinematics.PELVIS, :3], atol=1e-12)
        foot, J = kinematics.sole_motion(core.physics, 0, leg, omega), sole_jacobian(data, leg)
        for position in (foot.position, sole_position(core.physics, 0, leg)):
            np.testing.assert_allclose(position, data.site(PLAN.soles[leg]).xpos, atol=1e-12)
        np.testing.assert_allclose([*foot.velocity, *foot.omega], J @ qvel, atol=1e-12)
        drift = drift_by_differences(qpos, qvel, leg)
        np.testing.assert_allclose([*foot.drift, *foot.turn_drift], drift, atol=1e-6)


def axes(heading: float) -> np.ndarray:
    """Axes (9,) of an upright body at a heading [rad]."""
    quat, rotation = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), heading)
    mujoco.mju_quat2Mat(rotation, quat)
    return rotation


def error_of(rotation: np.ndarray, heading: float) -> tuple[float, float, float]:
    """`upright_error` of a body with the axes `rotation`."""
    return kinematics.upright_error(rotation.reshape(1, 1, 9), 0, 0, (np.cos(heading), np.sin(heading)))


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


def test_rows_and_columns_are_where_mujoco_stores_them():
    np.testing.assert_array_equal(ROW, MODEL.M_rowadr)
    for j in range(NV):
        columns = [
            *range(min(j, kinematics.BASE)),
            *range(kinematics.CHAIN[j] if j >= kinematics.BASE else j, j + 1),
        ]
        np.testing.assert_array_equal(MODEL.M_colind[ROW[j] :][: MODEL.M_rownnz[j]], columns)


def test_com_velocity_is_mujocos(random_state, robot_in):
    rng = np.random.default_rng(2)
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.4))
        np.testing.assert_allclose(
            kinematics.com_velocity(core.physics, 0), data.subtree_linvel[0], atol=1e-12
        )


def test_generalised_force_is_the_mass_matrix_times_acceleration_and_bias(random_state, robot_in):
    rng = np.random.default_rng(3)
    for _ in range(10):
        core, data = robot_in(*random_state(rng))
        qdd, expected, out = rng.normal(0.0, 10.0, NV), np.empty(NV), np.full(NV, np.nan)
        mujoco.mj_mulM(MODEL, data, expected, qdd)
        kinematics.write_generalised_force(core.physics, 0, qdd, out)
        np.testing.assert_allclose(out, expected + data.qfrc_bias, atol=1e-9)


def test_compliance_gives_the_pelvis_the_acceleration_that_a_force_on_the_com_asks_for(
    random_state, robot_in
):
    """With qdd = (a, 0, 0, -J^-1 (a, 0) of both legs) the first three rows of M qdd are the force."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        core, data = robot_in(*random_state(rng))
        inverses = kinematics.LegInverses(np.empty((2, 6, 3)), np.empty((2, 6, 3)))
        for leg in range(2):
            kinematics.write_leg_inverse(
                core.physics, 0, leg, sole_position(core.physics, 0, leg), 0.0, inverses
            )
        force, qdd, total = rng.normal(0.0, 100.0, 3), np.zeros(NV), np.empty(NV)
        qdd[:3] = np.array(kinematics.com_compliance(core.physics, 0, inverses)) @ force
        for leg in range(2):
            motion = [*qdd[:3], 0.0, 0.0, 0.0]
            qdd[LEG_DOF[leg] : LEG_DOF[leg] + 6] = -np.linalg.solve(leg_jacobian(data, leg), motion)
        mujoco.mj_mulM(MODEL, data, total, qdd)
        np.testing.assert_allclose(total[:3], force, atol=1e-8)


def leg_jacobian(data: mujoco.MjData, leg: int) -> np.ndarray:
    """Jacobian (6, 6) of a sole by the joints of its leg, linear part first."""
    return sole_jacobian(data, leg)[:, LEG_DOF[leg] : LEG_DOF[leg] + 6]


def leg_inverse(core, leg: int, damping: float, write=kinematics.write_leg_inverse) -> np.ndarray:
    """J^-1 (6, 6) of a leg; nothing of the other leg's is written."""
    inverses = kinematics.LegInverses(np.full((2, 6, 3), np.nan), np.full((2, 6, 3), np.nan))
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
        columns = leg_inverse(core, leg, damping, kinematics.write_inverse_of_any_axes)
        scale = np.linalg.cond(leg_jacobian(data, leg)) * np.abs(closed).max()
        assert np.abs(columns - closed).max() < 1e-13 * scale


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
            foot = kinematics.sole_motion(
                core.physics, 0, leg, kinematics.base_angular_velocity(core.physics, 0)
            )
            np.testing.assert_allclose([*foot.velocity, *foot.omega], J @ data.qvel, atol=1e-12)


@pytest.mark.parametrize("write", [kinematics.write_leg_inverse, kinematics.write_inverse_of_any_axes])
@pytest.mark.parametrize("knee", [0.0, 1e-6, 1e-3])
def test_damping_bounds_the_rates_of_a_straight_leg(robot_in, random_state, knee, write):
    """|c / (c^2 + damping)| <= 1 / (2 sqrt(damping)), the knee's rate per velocity along the leg [rad/m]."""
    qpos, qvel = random_state(np.random.default_rng(3), 0.0)
    qpos[LEG_QPOS[0] + KNEE] = knee
    inverse = leg_inverse(robot_in(qpos, qvel)[0], 0, 1e-6, write)
    assert np.linalg.norm(inverse[KNEE, :3]) <= 500.0 + 1e-9
    assert np.isfinite(inverse).all()


@pytest.mark.parametrize("write", [kinematics.write_leg_inverse, kinematics.write_inverse_of_any_axes])
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
        kinematics.subtract_leg_torques(
            core.physics, 0, leg, sole_position(core.physics, 0, leg), wrench, torque
        )
        np.testing.assert_allclose(torque, expected, atol=1e-11)


@pytest.mark.parametrize("stance", [0, 1])
def test_a_deviation_changes_its_own_task_by_one(random_state, robot_in, stance):
    """With M qdd = S' T_d + J_s' W_d: tasks(qdd) = identity, and the stance sole stays at rest."""
    rng = np.random.default_rng(stance)
    for _ in range(5):
        core, data = robot_in(*random_state(rng, 0.1), stance)
        inverses = kinematics.LegInverses(np.empty((2, 6, 3)), np.empty((2, 6, 3)))
        left, right = sole_position(core.physics, 0, 0), sole_position(core.physics, 0, 1)
        for leg, sole in enumerate((left, right)):
            kinematics.write_leg_inverse(core.physics, 0, leg, sole, 0.0, inverses)
        legs = kinematics.Legs(
            stance, left, right, inverses, kinematics.com_compliance(core.physics, 0, inverses)
        )
        wrench, torque = np.empty((6, TASKS)), np.empty((NU, TASKS))
        kinematics.write_deviation_maps(core.physics, 0, legs, wrench, torque)
        M, J = np.zeros((NV, NV)), sole_jacobian(data, stance)
        mujoco.mj_fullM(MODEL, data, M)
        qdd = np.linalg.solve(M, np.vstack([np.zeros((6, TASKS)), torque]) + J.T @ wrench)
        tasks = np.vstack([
            M[:3] @ qdd / M[0, 0],
            data.xmat[kinematics.PELVIS].reshape(3, 3) @ qdd[3:6],
            sole_jacobian(data, 1 - stance) @ qdd,
            qdd[kinematics.WAIST_DOF : kinematics.WAIST_DOF + 2],
        ])  # fmt: skip
        np.testing.assert_allclose(tasks, np.eye(TASKS), atol=1e-8)
        np.testing.assert_allclose(J @ qdd, 0.0, atol=1e-8)


@pytest.mark.parametrize("last", [1e-9, -1e-9])
def test_a_singular_leg_has_finite_rates(last):
    matrix, inverse = np.diag([1.0, 2.0, 4.0, 5.0, 10.0, last]), np.empty((6, 6))
    kinematics.invert_6(matrix, inverse)
    expected = np.diag([1.0, 0.5, 0.25, 0.2, 0.1, np.sign(last) * 1e6])
    np.testing.assert_allclose(inverse, expected, rtol=1e-12)
