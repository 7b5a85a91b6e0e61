"""Friction believed in, on motions of a sole that are written by hand."""

import math

import numpy as np
import pytest
from push_recovery.controllers.estimation.base_estimate import (
    GRIP_MIN,
    MOST,
    NO_NOISE,
    NOISE,
    RISE,
    SIZE,
    SLIDES,
    SLIDING,
    feel_grip,
)

FIRST, PERIOD = 0.8, 0.01  # friction believed in at first; [s]


class Sole:
    """A stance sole, and what its robot believes of the floor."""

    def __init__(self, noise: float = 0.0, seed: int = 0):
        self.place, self.grip, self.step = np.zeros(2), FIRST, 0
        self.landed = True
        self.noise, self.rng = noise, np.random.default_rng(seed)
        self.stood = np.zeros(SIZE)
        self.stood[MOST] = FIRST

    def move(self, speed: float, share: float, periods: int = 1, direction: float = 0.7) -> float:
        for _ in range(periods):
            self.place += speed * PERIOD * np.array([math.cos(direction), math.sin(direction)])
            x, y = self.place + self.noise * self.rng.normal(size=2)
            self.grip = feel_grip(self.stood, self.grip, x, y, self.step, self.landed, share, PERIOD)
        return self.grip


def standing(noise: float = 0.0, seed: int = 0) -> Sole:
    sole = Sole(noise, seed)
    sole.move(0.0, 0.1, 30)
    return sole


@pytest.mark.parametrize("share", [0.1, 0.5, 2.0])
def test_a_slide_of_three_periods_tells_the_friction(share):
    sole = standing()
    assert sole.move(0.9 * SLIDES, share, 2 * SLIDING) == FIRST
    assert sole.move(1.1 * SLIDES, share, SLIDING - 1) == FIRST
    assert sole.move(1.1 * SLIDES, share) == min(max(share, GRIP_MIN), FIRST)


def test_the_largest_share_of_a_slide_counts_and_a_blow_does_not():
    sole = standing()
    sole.move(1.0, 0.6)
    sole.move(1.0, 0.5, SLIDING - 1)
    assert sole.grip == 0.6
    sole = standing()
    for _ in range(5):
        assert sole.move(5.0, 0.5, SLIDING - 1) == FIRST
        assert sole.move(0.0, 0.5) == FIRST


@pytest.mark.parametrize("what", ["landed", "no force", "another step"])
def test_a_slide_counts_only_under_load_and_within_a_step(what):
    sole = standing()
    sole.move(1.0, 0.5, SLIDING - 1)
    if what == "another step":
        sole.step = 1
        assert sole.move(1.0, 0.5) == FIRST
    elif what == "landed":
        sole.landed = False
        assert sole.move(1.0, 0.5, 20) == FIRST
        sole.landed = True
    else:
        assert sole.move(1.0, -1.0) == FIRST
    assert sole.move(1.0, 0.5, SLIDING - 1) == FIRST
    assert sole.move(1.0, 0.5) == 0.5


def test_a_floor_that_holds_what_is_believed_is_believed_more_of():
    sole = standing(0.002)
    sole.move(2.0, 0.5, 8)
    assert sole.grip == 0.5
    sole.step += 1
    sole.move(0.0, 0.4, 20)
    assert sole.move(0.0, 0.4, 100) == 0.5  # less than is believed tells nothing
    assert 0.5 + 5 * RISE * PERIOD < sole.move(0.0, 0.5, 100) <= 0.5 + 101 * RISE * PERIOD
    assert sole.move(0.0, 1.0, 1000) == FIRST
    assert sole.move(2.0, 0.6, 8) == 0.6  # and less again once it slides


def test_without_noise_a_slide_is_sure_and_nothing_is_tried_again():
    sole = standing()
    sole.move(1.0, 0.5, SLIDING)
    assert sole.move(0.0, 1.0, 100) == 0.5


@pytest.mark.parametrize("noise", [5e-4, 2.5e-3, 0.01])
def test_noise_is_found_and_taken_for_no_slide(noise):
    """Sixty robots for 50 s: 3e5 periods, in each of which a difference of two places may be 6 deviations."""
    for seed in range(60):
        sole = Sole(noise, seed)
        for _ in range(100):  # steps of half a second
            sole.step += 1
            assert sole.move(0.0, 0.5, 50) == FIRST
    assert math.sqrt(sole.stood[NOISE]) == pytest.approx(noise, rel=0.3)


@pytest.mark.parametrize(("noise", "speed", "within"), [(2.5e-3, 1.0, 5), (2.5e-3, 0.6, 12), (0.01, 1.0, 20)])
def test_a_slide_is_found_in_noise(noise, speed, within):
    """After t it has gone (speed - SLIDES) t further than a sole that rests may: DOUBT noise is enough."""
    for seed in range(20):
        sole = standing(noise, seed)
        sole.move(0.0, 0.5, 100)
        assert sole.grip == FIRST
        assert sole.move(speed, 0.5, within) == 0.5


def test_noise_that_begins_later_is_found_in_time_and_shaking_is_none():
    """A period counts 3 times the variance at most, a fiftieth of it: 1.04^n, 1e4 times in 235 periods."""
    for seed in range(20):
        sole = standing(1e-5, seed)
        sole.move(0.0, 0.5, 50)
        sole.noise = 2.5e-3
        sole.move(0.0, 0.5, 30)  # as long as a fall takes
        assert sole.stood[NOISE] < NO_NOISE
        sole.move(0.0, 0.5, 370)
        assert math.sqrt(sole.stood[NOISE]) == pytest.approx(2.5e-3, rel=0.4)
        sole.move(0.0, 0.9, 200)
        assert sole.grip == FIRST  # what the first periods were taken for is tried again


def test_the_belief_does_not_hang_on_place_or_direction():
    found = []
    for direction in np.linspace(0.0, 2.0 * math.pi, 9):
        sole = standing()
        sole.place += 1000.0 * np.array([math.cos(direction), -math.sin(direction)])
        sole.step = 1
        sole.move(0.0, 0.1, 20)
        found.append([sole.move(s, 0.55, 1, direction) for s in (0.0, 0.5, 0.5, 0.5)])
    np.testing.assert_array_equal(found, [[FIRST, FIRST, FIRST, 0.55]] * 9)
