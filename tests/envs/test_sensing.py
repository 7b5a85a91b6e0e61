"""Readings against the state that they are made of, noise against its data sheet.

Bipeds that act on their own sensors: no leak of the true state, repeatable, and sure within bounds.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numba import njit
from push_recovery.controllers.array_table import Floats2
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.controllers.estimation.base_estimate import Estimator, deviations
from push_recovery.controllers.estimation.observe import Contacts
from push_recovery.controllers.math3 import conjugate, of_rotation, product, rotated, rotation_of
from push_recovery.controllers.model.robot import GRAVITY
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import NU, PELVIS
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS, BipedCore
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.biped.period import sensing_step
from push_recovery.envs.robots.biped import ARMS_HELD, NO_WAIST_ROLL
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import SENSING, Command, Scenario
from push_recovery.envs.sensing import (
    BASE,
    JOINT,
    SensorSettings,
    begin_sensing,
    read_feet,
    read_inertial,
    read_joints,
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
    sensors.seed[0], sensors.side[0] = seed, side
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


def test_a_gyro_feels_the_floor_turn_under_it(true):
    sensors = sensing(true)
    sensors.turn[0] = 0.3, -0.2, 0.1  # in the axes of the floor, in which the base is told
    turn(true, 0.4, -0.5, 0.6)
    told, facing = read_inertial(sensors, 0, 1, true, DT), tuple(true.qpos[0, 3:7])
    alone = read_inertial(sensing(true), 0, 1, true, DT)
    np.testing.assert_allclose(alone.rate, 0.0, atol=1e-12)
    np.testing.assert_allclose(rotated(facing, np.subtract(told.rate, (0.4, -0.5, 0.6))), (0.3, -0.2, 0.1))


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


POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
PUSH = Push((60.0, 90.0, 0.0), 0.1, GaitEvent(1, "right", 0.3))
ERRORS = ModelErrors(), ModelErrors(delay=0.004, dcm_noise=0.002), ModelErrors(payload=3.0, slope_left=0.03)


def onboard_core(n: int = 1, threads: int = 1) -> BipedCore:
    return BipedCore(n, BIPED, BIPED_LIMITS, threads=threads, sensing="onboard")


def step(core) -> None:
    action = POLICY.predict(core.observation)[0]
    core.step(BIPED_LIMITS.from_action(action), action.astype(np.float64))


def scenarios(n: int = 3) -> list[Scenario]:
    sides = "left", "right"
    return [
        Scenario(f"s{k}", (PUSH,), Command(0.1 * k), sides[k % 2], noise_seed=k, errors=ERRORS[k % 3])
        for k in range(n)
    ]


def trajectory(core, begin, all_scenarios, seconds: float = 1.2) -> np.ndarray:
    """True state, believed state and what is seen at every planning period, (ticks, n, 118)."""
    for k, scenario in enumerate(all_scenarios):
        begin(core, k, scenario)
    out = []
    for _ in range(round(seconds * 100)):
        step(core)
        true = [np.concatenate([data.qpos, data.qvel]) for data in core.simulations.data]
        out.append(np.concatenate([true, core.physics.qpos, core.physics.qvel, core.observation], axis=1))
    return np.array(out)


def test_an_unknown_sensing_is_refused():
    with pytest.raises(UnknownNameError, match=r"sensing 'onbord'.*exact, onboard"):
        BipedEnv(sensing="onbord")


def test_exact_sensing_judges_by_what_control_sees(biped_core):
    core = biped_core()
    assert core.judged is core.physics


def test_nothing_that_acts_reads_the_true_state(begin):
    """Whatever physics has told of itself is overwritten once the sensors have read it."""
    clean = trajectory(onboard_core(), begin, scenarios(1))
    core = onboard_core()
    begin(core, 0, scenarios(1)[0])
    own = {id(field) for field in core.physics}
    true = [field for field in core.judged if id(field) not in own]
    old = [field.copy() for field in true]
    assert len(true) == 10  # qpos to load

    def poison():
        for field, value in zip(true, old, strict=True):
            field[:] = value  # as it was at the reset: finite, and wrong
        for name in ("sensordata", "qfrc_constraint", "xpos", "xmat", "xanchor", "xaxis"):
            getattr(core.simulations.data[0], name)[:] = 1e3

    core.after_physics_step = poison
    poisoned = []
    for _ in range(len(clean)):
        step(core)
        data = core.simulations.data[0]
        state = np.concatenate([data.qpos, data.qvel, core.physics.qpos[0], core.physics.qvel[0]])
        poisoned.append(np.concatenate([state, core.observation[0]]))
    np.testing.assert_array_equal(np.array(poisoned), clean[:, 0])
    assert core.truth[0, 1] != clean[-1, 0, 83]  # the judge has seen the poison


def test_robots_do_not_depend_on_each_other_nor_on_threads(begin):
    many, threaded = (trajectory(onboard_core(3, threads), begin, scenarios()) for threads in (1, 2))
    np.testing.assert_array_equal(many, threaded)
    for k, scenario in enumerate(scenarios()):
        np.testing.assert_array_equal(trajectory(onboard_core(), begin, [scenario])[:, 0], many[:, k])


def test_robots_of_either_sensing_share_a_core(begin):
    """Each is what it is among its own kind, slowly too, and so after the other kind had its place."""
    kinds = "onboard", "exact", "exact", "onboard"
    mixed = [replace(s, sensing=kind) for s, kind in zip(scenarios(4), kinds, strict=True)]
    alone = [trajectory(BipedCore(1, BIPED, BIPED_LIMITS), begin, [s], 0.6)[:, 0] for s in mixed]
    core = BipedCore(4, BIPED, BIPED_LIMITS, threads=2)
    others = [replace(s, sensing=kind) for s, kind in zip(scenarios(4), reversed(kinds), strict=True)]
    trajectory(core, begin, others, 0.1)
    together = trajectory(core, begin, mixed, 0.6)
    core.after_physics_step = lambda: None
    slowly = trajectory(core, begin, mixed, 0.6)
    for k, own in enumerate(alone):
        np.testing.assert_array_equal(together[:, k], own)
        np.testing.assert_array_equal(slowly[:, k], own)
    assert core.true_state(1) is core.physics
    assert core.true_state(0) is core.judged


def test_a_forced_sensing_stands_above_the_scenarios(begin):
    """An exact robot believes what is true, whatever its scenario says, and an onboard one does not."""
    for forced, other in (("exact", "onboard"), ("onboard", "exact")):
        core = BipedCore(1, BIPED, BIPED_LIMITS, sensing=forced)
        begin(core, 0, replace(scenarios(1)[0], sensing=other))
        believed = np.array_equal(core.physics.qpos[0], core.simulations.data[0].qpos)
        assert believed == (forced == "exact")


def test_the_true_com_is_what_episodes_go_by(begin):
    """The CoM that progress is measured by is MuJoCo's of the whole robot, whatever the robot believes."""
    core = onboard_core(2)
    trajectory(core, begin, scenarios(2), 0.5)
    for k, data in enumerate(core.simulations.data):
        np.testing.assert_array_equal(core.com[k], data.subtree_com[1, :2])
        assert np.abs(core.com[k] - core.physics.com[k, 0, :2]).max() > 1e-5


