"""Motions made by hand: what a perfect inertial sensor tells of them, and where the estimate goes.

A robot that stands, slides, flies or hops, and what its soles tell of its base.

Friction believed in, on motions of a sole that are written by hand.

Covariances against dense Kalman filters written out in numpy.
"""

import numpy as np
import pytest
from push_recovery.controllers.estimation import base_estimate as base
from push_recovery.controllers.estimation.base_estimate import BB, TV, VV, Inertial, listen_to_soles, navigate
from push_recovery.controllers.estimation.base_estimate import BV as BIAS_V
from push_recovery.controllers.math3 import conjugate, of_rotation, product, rotated
from push_recovery.controllers.whole_body.kinematics import LEG_DOF, Physics, sole_motion, sole_position
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.sensing import SensorSettings

DT, G = 0.002, 9.81
LEVEL = (1.0, 0.0, 0.0, 0.0)
TILTED = of_rotation((0.2, -0.1, 0.4))


def estimate_at(attitude=LEVEL, velocity=(0.0, 0.0, 0.0)) -> base.BaseEstimate:
    estimate = base.empty_base_estimate(1)
    base.begin_estimate(estimate, 0, np.zeros(3), np.array(attitude), np.array(velocity))
    return estimate


def test_at_first_the_velocity_is_known_to_two_centimetres_a_second():
    """Of all three axes: variances of 0.02^2; what was known before is forgotten."""
    estimate = estimate_at()
    estimate.gyro_bias[0] = estimate.lift_bias[0] = 0.3
    base.begin_estimate(estimate, 0, np.zeros(3), np.array(TILTED), np.array([0.1, 0.2, 0.3]))
    assert estimate.level[0, VV] == pytest.approx(4e-4)
    assert estimate.lift[0, base.LIFT_VV] == pytest.approx(4e-4)
    assert not estimate.gyro_bias[0].any()
    assert estimate.lift_bias[0] == 0.0


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
    before, tilt = base.deviations(estimate_at()).velocity[0], 3e-3
    assert base.deviations(flying).velocity[0] > before
    np.testing.assert_allclose(
        base.deviations(carried).velocity[0], np.hypot(before, tilt * G * 0.5), rtol=0.05
    )


@pytest.mark.parametrize(("lift", "gained"), [(0.0, 4e-8), (10.0, 8e-8), (-5.0, 5e-8)])
def test_the_velocity_grows_unsure_by_noise_and_by_a_share_of_what_is_more_than_gravity(lift, gained):
    """(0.1 m/s^2 x 2 ms)^2 of noise, and one percent of 10 or 5 m/s^2."""
    estimate = estimate_at()
    estimate.level[0] = estimate.lift[0] = 0.0
    navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, DT * (G + lift))), DT)
    assert estimate.level[0, VV] == pytest.approx(gained, rel=1e-3)
    assert estimate.lift[0, base.LIFT_VV] == pytest.approx(gained, rel=1e-3)


def test_beyond_the_range_of_the_accelerometer_the_velocity_is_unknown():
    estimate = estimate_at()
    navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (1.01 * base.FORCE_RANGE * DT, 0.0, 0.0)), DT)
    assert estimate.level[0, VV] > base.BEYOND_RANGE**2
    near = estimate_at()
    navigate(near, 0, Inertial((0.0, 0.0, 0.0), (0.99 * base.FORCE_RANGE * DT, 0.0, 0.0)), DT)
    assert near.level[0, VV] < 0.01 * base.BEYOND_RANGE**2


SOLES = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
AT_REST = (0.0, 0.0, DT * G)


@pytest.fixture
def standing(robot_in):
    """Arrays of a robot that stands upright, both soles loaded, and an estimate of its true state."""

    def make(loads=(300.0, 300.0)) -> tuple[Physics, base.BaseEstimate]:
        qpos, qvel = posture(biped(), np.array([0.0, 0.0, 0.8]), np.zeros(3), SOLES)
        phys, estimate = robot_in(qpos, np.zeros_like(qvel))[0].physics, base.empty_base_estimate(1)
        base.begin_estimate(estimate, 0, qpos[:3], qpos[3:7], np.zeros(3))
        phys.load[0] = loads
        return phys, estimate

    return make


