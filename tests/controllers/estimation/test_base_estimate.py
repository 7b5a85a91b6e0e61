"""Covariances against dense Kalman filters written out in numpy."""

import numpy as np
import pytest
from push_recovery.controllers.estimation.base_estimate import (
    BB,
    LIFT_BB,
    LIFT_VB,
    LIFT_VV,
    TB,
    TILT_OF_BIAS,
    TT,
    TV,
    VV,
    begin_estimate,
    deviations,
    empty_base_estimate,
    predict_level,
    predict_lift,
    update_level,
    update_lift,
)
from push_recovery.controllers.estimation.base_estimate import BV as BIAS_V

LEVEL = [[TT, TB, TV], [TB, BB, BIAS_V], [TV, BIAS_V, VV]]  # places of the entries in the packed covariance
LIFT = [[LIFT_VV, LIFT_VB], [LIFT_VB, LIFT_BB]]


def packed(P: np.ndarray, places: list) -> np.ndarray:
    out = np.zeros(len({place for row in places for place in row}))
    for i, row in enumerate(places):
        for j, place in enumerate(row):
            out[place] = P[i, j]
    return out


def dense_update(P: np.ndarray, H: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    gain = P @ H / (H @ P @ H + noise)
    return gain, P - np.outer(gain, H @ P)


def random_covariance(size: int) -> np.ndarray:
    A = np.random.default_rng(size).normal(size=(size, size))
    return A @ A.T


@pytest.mark.parametrize("s", [0.02, 0.0, -0.03])
def test_level_covariance_follows_the_law_of_tilt_bias_and_velocity(s):
    dt, Q = 0.002, np.diag([1e-6, 2e-7, 3e-5])
    F = np.array([[1.0, -dt, 0.0], [0.0, 1.0, 0.0], [s, 0.0, 1.0]])
    P = random_covariance(3)
    found = packed(P, LEVEL)
    predict_level(found, s, dt, *np.diag(Q))
    np.testing.assert_allclose(found[LEVEL], F @ P @ F.T + Q, atol=1e-14)


def test_a_measured_velocity_gives_the_gains_of_kalman():
    P = random_covariance(3)
    found = packed(P, LEVEL)
    gains = update_level(found, 0.3)
    want, after = dense_update(P, np.array([0.0, 0.0, 1.0]), 0.3)
    np.testing.assert_allclose(gains, want, atol=1e-14)
    np.testing.assert_allclose(found[LEVEL], after, atol=1e-14)


def test_lift_covariance_follows_the_law_of_velocity_and_bias():
    dt, Q, P = 0.01, np.diag([1e-4, 2e-5]), random_covariance(2)
    F = np.array([[1.0, -dt], [0.0, 1.0]])
    found = packed(P, LIFT)
    predict_lift(found, dt, *np.diag(Q))
    np.testing.assert_allclose(found[LIFT], F @ P @ F.T + Q, atol=1e-14)
    gains = update_lift(found, 0.2)
    want, after = dense_update(F @ P @ F.T + Q, np.array([1.0, 0.0]), 0.2)
    np.testing.assert_allclose(gains, want, atol=1e-14)
    np.testing.assert_allclose(found[LIFT], after, atol=1e-14)


def test_covariances_stay_positive_through_standing_and_flight():
    """Forty seconds of standing, flying and landing at 500 Hz."""
    estimate = empty_base_estimate(1)
    begin_estimate(estimate, 0, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    level, lift, rng = estimate.level[0], estimate.lift[0], np.random.default_rng(0)
    for i, s in enumerate(rng.uniform(-0.02, 0.08, 20_000)):
        predict_level(level, s, 0.002, 1.6e-11, 2e-11, 1e-8)
        predict_lift(lift, 0.002, 1e-8, 2e-9)
        if i % 400 < 200:
            update_level(level, 9e-4), update_lift(lift, 9e-4)
        assert np.linalg.eigvalsh(level[LEVEL]).min() > 0.0 < np.linalg.eigvalsh(lift[LIFT]).min()


def test_deviations_are_the_roots_of_the_variances_and_doubt_the_accelerometer():
    estimate = empty_base_estimate(2)
    estimate.level[1, [TT, BB, VV]] = 16e-6, 25e-6, 4e-4
    estimate.lift[1, LIFT_VV], estimate.spread[1] = 9e-4, 36e-6
    told = deviations(estimate)
    np.testing.assert_allclose(told.tilt, [TILT_OF_BIAS, np.hypot(4e-3, TILT_OF_BIAS)])
    np.testing.assert_allclose(told.velocity, [0.0, 0.02])
    np.testing.assert_allclose(told.climb, [0.0, 0.03])
    np.testing.assert_allclose(told.gyro_bias, [0.0, 5e-3])
    np.testing.assert_allclose(told.place, [0.0, 6e-3])


def test_a_beginning_forgets_what_was():
    estimate = empty_base_estimate(2)
    for field in estimate:
        field[:] = 7.0
    begin_estimate(estimate, 1, np.ones(3), np.array([1.0, 0.0, 0.0, 0.0]), np.full(3, 2.0))
    np.testing.assert_array_equal(estimate.place, [[7.0] * 3, [1.0] * 3])
    np.testing.assert_array_equal(estimate.velocity[1], 2.0)
    assert not estimate.gyro_bias[1].any()
    assert not estimate.stood[1].any()
    assert estimate.spread[1] == 0.0
    assert estimate.level[1, VV] > 0.0 == estimate.level[1, TV]
