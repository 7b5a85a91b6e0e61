"""The biped's observation against MuJoCo's own quantities, and its mirror symmetry.

The push estimate of the biped against the forces that act on it.
"""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.model import observation as layout
from push_recovery.controllers.model.observation import PREVIOUS_ACTION, PUSH_ESTIMATE
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.gait_machine import FLOOR
from push_recovery.controllers.whole_body.kinematics import PELVIS, TRUNK
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.robots.biped import PLAN, biped_model
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

MODEL = biped_model()


def observe(core, command=(0.0, 0.0)) -> np.ndarray:
    """Observation of the state as it is; a planning period of no length."""
    core.command[0, :2] = command
    substeps, core.substeps = core.substeps, 0
    core.gait.plan[0] = [0.0, 0.2, 0.5, 0.0, 0.0, 0.0, 0.0]
    core.step(core.gait.plan.copy(), np.full((1, 7), 0.25))
    core.substeps = substeps
    return core.observation[0].copy()


def velocity(data: mujoco.MjData, kind: mujoco.mjtObj, index: int) -> np.ndarray:
    """Linear, then angular velocity in world axes, (6,)."""
    twist = np.empty(6)
    mujoco.mj_objectVelocity(MODEL, data, kind, index, twist, 0)
    return np.concatenate([twist[3:], twist[:3]])


@pytest.mark.parametrize("stance", [0, 1])
def test_entries_are_mujocos_quantities_in_the_canonical_frame(random_state, robot_in, stance):
    rng, flip = np.random.default_rng(stance), np.array([1.0, -1.0 if stance == 0 else 1.0])
    for _ in range(10):
        core, data = robot_in(*random_state(rng), stance)
        core.gait.elapsed[0] = 0.123
        obs = observe(core, (0.3, 0.1))
        soles = [MODEL.site(name).id for name in PLAN.soles]
        sole, swing = data.site_xpos[soles[stance]], data.site_xpos[soles[1 - stance]]
        com, com_velocity = data.subtree_com[0], data.subtree_linvel[0]
        foot = velocity(data, mujoco.mjtObj.mjOBJ_SITE, soles[1 - stance])
        expected = [
            (layout.COM, flip * (com - sole)[:2]),
            (layout.COM_VELOCITY, flip * com_velocity[:2]),
            (layout.DCM, flip * ((com - sole)[:2] + com_velocity[:2] / BIPED.omega)),
            (layout.SWING_POSITION, [*(flip * (swing - sole)[:2]), swing[2]]),
            (layout.SWING_VELOCITY, [*(flip * foot[:2]), foot[2]]),
            (layout.COMMAND, flip * [0.3, 0.1]),
            (layout.PREVIOUS_ACTION, np.full(7, 0.25)),
        ]
        for entry, value in expected:
            np.testing.assert_allclose(obs[entry], value, atol=1e-12)
        assert obs[layout.ELAPSED] == 0.123
        assert obs[layout.COM_HEIGHT_ERROR] == pytest.approx(com[2] - sole[2] - BIPED.com_height, abs=1e-12)
        assert obs[layout.COM_VERTICAL_VELOCITY] == pytest.approx(com_velocity[2], abs=1e-12)
        spin = velocity(data, mujoco.mjtObj.mjOBJ_BODY, PELVIS)[3:]
        assert obs[layout.YAW_RATE] == pytest.approx(flip[1] * spin[2], abs=1e-12)
        spin = velocity(data, mujoco.mjtObj.mjOBJ_BODY, TRUNK)[3:]
        np.testing.assert_allclose(obs[layout.TRUNK_RATE], [spin[1], -flip[1] * spin[0]], atol=1e-12)


