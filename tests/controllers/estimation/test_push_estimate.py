"""The push estimate of the biped against the forces that act on it."""

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.model.observation import PREVIOUS_ACTION, PUSH_ESTIMATE
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

MODEL = biped_model()
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


def test_the_mirrored_scenario_gives_the_mirrored_estimate(biped_core, begin):
    push = Push((80.0, -90.0, 0.0), 0.1, GaitEvent(2, "right", 0.4), "trunk")
    scenario, core = Scenario("a", (push,), Command(0.2, 0.1)), biped_core()
    left, forces = walk(core, begin, scenario, 2.0)
    right, _ = walk(core, begin, scenario.mirrored(), 2.0)
    assert np.linalg.norm(forces, axis=1).max() > 0.1
    np.testing.assert_allclose(left, right * [1.0, -1.0], atol=1e-6)


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