def listen(estimate: base.BaseEstimate, phys: Physics, inertial: Inertial) -> None:
    """A physics step of a robot that stands still, as its inertial sensor tells it."""
    phys.qvel[0, 3:6] = navigate(estimate, 0, inertial, DT)
    phys.qvel[0, :3] = estimate.velocity[0]
    listen_to_soles(estimate, 0, phys, DT)


def moving(estimate: base.BaseEstimate, phys: Physics, velocity) -> None:
    """Believe in a velocity of the base while the joints rest: the soles then seem to move with it."""
    estimate.velocity[0] = phys.qvel[0, :3] = velocity


def test_a_standing_sole_corrects_the_velocity_by_the_gain_of_one_measurement(standing):
    phys, estimate = standing((300.0, 0.0))
    moving(estimate, phys, (0.02, -0.01, 0.015))
    estimate.level[0, VV] = estimate.lift[0, 0] = 9e-4
    left = base.STANDING_DEVIATION**2 / (base.STANDING_DEVIATION**2 + 9e-4)
    listen_to_soles(estimate, 0, phys, DT)
    np.testing.assert_allclose(estimate.velocity[0], left * np.array([0.02, -0.01, 0.015]), rtol=1e-12)
    np.testing.assert_array_equal(phys.qvel[0, :3], estimate.velocity[0])
    np.testing.assert_allclose(estimate.level[0, VV], left * 9e-4, rtol=1e-12)


def test_a_sole_that_turns_counts_for_less(standing):
    """At 0.5 rad/s its velocity has a deviation of 0.2 m/s beside that of a sole at rest."""
    phys, estimate = standing((300.0, 0.0))
    moving(estimate, phys, (0.02, 0.0, 0.0))
    estimate.level[0, VV] = 9e-4
    phys.qvel[0, LEG_DOF[0] + 5] = 0.5  # of the ankle about the foot's long axis, through the sole's centre
    before = sole_motion(phys, 0, 0, (0.0, 0.0, 0.0)).velocity[0]
    listen_to_soles(estimate, 0, phys, DT)
    noise = base.STANDING_DEVIATION**2 + 0.2**2
    np.testing.assert_allclose(estimate.velocity[0, 0], 0.02 - 9e-4 / (9e-4 + noise) * before, rtol=1e-6)


@pytest.mark.parametrize(
    ("yaw", "roll", "noise"), [(0.0, 0.0, 0.1**2), (2.0, 0.0, 0.1**2 + 8.0**2), (1.5, 2.0, 0.1**2 + 10.0**2)]
)
def test_a_sole_that_twists_hardly_tells_the_bias_of_the_gyro(standing, yaw, roll, noise):
    """Its rate counts with a deviation of four times how fast it turns about any axis, beside 0.1 rad/s."""
    phys, estimate = standing((300.0, 0.0))
    estimate.turn[0] = 1e-6
    phys.qvel[0, LEG_DOF[0]] = yaw
    phys.qvel[0, LEG_DOF[0] + 5] = roll
    listen_to_soles(estimate, 0, phys, DT)
    np.testing.assert_allclose(estimate.gyro_bias[0, 2], 1e-6 / (1e-6 + noise) * yaw, rtol=1e-6)
    np.testing.assert_allclose(estimate.turn[0], 1e-6 * noise / (1e-6 + noise), rtol=1e-12)


def test_two_soles_count_as_two_measurements(standing):
    phys, estimate = standing()
    moving(estimate, phys, (0.02, 0.0, 0.0))
    estimate.level[0, VV] = 9e-4
    listen_to_soles(estimate, 0, phys, DT)
    left = 1.0 / (1.0 + 2.0 * 9e-4 / base.STANDING_DEVIATION**2)
    np.testing.assert_allclose(estimate.velocity[0, 0], left * 0.02, rtol=1e-12)