@pytest.mark.parametrize("stance", [0, 1])
@pytest.mark.parametrize("body", ["trunk", "pelvis"])
def test_lean_is_positive_towards_x_and_the_swing_side(robot_in, stance, body):
    """A lean that moves the body's top by 0.1 m per metre reads atan(0.1)."""
    entry = layout.TRUNK_ANGLE if body == "trunk" else layout.PELVIS_ANGLE
    outward = -1.0 if stance == 0 else 1.0
    for axis, towards in ((0, [1.0, 0.0]), (1, [0.0, outward])):
        qpos = MODEL.qpos0.copy()
        angle = np.arctan(0.1)
        # a turn about the horizontal axis z x towards
        turn = np.array([-towards[1], towards[0], 0.0])
        mujoco.mju_axisAngle2Quat(qpos[3:7], turn, angle)
        if body == "trunk":
            qpos[3:7], qpos[7], qpos[8] = (1, 0, 0, 0), angle * turn[1], angle * turn[0]
        core, data = robot_in(qpos, np.zeros(MODEL.nv), stance)
        top = data.body(body).xmat.reshape(3, 3)[:, 2]
        assert top[:2] @ towards > 0.09
        value = observe(core)[entry]
        assert value[axis] == pytest.approx(angle, abs=1e-9)
        assert value[1 - axis] == pytest.approx(0.0, abs=1e-9)


def test_rates_are_the_derivatives_of_the_angles(robot_in, random_state):
    rng = np.random.default_rng(4)
    qpos, qvel = random_state(rng, 0.01)
    qvel[3:6] *= [10.0, 10.0, 10.0]
    core, _ = robot_in(qpos, qvel)
    rates = observe(core)
    angles, eps = [], 1e-5
    for step in (eps, -eps):
        moved = qpos.copy()
        mujoco.mj_integratePos(MODEL, moved, qvel, step)
        angles.append(observe(robot_in(moved, qvel)[0]))
    derivative = (angles[0] - angles[1]) / (2 * eps)
    pairs = ((layout.TRUNK_RATE, layout.TRUNK_ANGLE), (layout.YAW_RATE, layout.HEADING_ERROR))
    for rate, angle in pairs:
        np.testing.assert_allclose(rates[rate], derivative[angle], atol=0.02 * np.abs(qvel).max())


def mirrored(qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reflection in the x-z plane: legs exchanged, y and the turns about x and z negated."""
    leg = np.array([-1.0, -1.0, 1.0, 1.0, 1.0, -1.0])
    q, v = qpos.copy(), qvel.copy()
    q[1], q[4], q[6], q[8] = -q[1], -q[4], -q[6], -q[8]
    v[1], v[3], v[5], v[7] = -v[1], -v[3], -v[5], -v[7]
    q[9:15], q[15:21] = leg * qpos[15:21], leg * qpos[9:15]
    v[8:14], v[14:20] = leg * qvel[14:20], leg * qvel[8:14]
    return q, v


def test_the_mirrored_robot_sees_the_same(random_state, robot_in):
    rng = np.random.default_rng(5)
    for _ in range(10):
        qpos, qvel = random_state(rng)
        left = observe(robot_in(qpos, qvel, 0)[0], (0.2, 0.1))
        right = observe(robot_in(*mirrored(qpos, qvel), 1)[0], (0.2, -0.1))
        np.testing.assert_allclose(left, right, atol=1e-10)


@pytest.mark.parametrize("stance", [0, 1])
def test_world_points_are_those_of_the_wrench_off_heading_0(random_state, robot_in, stance):
    """About the CoP the wrench has no horizontal moment; the CMP is the plan's trunk acceleration further."""
    core, data = robot_in(*random_state(np.random.default_rng(8)), stance)
    heading, outward = 0.7, -1.0 if stance == 0 else 1.0
    sole = data.site_xpos[MODEL.site(PLAN.soles[stance]).id]
    force, moment = np.array([40.0, -70.0, 500.0]), np.array([12.0, 18.0, 3.0])
    core.gait.heading[0], core.gait.wrench[0] = heading, [*force, *moment]
    core.gait.plan[0] = [0.0, 0.2, 0.5, 0.0, 0.0, 5.0, -3.0]
    substeps, core.substeps = core.substeps, 0
    core.step(core.gait.plan.copy(), np.zeros((1, 7)))
    core.substeps = substeps
    dcm, cop, cmp = core.world[0].reshape(3, 2)
    com, velocity = data.subtree_com[0], data.subtree_linvel[0]
    np.testing.assert_allclose(dcm, (com + velocity / BIPED.omega)[:2], atol=1e-12)
    lever = np.array([*(cop - sole[:2]), 0.0])
    np.testing.assert_allclose((moment - np.cross(lever, force))[:2], 0.0, atol=1e-9)
    ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    shift = BIPED.cmp_per_trunk_acceleration * (5.0 * ahead - 3.0 * outward * left)
    np.testing.assert_allclose(cmp - cop, shift, atol=1e-12)


@pytest.mark.parametrize("stance", [0, 1])
def test_the_observation_moves_and_turns_with_the_heading(random_state, robot_in, stance):
    """A robot that stands elsewhere and turned, told that heading, sees what it saw."""
    qpos, qvel = random_state(np.random.default_rng(9))
    here, _ = robot_in(qpos, qvel, stance)
    seen = observe(here, (0.3, 0.1))
    turn, quat = 1.1, np.empty(4)
    mujoco.mju_axisAngle2Quat(quat, np.array([0.0, 0.0, 1.0]), turn)
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    turned, rates = qpos.copy(), qvel.copy()
    turned[:2], rates[:2] = spin @ qpos[:2] + [3.0, -2.0], spin @ qvel[:2]
    mujoco.mju_mulQuat(turned[3:7], quat, qpos[3:7].copy())
    core, _ = robot_in(turned, rates, stance)
    core.gait.heading[0] = turn
    np.testing.assert_allclose(observe(core, (0.3, 0.1)), seen, atol=1e-10)


POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
STIFFNESS = BIPED.mass * BIPED.omega**2  # force per estimate [N/m]
QUIET = 0.02  # [m]


def step(core) -> None:
    action = POLICY.predict(core.observation)[0]
    core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))


