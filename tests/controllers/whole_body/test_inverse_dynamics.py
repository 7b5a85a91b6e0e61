"""Whole-body control against one dense system of MuJoCo's own matrices.

What the tasks ask for, written out by hand on a robot that stands straight and moves a little.
"""

import math

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.whole_body import inverse_dynamics as dynamics
from push_recovery.controllers.whole_body import kinematics
from push_recovery.controllers.whole_body.inverse_dynamics import Gains, Task, com_force, swing_acceleration
from push_recovery.controllers.whole_body.kinematics import FOOT_BODY, NU, NV, PELVIS, TASKS, SoleMotion
from push_recovery.controllers.whole_body.limits import Bounds, centre_of_pressure, driving_share, make_bounds
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS
from push_recovery.envs.biped.core import BIPED_GAINS as G
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.scenario.scenario import Scenario

MODEL = biped_model()
GAINS = BIPED_GAINS._replace(damping=0.0)  # exact leg inverse
MOTORS = biped().motors
LOOSE, _LOOSE_MEMORY = make_bounds(
    BIPED_BOUNDS._replace(cop_x_max=1e6, cop_y_max=1e6, yaw_friction=1e6, friction=1e6, force_min=-1e9),
    np.full((2, NU), 1e9),
)


def random_task(rng: np.random.Generator, core, stance: int, size: float = 1.0) -> Task:
    """A task near what the robot does, accelerations of about `size` times those of walking."""
    swing = np.zeros(9)
    foot = kinematics.sole_motion(
        core.physics, 0, 1 - stance, kinematics.base_angular_velocity(core.physics, 0)
    )
    swing[:3] = foot.position + rng.normal(0.0, 0.005, 3)
    swing[3:6] = foot.velocity + rng.normal(0.0, 0.05, 3)
    swing[6:] = rng.normal(0.0, 2.0 * size, 3)
    com, waist = rng.normal(0.0, size, 2), rng.normal(0.0, 4.0 * size, 2)
    heading = rng.normal(0.0, 0.05)
    facing = float(np.cos(heading)), float(np.sin(heading))
    above, climb = (
        core.physics.com[0, 0, 2] - kinematics.sole_position(core.physics, 0, stance)[2],
        kinematics.com_velocity(core.physics, 0)[2],
    )
    height = above + rng.normal(0.0, 0.001), climb + rng.normal(0.0, 0.01), rng.normal(0.0, size)
    return Task(stance, tuple(com), height, facing, swing, tuple(waist))


def torques(core, task: Task, gains: Gains, bounds: Bounds, out: np.ndarray) -> np.ndarray:
    """Write the torques (14,) of the core's robot; returns the wrench (6,)."""
    climb, wrench = kinematics.com_velocity(core.physics, 0)[2], np.empty(6)
    dynamics.whole_body_torque(core.physics, 0, task, climb, gains, bounds, wrench, out)
    return wrench


def drift(foot: SoleMotion) -> np.ndarray:
    """Jdot qd of a sole, linear and angular part, (2, 3)."""
    return np.array([foot.drift, foot.turn_drift])


def task_equations(core, data: mujoco.MjData, task: Task) -> tuple[np.ndarray, np.ndarray]:
    """A qdd = b of the 14 tasks in the order of `wrench_bounds`, and of the stance foot at rest (6 rows)."""
    phys, omega = core.physics, kinematics.base_angular_velocity(core.physics, 0)
    stance, swing = (kinematics.sole_motion(phys, 0, leg, omega) for leg in (task.stance, 1 - task.stance))
    M, A, b = np.zeros((NV, NV)), np.zeros((TASKS + 6, NV)), np.empty(TASKS + 6)
    mujoco.mj_fullM(MODEL, data, M)
    height = data.subtree_com[0, 2] - stance.position[2]
    asked, rate, climb = task.height
    climb += GAINS.height_kp * (asked - height) + GAINS.height_kd * (
        rate - kinematics.com_velocity(phys, 0)[2]
    )
    A[:3], b[:3] = M[:3] / BIPED.mass, [*task.com_acceleration, GRAVITY + climb]
    b[:3] -= data.qfrc_bias[:3] / BIPED.mass
    A[3:6, 3:6] = data.xmat[PELVIS].reshape(3, 3)
    b[3:6] = dynamics.base_angular_acceleration(phys, 0, omega, task, GAINS)
    jacobians = [np.zeros((6, NV)), np.zeros((6, NV))]
    for J, leg in zip(jacobians, (task.stance, 1 - task.stance), strict=True):
        mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
    A[6:12] = jacobians[1]
    b[6:12] = np.subtract(swing_acceleration(phys, 0, swing, task, GAINS), drift(swing)).ravel()
    A[12, kinematics.WAIST_DOF] = A[13, kinematics.WAIST_DOF + 1] = 1.0
    b[12:14] = task.waist
    A[14:] = jacobians[0]
    b[14:] = np.subtract(
        dynamics.stance_acceleration(phys, 0, task.stance, stance, task.facing, GAINS), drift(stance)
    ).ravel()
    return A, b