def test_a_wrong_tilt_and_velocity_are_found_while_standing(standing):
    """The estimate leans by 0.5 degrees to the left and forward: gravity then seems to pull it away."""
    phys, estimate = standing()
    estimate.attitude[0] = of_rotation((np.radians(-0.5), np.radians(0.5), 0.0))
    estimate.velocity[0] = 0.03, -0.02, 0.01
    for _ in range(5000):
        listen(estimate, phys, Inertial((0.0, 0.0, 0.0), AT_REST))
    np.testing.assert_allclose(estimate.velocity[0], 0.0, atol=1e-3)
    up = rotated(tuple(estimate.attitude[0]), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(up[:2], 0.0, atol=np.radians(0.02))


def test_the_biases_of_gyro_and_lift_are_found_while_standing(standing):
    phys, estimate = standing()
    bias, lift = np.array([8e-4, -6e-4, 5e-4]), 0.04
    for _ in range(15_000):
        listen(estimate, phys, Inertial(tuple(bias), (0.0, 0.0, DT * (G + lift))))
    np.testing.assert_allclose(estimate.gyro_bias[0], bias, rtol=0.3)
    np.testing.assert_allclose(estimate.lift_bias[0], lift, rtol=0.1)
    assert base.deviations(estimate).tilt[0] < 4e-3


def test_a_sliding_sole_is_not_believed(standing):
    """The base stands still; one sole slides away under it."""
    phys, estimate = standing((300.0, 0.0))
    for _ in range(200):
        listen(estimate, phys, Inertial((0.0, 0.0, 0.0), AT_REST))
    before = estimate.level[0, VV]
    phys.qvel[0, 8:14] = 0.0, 0.6, 0.8, 0.0, 0.0, 0.0  # the left hip throws its sole aside and back
    for _ in range(50):
        listen(estimate, phys, Inertial((0.0, 0.0, 0.0), AT_REST))
    np.testing.assert_allclose(estimate.velocity[0], 0.0, atol=2e-3)
    assert estimate.level[0, VV] > before
    assert estimate.stood[0, 0] == 0.0


def test_a_sole_without_load_says_nothing(standing):
    phys, estimate = standing((0.99 * base.LOADED, 0.0))
    moving(estimate, phys, (0.02, -0.01, 0.015))
    before = [field.copy() for field in estimate]
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.spread[0] > 0.0
    for field, old, name in zip(estimate, before, estimate._fields, strict=True):
        if name != "spread":
            np.testing.assert_array_equal(field, old, err_msg=name)


@pytest.mark.parametrize("axis", range(3))
def test_the_gate_opens_where_the_estimate_is_unsure(standing, axis):
    phys, estimate = standing((300.0, 0.0))
    moving(estimate, phys, 0.5 * np.eye(3)[axis])
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, axis] == 0.5
    if axis == 2:
        estimate.lift[0, base.LIFT_VV] = (0.51 / base.GATE) ** 2
    else:
        estimate.level[0, VV] = (0.51 / base.GATE) ** 2
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, axis] < 0.1


def test_the_base_stays_where_its_soles_stand(standing):
    """A drift of the place by 1 cm is drawn back to the footholds that were taken before it."""
    phys, estimate = standing()
    place = estimate.place[0].copy()
    for i in range(300):
        if i == 5:
            estimate.place[0] += 0.01, -0.01, 0.005
        listen(estimate, phys, Inertial((0.0, 0.0, 0.0), AT_REST))
    np.testing.assert_allclose(estimate.place[0], place, atol=1e-6)
    np.testing.assert_allclose(estimate.anchor[0, 1], sole_position(phys, 0, 1), atol=1e-6)
    assert estimate.stood[0, 0] == pytest.approx(0.6)