def world_estimate(core, k: int = 0) -> np.ndarray:
    """Estimate [m] in world axes of a robot whose heading is 0."""
    return core.observation[k, PUSH_ESTIMATE] * [1.0, -1.0 if core.gait.stance[k] == 0 else 1.0]


def walk(core, begin, scenario: Scenario, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and mean push forces over m omega^2 of every period, (ticks, 2) [m], world axes."""
    begin(core, 0, scenario)
    estimates, forces, before = [], [], np.zeros(2)
    period = core.substeps * MODEL.opt.timestep
    for _ in range(round(seconds / period)):
        step(core)
        delivered = core.pushes.delivered[0].sum(axis=0)[:2]
        forces.append((delivered - before) / (period * STIFFNESS))
        estimates.append(world_estimate(core))
        before = delivered
    assert core.gait.failure[0] == 0
    return np.array(estimates), np.array(forces)


@pytest.mark.parametrize("rate", [50.0, 100.0])
@pytest.mark.parametrize("body", ["pelvis", "trunk"])
@pytest.mark.parametrize("command", [Command(), Command(0.4, 0.0), Command(0.0, 0.15)], ids=str)
def test_the_estimate_is_the_push(biped_core, begin, command, body, rate):
    push = Push((-120.0, 160.0, 40.0), 0.12, GaitEvent(2, "left", 0.6), body)  # lasts into the next step
    estimates, forces = walk(biped_core(1, rate), begin, Scenario("a", (push,), command), 2.5)
    size = np.linalg.norm(forces, axis=1)
    pushed = size > 0.99 * size.max()
    assert pushed.sum() >= 4
    np.testing.assert_allclose(size[pushed], np.hypot(120.0, 160.0) / STIFFNESS, rtol=1e-9)
    error = np.linalg.norm(estimates - forces, axis=1)
    assert np.linalg.norm((estimates - forces)[pushed].mean(axis=0)) < 0.03 * size.max()
    assert error.max() < QUIET  # periods pushed in part, touchdowns and the recovery too


@pytest.mark.parametrize("command", [Command(), Command(0.4, 0.0)], ids=str)
def test_the_estimate_is_quiet_without_push(biped_core, begin, command):
    estimates, _ = walk(biped_core(), begin, Scenario("a", (), command), 3.0)
    assert np.abs(estimates).max() < QUIET
    assert np.abs(estimates).max() > 0.0


def test_a_force_that_no_scenario_tells_of_is_felt(biped_core, begin):
    core, force = biped_core(), np.array([25.0, -15.0])
    begin(core, 0, Scenario("a"))
    core.simulations.data[0].qfrc_applied[:2] = force  # on the pelvis, beside what pushes write
    estimates = []
    for _ in range(30):
        step(core)
        estimates.append(world_estimate(core))
    np.testing.assert_allclose(np.mean(estimates, axis=0), force / STIFFNESS, atol=0.001)


def test_the_mirrored_walk_is_seen_alike_turning_and_pushed_off_centre(biped_core, begin):
    """Every entry of the observation, the previous action and the push estimate among them."""
    push = Push((150.0, -140.0, 20.0), 0.1, GaitEvent(2, "right", 0.4), "trunk", (0.05, 0.12, 0.1))
    scenario, seen = Scenario("a", (push,), Command(0.2, 0.1, 0.3)), []
    for one in (scenario, scenario.mirrored()):
        core = biped_core()
        begin(core, 0, one)
        walked = []
        for _ in range(170):
            step(core)
            walked.append(core.observation[0].copy())
        seen.append(walked)
    left, right = np.array(seen)
    np.testing.assert_allclose(left, right, atol=1e-5)
    assert np.abs(left[:, PREVIOUS_ACTION]).max(axis=0).min() > 0.04
    assert np.abs(left[:, PUSH_ESTIMATE]).max() > 0.2


def test_it_is_zero_after_reset_and_no_reset_touches_another_robot(biped_core, begin):
    push = Push((100.0, 0.0, 0.0), 0.1, 0.05)
    core = biped_core(2)
    for k in range(2):
        begin(core, k, Scenario("a", (push,)))
    for _ in range(9):
        step(core)
    seen = core.observation[:, PUSH_ESTIMATE].copy()
    assert np.linalg.norm(seen, axis=1).min() > 0.1
    begin(core, 0, Scenario("b"))
    assert not core.observation[0, PUSH_ESTIMATE].any()
    assert core.observation[1, PUSH_ESTIMATE].tobytes() == seen[1].tobytes()
    step(core)
    assert np.abs(core.observation[0, PUSH_ESTIMATE]).max() < QUIET
    np.testing.assert_allclose(world_estimate(core, 1), [100.0 / STIFFNESS, 0.0], atol=0.002)


def test_the_rows_of_the_free_joint_hold_the_external_contacts_alone(random_state):
    """Sum of the floor's contact forces, although joints are at their limits and the feet touch."""
    rng, data, force = np.random.default_rng(0), mujoco.MjData(MODEL), np.empty(6)
    floor, limit = MODEL.geom("floor").id, int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
    limited = internal = 0
    for _ in range(60):
        data.qpos[:], data.qvel[:] = random_state(rng, 0.4)
        data.qpos[2] -= 0.02
        data.qpos[8] = np.deg2rad(60.5)  # waist beyond its limit
        mujoco.mj_forward(MODEL, data)
        total = np.zeros(3)
        for i, contact in enumerate(data.contact):
            mujoco.mj_contactForce(MODEL, data, i, force)
            if floor in contact.geom:
                total += contact.frame.reshape(3, 3).T @ force[:3]
            else:
                internal += int(force[0] > 1.0)
        active = (data.efc_type == limit) & (np.abs(data.efc_force) > 1.0)
        limited += int(np.count_nonzero(active))
        np.testing.assert_allclose(data.qfrc_constraint[:3], total, atol=1e-8 * (1.0 + np.abs(total).max()))
    assert limited > 0
    assert internal > 0


@pytest.mark.parametrize("stance", [0, 1])
def test_height_counts_from_the_floor_and_contact_from_one_newton_on(random_state, robot_in, stance):
    core, data = robot_in(*random_state(np.random.default_rng(7)), stance)
    core.gait.height[0, FLOOR] = 0.3
    swing = data.site_xpos[MODEL.site(PLAN.soles[1 - stance]).id]
    for loads in ((1.01, 0.99), (0.99, 1.01)):
        core.physics.load[0, [stance, 1 - stance]] = loads
        seen = observe(core)
        assert seen[layout.SWING_POSITION][2] == pytest.approx(swing[2] - 0.3, abs=1e-12)
        found = seen[layout.STANCE_CONTACT], seen[layout.SWING_CONTACT]
        assert found == tuple(float(load > 1.0) for load in loads)