def test_a_reset_forgets_the_episode_before(begin):
    core, (first, second, _) = onboard_core(), scenarios()
    once = trajectory(core, begin, [first], 0.5)
    trajectory(core, begin, [second], 0.5)
    np.testing.assert_array_equal(trajectory(core, begin, [first], 0.5), once)


def test_another_noise_seed_is_another_walk(begin):
    walks = [
        trajectory(onboard_core(), begin, [Scenario("a", noise_seed=seed)], 0.5)[-1, 0, :3] for seed in (1, 2)
    ]
    assert 1e-6 < np.abs(walks[0] - walks[1]).max() < 0.05


def test_a_mirrored_scenario_is_a_mirrored_walk(begin):
    scenario = Scenario("a", (PUSH,), Command(0.1, 0.05), noise_seed=3)
    left, right = (trajectory(onboard_core(), begin, [s], 0.5)[:, 0] for s in (scenario, scenario.mirrored()))
    mirror = [1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0]
    np.testing.assert_allclose(right[:, :7], left[:, :7] * mirror, atol=1e-9)  # true pose of the base
    np.testing.assert_allclose(right[:, 41:48], left[:, 41:48] * mirror, atol=1e-9)  # believed


def test_a_walk_is_known_within_its_bounds(begin):
    """Base velocity within 0.05 m/s and tilt within 0.5 degrees in the mean, 1 m of walking to 3 cm."""
    core, off, lean, stated = onboard_core(), [], [], []
    begin(core, 0, Scenario("a", command=Command(0.3), noise_seed=4))
    start = core.judged.qpos[0, :2] - core.physics.qpos[0, :2]
    for _ in range(400):
        step(core)
        off.append(core.physics.qvel[0, :3] - core.judged.qvel[0, :3])
        ups = core.physics.xmat[0, PELVIS, 2::3], core.judged.xmat[0, PELVIS, 2::3]
        lean.append(np.linalg.norm(np.cross(*ups)))
        stated.append(deviations(core.estimate).velocity[0])
    assert core.judged.com[0, 0, 0] > 1.0
    assert np.sqrt(np.mean(np.square(off), axis=0)).max() < 0.02
    assert np.sqrt(np.mean(np.square(lean))) < np.radians(0.5)
    assert np.linalg.norm(core.judged.qpos[0, :2] - core.physics.qpos[0, :2] - start) < 0.03
    assert 0.3 < np.mean(stated) / np.sqrt(np.mean(np.square(off)[:, :2])) < 3.0