def test_a_new_foothold_is_unsure_by_3_mm_once_and_ties_a_tenth_of_the_distance(standing):
    phys, estimate = standing((300.0, 0.0))
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.spread[0] == pytest.approx(9e-6)  # (3 mm)^2 for the one sole that has landed
    np.testing.assert_allclose(estimate.stood[0], [0.002, 0.0])
    estimate.place[0] += 0.01, -0.02, 0.005
    moved = estimate.place[0].copy()
    listen_to_soles(estimate, 0, phys, DT)
    np.testing.assert_allclose(estimate.place[0] - moved, [-0.001, 0.002, -0.0005], rtol=1e-9)
    assert estimate.spread[0] == pytest.approx(9e-6)
    np.testing.assert_allclose(estimate.stood[0], [0.004, 0.0])


def test_a_loaded_sole_that_is_left_out_makes_the_velocity_unsure_and_loses_its_standing(standing):
    phys, estimate = standing((300.0, 0.0))
    estimate.stood[0] = 0.1, 0.3
    moving(estimate, phys, (0.9, 0.0, 0.0))  # far beyond noise: it slides
    level, lift, place = (
        estimate.level[0, VV],
        estimate.lift[0, base.LIFT_VV],
        estimate.place[0].copy(),
    )
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.level[0, VV] - level == pytest.approx(4e-5, rel=1e-6)  # 0.02 m^2/s^3 for 2 ms
    assert estimate.lift[0, base.LIFT_VV] - lift == pytest.approx(4e-5, rel=1e-6)
    np.testing.assert_allclose(estimate.stood[0], [0.09, 0.0])  # five times as fast as it is gained; no load
    np.testing.assert_array_equal(estimate.place[0], place)
    estimate.stood[0, 0] = 0.004
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.stood[0, 0] == 0.0


def test_while_no_sole_stands_the_place_drifts_at_the_deviation_of_the_velocity(standing):
    phys, estimate = standing((0.0, 0.0))
    estimate.spread[0], estimate.level[0, VV] = 0.01**2, 0.5**2
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.spread[0] == pytest.approx(0.011**2)  # 10 mm and 2 ms at 0.5 m/s


@pytest.mark.parametrize("loads", [(300.0, 0.0), (400.0, 200.0)])
def test_a_mirrored_robot_makes_mirrored_estimates(standing, loads):
    """Axes along x and z of what turns change their sign, those of what moves along y."""
    found = []
    for side in range(2):
        phys, estimate = standing(loads if side == 0 else loads[::-1])
        sign = 1.0 - 2.0 * side
        estimate.attitude[0] = of_rotation((sign * 0.004, 0.003, 0.0))
        moving(estimate, phys, (0.02, sign * 0.015, 0.01))
        rate = sign * 0.01, 0.02, sign * 0.03
        for _ in range(40):
            listen(estimate, phys, Inertial(rate, AT_REST))
        found.append([*estimate.velocity[0], *estimate.attitude[0, 1:], *estimate.gyro_bias[0]])
    signs = [1, -1, 1, -1, 1, -1, -1, 1, -1]
    np.testing.assert_allclose(found[1], np.array(signs) * found[0], atol=1e-12)
    assert min(np.abs(found[0])) > 1e-9


LEVEL_BASE_ESTIMATE = [
    [base.TT, base.TB, TV],
    [base.TB, BB, BIAS_V],
    [TV, BIAS_V, VV],
]  # places of the entries in the packed covariance
LIFT = [[base.LIFT_VV, base.LIFT_VB], [base.LIFT_VB, base.LIFT_BB]]


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
    found = packed(P, LEVEL_BASE_ESTIMATE)
    base.predict_level(found, s, dt, *np.diag(Q))
    np.testing.assert_allclose(found[LEVEL_BASE_ESTIMATE], F @ P @ F.T + Q, atol=1e-14)


