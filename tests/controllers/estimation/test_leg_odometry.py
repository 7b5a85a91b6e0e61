"""A robot that stands, slides, flies or hops, and what its soles tell of its base."""

import numpy as np
import pytest
from push_recovery.controllers.estimation.base_estimate import (
    GATE,
    LOADED,
    STANDING_DEVIATION,
    VV,
    BaseEstimate,
    Inertial,
    begin_estimate,
    deviations,
    empty_base_estimate,
    listen_to_soles,
    navigate,
)
from push_recovery.controllers.math3 import of_rotation, rotated
from push_recovery.controllers.whole_body.kinematics import LEG_DOF, Physics, sole_motion, sole_position
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import biped

DT, G = 0.002, 9.81
SOLES = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
AT_REST = (0.0, 0.0, DT * G)


@pytest.fixture
def standing(robot_in):
    """Arrays of a robot that stands upright, both soles loaded, and an estimate of its true state."""

    def make(loads=(300.0, 300.0)) -> tuple[Physics, BaseEstimate]:
        qpos, qvel = posture(biped(), np.array([0.0, 0.0, 0.8]), np.zeros(3), SOLES)
        phys, estimate = robot_in(qpos, np.zeros_like(qvel))[0].physics, empty_base_estimate(1)
        begin_estimate(estimate, 0, qpos[:3], qpos[3:7], np.zeros(3))
        phys.load[0] = loads
        return phys, estimate

    return make


def listen(estimate: BaseEstimate, phys: Physics, inertial: Inertial) -> None:
    """A physics step of a robot that stands still, as its inertial sensor tells it."""
    phys.qvel[0, 3:6] = navigate(estimate, 0, inertial, DT)
    phys.qvel[0, :3] = estimate.velocity[0]
    listen_to_soles(estimate, 0, phys, DT)


def moving(estimate: BaseEstimate, phys: Physics, velocity) -> None:
    """Believe in a velocity of the base while the joints rest: the soles then seem to move with it."""
    estimate.velocity[0] = phys.qvel[0, :3] = velocity


def test_a_standing_sole_corrects_the_velocity_by_the_gain_of_one_measurement(standing):
    phys, estimate = standing((300.0, 0.0))
    moving(estimate, phys, (0.02, -0.01, 0.015))
    estimate.level[0, VV] = estimate.lift[0, 0] = 9e-4
    left = STANDING_DEVIATION**2 / (STANDING_DEVIATION**2 + 9e-4)
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
    noise = STANDING_DEVIATION**2 + 0.2**2
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
    left = 1.0 / (1.0 + 2.0 * 9e-4 / STANDING_DEVIATION**2)
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
    assert deviations(estimate).tilt[0] < 4e-3


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
    phys, estimate = standing((0.99 * LOADED, 0.0))
    moving(estimate, phys, (0.02, -0.01, 0.015))
    before = [field.copy() for field in estimate]
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.spread[0] > 0.0
    for field, old, name in zip(estimate, before, estimate._fields, strict=True):
        if name != "spread":
            np.testing.assert_array_equal(field, old, err_msg=name)


def test_the_gate_opens_where_the_estimate_is_unsure(standing):
    phys, estimate = standing((300.0, 0.0))
    moving(estimate, phys, (0.5, 0.0, 0.0))
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, 0] == 0.5
    estimate.level[0, VV] = (0.51 / GATE) ** 2
    listen_to_soles(estimate, 0, phys, DT)
    assert estimate.velocity[0, 0] < 0.1


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


def test_a_mirrored_robot_makes_mirrored_estimates(standing):
    """Axes along x and z of what turns change their sign, those of what moves along y."""
    found = []
    for side in range(2):
        phys, estimate = standing((300.0, 0.0) if side == 0 else (0.0, 300.0))
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