def test_a_slope_is_felt_as_a_tilt_of_the_floor(begin):
    """The robot takes gravity for the vertical: it believes in a pelvis that leans by the slope."""
    core = onboard_core()
    begin(core, 0, Scenario("a", noise_seed=1, errors=ModelErrors(slope_left=0.04)))
    up = core.physics.xmat[0, PELVIS, 2::3]
    downhill = core.simulations.models[0].opt.gravity / GRAVITY
    np.testing.assert_allclose(up[1], downhill[1], atol=0.012)  # of a pelvis upright on its floor
    assert up[1] < -0.02  # leaning to the right, where a floor that rises to the left goes down


def test_the_environment_takes_it_alone_and_in_a_vector():
    env = gym.make("PushRecovery/Biped-v0", sensing="onboard")
    check_env(env.unwrapped, skip_render_check=True)
    assert env.spec is not None
    assert '"sensing": "onboard"' in env.spec.to_json()
    vector = gym.make_vec("PushRecovery/Biped-v0", num_envs=2, sensing="onboard")
    vector.reset(seed=1)
    vector.step(np.zeros((2, 7), np.float32))


class Still(NamedTuple):
    """An estimate of robots that take themselves for standing where they began."""

    place: Floats2


def begin_still(estimate: Still, k: int, place, attitude, velocity) -> None:
    estimate.place[k] = place


@njit
def predict_still(estimate, k, inertial, phys, dt):
    for i in range(3):
        phys.qpos[k, i], phys.qvel[k, i], phys.qvel[k, 3 + i] = estimate.place[k, i], 0.0, 0.0


@njit
def correct_still(estimate, k, phys, dt):
    estimate.place[k, 0] += 0.001  # seen in the next step


STILL = Estimator(lambda n: Still(np.zeros((n, 3))), begin_still, predict_still, correct_still)


