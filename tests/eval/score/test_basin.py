"""The N-step capture basin: theory against simulated states, and what the pendulum needs."""

import json
from pathlib import Path

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import n_step_offset, recoverable_offset
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.eval.cli.main import main
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
