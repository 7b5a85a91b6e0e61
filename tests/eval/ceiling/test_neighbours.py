import numpy as np
import pytest
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.hindsight import NEIGHBOURS, neighbours

PUSH = polar_push(500.0, np.radians(170.0), 0.1, GaitEvent(4, "left", 0.3))
SCENARIO = Scenario("s", (PUSH, Push((0.0, 100.0, -50.0), 0.2, 3.0, "trunk")), Command(0.2), noise_seed=3)


def test_neighbours_are_a_grid_about_the_push_without_itself():
    found = neighbours(SCENARIO)
    assert len(found) == NEIGHBOURS == 24
    assert len({one.id for one in found}) == 24
    forces = [np.hypot(*one.pushes[0].force[:2]) / 500.0 for one in found]
    turns = [np.degrees(one.pushes[0].direction) for one in found]
    turns = [turn % 360.0 - 170.0 for turn in turns]
    grid = {(round(force, 9), round(turn, 9)) for force, turn in zip(forces, turns, strict=True)}
    assert grid == {
        (f, t) for f in (0.98, 0.99, 1.0, 1.01, 1.02) for t in (-2, -1, 0, 1, 2) if (f, t) != (1.0, 0)
    }


def test_all_pushes_change_alike_and_nothing_else_does():
    for one in neighbours(SCENARIO):
        first, second = one.pushes
        ratio = np.hypot(*first.force[:2]) / 500.0
        assert second.force[2] == pytest.approx(-50.0 * ratio)
        assert np.hypot(*second.force[:2]) == pytest.approx(100.0 * ratio)
        turn = (first.direction - PUSH.direction + np.pi) % (2 * np.pi) - np.pi
        assert second.direction == pytest.approx(np.pi / 2 + turn)
        assert (second.duration, second.start, second.body) == (0.2, 3.0, "trunk")
        assert (one.command, one.noise_seed) == (SCENARIO.command, SCENARIO.noise_seed)