def test_an_estimator_may_come_from_outside(monkeypatch, begin):
    """One file and its name in SENSING: it finds the base, sensors and kinematics are as with any other."""
    monkeypatch.setitem(SENSING, "still", f"{__name__}:STILL")
    core = BipedCore(2, BIPED, BIPED_LIMITS)
    begin(core, 1, Scenario("exact"))
    begin(core, 0, Scenario("still", noise_seed=2, sensing="still"))
    assert core.senses.onboard.tolist() == [True, False]
    start = core.judged.qpos[0, :3].copy()
    np.testing.assert_array_equal(core.estimate.place[0], start)
    tables = core._tables[core.senses.of(0)][0]
    for i in range(15):  # no torques: it sinks
        sensing_step(STILL)(tables, 0, DT)
        np.testing.assert_allclose(core.physics.qpos[0, :3], start + [0.001 * i, 0.0, 0.0], atol=1e-12)
    assert core.judged.qpos[0, 2] < start[2] - 5e-4
    np.testing.assert_allclose(core.physics.qpos[0, JOINT:], core.judged.qpos[0, JOINT:], atol=3e-3)
    np.testing.assert_allclose(core.physics.xpos[0, PELVIS], core.physics.qpos[0, :3], atol=1e-12)
    assert core.true_state(0) is core.judged
    assert core.true_state(1) is core.physics


def test_episodes_alike_sense_alike():
    assert BipedEpisodes(1, sensing="onboard").clone(2).core.senses.forced == "onboard"


def test_a_robot_begins_as_if_there_had_been_none_before_it():
    used, fresh = BipedEnv(sensing="onboard"), BipedEnv(sensing="onboard")
    used.reset(options={"scenario": Scenario("pushed", (polar_push(400.0, 1.0, 0.1, 0.05),))})
    for _ in range(10):
        used.step(np.zeros(7, np.float32))
    observation, _ = used.reset(options={"scenario": Scenario("next")})
    expected, _ = fresh.reset(options={"scenario": Scenario("next")})
    assert observation.tolist() == expected.tolist()


def test_scale_errors_have_their_stated_sizes(true):
    settings, off, start = PERFECT._replace(rate_scale=0.01, force_scale=0.05), [], true.qpos[0].copy()
    for seed in range(300):
        true.qpos[0] = start
        sensors = sensing(true, settings, seed)
        turn(true, 0.4, -0.5, 0.6)
        told, q = read_inertial(sensors, 0, 1, true, DT), true.qpos[0, 3:7]
        felt = rotated((q[0], *-q[1:]), (0.0, 0.0, DT * G))
        off.append([*np.divide(told.rate, (0.4, -0.5, 0.6)), *np.divide(told.change, felt)])
    np.testing.assert_allclose(np.std(off, axis=0), [0.01] * 3 + [0.05] * 3, rtol=0.2)
    assert np.abs(np.corrcoef(np.transpose(off)) - np.eye(6)).max() < 0.25


def test_force_sensors_have_noise_of_their_own_of_the_stated_size(true, read):
    """2 N each: the load of either sole and three components of the floor's force."""
    sensors, told = sensing(true, SensorSettings()), []
    for step in range(1, 801):
        floor = read_feet(sensors, 0, step, true, contacts(), read, DT)
        told.append([*read.load[0], *floor])
    np.testing.assert_allclose(np.std(told, axis=0), 2.0, rtol=0.12)
    assert np.abs(np.corrcoef(np.transpose(told)) - np.eye(5)).max() < 0.15


def test_the_sensors_are_those_of_the_data_sheets():
    degree, g = math.pi / 180.0, 9.81
    assert SensorSettings()._asdict() == pytest.approx({
        "rate_noise": 0.007 * degree * math.sqrt(250.0), "rate_bias": 0.05 * degree, "rate_walk": 2e-5,
        "rate_scale": 0.001, "rate_range": 34.906585, "force_noise": 120e-6 * g * math.sqrt(250.0),
        "force_bias": 0.02943, "force_walk": 1e-4, "force_scale": 0.005, "force_range": 156.96,
        "angle_resolution": 4.79369e-5, "angle_noise": 2e-5, "angle_offset": 5e-4, "load_noise": 2.0,
        "load_lag": 0.001, "load_least": 8.0,
    }, rel=1e-7)  # fmt: skip


