"""Whole-body control on two feet against dense systems of MuJoCo's own matrices."""

import math

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.whole_body.inverse_dynamics import (
    Task,
    base_angular_acceleration,
    stance_acceleration,
)
from push_recovery.controllers.whole_body.kinematics import (
    NU,
    NV,
    PELVIS,
    WAIST_DOF,
    base_angular_velocity,
    com_velocity,
    sole_motion,
    sole_position,
)
from push_recovery.controllers.whole_body.limits import SHARE_PRICE, SOLE_EDGE, make_bounds, yaw_grip
from push_recovery.controllers.whole_body.two_feet import foot_bears, share_wrench, standing_torque
from push_recovery.envs.biped.core import BIPED, BIPED_BOUNDS, BIPED_GAINS
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import PLAN, biped, biped_model
from push_recovery.envs.simulation import advance
from scipy.optimize import linprog

MODEL = biped_model()
GAINS = BIPED_GAINS._replace(damping=0.0)  # exact leg inverse
MOTORS = biped().motors
FULL = BIPED_BOUNDS._replace(cop_x_max=0.1, cop_y_max=0.05)
LOOSE, _LOOSE_MEMORY = make_bounds(
    FULL._replace(cop_x_max=1e6, cop_y_max=1e6, yaw_friction=1e6, friction=1e6),
    np.full((2, NU), 1e9),
    two_feet=True,
)
AHEAD, WIDE = (1.0, 0.0), LOOSE.settings
ZERO, PLANNED = (0.0, 0.0, 0.0), ((0.0, 0.0), (0.0, 0.0))


def random_task(rng, core, stance, size):
    """Accelerations of CoM, waist and height about a robot's present state."""
    above = core.physics.com[0, 0, 2] - sole_position(core.physics, 0, stance)[2]
    climb, heading = com_velocity(core.physics, 0)[2], rng.normal(0.0, 0.05)
    height = above + rng.normal(0.0, 0.001), climb + rng.normal(0.0, 0.01), rng.normal(0.0, size)
    facing = float(np.cos(heading)), float(np.sin(heading))
    com, waist = tuple(rng.normal(0.0, size, 2)), tuple(rng.normal(0.0, 4.0 * size, 2))
    return Task(stance, com, height, facing, np.zeros(9), waist, ZERO, ZERO, (0.0, 0.0), (0.0, 0.0))


def torques(core, task, bounds, most=1.0):
    """Wrenches of stance and other sole (6,), torque (14,) and the bits of the bounds met."""
    wrench, other, torque = np.empty(6), np.empty(6), np.empty(NU)
    climb = com_velocity(core.physics, 0)[2]
    met = standing_torque(core.physics, 0, task, climb, most, GAINS, bounds, wrench, other, torque)
    return wrench, other, torque, met


def jacobians(data, stance):
    """(6, 20) of the stance sole and of the other one."""
    found = []
    for leg in (stance, 1 - stance):
        J = np.zeros((6, NV))
        mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site(PLAN.soles[leg]).id)
        found.append(J)
    return found


def dense_total(core, data, task, deviation):
    """M qdd + h (20,) of the tasks, CoM, pelvis and waist deviating by (8,), both soles still."""
    phys, omega = core.physics, base_angular_velocity(core.physics, 0)
    M, A, b = np.zeros((NV, NV)), np.zeros((NV, NV)), np.empty(NV)
    mujoco.mj_fullM(MODEL, data, M)
    asked, rate, climb = task.height
    climb += GAINS.height_kp * (asked - data.subtree_com[0, 2] + sole_position(phys, 0, task.stance)[2])
    climb += GAINS.height_kd * (rate - com_velocity(phys, 0)[2])
    A[:3], b[:3] = M[:3] / BIPED.mass, [*task.com_acceleration, GRAVITY + climb]
    b[:3] -= data.qfrc_bias[:3] / BIPED.mass
    A[3:6, 3:6] = data.xmat[PELVIS].reshape(3, 3)
    b[3:6] = base_angular_acceleration(phys, 0, omega, task, GAINS)
    (cos, sin), R = task.facing, data.xmat[PELVIS].reshape(3, 3)
    A[6, WAIST_DOF] = A[7, WAIST_DOF + 1] = 1.0  # of the trunk in the world, about left and ahead
    A[6, 3:6], A[7, 3:6] = np.array([-sin, cos, 0.0]) @ R, np.array([cos, sin, 0.0]) @ R
    b[6:8] = task.waist
    b[:8] += deviation
    for i, (J, leg) in enumerate(
        zip(jacobians(data, task.stance), (task.stance, 1 - task.stance), strict=True)
    ):
        foot, rows = sole_motion(phys, 0, leg, omega), slice(8 + 6 * i, 14 + 6 * i)
        still = np.array(stance_acceleration(phys, 0, leg, foot, task.facing, GAINS))
        if phys.load[0, leg] == 0.0:  # it is to sink at 0.1 m/s
            still[0, 2] -= 0.1 * GAINS.stance_kd
        A[rows], b[rows] = J, np.subtract(still, [foot.drift, foot.turn_drift]).ravel()
    return M @ np.linalg.solve(A, b) + data.qfrc_bias