def test_a_measured_velocity_gives_the_gains_of_kalman():
    P = random_covariance(3)
    found = packed(P, LEVEL_BASE_ESTIMATE)
    gains = base.update_level(found, 0.3)
    want, after = dense_update(P, np.array([0.0, 0.0, 1.0]), 0.3)
    np.testing.assert_allclose(gains, want, atol=1e-14)
    np.testing.assert_allclose(found[LEVEL_BASE_ESTIMATE], after, atol=1e-14)


def test_lift_covariance_follows_the_law_of_velocity_and_bias():
    dt, Q, P = 0.01, np.diag([1e-4, 2e-5]), random_covariance(2)
    F = np.array([[1.0, -dt], [0.0, 1.0]])
    found = packed(P, LIFT)
    base.predict_lift(found, dt, *np.diag(Q))
    np.testing.assert_allclose(found[LIFT], F @ P @ F.T + Q, atol=1e-14)
    gains = base.update_lift(found, 0.2)
    want, after = dense_update(F @ P @ F.T + Q, np.array([1.0, 0.0]), 0.2)
    np.testing.assert_allclose(gains, want, atol=1e-14)
    np.testing.assert_allclose(found[LIFT], after, atol=1e-14)


def test_covariances_stay_positive_through_standing_and_flight():
    """Forty seconds of standing, flying and landing at 500 Hz."""
    estimate = base.empty_base_estimate(1)
    base.begin_estimate(estimate, 0, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    level, lift, rng = estimate.level[0], estimate.lift[0], np.random.default_rng(0)
    for i, s in enumerate(rng.uniform(-0.02, 0.08, 20_000)):
        base.predict_level(level, s, 0.002, 1.6e-11, 2e-11, 1e-8)
        base.predict_lift(lift, 0.002, 1e-8, 2e-9)
        if i % 400 < 200:
            base.update_level(level, 9e-4), base.update_lift(lift, 9e-4)
        assert (
            np.linalg.eigvalsh(level[LEVEL_BASE_ESTIMATE]).min() > 0.0 < np.linalg.eigvalsh(lift[LIFT]).min()
        )


def test_deviations_are_the_roots_of_the_variances_and_doubt_the_accelerometer():
    estimate = base.empty_base_estimate(2)
    estimate.level[1, [base.TT, BB, VV]] = 16e-6, 25e-6, 4e-4
    estimate.lift[1, base.LIFT_VV], estimate.spread[1] = 9e-4, 36e-6
    told = base.deviations(estimate)
    np.testing.assert_allclose(told.tilt, [base.TILT_OF_BIAS, np.hypot(4e-3, base.TILT_OF_BIAS)])
    np.testing.assert_allclose(told.velocity, [0.0, 0.02])
    np.testing.assert_allclose(told.climb, [0.0, 0.03])
    np.testing.assert_allclose(told.gyro_bias, [0.0, 5e-3])
    np.testing.assert_allclose(told.place, [0.0, 6e-3])


def test_a_beginning_forgets_what_was():
    estimate = base.empty_base_estimate(2)
    for field in estimate:
        field[:] = 7.0
    base.begin_estimate(estimate, 1, np.ones(3), np.array([1.0, 0.0, 0.0, 0.0]), np.full(3, 2.0))
    np.testing.assert_array_equal(estimate.place, [[7.0] * 3, [1.0] * 3])
    np.testing.assert_array_equal(estimate.velocity[1], 2.0)
    assert not estimate.gyro_bias[1].any()
    assert not estimate.stood[1].any()
    assert estimate.spread[1] == 0.0
    assert estimate.level[1, VV] > 0.0 == estimate.level[1, TV]


def test_tilt_and_biases_grow_unsure_with_time():
    """In 2 ms: (4e-3 rad/s x 2 ms)^2 of tilt, and walks of 1e-4 rad/s and 1e-3 m/s^2 a root of a second."""
    estimate = estimate_at()
    estimate.level[0] = estimate.lift[0] = estimate.turn[0] = 0.0
    navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (0.0, 0.0, DT * G)), DT)
    found = [
        estimate.level[0, base.TT],
        estimate.level[0, BB],
        estimate.turn[0],
        estimate.lift[0, base.LIFT_BB],
    ]
    np.testing.assert_allclose(found, [6.4e-11, 2e-11, 2e-11, 2e-9], rtol=1e-9)