def dense_solution(core, data, task: Task, deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wrench (6,) and torque (14,), M qdd + h = S' tau + J_s' w, of the tasks + `deviation` (14,)."""
    A, b = task_equations(core, data, task)
    b[:TASKS] += deviation
    M = np.zeros((NV, NV))
    mujoco.mj_fullM(MODEL, data, M)
    total = M @ np.linalg.solve(A, b) + data.qfrc_bias
    J = A[TASKS:]
    wrench = np.linalg.solve(J[:, :6].T, total[:6])
    return wrench, (total - J.T @ wrench)[6:]


@pytest.mark.parametrize("stance", [0, 1])
def test_torque_and_wrench_are_the_exact_inverse_dynamics_of_the_tasks(random_state, robot_in, stance):
    rng = np.random.default_rng(stance)
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.1), stance)
        task, torque = random_task(rng, core, stance), np.empty(NU)
        wrench = torques(core, task, GAINS, LOOSE, torque)
        expected = dense_solution(core, data, task, np.zeros(TASKS))
        np.testing.assert_allclose(wrench, expected[0], rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(torque, expected[1], rtol=1e-8, atol=1e-6)


def test_damping_of_the_leg_inverse_is_negligible_off_the_straight_knee(random_state, robot_in):
    rng = np.random.default_rng(2)
    for _ in range(10):
        core, _ = robot_in(*random_state(rng, 0.1))
        task, damped, exact = random_task(rng, core, 0), np.empty(NU), np.empty(NU)
        torques(core, task, BIPED_GAINS, LOOSE, damped)
        torques(core, task, GAINS, LOOSE, exact)
        np.testing.assert_allclose(damped, exact, atol=0.1)


def bound_values(core, wrench: np.ndarray, torque: np.ndarray, stance: int) -> np.ndarray:
    """Excess over each bound: CoP x, y [m], friction, yaw [m], load [300 N], torque [100 N m]."""
    s = BIPED_BOUNDS
    R = core.physics.xmat[0, foot_body(stance)].reshape(3, 3)
    x = R[:2, 0] / np.linalg.norm(R[:2, 0])
    y = np.array([-x[1], x[0]])
    force, moment = wrench[:3], wrench[3:]
    cop = np.array([-moment[1], moment[0]]) / force[2]
    yaw = moment[2] - (cop[0] * force[1] - cop[1] * force[0])
    return np.array(
        [
            abs(cop @ x) - s.cop_x_max,
            abs(cop @ y) - s.cop_y_max,
            math.hypot(force[0], force[1]) / force[2] - s.friction,
            abs(yaw) / force[2] - s.yaw_friction,
            (s.force_min - force[2]) / 300.0,
            np.max(np.abs(torque) - torque_limits(core, torque)) / 100.0,
        ]
    )


def torque_limits(core, torque: np.ndarray) -> np.ndarray:
    """What the motors can give in the direction of the torques, (14,) [N m]."""
    share = [driving_share(v * np.sign(t), v0)
             for v, t, v0 in zip(core.physics.qvel[0, 6:], torque, MOTORS[1], strict=True)]  # fmt: skip
    return MOTORS[0] * share


def foot_body(stance: int) -> int:
    return MODEL.body(("left_foot", "right_foot")[stance]).id


@pytest.mark.parametrize("stance", [0, 1])
def test_the_deviation_is_the_least_one_that_keeps_the_bounds(random_state, robot_in, stance):
    """KKT of min |v|^2 / 2 + sum w e^2 / 2: v + M' (w e) = 0, e what passes each row, d = Q^(-1/2) v."""
    rng, bound = np.random.default_rng(10 + stance), 0
    settings = BIPED_BOUNDS
    bounds, _memory = make_bounds(settings, MOTORS)
    for _ in range(60):
        core, data = robot_in(*random_state(rng, 0.1), stance)
        task, torque = random_task(rng, core, stance, 2.0), np.empty(NU)
        bounds.solution[:] = np.nan
        wrench = torques(core, task, GAINS, bounds, torque)
        if np.isnan(bounds.solution).any():  # the exact solution passes no bound
            assert bound_values(core, wrench, torque, stance).max() <= 1e-9
            continue
        bound += 1
        v, M = bounds.solution, bounds.matrix
        passed = np.maximum(M @ v - bounds.upper, 0) - np.maximum(bounds.lower - M @ v, 0)
        np.testing.assert_allclose(v + M.T @ (settings.row_price * passed), 0.0, atol=1e-7)
        assert np.abs(passed).max() < 5e-3  # in the units of the rows: 300 N, 20 N m, 100 N m
        # the yaw moment is bounded about the CoP of the exact solution, which is among the rows
        values = np.delete(bound_values(core, wrench, torque, stance), [2, 3])
        assert values.max() < 5e-3
        asked = torques(core, task, GAINS, LOOSE, np.empty(NU))[:2]
        # eight faces about the cone, one of them where the force was asked
        grip = settings.friction * wrench[2] + 300.0 * 5e-3
        assert wrench[:2] @ asked / np.linalg.norm(asked) < grip
        assert np.linalg.norm(wrench[:2]) * math.cos(math.pi / 8) < grip
        expected = dense_solution(core, data, task, bounds.scale * v)
        np.testing.assert_allclose(wrench, expected[0], rtol=1e-7, atol=1e-5)
        np.testing.assert_allclose(torque, expected[1], rtol=1e-7, atol=1e-5)
    assert bound >= 20


def test_a_problem_whose_bounds_do_not_bind_leaves_the_exact_solution(random_state, robot_in):
    """Only the lowest vertical force is passed, by a hair: the answer is the exact one but for a hair."""
    rng = np.random.default_rng(20)
    for _ in range(5):
        core, _ = robot_in(*random_state(rng, 0.1))
        task, exact, torque = random_task(rng, core, 0), np.empty(NU), np.empty(NU)
        wrench = torques(core, task, GAINS, LOOSE, exact)
        settings = LOOSE.settings._replace(force_min=wrench[2] + 1e-6)
        bounds, _memory = make_bounds(settings, np.full((2, NU), 1e9))
        again = torques(core, task, GAINS, bounds, torque)
        assert again[2] == pytest.approx(wrench[2] + 1e-6, abs=1e-6)
        np.testing.assert_allclose(again, wrench, atol=1e-4)
        np.testing.assert_allclose(torque, exact, atol=1e-4)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_cop_makes_up_for_the_swing_legs_momentum(biped_core, begin, axis):
    """With the CoM's acceleration asked for, an acceleration a of the swing sole moves the CoP by
    0.0031 s^2 a (docs/whole-body.md): what the leg takes the CMP away from the CoP."""
    core, a, cops = biped_core(1), 30.0, []
    begin(core, 0, Scenario("still"))
    foot = kinematics.sole_motion(core.physics, 0, 1, kinematics.base_angular_velocity(core.physics, 0))
    for share in (0.0, 1.0):
        swing = np.array([*foot.position, *foot.velocity, 0.0, 0.0, 0.0])
        swing[6 + axis] = share * a
        height = core.physics.com[0, 0, 2] - kinematics.sole_position(core.physics, 0, 0)[2]
        task = Task(0, (0.0, 0.0), (height, 0.0, 0.0), (1.0, 0.0), swing, (0.0, 0.0))
        wrench = torques(core, task, GAINS, LOOSE, np.empty(NU))
        cops.append(centre_of_pressure(wrench, (1.0, 0.0))[axis])
    assert cops[1] - cops[0] == pytest.approx(0.0031 * a, rel=0.1)


def wrench_rows(core, asked: np.ndarray, stance: int) -> np.ndarray:
    """P (15, 6) with P w <= 0 the bounds of the wrench, from what each row says of a wrench."""
    s = BIPED_BOUNDS
    R = core.physics.xmat[0, foot_body(stance)].reshape(3, 3)
    x = np.array([*R[:2, 0], 0.0]) / np.linalg.norm(R[:2, 0])
    up = np.array([0.0, 0.0, 1.0])
    y = np.cross(up, x)
    cop = np.cross(up, asked[3:]) / asked[2]  # of the exact solution, within the sole
    cop = np.clip(cop @ x, -s.cop_x_max, s.cop_x_max) * x + np.clip(cop @ y, -s.cop_y_max, s.cop_y_max) * y
    towards = math.atan2(asked[1], asked[0]) + 2.0 * math.pi * np.arange(8) / 8

    def excess(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
        ahead, aside = np.cross(up, moment) @ x, np.cross(up, moment) @ y  # CoP times the load
        yaw = (moment - np.cross(cop, force)) @ up
        room = np.array([s.cop_x_max, s.cop_y_max, s.yaw_friction]) * force[2]
        slides = np.cos(towards) * force[0] + np.sin(towards) * force[1] - s.friction * force[2]
        turning = np.concatenate([[ahead, aside, yaw] - room, [-ahead, -aside, -yaw] - room])
        return np.concatenate([turning / 20.0, slides / 300.0, [-force[2] / 300.0]])

    return np.array([excess(w[:3], w[3:]) for w in np.eye(6)]).T


@pytest.mark.parametrize("stance", [0, 1])
def test_every_row_of_the_problem_is_its_bound_on_the_dense_solution(random_state, robot_in, stance):
    """Torques, CoP, yaw moment, friction and load: rows and bounds from MuJoCo's own matrices."""
    rng, seen = np.random.default_rng(30 + stance), 0
    bounds, _memory = make_bounds(BIPED_BOUNDS, MOTORS)
    while seen < 4:
        core, data = robot_in(*random_state(rng, 0.1), stance)
        task = random_task(rng, core, stance, 2.0)
        bounds.solution[:] = np.nan
        torques(core, task, GAINS, bounds, np.empty(NU))
        if np.isnan(bounds.solution).any():
            continue
        seen += 1
        wrench, torque = dense_solution(core, data, task, np.zeros(TASKS))
        unit = [dense_solution(core, data, task, deviation) for deviation in np.eye(TASKS)]
        Wd, Td = (
            np.array([d[i] for d in unit]).T - exact[:, None] for i, exact in enumerate((wrench, torque))
        )
        P = wrench_rows(core, wrench, stance)
        scale = 1.0 / np.sqrt(bound_prices())
        np.testing.assert_allclose(
            bounds.matrix, np.vstack([Td / 100.0, P @ Wd]) * scale, rtol=1e-6, atol=1e-6
        )
        speed, sign = core.physics.qvel[0, 6:], np.ones(NU)
        top = torque_limits(core, sign), torque_limits(core, -sign)
        assert speed.min() < 0 < speed.max()
        np.testing.assert_allclose(bounds.upper[:NU], (top[0] - torque) / 100.0, atol=1e-7)
        np.testing.assert_allclose(bounds.lower[:NU], (-top[1] - torque) / 100.0, atol=1e-7)
        room = -P @ wrench - np.eye(15)[14] * BIPED_BOUNDS.force_min / 300.0
        np.testing.assert_allclose(bounds.upper[NU:], room, atol=1e-7)


def bound_prices() -> np.ndarray:
    """Price of each deviation (14,): CoM x, y, z; pelvis x, y, z; swing sole linear, angular; waist."""
    s = BIPED_BOUNDS
    com, pelvis = (
        [s.com_price, s.com_price, s.height_price],
        [s.pelvis_price, s.pelvis_price, s.heading_price],
    )
    return np.array([*com, *pelvis, *[s.swing_price] * 3, *[s.swing_turn_price] * 3, *[s.waist_price] * 2])


ZERO = (0.0, 0.0, 0.0)
OMEGA, SPEED = (0.1, -0.2, 0.3), (0.4, -0.5, 0.6)  # [rad/s], [m/s]
YAW = (0.02, 0.05, 0.7)  # beyond the heading [rad], its rate, its acceleration
SMALL = 1e-3  # [rad]


def task(swing=None, facing=(1.0, 0.0), height=ZERO, swing_yaw=ZERO, pelvis_yaw=ZERO, com=(0.0, 0.0)) -> Task:
    return Task(
        0, com, height, facing, np.zeros(9) if swing is None else swing, (0.0, 0.0), swing_yaw, pelvis_yaw
    )


@pytest.fixture
def upright(robot_in):
    """The robot with all joints at zero, and a function that leans one of its bodies."""
    core, _ = robot_in(MODEL.qpos0.copy(), np.zeros(MODEL.nv))
    straight = np.eye(3)

    def lean(body: int, rotation: np.ndarray) -> None:
        core.physics.xmat[0, body] = (rotation @ straight).ravel()

    for body in (PELVIS, *FOOT_BODY):
        lean(body, straight)
    return core.physics, lean


def turned(axis: int, angle: float) -> np.ndarray:
    """Rotation about a world axis."""
    cos, sin = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = cos, -sin, sin, cos
    return out


def test_the_pelvis_is_turned_against_its_lean_and_its_rate(upright):
    phys, lean = upright
    found = dynamics.base_angular_acceleration(phys, 0, OMEGA, task(pelvis_yaw=YAW), G)
    heading = G.heading_kp * 0.02 - G.heading_kd * (0.3 - 0.05) + 0.7
    np.testing.assert_allclose(found, [-0.1 * G.pelvis_kd, 0.2 * G.pelvis_kd, heading], atol=1e-12)
    for axis, gain in enumerate((G.pelvis_kp, G.pelvis_kp, G.heading_kp)):
        lean(PELVIS, turned(axis, SMALL))
        expected = np.zeros(3)
        expected[axis] = -gain * SMALL
        np.testing.assert_allclose(
            dynamics.base_angular_acceleration(phys, 0, ZERO, task(), G), expected, atol=1e-3
        )


def test_the_heading_is_that_of_the_task(upright):
    phys, _ = upright
    facing = (math.cos(0.3), math.sin(0.3))  # to the left of where the pelvis faces
    found = dynamics.base_angular_acceleration(phys, 0, ZERO, task(facing=facing), G)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.3 * G.heading_kp], atol=1e-12)


