"""Limits of power, with torques and rates worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.envs.biped.actuators import limit_power

FREE = np.inf


@pytest.fixture
def moving():
    """Joints 0, 1, 2 at 2, -5 and 4 rad/s, all others at rest; the base at a rate that counts nothing."""
    qvel = np.zeros((2, 20))
    qvel[1, :6] = 100.0
    qvel[1, 6:9] = 2.0, -5.0, 4.0
    return SimpleNamespace(qvel=qvel)


def limited(moving, each, together) -> list[float]:
    torque = np.zeros(14)
    torque[:4] = 100.0, -60.0, -50.0, 30.0  # 200 W, 300 W, braking with 200 W, at rest
    limit_power.py_func(moving, 1, torque, each, together)
    return torque[:4].tolist()


def test_no_limit_changes_nothing(moving):
    assert limited(moving, FREE, FREE) == [100.0, -60.0, -50.0, 30.0]
    assert limited(moving, 300.0, 500.0) == [100.0, -60.0, -50.0, 30.0]


def test_a_motor_gives_no_more_than_its_power(moving):
    assert limited(moving, 150.0, FREE) == pytest.approx([75.0, -30.0, -50.0, 30.0])


def test_a_battery_is_shared_by_those_that_drive(moving):
    """500 W are asked for and 250 W there: half of each driving torque; who brakes or holds is left alone."""
    assert limited(moving, FREE, 250.0) == pytest.approx([50.0, -30.0, -50.0, 30.0])


def test_both_limits_act_one_after_the_other(moving):
    """Each at 150 W, then 300 W of which 100 W are there: a third."""
    assert limited(moving, 150.0, 100.0) == pytest.approx([25.0, -10.0, -50.0, 30.0])
