"""The compiled end of a planning period against its rules, written out here."""

import copy
import math
from functools import reduce
from operator import add

import numpy as np
import pytest
from push_recovery.controllers.array_table import parts_table
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.nominal_gait import nominal_gait, step_start_dcm, transfer_weight
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.episode.period_end import (
    REWARD_TERMS,
    Episodes,
    PeriodArrays,
    Robots,
    end_period,
    period_constants,
)
from push_recovery.envs.episode.recovery import GaitMonitor, uphill_dcm
from push_recovery.envs.pendulum.env import PendulumEnv, PendulumEpisodes
from push_recovery.envs.scenario.push import SIDES, Push
from push_recovery.envs.scenario.scenario import Scenario

ROBOT, LIMITS = RobotModel(), GaitLimits()


def draw(n):
    """Arrays of n robots in any state, and the gaits of their period."""
    rng = np.random.default_rng(2)
    observation = 0.3 * rng.normal(size=(n, 36))
    observation[:, 0] = rng.uniform(0.0, 0.6, n)
    robots = Robots(
        steps=rng.integers(0, 3, n), com=rng.normal(size=(n, 2)), time=rng.uniform(0.0, 4.0, n),
        side=rng.integers(0, 2, n), heading=rng.normal(size=n), failure=rng.integers(0, 2, n),
        observation=observation,
        margin=rng.normal(0.05, 0.1, n), command=rng.normal(size=(n, 3)), action=rng.normal(size=(n, 7)),
        push_start=rng.uniform(0.0, 2.0, (n, 2)), push_duration=rng.uniform(0.0, 0.5, (n, 2)),
        world=rng.normal(size=(n, 6)),
    )  # fmt: skip
    robots.push_start[0, 1] = np.inf
    episodes = Episodes(
        pushes=rng.integers(0, 3, n), changed=np.where(rng.random(n) < 0.5, 0.0, rng.uniform(0.0, 4.0, n)),
        fixed=np.where(rng.random(n) < 0.5, np.nan, rng.uniform(0.0, 4.0, n)),
        settle=rng.uniform(0.0, 2.0, n), uphill=np.zeros((n, 2)), before=rng.uniform(-1.0, 1.0, (n, 7)),
        planned=np.zeros(n), event=np.zeros(n), terms=np.zeros((n, 7)), total=np.zeros(n),
    )  # fmt: skip
    return robots, episodes, rng.uniform(0.2, 0.7, (n, 7))


def judge(robots, episodes, gaits, timing=(0.0, 0.0)):
    monitor, ends = GaitMonitor(len(gaits)), np.zeros((2, len(gaits)), np.bool_)
    table = parts_table(PeriodArrays(robots, episodes, monitor.state))
    end_period(table, period_constants(ROBOT, LIMITS, *timing), gaits, ends)
    return monitor.state, ends


def formula(obs, before, planned, margin, failed, delay, double_support):
    nominal = nominal_gait(ROBOT, LIMITS, obs[25:27], delay, double_support)
    start = np.array(step_start_dcm(nominal, ROBOT.pelvis_width, ROBOT.omega, delay))
    decay = math.exp(-ROBOT.omega * nominal.duration)
    if double_support:
        start = np.array([nominal.length + nominal.offset_x, nominal.width + nominal.offset_y]) * decay
    left = transfer_weight(obs[0], double_support, ROBOT.omega) * obs[9:11]
    error = (obs[1:3] - left) * math.exp(-ROBOT.omega * obs[0]) - start
    return {
        "alive": 0.0 if failed else 1.0,
        "fall": -50.0 if failed else 0.0,
        "dcm": 0.0 if failed else math.exp(-(error @ error) / 0.1**2),
        "margin": -float(np.clip(1.0 - margin / 0.1, 0.0, 1.0)),
        "duration": -0.5 * (planned / nominal.duration - 1.0) ** 2,
        "trunk": max(-0.3 * obs[15:17] @ obs[15:17] - 0.01 * obs[17:19] @ obs[17:19], -2.0),
        "smoothness": -0.02 * float(np.sum((obs[27:34] - before) ** 2)),
    }, float(np.hypot(*error))


@pytest.mark.parametrize("timing", [(0.0, 0.0), (0.03, 0.0), (0.0, 0.1)])
def test_reward_terms_are_their_formulas(timing):
    robots, episodes, gaits = draw(40)
    before = episodes.before.copy()
    monitor, _ = judge(robots, episodes, gaits, timing)
    for k in range(40):
        seen = robots.observation[k], before[k], gaits[k, 2], robots.margin[k], robots.failure[k] != 0
        expected, error = formula(*seen, *timing)
        assert tuple(expected) == REWARD_TERMS
        np.testing.assert_allclose(episodes.terms[k], list(expected.values()), rtol=1e-12, atol=1e-14)
        # added one after the other: from Python 3.12 on, `sum` carries the rounding errors along
        assert episodes.total[k] == reduce(add, episodes.terms[k].tolist())
        assert monitor.error[k, 0] == pytest.approx(error if robots.steps[k] else 0.0, rel=1e-12)
    np.testing.assert_array_equal(episodes.before, robots.action)
    np.testing.assert_array_equal(episodes.planned, gaits[:, 2])