def test_the_speed_that_a_robot_begins_with_is_not_gained(true):
    true.qvel[0, :3] = 0.3, -0.2, 0.1
    told = read_inertial(sensing(true), 0, 1, true, DT)
    np.testing.assert_allclose(rotated(TILTED, told.change), [0.0, 0.0, DT * G], atol=1e-12)


def test_an_estimate_begins_as_unsure_as_it_says(begin):
    """Tilt of 3 mrad and speed of 2 cm/s, each axis; yaw is where the estimate says that it is."""
    core, tilts, speeds = onboard_core(), [], []
    for seed in range(120):
        begin(core, 0, Scenario("a", command=Command(0.3), noise_seed=seed))
        believed, true = tuple(core.estimate.attitude[0]), tuple(core.judged.qpos[0, 3:7])
        tilts.append(rotation_of(product(believed, conjugate(true))))
        speeds.append(core.estimate.velocity[0] - core.judged.qvel[0, :3])
    np.testing.assert_allclose(np.std(tilts, axis=0), [0.003, 0.003, 0.0], rtol=0.25, atol=1e-9)
    np.testing.assert_allclose(np.std(speeds, axis=0), 0.02, rtol=0.25)


def test_on_a_slope_a_robot_believes_in_a_velocity_turned_by_it(begin):
    core, found = onboard_core(), []
    for slope in (0.0, 0.08):  # the same noise seed: the same error
        begin(core, 0, Scenario("a", command=Command(0.5), errors=ModelErrors(slope_forward=slope)))
        found.append(core.estimate.velocity[0].copy())
    (x, _, z), less = core.judged.qvel[0, :3], np.cos(0.08) - 1.0
    wanted = [x * less - z * np.sin(0.08), 0.0, x * np.sin(0.08) + z * less]
    np.testing.assert_allclose(found[1] - found[0], wanted, atol=1e-4)  # x sin 0.08 is 0.048 m/s


def test_held_joints_are_known_as_they_are():
    episodes = BipedEpisodes(1, robot=ARMS_HELD, sensing="onboard")
    episodes.begin(0, Scenario("a", (Push((0.0, 600.0, 0.0), 0.1, 0.0, "trunk"),)))
    for _ in range(4):
        episodes.step(np.zeros((1, 7), np.float32))
    known, true = episodes.core.physics, episodes.core.judged
    np.testing.assert_array_equal(known.qpos[0, 21:], true.qpos[0, 21:])
    np.testing.assert_array_equal(known.qvel[0, 20:], true.qvel[0, 20:])
    assert np.abs(true.qvel[0, 20:]).min() > 1e-3


def test_joint_noise_of_the_model_errors_comes_on_top_of_the_encoders(begin):
    core, off = onboard_core(), []

    def look():
        off.append(core.physics.qpos[0, JOINT : JOINT + NU] - core.judged.qpos[0, JOINT : JOINT + NU])

    core.after_physics_step = look
    begin(core, 0, Scenario("a", noise_seed=2, errors=ModelErrors(joint_noise=2e-3)))
    for _ in range(40):
        step(core)
    assert core.gait.failure[0] == 0
    np.testing.assert_allclose(np.std(off, axis=0), 2e-3, rtol=0.25)


def test_a_robot_without_a_waist_roll_reads_none():
    episodes = BipedEpisodes(1, robot=NO_WAIST_ROLL, sensing="onboard")
    episodes.begin(0, Scenario("a", noise_seed=3, sensing="onboard"))
    for _ in range(5):
        episodes.step(np.zeros((1, 7), np.float32))
    phys = episodes.core.physics
    assert (phys.qpos[0, JOINT + 1], phys.qvel[0, BASE + 1]) == (0.0, 0.0)
    assert phys.qpos[0, JOINT] != episodes.core.judged.qpos[0, JOINT]  # the pitch has an encoder
