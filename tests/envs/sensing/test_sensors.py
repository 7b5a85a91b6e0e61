"""Readings against the state that they are made of, noise against its data sheet."""

import numpy as np
import pytest
from push_recovery.controllers.estimation.observe import Contacts
from push_recovery.controllers.math3 import of_rotation, product, rotated
from push_recovery.controllers.whole_body.kinematics import NU
from push_recovery.envs.sensing import (
    BASE,
    JOINT,
    SensorSettings,
    begin_sensing,
    read_feet,
    read_inertial,
    read_joints,
    seed_sensors,
    sensors_of,
)

DT, G = 0.002, 9.81
PERFECT = SensorSettings(*[0.0] * len(SensorSettings._fields))._replace(
    rate_range=35.0, force_range=157.0, angle_resolution=1e-9, load_lag=1e-9
)
TILTED = of_rotation((0.3, -0.2, 0.5))


def turn(true, *rate) -> None:
    """Let the base turn at a rate in its own axes for a step."""
    true.qpos[0, 3:7] = product(tuple(true.qpos[0, 3:7]), of_rotation(tuple(DT * r for r in rate)))


@pytest.fixture
def true(biped_core):
    """Arrays of a robot that is tilted and stands on both soles."""
    phys = biped_core(1).physics
    phys.qpos[0], phys.qvel[0], phys.load[0] = 0.1, 0.0, (200.0, 400.0)
    phys.qpos[0, 3:7] = TILTED
    return phys


@pytest.fixture
def read(biped_core):
    """Where readings are written."""
    return biped_core(1).physics


def contacts(force=(3.0, -4.0, 600.0)) -> Contacts:
    felt = Contacts(np.zeros((1, 20)), np.zeros((1, 3)), np.zeros(1), np.zeros((1, 3)))
    felt.force[0, :3] = force
    return felt


def sensing(true, settings=PERFECT, seed=1, side=0, present=None):
    sensors = sensors_of(1, settings, np.ones(NU) if present is None else present)
    seed_sensors(sensors, 0, seed, side)
    sensors.gravity[0, 2] = -G
    begin_sensing(sensors, 0, true, contacts())
    return sensors


def test_perfect_sensors_tell_rate_and_specific_force(true):
    sensors = sensing(true)
    true.qvel[0, :3] = 0.004, -0.002, 0.006  # gained in a step: 2, -1 and 3 m/s^2
    turn(true, 0.4, -0.5, 0.6)
    told, facing = read_inertial(sensors, 0, 1, true, DT), tuple(true.qpos[0, 3:7])
    np.testing.assert_allclose(told.rate, [0.4, -0.5, 0.6])
    np.testing.assert_allclose(rotated(facing, told.change), [0.004, -0.002, 0.006 + DT * G], atol=1e-15)
    again = read_inertial(sensors, 0, 2, true, DT)  # nothing more was gained
    np.testing.assert_allclose(again.rate, 0.0, atol=1e-12)
    np.testing.assert_allclose(rotated(facing, again.change), [0.0, 0.0, DT * G], atol=1e-15)


def test_readings_end_at_the_range(true):
    true.qpos[0, 3:7], true.qvel[0] = (1.0, 0.0, 0.0, 0.0), 0.0
    sensors = sensing(true)
    true.qvel[0, 0] = 1.0  # 500 m/s^2 in a step
    told = read_inertial(sensors, 0, 1, true, DT)
    np.testing.assert_allclose(told.change, [157.0 * DT, 0.0, G * DT])
    turn(true, 50.0, -60.0, 1.0)
    np.testing.assert_allclose(read_inertial(sensors, 0, 2, true, DT).rate, [35.0, -35.0, 1.0])


def test_bias_and_noise_have_their_stated_sizes(true):
    settings = SensorSettings()._replace(rate_scale=0.0, force_scale=0.0, rate_walk=0.0, force_walk=0.0)
    rates, changes, means = [], [], []
    for seed in range(60):
        sensors = sensing(true, settings, seed)
        told = [read_inertial(sensors, 0, step, true, DT) for step in range(1, 60)]
        rate, change = np.array([t.rate for t in told]), np.array([t.change for t in told]) / DT
        rates.append(rate - rate.mean(axis=0)), changes.append(change - change.mean(axis=0))
        means.append([*(rate.mean(axis=0)), *sensors.force_bias[0]])
    np.testing.assert_allclose(np.std(rates, axis=(0, 1)), settings.rate_noise, rtol=0.1)
    np.testing.assert_allclose(np.std(changes, axis=(0, 1)), settings.force_noise, rtol=0.1)
    np.testing.assert_allclose(np.std(means, axis=0)[:3], settings.rate_bias, rtol=0.35)
    np.testing.assert_allclose(np.std(means, axis=0)[3:], settings.force_bias, rtol=0.35)


