"""Motions made by hand: what a perfect inertial sensor tells of them, and where the estimate goes."""

import numpy as np
import pytest
from push_recovery.controllers.estimation.base_estimate import (
    BEYOND_RANGE,
    FORCE_RANGE,
    VV,
    BaseEstimate,
    Inertial,
    begin_estimate,
    deviations,
    empty_base_estimate,
    navigate,
)
from push_recovery.controllers.math3 import conjugate, of_rotation, product, rotated

DT, G = 0.002, 9.81
LEVEL = (1.0, 0.0, 0.0, 0.0)
TILTED = of_rotation((0.2, -0.1, 0.4))


def estimate_at(attitude=LEVEL, velocity=(0.0, 0.0, 0.0)) -> BaseEstimate:
    estimate = empty_base_estimate(1)
    begin_estimate(estimate, 0, np.zeros(3), np.array(attitude), np.array(velocity))
    return estimate


def felt(attitude, acceleration) -> tuple:
    """Specific force times DT in the axes of a base that is accelerated in the world."""
    x, y, z = acceleration
    return rotated(conjugate(attitude), (DT * x, DT * y, DT * (z + G)))


@pytest.mark.parametrize("attitude", [LEVEL, TILTED])
def test_a_base_that_is_carried_evenly_keeps_its_velocity(attitude):
    estimate = estimate_at(attitude, (0.3, -0.2, 0.1))
    for _ in range(500):
        navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), felt(attitude, (0.0, 0.0, 0.0))), DT)
    np.testing.assert_allclose(estimate.velocity[0], [0.3, -0.2, 0.1], atol=1e-12)
    np.testing.assert_allclose(estimate.place[0], [0.3, -0.2, 0.1], atol=1e-12)
    np.testing.assert_allclose(estimate.attitude[0], attitude, atol=1e-12)


def test_a_falling_base_feels_nothing():
    estimate = estimate_at(TILTED)
    for _ in range(100):
        navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), DT)
    np.testing.assert_allclose(estimate.velocity[0], [0.0, 0.0, -G * 0.2], atol=1e-12)
    # v is that of the end of a step: p = g dt^2 n (n + 1) / 2
    np.testing.assert_allclose(estimate.place[0, 2], -G * DT**2 * 100 * 101 / 2, atol=1e-12)


def test_rates_are_in_the_axes_of_the_base_and_free_of_their_known_bias():
    estimate = estimate_at(of_rotation((0.0, 0.0, np.pi / 2)))
    estimate.gyro_bias[0] = 0.1, -0.2, 0.3
    told = navigate(estimate, 0, Inertial((0.1, 4.8, 0.3), (0.0, 0.0, 0.0)), DT)
    np.testing.assert_allclose(told, [0.0, 5.0, 0.0], atol=1e-15)
    turned = product(of_rotation((0.0, 0.0, np.pi / 2)), of_rotation((0.0, 0.01, 0.0)))
    np.testing.assert_allclose(estimate.attitude[0], turned, atol=1e-15)


def test_a_push_moves_the_base_by_its_impulse():
    estimate = estimate_at(TILTED)
    for _ in range(50):
        navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), felt(TILTED, (3.0, -5.0, 2.0))), DT)
    np.testing.assert_allclose(estimate.velocity[0], [0.3, -0.5, 0.2], atol=1e-12)


def test_a_known_bias_of_the_lift_is_taken_off():
    estimate = estimate_at()
    estimate.lift_bias[0] = 0.5
    navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, DT * (G + 0.5))), DT)
    np.testing.assert_allclose(estimate.velocity[0], 0.0, atol=1e-15)


def test_in_flight_the_estimate_grows_less_sure_and_faster_while_it_weighs():
    """An error of the tilt turns weight into velocity; in free fall it does nothing."""
    flying, carried = estimate_at(), estimate_at()
    for _ in range(250):
        navigate(flying, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), DT)
        navigate(carried, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, DT * G)), DT)
    before, tilt = deviations(estimate_at()).velocity[0], 3e-3
    assert deviations(flying).velocity[0] > before
    np.testing.assert_allclose(deviations(carried).velocity[0], np.hypot(before, tilt * G * 0.5), rtol=0.05)


def test_beyond_the_range_of_the_accelerometer_the_velocity_is_unknown():
    estimate = estimate_at()
    navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (1.01 * FORCE_RANGE * DT, 0.0, 0.0)), DT)
    assert estimate.level[0, VV] > BEYOND_RANGE**2
    near = estimate_at()
    navigate(near, 0, Inertial((0.0, 0.0, 0.0), (0.99 * FORCE_RANGE * DT, 0.0, 0.0)), DT)
    assert near.level[0, VV] < 0.01 * BEYOND_RANGE**2