@pytest.mark.parametrize("stance", [0, 1])
def test_wrenches_and_torques_are_the_inverse_dynamics_of_still_soles(random_state, robot_in, stance):
    rng = np.random.default_rng(stance)
    for _ in range(20):
        core, data = robot_in(*random_state(rng, 0.1), stance)
        core.physics.load[0] = rng.permutation([300.0, 0.0, 200.0])[:2]
        task = random_task(rng, core, stance, 1.0)
        wrench, other, torque, _ = torques(core, task, LOOSE)
        total = dense_total(core, data, task, np.zeros(8))
        near, far = jacobians(data, stance)
        forces = near.T @ wrench + far.T @ other
        np.testing.assert_allclose(forces[:6], total[:6], rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(torque, (total - forces)[6:], rtol=1e-8, atol=1e-6)


def cop(wrench):
    return np.array([-wrench[4], wrench[3]]) / wrench[2]


@pytest.mark.parametrize(
    ("place", "share"), [(0.0, 0.0), (0.25, 0.25), (0.5, 0.5), (1.0, 1.0), (-0.2, 0.0), (1.3, 1.0)]
)
def test_the_load_goes_with_the_cop_from_foot_to_foot(place, share):
    r, force, off = np.array([0.05, 0.2, 0.03]), np.array([30.0, -20.0, 600.0]), np.array([0.01, -0.004, 0.0])
    at = place * np.array([*r[:2], 0.0]) + off - off @ r / (r[:2] @ r[:2]) * np.array([*r[:2], 0.0])
    total = np.concatenate([force, np.cross(at, force) + [0.0, 0.0, 4.0]])
    wrench, other = total.copy(), np.empty(6)
    share_wrench(wrench, tuple(r), AHEAD, WIDE, 1.0, other)
    np.testing.assert_allclose(wrench[:3] + other[:3], force)
    np.testing.assert_allclose(wrench[3:] + other[3:] + np.cross(r, other[:3]), total[3:])
    assert other[2] == pytest.approx(share * 600.0)
    if 0.0 < share < 1.0:
        np.testing.assert_allclose(cop(wrench), cop(other))
        np.testing.assert_allclose(wrench[:3] / wrench[2], other[:3] / other[2])


def test_a_foot_that_is_about_to_leave_has_no_more_than_its_share():
    total = np.array([0.0, 0.0, 600.0, 600.0 * 0.15, 0.0, 0.0])  # CoP at 3/4 of the way
    other = np.empty(6)
    for most in (0.75, 0.3, 0.0):
        wrench = total.copy()
        share_wrench(wrench, (0.0, 0.2, 0.0), AHEAD, WIDE, most, other)
        assert other[2] == pytest.approx(most * 600.0)
        assert wrench[3] + other[3] + 0.2 * other[2] == pytest.approx(total[3])


@pytest.mark.parametrize("turn", [0.0, 0.4, -2.0])
def test_no_sole_passes_its_edge_while_the_cop_is_in_the_hull_of_both(turn):
    """Any mixture of a point of either sole is a CoP that both together can have, of equal CoPs in each."""
    rng, edges = np.random.default_rng(5), np.array([0.09, 0.04])
    R = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    soles = WIDE._replace(cop_x_max=edges[0], cop_y_max=edges[1])
    for _ in range(200):
        r, mixture = R @ rng.uniform([-0.3, 0.1], [0.3, 0.3]), rng.uniform()
        here, there = R @ (edges * rng.uniform(-1, 1, 2)), r + R @ (edges * rng.uniform(-1, 1, 2))
        at = (1.0 - mixture) * here + mixture * there
        wrench, other = np.array([0.0, 0.0, 500.0, 500.0 * at[1], -500.0 * at[0], 0.0]), np.empty(6)
        share_wrench(wrench, (*r, 0.0), (math.cos(turn), math.sin(turn)), soles, 1.0, other)
        for one in (wrench, other):
            if one[2] > 1e-6:
                assert (np.abs(R.T @ cop(one)) <= edges * (1.0 + 1e-9)).all()
        assert min(wrench[2], other[2]) >= 0.0


@pytest.mark.parametrize("cop", [(0.0, 0.0), (0.09, 0.0), (0.03, -0.04), (-0.09, 0.045), (0.1, 0.05)])
def test_a_sole_resists_no_more_yaw_than_its_corners_can(cop):
    """The largest moment of four corner forces within friction pyramids, by a linear program."""
    X, Y, mu = FULL.cop_x_max, FULL.cop_y_max, 0.3
    corners = np.array([(X, Y), (X, -Y), (-X, Y), (-X, -Y)])
    moment = np.column_stack([-corners[:, 1], corners[:, 0], np.zeros(4)]).ravel()
    grid, one = np.eye(4), np.ones(4)
    equal = [np.kron(one, axis) for axis in np.eye(3)] + [np.kron(c, [0, 0, 1.0]) for c in corners.T]
    cone = [np.kron(corner, [*(sign * np.eye(2)[axis]), -mu]) for corner in grid for axis in (0, 1)
            for sign in (1.0, -1.0)]  # fmt: skip
    found = linprog(
        -moment, cone, np.zeros(16), equal, [0.0, 0.0, 1.0, *cop], bounds=[(None, None)] * 12, method="highs"
    )
    bounds, _memory = make_bounds(FULL._replace(yaw_friction=1e3), MOTORS, two_feet=True)
    bounds.grip[0] = mu
    assert yaw_grip(*cop, bounds) == pytest.approx(-found.fun)
    small, _memory_of_small = make_bounds(FULL._replace(yaw_friction=1e-3), MOTORS, two_feet=True)
    assert yaw_grip(0.0, 0.0, small) == 1e-3
    one_foot, _memory_of_one = make_bounds(FULL, MOTORS)
    assert yaw_grip(*cop, one_foot) == FULL.yaw_friction


def forward(core, leg):
    """Where a sole points, world axes (2,)."""
    R = core.physics.xmat[0, MODEL.body(("left_foot", "right_foot")[leg]).id].reshape(3, 3)
    return tuple(R[:2, 0] / np.linalg.norm(R[:2, 0]))


def excess(core, leg, wrench):
    """What a sole's wrench passes its bounds by: CoP [m] and friction, times its load, and pull; [300 N]."""
    x = forward(core, leg)
    if wrench[2] < 1.0:
        return -wrench[2] / 300.0
    ahead, aside = cop(wrench) @ x, cop(wrench) @ [-x[1], x[0]]
    slip = math.hypot(*wrench[:2]) / wrench[2] - FULL.friction / math.cos(math.pi / 8)
    return max(abs(ahead) - 0.1, abs(aside) - 0.05, slip) * wrench[2] / 300.0


def yaw_excess(core, leg, wrench, asked):
    """What |M_z| passes its bound by, about the CoP that was asked for and with its signs; [20 N m]."""
    x = forward(core, leg)
    axes, edges = np.array([x, [-x[1], x[0]]]), np.array([0.1, 0.05])
    old, new = axes @ cop(asked), axes @ cop(wrench)
    at = axes.T @ np.clip(old, -edges, edges)
    grip = FULL.friction * (0.15 - np.abs(old).sum())
    bound = FULL.yaw_friction if grip >= FULL.yaw_friction else FULL.friction * (0.15 - np.sign(old) @ new)
    yaw = wrench[5] - at[0] * wrench[1] + at[1] * wrench[0]
    return (abs(yaw) - bound * wrench[2]) / 20.0


def edge_room(core, leg, wrench):
    """How far the CoP under a sole is from its edge, times its load [N m]; inf where that is small."""
    if wrench[2] <= 1.0:
        return math.inf
    x = forward(core, leg)
    ahead, aside = cop(wrench) @ x, cop(wrench) @ [-x[1], x[0]]
    return min(0.1 - abs(ahead), 0.05 - abs(aside)) * wrench[2]


def bounded(random_state, robot_in, stance, count):
    """Bounds, and an iterator over loaded robots with a task that asks for much of both soles."""
    rng = np.random.default_rng(40 + stance)
    bounds, memory = make_bounds(FULL, MOTORS, two_feet=True)

    def tasks():
        for _ in range(count):
            core, data = robot_in(*random_state(rng, 0.1), stance)
            core.physics.load[0] = 300.0
            yield core, data, random_task(rng, core, stance, 2.0)

    return bounds, memory, tasks()


@pytest.mark.parametrize("stance", [0, 1])
def test_the_deviation_is_the_least_one_that_keeps_the_bounds_of_both_soles(random_state, robot_in, stance):
    bounds, _memory, tasks = bounded(random_state, robot_in, stance, 60)
    bound = 0
    for core, data, task in tasks:
        bounds.solution[:] = np.nan
        wrench, other, torque, met = torques(core, task, bounds)
        if min(edge_room(core, stance, wrench), edge_room(core, 1 - stance, other)) < 1e-3:
            assert met & SOLE_EDGE
        if np.isnan(bounds.solution).any():
            assert max(excess(core, stance, wrench), excess(core, 1 - stance, other)) <= 1e-9
            for leg, one in ((stance, wrench), (1 - stance, other)):
                assert one[2] < 1.0 or yaw_excess(core, leg, one, one) <= 1e-9
            continue
        bound += 1
        v, M = bounds.solution, bounds.matrix
        passed = np.maximum(M @ v - bounds.upper, 0) - np.maximum(bounds.lower - M @ v, 0)
        np.testing.assert_allclose(v + M.T @ (FULL.row_price * passed), 0.0, atol=1e-6)
        if np.abs(passed).max() < 1e-3:
            assert max(excess(core, stance, wrench), excess(core, 1 - stance, other)) < 0.02
        # d = Q^(-1/2) v: CoM, pelvis and waist deviate, the other sole takes over a wrench, both stay still
        d = bounds.scale * v
        total = dense_total(core, data, task, np.concatenate([d[:6], d[12:]]))
        near, far = jacobians(data, stance)
        forces = near.T @ wrench + far.T @ other
        np.testing.assert_allclose(forces[:6], total[:6], rtol=1e-7, atol=1e-5)
        np.testing.assert_allclose(torque, (total - forces)[6:], rtol=1e-7, atol=1e-5)
        asked, before, _, _ = torques(core, task, LOOSE)
        r = np.subtract(*(sole_position(core.physics, 0, leg) for leg in (1 - stance, stance)))
        asked[:3], asked[3:] = asked[:3] + before[:3], asked[3:] + before[3:] + np.cross(r, before[:3])
        share_wrench(asked, tuple(r), forward(core, stance), FULL, 1.0, before)
        for leg, one, was in ((stance, wrench, asked), (1 - stance, other, before)):
            if np.abs(passed).max() < 1e-3 and min(was[2], one[2]) > 1.0:
                assert yaw_excess(core, leg, one, was) < 2e-3
        np.testing.assert_allclose(other - before, d[6:12], rtol=1e-7, atol=1e-5)
        s = FULL
        prices = [s.com_price, s.com_price, s.height_price, s.pelvis_price, s.pelvis_price, s.heading_price]
        prices += [SHARE_PRICE] * 6 + [s.waist_price] * 2
        np.testing.assert_allclose(bounds.scale, 1.0 / np.sqrt(prices))
    assert bound >= 20


def test_a_robot_stands_still_and_carries_half_of_its_weight_on_each_foot(biped_core):
    """Ten seconds under a CMP on the DCM's far side, which is the law of a pendulum that is to stay."""
    core, soles = biped_core(1), np.array([[0.0, 0.1, 0.0], [0.05, -0.1, 0.0]])
    bounds, _memory = make_bounds(FULL, MOTORS, two_feet=True)
    rest, omega, phys = np.array([0.025, 0.0]), BIPED.omega, core.physics
    core.put(0, *posture(core.body, np.array([*rest, BIPED.com_height]), np.zeros(3), soles))
    for _ in range(5000):
        com = phys.com[0, 0, :2]
        dcm = com + np.array(com_velocity(phys, 0)[:2]) / omega
        asked = omega**2 * (com - rest - 2.0 * (dcm - rest))
        waist = -20.0 * phys.qpos[0, 7:9] - 9.0 * phys.qvel[0, 6:8]
        height = BIPED.com_height, 0.0, 0.0
        task = Task(0, tuple(asked), height, (1.0, 0.0), np.zeros(9), tuple(waist), ZERO, ZERO, *PLANNED)
        phys.ctrl[0] = torques(core, task, bounds)[2]
        advance(core.simulations.handles, 0)
    np.testing.assert_allclose(phys.com[0, 0], [*rest, BIPED.com_height], atol=1e-3)
    np.testing.assert_allclose(phys.load[0], 0.5 * BIPED.weight, rtol=1e-3)
    assert np.abs(phys.qvel[0]).max() < 1e-3


@pytest.mark.parametrize(("load", "bears"), [(0.0, True), (300.0, True), (-1.0, False)])
def test_a_foot_may_bear_nothing_and_never_pulls(load, bears):
    assert foot_bears(np.array([0.0, 0.0, load, 0.0, 0.0, 0.0]), AHEAD, LOOSE) is bears


@pytest.mark.parametrize("stance", [0, 1])
def test_no_bound_gives_a_leaving_foot_more_than_its_share(random_state, robot_in, stance):
    bounds, _memory, tasks = bounded(random_state, robot_in, stance, 20)
    solved = 0
    for core, _, task in tasks:
        wrench, other, _, _ = torques(core, task, LOOSE, 0.2)
        load = wrench[2] + other[2]
        assert other[2] <= 0.2 * load + 1e-9
        bounds.solution[:] = np.nan
        assert torques(core, task, bounds, 0.2)[1][2] <= 0.2 * load + 1.0
        solved += not np.isnan(bounds.solution).any()
    assert solved > 10
