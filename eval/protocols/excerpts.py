"""Excerpts of the tour to tune on: three of the hardest punches of a run on a robot that walks.

Their run ids are none of the protocol's, so what is tuned on them has met none of its punches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...controllers.model.similarity import Similarity
from ...envs.biped.robots.compiled_robot import CompiledRobot
from ...envs.scenario.command import FASTEST_TURN, Command
from ...envs.scenario.scenario import Scenario
from .follower import FASTEST_X, FASTEST_Y, SLOWEST_X
from .tour import tour_scenario

TAKEN = (12, 14, 16)  # punches of a run, all under the whole ceiling
FIRST, APART, SPREAD = 1.0, 2.5, 0.3  # when the first comes, how far apart they are, drawn later by up to [s]
LENGTH = 9.0  # of an excerpt [s]
IN_PLACE, STRAIGHT, KINDS = 0, 1, 4  # of commands; the others are of everything at once


def excerpt(scenario_id: str, run_id: int, robot: CompiledRobot) -> Scenario:
    """Punches of a run on a robot told to turn in place, to walk straight on, or all at once."""
    rng, whole = np.random.default_rng(run_id), tour_scenario(run_id, robot)
    starts = [round(FIRST + APART * i + SPREAD * float(rng.random()), 4) for i in range(len(TAKEN))]
    pushes = [replace(whole.pushes[i], start=start) for i, start in zip(TAKEN, starts, strict=True)]
    velocity, kind = Similarity.of(robot.robot).velocity, int(rng.integers(KINDS))
    forward = 0.0 if kind == IN_PLACE else velocity * rng.uniform(SLOWEST_X, FASTEST_X)
    left = 0.0 if kind in {IN_PLACE, STRAIGHT} else velocity * rng.uniform(-FASTEST_Y, FASTEST_Y)
    turn = 0.0 if kind == STRAIGHT else rng.uniform(-FASTEST_TURN, FASTEST_TURN)
    command = Command(forward, left, turn)
    return Scenario(scenario_id, tuple(pushes), command, duration=LENGTH, noise_seed=run_id)
