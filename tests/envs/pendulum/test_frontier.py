"""The pendulum's frontier against the closed-form limits: all directions and forces in one batch."""

import math

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.pendulum.env import PendulumCore
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Scenario

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
ANGLES = range(-90, 91, 15)  # the other half is the mirror image, psi -> 180 deg - psi
WEIGHTS = [1, *[2] * 11, 1]
DURATION = 4 * 0.65 + 0.1 + 3.0


def scan(name, forces):
    """For {psi: forces} whether the variant survives, as {psi: [bool]}."""
    policy, gait = make_policy(name), nominal_gait(ROBOT, LIMITS)
    start = nominal_start(gait, ROBOT.pelvis_width, ROBOT.omega)
    values = np.array([gait.length, gait.width, gait.duration, 0.0, 0.0, 0.0, 0.0])
    jobs = [(psi, force) for psi in forces for force in forces[psi]]
    core = PendulumCore(len(jobs), ROBOT, LIMITS)
    for k, (psi, force) in enumerate(jobs):
        push = polar_push(float(force), math.radians(psi), 0.1, GaitEvent(4, "left"))
        core.reset(k, Scenario("x", (push,)), start, values, LIMITS.to_action(values).astype(float))
    for _ in range(round(100 * DURATION)):
        action = policy.predict(core.observation)[0]
        core.step(LIMITS.from_action(action), action.astype(float))
    survived = core.state.failure == 0
    return {psi: [bool(ok) for (p, _), ok in zip(jobs, survived, strict=True) if p == psi] for psi in forces}


def frontier(name, low):
    """Largest force before the first failure on a 10 N grid, from a fraction `low` of F* on, by angle."""
    limit = {psi: max_recoverable_force(ROBOT, math.radians(psi)) for psi in ANGLES}
    grid = {psi: np.arange(10 * int(low * limit[psi] / 10), limit[psi] + 20, 10) for psi in ANGLES}
    alive = scan(name, grid)
    return np.array([grid[p][alive[p].index(False)] - 10 for p in ANGLES]), np.array(list(limit.values()))


def test_stage_1_reaches_97_percent_of_the_point_foot_limit_and_no_more():
    limits = {p: max_recoverable_force(ROBOT, math.radians(p), foot=False, flywheel=False) for p in ANGLES}
    alive = scan("stage-1", {p: [0.5 * f, 0.8 * f, 0.97 * f, 1.02 * f] for p, f in limits.items()})
    assert all(result == [True, True, True, False] for result in alive.values())


def test_two_stage_comes_within_a_grid_step_of_97_percent_and_beats_every_ablated_variant():
    force, limit = frontier("two-stage", 0.55)
    assert np.average((force + 10) / limit, weights=WEIGHTS) >= 0.98  # the first failure on the 10 N grid
    assert ((force + 10) / limit).min() >= 0.97
    for name in ("stage-1+cop", "stage-1+momentum"):
        assert (force > frontier(name, 0.4)[0]).all()


@pytest.mark.parametrize("name", ["stage-1", "stage-1-paper"])
def test_two_stage_beats_stage_1_alone(name):
    limit = {p: max_recoverable_force(ROBOT, math.radians(p)) for p in ANGLES}
    alive = scan(name, {p: [0.82 * f] for p, f in limit.items()})
    assert not any(result[0] for result in alive.values())