def test_what_a_turned_robot_learns_is_in_the_right_axes(robot_in):
    """A sole of a robot that faces y slides by 2 cm/s along x of the world, which is its right."""
    qpos, qvel = posture(biped(), np.array([0.0, 0.0, 0.8]), np.zeros(3), SOLES)
    qpos[:2], qpos[3:7] = (-qpos[1], qpos[0]), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    phys, estimate = robot_in(qpos, np.zeros_like(qvel))[0].physics, base.empty_base_estimate(1)
    base.begin_estimate(estimate, 0, qpos[:3], qpos[3:7], np.zeros(3))
    phys.load[0] = 300.0, 0.0
    moving(estimate, phys, (0.02, 0.0, 0.0))
    estimate.level[0, [VV, TV, BIAS_V]] = 9e-4, 1e-4, 2e-4
    listen_to_soles(estimate, 0, phys, DT)
    unit = 0.02 / (9e-4 + 0.06**2)
    np.testing.assert_allclose(estimate.gyro_bias[0], [-2e-4 * unit, 0.0, 0.0], atol=1e-9)
    up = rotated(tuple(estimate.attitude[0]), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(up[:2], [-1e-4 * unit, 0.0], atol=1e-8)


def test_soles_of_a_light_robot_count_by_their_share_of_its_weight(standing):
    phys, estimate = standing((15.0, 15.0))
    moving(estimate, phys, (0.02, 0.0, 0.0))
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, 0] == 0.02  # 15 N are little of 60 kg
    phys.mass_matrix[0] *= 0.05
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, 0] < 0.02


@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_a_loaded_sole_rests_up_to_three_deviations_of_what_moves_one(standing, rate):
    """0.06 m/s of a sole that stands, 0.1 m to the edge that it rolls over, and what the estimate leaves."""
    for share, believed in ((0.98, True), (1.02, False)):
        phys, estimate = standing((300.0, 0.0))
        estimate.level[0, VV] = 0.02**2
        speed = share * 3.0 * np.sqrt(0.02**2 + 0.06**2 + (0.1 * rate) ** 2)
        moving(estimate, phys, (speed, 0.0, 0.0))
        phys.qvel[0, LEG_DOF[0] + 5] = rate  # of the ankle about the foot's long axis
        listen_to_soles(estimate, 0, phys, DT)
        assert bool(estimate.velocity[0, 0] < speed) is believed


def test_near_the_sixteen_g_of_its_data_sheet_the_accelerometer_is_not_believed():
    unsure = []
    for share in (0.5, 0.97, 1.0):  # of 156.96 m/s^2, where readings end
        estimate = estimate_at()
        navigate(estimate, 0, Inertial((0.0, 0.0, 0.0), (share * 16.0 * G * DT, 0.0, 0.0)), DT)
        unsure.append(estimate.level[0, VV])
    assert unsure[0] < 1e-3 < 0.1 < min(unsure[1:])


def test_at_first_it_is_as_unsure_as_the_data_sheets_of_its_sensors():
    """0.05 degrees a second and 3 mg: what calibration leaves; of gravity, 3 mg are 3 mrad of tilt."""
    sheet, estimate = SensorSettings(), estimate_at()
    stated = base.deviations(estimate)
    assert stated.gyro_bias[0] == pytest.approx(sheet.rate_bias, rel=0.2)
    assert np.sqrt(estimate.turn[0]) == pytest.approx(sheet.rate_bias, rel=0.2)
    assert np.sqrt(estimate.lift[0, base.LIFT_BB]) == pytest.approx(sheet.force_bias, rel=0.2)
    assert stated.tilt[0] == pytest.approx(np.hypot(3e-3, sheet.force_bias / G), rel=0.05)