@pytest.mark.parametrize("double_support", [0.0, 0.1])
def test_a_slope_is_judged_by_its_own_gait(double_support):
    """A DCM that is h tan(slope) further uphill is judged as the level one is, whatever heading and side."""
    (level, on_level, gaits), (tilted, on_slope, _) = draw(40), draw(40)
    slopes = np.random.default_rng(3).uniform(-0.08, 0.08, (40, 2))
    for k in range(40):
        on_slope.uphill[k] = uphill_dcm(ROBOT.com_height, *slopes[k])
        np.testing.assert_allclose(on_slope.uphill[k], ROBOT.com_height * np.tan(slopes[k]), rtol=1e-15)
        cos, sin = math.cos(tilted.heading[k]), math.sin(tilted.heading[k])
        lean = np.array([[cos, sin], [-sin, cos]]) @ on_slope.uphill[k]
        tilted.observation[k, 1:3] += lean * [1.0, -1.0 if SIDES[tilted.side[k]] == "left" else 1.0]
    expected, _ = judge(level, on_level, gaits, (0.0, double_support))
    monitor, _ = judge(tilted, on_slope, gaits, (0.0, double_support))
    np.testing.assert_allclose(monitor.error, expected.error, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(on_slope.total, on_level.total, rtol=1e-12)


def test_an_episode_ends_by_a_fall_its_own_length_or_after_the_last_event():
    robots, episodes, gaits = draw(200)
    _, (failed, truncated) = judge(robots, episodes, gaits)
    reasons = set()
    for k in range(200):
        pushes = range(episodes.pushes[k])
        last = max((robots.push_start[k, i] + robots.push_duration[k, i] for i in pushes), default=0.0)
        last = max(last, episodes.changed[k])
        fixed = not math.isnan(episodes.fixed[k])
        end = episodes.fixed[k] if fixed else last + episodes.settle[k]
        assert failed[k] == (robots.failure[k] == 1)
        assert truncated[k] == (robots.time[k] >= end and not failed[k])
        reasons.add((fixed, bool(failed[k]), bool(truncated[k])))
    assert len(reasons) == 6


def test_a_robots_period_does_not_depend_on_the_others():
    together, alone = draw(9), draw(9)
    _, ends = judge(*together)
    for k in range(9):
        robots, episodes = (type(part)(*(a[k : k + 1] for a in part)) for part in alone[:2])
        _, own = judge(robots, episodes, alone[2][k : k + 1])
        assert episodes.terms.tobytes() == together[1].terms[k].tobytes()
        assert own.tobytes() == ends[:, k : k + 1].tobytes()


def test_steps_are_judged_once_each():
    robots, episodes, gaits = draw(4)
    robots.steps[:] = 0, 1, 2, 0
    monitor, ends = GaitMonitor(4), np.zeros((2, 4), np.bool_)
    table = parts_table(PeriodArrays(robots, episodes, monitor.state))
    for _ in range(3):
        end_period(table, period_constants(ROBOT, LIMITS, 0.0, 0.0), gaits, ends)
    assert monitor.state.touchdowns.tolist() == [0, 1, 1, 0]


def test_more_pushes_than_before_are_all_waited_for():
    episodes, action = PendulumEpisodes(2), np.zeros((2, 7), np.float32)
    late = tuple(Push((0.0, 0.0, 0.0), 0.01, start) for start in (0.0, 0.02, 0.05))
    episodes.begin(0, Scenario("one", late[:1], settle_time=0.01))
    episodes.begin(1, Scenario("three", late, settle_time=0.01))
    ended = [episodes.step(action).truncated.tolist() for _ in range(7)]
    assert [row[0] for row in ended] == [False, True, True, True, True, True, True]
    assert [row[1] for row in ended] == [False] * 6 + [True]


def test_a_copy_of_an_environment_goes_its_own_way():
    env, action = PendulumEnv(), np.zeros(7)
    env.reset(seed=1)
    for _ in range(3):
        env.step(action)
    other = copy.deepcopy(env)
    expected = [env.step(action) for _ in range(30)]
    for seen in expected:
        again = other.step(action)
        assert again[0].tobytes() == seen[0].tobytes()
        assert again[1:4] == seen[1:4]
        assert again[4]["reward_terms"] == seen[4]["reward_terms"]


def test_a_stander_on_a_slope_rests_uphill_of_the_middle_and_ends_no_step():
    """By side the middle between the feet is at (0.05, 0.1); the second robot goes 0.2 m/s aside."""
    robots, episodes, gaits = draw(2)
    robots.observation[:] = 0.0
    robots.observation[:, 0], robots.observation[:, 9:11] = -1.0, (0.1, 0.2)
    robots.observation[:, 1:3] = [[0.11, 0.07], [0.11, 0.13]]
    robots.observation[1, 6] = 0.2
    robots.heading[:], robots.side[:], robots.steps[:] = 0.0, (0, 1), 3
    robots.failure[:], robots.time[:] = 0, 3.0
    episodes.uphill[:], episodes.pushes[:], episodes.changed[:] = (0.06, 0.03), 0, 0.0
    monitor, ends = GaitMonitor(2), np.zeros((2, 2), np.bool_)
    table = parts_table(PeriodArrays(robots, episodes, monitor.state))
    constants = period_constants(ROBOT, LIMITS, 0.0, 0.0)
    end_period(table, constants, gaits, ends)
    np.testing.assert_allclose(episodes.terms[:, REWARD_TERMS.index("dcm")], 1.0)
    assert (monitor.recovered_at(0), monitor.recovered_at(1)) == (3.0, None)
    robots.observation[:, 0] = 0.01  # a step has begun; none has ended since
    end_period(table, constants, gaits, ends)
    assert not monitor.state.touchdowns.any()