def test_a_bias_walks_with_the_root_of_time(true):
    settings, ends = PERFECT._replace(rate_walk=1e-3, force_walk=1e-2), []
    for seed in range(80):
        sensors = sensing(true, settings, seed)
        for step in range(1, 1001):
            if step % 50 == 0:
                read_inertial(sensors, 0, step, true, DT)
        ends.append([*sensors.rate_bias[0], *sensors.force_bias[0]])
    np.testing.assert_allclose(np.std(ends, axis=0), np.sqrt(2.0) * np.repeat([1e-3, 1e-2], 3), rtol=0.3)


def test_encoders_tell_whole_steps_and_their_difference_is_the_rate(true, read):
    settings = PERFECT._replace(angle_resolution=1e-3, angle_offset=0.01)
    sensors = sensing(true, settings)
    before = true.qpos[0, JOINT:].copy()
    true.qpos[0, JOINT:] += 0.02
    read_joints(sensors, 0, 1, true, read, DT)
    told, offset = read.qpos[0, JOINT:], sensors.offset[0]
    np.testing.assert_allclose(told, before + 0.02 + offset, atol=0.5001e-3)
    np.testing.assert_allclose(told / 1e-3, np.round(told / 1e-3), atol=1e-9)
    np.testing.assert_allclose(read.qvel[0, BASE:], 10.0, atol=1.0001e-3 / DT)
    assert 0.003 < np.std(offset) < 0.03
    assert len(set(offset)) == NU


def test_a_joint_that_is_not_there_has_no_noise(true, read):
    present = np.ones(NU)
    present[0] = 0.0
    sensors = sensing(true, SensorSettings()._replace(angle_resolution=1e-9), present=present)
    read_joints(sensors, 0, 1, true, read, DT)
    np.testing.assert_allclose(read.qpos[0, JOINT], true.qpos[0, JOINT], atol=1e-9)
    assert abs(read.qpos[0, JOINT + 1] - true.qpos[0, JOINT + 1]) > 1e-6


def test_loads_follow_with_their_lag_and_small_ones_are_none(true, read):
    sensors = sensing(true, PERFECT._replace(load_lag=0.002, load_least=5.0))
    true.load[0] = 500.0, 0.0
    force = contacts((0.0, 0.0, 500.0))
    sensors.floor[0], sensors.load[0] = 0.0, (0.0, 12.0)
    told = read_feet(sensors, 0, 1, true, force, read, DT)
    share = 1.0 - np.exp(-1.0)
    np.testing.assert_allclose(read.load[0], [500.0 * share, 0.0])  # 12 exp(-1) = 4.4 N are none
    np.testing.assert_allclose(rotated(TILTED, told), [0.0, 0.0, 500.0 * share], atol=1e-12)


def test_noise_of_a_mirrored_robot_is_mirrored(true, read, biped_core):
    """The sole that stands first, y and the axes' signs change; nothing else does."""
    true.qpos[0] = true.qvel[0] = 0.0
    true.qpos[0, 3], true.load[0] = 1.0, 300.0
    other, settings = biped_core(1).physics, SensorSettings()._replace(angle_resolution=1e-12)
    told = []
    for side, out in ((0, read), (1, other)):
        sensors = sensing(true, settings, seed=5, side=side)
        sensors.floor[0] = 0.0
        inertial = read_inertial(sensors, 0, 50, true, DT)  # with a step of the walk
        read_joints(sensors, 0, 1, true, out, DT)
        told.append((inertial, read_feet(sensors, 0, 1, true, contacts((0.0, 0.0, 600.0)), out, DT)))
    (left, left_floor), (right, right_floor) = told
    np.testing.assert_allclose(right.rate, np.array(left.rate) * [-1, 1, -1], rtol=1e-2)
    np.testing.assert_allclose(right.change, np.array(left.change) * [1, -1, 1], rtol=3e-2)
    np.testing.assert_allclose(right_floor, np.array(left_floor) * [1, -1, 1], rtol=1e-12)
    np.testing.assert_allclose(other.load[0], read.load[0][::-1], rtol=1e-12)
    legs, mirror = read.qpos[0, JOINT:], other.mirror
    swapped = np.concatenate([legs[:2], legs[8:], legs[2:8]])
    np.testing.assert_allclose(other.qpos[0, JOINT:], mirror * swapped, atol=1e-11)
