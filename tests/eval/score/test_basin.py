"""The N-step capture basin: theory against simulated states, and what the pendulum needs."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import n_step_offset, recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait
from push_recovery.controllers.model.observation import DCM, TRUNK_ANGLE, TRUNK_RATE
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.push import GaitEvent
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.score import basin as basins
from push_recovery.eval.score.basin import Basin, Grid, basin_table

ROBOT = RobotModel()
LIMITS = GaitLimits.of(ROBOT)
SOLE = np.array([LIMITS.cop_x_max, LIMITS.cop_y_max])


def still(offset):
    """Whether a point foot with a sole is within it."""
    return (np.abs(offset) <= SOLE + 1e-12).all()


def caught(offset, steps, elapsed=0.0):
    """Whether some of a grid of steps bring the DCM over the sole, each axis by a search of its own.

    The CoP is at an edge of the sole or in its middle, and each step as short in time as it may be.
    """
    for axis in range(2):
        states = [offset[axis]]
        for n in range(steps + 1):
            if any(abs(value) <= SOLE[axis] + 1e-12 for value in states):
                break
            if n == steps:
                return False
            time = LIMITS.duration_min - (elapsed if n == 0 else 0.0)
            growth = np.exp(ROBOT.omega * max(time, 0.0))
            box = (
                (LIMITS.length_min, LIMITS.length_max) if axis == 0 else (LIMITS.width_min, LIMITS.width_max)
            )
            grown = [
                cop + growth * (value - cop) for value in states for cop in np.linspace(-1, 1, 3) * SOLE[axis]
            ]
            sizes = np.linspace(*box, 41)
            after = np.array([(g - u) if axis == 0 else (u - g) for g in grown for u in sizes])
            keep = np.abs(after) < 1.2
            states = np.unique(np.round(after[keep], 3))
    return True


@pytest.mark.parametrize("steps", [0, 1, 2])
@pytest.mark.parametrize("elapsed", [0.0, 0.1])
def test_steps_of_a_fine_box_catch_what_is_within_the_bounds_and_nothing_beyond(steps, elapsed):
    bounds = n_step_offset(ROBOT, LIMITS, steps, elapsed, flywheel=False)
    for axis in range(2):
        for edge, side in ((bounds.low, -1.0), (bounds.high, 1.0)):
            inside, beyond = np.zeros(2), np.zeros(2)
            inside[axis], beyond[axis] = edge[axis] - side * 0.01, edge[axis] + side * 0.01
            assert caught(inside, steps, elapsed), (axis, side)
            assert not caught(beyond, steps, elapsed), (axis, side)


def test_more_steps_tend_to_any_number_from_within():
    last = n_step_offset(ROBOT, LIMITS, 0)
    assert np.allclose(n_step_offset(ROBOT, LIMITS, 0, flywheel=False).high, SOLE)
    for steps in range(1, 8):
        found = n_step_offset(ROBOT, LIMITS, steps)
        assert (found.low <= last.low).all()
        assert (found.high >= last.high).all()
        last = found
    ever = recoverable_offset(ROBOT, LIMITS)
    for steps, off in ((8, 1e-4), (40, 1e-12)):
        found = n_step_offset(ROBOT, LIMITS, steps)
        assert np.allclose(found.low, ever.low, atol=off)
        assert np.allclose(found.high, ever.high, atol=off)


def test_the_pendulum_takes_no_step_fewer_than_theory_and_is_caught_where_it_says(tmp_path, capsys):
    argv = [
        "basin",
        "--env",
        "PushRecovery/Pendulum-v0",
        "--points",
        "5",
        "--out",
        str(tmp_path),
        "--workers",
        "1",
    ]
    assert main([*argv, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    theory, measured = (
        np.array(one, float) for one in (found["closed_form"], found["policies"]["two-stage"])
    )
    assert theory.shape == measured.shape == (len(found["y_m"]), len(found["x_m"]))
    assert np.array_equal(np.isnan(theory), np.isnan(measured))
    known = ~np.isnan(theory)
    assert (measured[known] >= theory[known]).all()
    assert (measured[known] <= theory[known] + 1).all()
    assert theory[2, 2] == 0  # the middle of the grid
    before = (tmp_path / "outcomes.jsonl").read_text()
    assert main(argv) == 0
    assert (tmp_path / "outcomes.jsonl").read_text() == before
    assert "N-step capture basin, 25 points" in capsys.readouterr().out
    assert (tmp_path / "basin.png").read_bytes()[:4] == b"\x89PNG"


def test_points_are_counted_by_their_steps():
    found = Basin(
        "E", Grid((0.0, 1.0, 2.0), (0.0, 1.0)), [[0, 1, 2], [4, None, 1]],
        {"p": [[0, 2, 1], [5, 3, None]]}, Path(),
    )  # fmt: skip
    assert basin_table(found).rows == [("closed form", *"1210110"), ("p", *"1111111")]


ENV = SimpleNamespace(unwrapped=SimpleNamespace(robot=ROBOT, limits=LIMITS))


def test_steps_are_counted_once_from_the_push_on():
    counter, truth, found = basins.StepsToCapture(ENV), np.zeros((1, 36)), []
    counter.begin(None, 0, Scenario("a"))
    core = SimpleNamespace(pushes=SimpleNamespace(start=np.array([[3.0]])), truth=truth)
    for time, steps, dcm in ((3.0, 4, 0.0), (3.01, 4, 0.5), (3.6, 5, 0.0), (4.0, 6, 0.0)):
        truth[0, 1] = dcm
        motion = SimpleNamespace(time=np.array([time]), steps=np.array([steps]))
        episodes = SimpleNamespace(core=core, motion=lambda motion=motion: motion)
        counter.after_step(SimpleNamespace(episodes=episodes), np.array([0]))
        found.append(dict(counter.steps))
    assert found == [{}, {}, {"a": 1}, {"a": 1}]


def test_the_sole_and_what_the_trunk_has_left_catch_in_place():
    """At rest by a bang-bang swing; none towards where the trunk leans to its stop, more the other way."""
    counter, lean, torque = basins.StepsToCapture(ENV), ROBOT.trunk_angle_max, ROBOT.trunk_torque_max
    swing = math.sqrt(lean * ROBOT.trunk_inertia / torque)
    reserve = torque / (ROBOT.mass * 9.81) * (1.0 - math.exp(-ROBOT.omega * swing)) ** 2

    def stays(axis, dcm, angle=0.0, rate=0.0):
        seen = np.zeros(36)
        seen[DCM][axis], seen[TRUNK_ANGLE][axis], seen[TRUNK_RATE][axis] = dcm, angle, rate
        return counter._stays(seen)

    for axis in range(2):
        edge = SOLE[axis] + reserve
        for side in (1.0, -1.0):
            inside, beyond = side * (edge - 1e-6), side * (edge + 1e-6)
            assert stays(axis, inside)
            assert not stays(axis, beyond)
            for part in ("angle", "rate"):
                assert stays(axis, beyond, **{part: -side * 0.1})
                assert not stays(axis, inside, **{part: side * 0.1})
            assert stays(axis, side * (SOLE[axis] - 1e-6), angle=side * lean)
            assert not stays(axis, side * (SOLE[axis] + 1e-6), angle=side * lean)


def test_a_kick_brings_the_dcm_from_where_the_gait_has_it_to_the_point():
    """In place a step begins with the DCM l_p / (1 + exp(omega T)) towards the swing side, the right one."""
    (push,) = basins.kicked(ENV, 0.3, -0.2).pushes
    begin = ROBOT.pelvis_width / (1.0 + math.exp(ROBOT.omega * nominal_gait(ROBOT, LIMITS).duration))
    jump = np.array(push.force) * push.duration / (ROBOT.mass * ROBOT.omega)
    assert jump == pytest.approx((0.3, 0.2 + begin, 0.0))
    assert push.start == GaitEvent(4, "left", 0.0)


def test_a_robot_that_fell_after_all_has_no_number_of_steps():
    def run_all(policy, scenarios, seen):
        seen.steps.update({scenarios[0].id: 1, scenarios[2].id: 3})
        ends = ((one.id, one is not scenarios[2]) for one in scenarios[::-1])
        return [SimpleNamespace(scenario_id=name, survived=survived) for name, survived in ends]

    job = basins.BasinJob("p", (-0.1, 0.0, 0.2), 0.05)
    row = basins.measure(SimpleNamespace(env=ENV, run_all=run_all), job)
    assert row == {"policy": "p", "y_m": 0.05, "steps": [1, None, None]}