def test_the_stance_foot_is_braked_and_levelled_and_does_not_turn_back(upright):
    phys, lean = upright
    foot = SoleMotion(ZERO, SPEED, OMEGA, ZERO, ZERO)
    linear, angular = dynamics.stance_acceleration(phys, 0, 0, foot, (1.0, 0.0), G)
    np.testing.assert_allclose(linear, -G.stance_kd * np.array(SPEED), atol=1e-12)
    np.testing.assert_allclose(angular, -G.stance_kd * np.array(OMEGA), atol=1e-12)
    still = SoleMotion(ZERO, ZERO, ZERO, ZERO, ZERO)
    for axis, gain in enumerate((G.stance_kp, G.stance_kp, 0.0)):
        lean(FOOT_BODY[0], turned(axis, SMALL))
        expected = np.zeros(3)
        expected[axis] = -gain * SMALL
        np.testing.assert_allclose(
            dynamics.stance_acceleration(phys, 0, 0, still, (1.0, 0.0), G)[1], expected, atol=1e-3
        )


def test_the_swing_sole_follows_its_reference(upright):
    phys, lean = upright
    reference = np.array([0.01, -0.02, 0.03, 0.1, 0.2, -0.1, 1.0, -2.0, 3.0])
    foot = SoleMotion((0.02, 0.01, 0.0), (0.3, 0.1, 0.2), OMEGA, ZERO, ZERO)
    linear, angular = swing_acceleration(phys, 0, foot, task(reference, swing_yaw=YAW), G)
    kp, kd = G.swing_kp, G.swing_kd
    expected = [1.0 - 0.01 * kp - 0.2 * kd, -2.0 - 0.03 * kp + 0.1 * kd, 3.0 + 0.03 * kp - 0.3 * kd]
    assert math.hypot(*expected[:2]) < G.swing_max
    np.testing.assert_allclose(linear, expected, atol=1e-12)
    kp, kd = G.swing_turn_kp, G.swing_turn_kd
    np.testing.assert_allclose(angular, [-0.1 * kd, 0.2 * kd, 0.02 * kp - 0.25 * kd + 0.7], atol=1e-12)
    lean(FOOT_BODY[1], turned(1, SMALL))
    found = swing_acceleration(phys, 0, foot, task(reference, swing_yaw=YAW), G)[1]
    np.testing.assert_allclose(np.subtract(found, angular), [0.0, -kp * SMALL, 0.0], atol=1e-3)


def test_what_is_asked_of_the_swing_sole_is_bounded_sideways_alone(upright):
    phys, _ = upright
    reference = np.zeros(9)
    reference[6:] = 3.0 * G.swing_max, -4.0 * G.swing_max, 5.0 * G.swing_max
    still = SoleMotion(ZERO, ZERO, ZERO, ZERO, ZERO)
    linear, _ = swing_acceleration(phys, 0, still, task(reference), G)
    np.testing.assert_allclose(linear, np.array([0.6, -0.8, 5.0]) * G.swing_max, rtol=1e-12)


def test_the_force_on_the_com_carries_it_and_brings_it_to_its_height(upright):
    phys, _ = upright
    com = phys.com[0, 0, 2]
    asked = task(height=(com - 0.1 + 0.02, 0.3, 0.5), com=(1.0, -2.0))
    found = com_force(phys, 0, asked, (0.0, 0.0, 0.1), 0.2, G)  # the sole is 0.1 m up, the CoM climbs
    lift = 0.5 + 0.02 * G.height_kp + (0.3 - 0.2) * G.height_kd
    np.testing.assert_allclose(found, BIPED.mass * np.array([1.0, -2.0, GRAVITY + lift]), rtol=1e-9)
