"""Waypoints and punches of the benchmark, against values of its own program."""

import math

import numpy as np
import pytest
from push_recovery.eval.protocols.tour import (
    place_of,
    punches,
    run_id_of,
    tour_scenario,
    waypoints,
    wrapped,
)


def test_waypoints_are_the_benchmarks():
    first = np.array(waypoints(0)[:3])
    assert first == pytest.approx(
        np.array([
            (0.782998288, 0.810799756, 3.122743715),
            (0.461394873, 0.566350629, -1.594198522),
            (0.414540347, -0.725804558, 0.861053826),
        ]),
        abs=2e-7,  # that program computes in single precision
    )  # fmt: skip
    second = np.array(waypoints(1)[:2])
    assert second == pytest.approx(
        np.array([(0.297155129, -0.867551511, 2.319512276), (-0.054967826, 0.188983387, 1.034179063)]),
        abs=2e-7,
    )
    assert len(waypoints(5119)) == 18


@pytest.mark.parametrize(
    ("run_id", "index", "joint", "direction", "force"),
    [
        (0, 0, 23, (0.581393174, 0.459788641, 0.671249866), 152.427226),
        (0, 1, 27, (-0.963305333, 0.074874694, 0.257753015), 122.412403),
        (0, 2, 15, (-0.024758768, -0.941015397, -0.337456703), 219.024996),
        (1, 0, 12, (0.672844777, 0.625028615, 0.395751357), 164.020990),
    ],
)
def test_punches_are_the_benchmarks(run_id, index, joint, direction, force):
    punch = punches(run_id)[index]
    assert punch.joint == joint
    assert punch.direction == pytest.approx(direction, abs=2e-7)
    assert punch.force == pytest.approx(force, abs=2e-4)


def test_the_ceiling_rises_for_a_minute():
    """A third of 500 N at first, all of it from the 13th punch on; each between half of it and all."""
    for run_id in range(20):
        for i, punch in enumerate(punches(run_id)):
            ceiling = 500.0 * (1 / 3 + 2 / 3 * min(5 * i / 60, 1.0))
            assert 0.5 * ceiling <= punch.force < ceiling
            assert math.hypot(*punch.direction) == pytest.approx(1.0)


def test_a_scenario_has_the_impulse_by_mass():
    scenario = tour_scenario(3, mass=60.0)
    assert (scenario.id, scenario.duration, len(scenario.pushes)) == ("tour-0003", 90.0, 18)
    assert run_id_of(scenario.id) == 3
    for i, (push, punch) in enumerate(zip(scenario.pushes, punches(3), strict=True)):
        assert (push.start, push.duration, push.frame) == (pytest.approx(0.1 + 5 * i), 0.08, "world")
        assert push.impulse_magnitude / 60.0 == pytest.approx(punch.force * 0.08 / 35.112, rel=1e-5)
        assert push.direction == pytest.approx(math.atan2(punch.direction[1], punch.direction[0]), abs=1e-4)


def test_where_the_joints_of_the_g1_are_punched():
    left, right = place_of(3), place_of(9)
    assert (left.body, right.body) == ("pelvis", "pelvis")
    assert left.offset[1] == -right.offset[1] > 0
    assert {place_of(joint).offset for joint in (12, 13, 14)} == {(0.0, 0.0, -0.18)}
    shoulders = place_of(15), place_of(28)
    assert shoulders[0].offset == (0.0, 0.10, 0.06)
    assert shoulders[1].offset == (0.0, -0.10, 0.06)
    assert {place.body for place in shoulders} == {"trunk"}


@pytest.mark.parametrize(("angle", "same"), [(0.5, 0.5), (4.0, 4.0 - 2 * math.pi), (-math.pi, math.pi)])
def test_wrapped(angle, same):
    assert wrapped(angle) == pytest.approx(same)
