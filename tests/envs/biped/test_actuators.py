"""Limits of power, with torques and rates worked out by hand.

What drives give: the torque-speed line, the brake beyond it, warmth; numbers worked out by hand.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.envs.biped import actuators as drives
from push_recovery.envs.biped.actuators import HEATING, given_torque, limit_power

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


TOP, FREE_DRIVES, INERTIA = 90.0, 10.0, 0.02  # the line falls by 90 / 3 = 30 N m s/rad from 7 rad/s on
MOTOR = np.array([TOP, FREE_DRIVES, INERTIA])
UNBRAKED = np.array([TOP, FREE_DRIVES, 0.0])


def given(asked, speed, motor=MOTOR, share=1.0, dt=0.002) -> float:
    return given_torque.py_func(asked, speed, motor, share, dt)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("asked", "speed", "torque"),
    [
        (50.0, 0.0, 50.0), (200.0, 0.0, 90.0), (-200.0, 0.0, -90.0), (200.0, 7.0, 90.0), (200.0, 8.0, 60.0),
        (20.0, 8.0, 20.0), (200.0, 10.0, 0.0), (-200.0, 8.0, -90.0), (-30.0, 10.0, -30.0),
    ],
)  # fmt: skip
def test_the_line_binds_who_drives_and_not_who_brakes(way, asked, speed, torque):
    assert given(way * asked, way * speed) == pytest.approx(way * torque, abs=1e-12)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_beyond_the_line_a_motor_brakes_whatever_is_asked(way):
    """30 N m s/rad over 1 + 30 dt / 0.02 = 4 at 2 ms: 7.5 N m for each rad/s too fast."""
    for asked in (-5.0, 0.0, 50.0):
        assert given(way * asked, way * 12.0) == pytest.approx(-way * 15.0)
    assert given(-way * 40.0, way * 12.0) == -way * 40.0  # who brakes harder may
    assert given(0.0, way * 12.0, dt=0.0) == pytest.approx(-way * 60.0)  # the line itself
    assert given(0.0, way * 100.0) == -way * TOP
    assert given(50.0, way * 12.0, UNBRAKED) == (0.0 if way > 0 else 50.0)
    assert given(0.0, way * 12.0, UNBRAKED) == 0.0


@pytest.mark.parametrize("dt", [1e-4, 0.002, 0.02])
def test_the_brake_ends_at_the_speed_without_load_and_never_below(dt):
    """In any step: speed - FREE falls by (s dt / I) / (1 + s dt / I) of itself."""
    speed, ratio = 11.0, 30.0 * dt / INERTIA
    for _ in range(50):
        before, speed = speed, speed + dt / INERTIA * given(0.0, speed, dt=dt)
        assert speed - FREE_DRIVES == pytest.approx((before - FREE_DRIVES) / (1.0 + ratio), abs=1e-9)
        assert speed >= FREE_DRIVES


def test_a_hot_drive_comes_down_to_its_continuous_torque():
    share = drives.allowed_share.py_func
    assert [share(w, 0.4) for w in (0.0, 0.9, 0.95, 1.0, 7.0)] == pytest.approx([1.0, 1.0, 0.7, 0.4, 0.4])
    assert given(80.0, 0.0, share=0.4) == pytest.approx(36.0)
    assert given(-80.0, 0.0, share=0.4) == pytest.approx(-36.0)


def warmed(asked, seconds, dt=0.01):
    """Warmth and torque of a drive at rest after it was asked for a torque; 36 N m are its continuous one."""
    warmth, torque = np.zeros(2), np.zeros(2)
    for _ in range(round(seconds / dt)):
        torque[1] = given(asked, 0.0, share=drives.allowed_share.py_func(warmth[1], 0.4))
        drives.warm.py_func(warmth, torque, np.full(2, TOP), 0.4, dt)
    assert warmth[0] == 0.0
    return warmth[1], torque[1]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_winding_warms_with_the_square_of_its_torque(way):
    """27 of 36 N m come to 0.75^2 = 0.5625, as 1 - exp(-t / T)."""
    for seconds in (5.0, 40.0):
        warmth, torque = warmed(way * 27.0, seconds)
        assert warmth == pytest.approx(0.5625 * (1.0 - math.exp(-seconds / HEATING)), rel=2e-4)
        assert torque == way * 27.0


def test_what_is_asked_for_too_long_is_not_given_for_ever():
    """From cold the largest torque lasts T ln(6.25 / (6.25 - 0.9)), 6.2 s; then it comes down."""
    assert warmed(90.0, 6.1)[1] == 90.0
    assert warmed(90.0, 6.4)[1] < 90.0
    assert warmed(90.0, 400.0) == pytest.approx((1.0, 36.0), rel=1e-3)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_hot_drive_brakes_as_a_cold_one(way):
    """By 30 x 2 / (1 + 30 dt / I) N m beyond its largest speed, however little it may still drive."""
    assert given(0.0, way * 12.0, share=0.4) == pytest.approx(-way * 15.0)
    assert given(0.0, way * 100.0, share=0.4) == -way * TOP
