"""Rewards of three robots whose periods are made up."""

from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.training.builders import completed, make_env, make_robots
from push_recovery.training.reward import REWARDS, EnvironmentReward, RecoveryReward, StepReward
from push_recovery.training.settings import TrainingSettings

GAMMA = 0.9


def robots(margin, recovered=(False, False, False)):
    state = SimpleNamespace(recovered_at=np.where(recovered, 1.0, np.nan))
    core = SimpleNamespace(margin=np.array(margin))
    monitor, time = SimpleNamespace(state=state), np.full(3, 0.5)
    return SimpleNamespace(n=3, core=core, monitor=monitor, motion=lambda: SimpleNamespace(time=time))


def period(failed=(0, 0, 0), truncated=(0, 0, 0), total=(0.0, 0.0, 0.0)):
    return SimpleNamespace(
        failed=np.array(failed, bool), truncated=np.array(truncated, bool),
        reward=SimpleNamespace(total=np.array(total)),
    )  # fmt: skip


ALL, SHUT, OPEN = np.ones(3, bool), np.ones(3, bool), np.zeros(3, bool)


def begun(margin, recovered=(False, False, False)):
    episodes = robots(margin, recovered)
    reward = RecoveryReward(episodes, GAMMA)
    reward.begin(np.arange(3))
    return episodes, reward


def test_the_margin_is_a_potential_between_its_bounds():
    """phi = 2 clip(m, -0.3, 0.05): from -0.1 to -0.2, from -1 to -0.3, from 0 to 1 m."""
    episodes, reward = begun([-0.1, -1.0, 0.0])
    assert not reward.period(period(), ALL, OPEN).any()
    episodes.core.margin[:] = -0.2, -0.3, 1.0
    np.testing.assert_allclose(
        reward.collect(OPEN), [GAMMA * -0.4 + 0.2, GAMMA * -0.6 + 0.6, GAMMA * 0.1], atol=1e-15
    )
    episodes.core.margin[:] = 0.0
    np.testing.assert_allclose(reward.collect(OPEN), [0.4, 0.6, -0.1], atol=1e-15)


def test_the_potentials_of_an_episode_add_up_to_that_of_its_begin():
    """With gamma 1 the shaping of a whole episode is -phi of its begin: it prefers no way over another."""
    episodes = robots([-0.1, 0.0, 0.02])
    reward = RecoveryReward(episodes, 1.0)
    reward.begin(np.arange(3))
    total = np.zeros(3)
    for margins in ([0.05, -0.2, 0.0], [-0.3, 0.01, 0.01]):
        reward.period(period(), ALL, OPEN)
        episodes.core.margin[:] = margins
        total += reward.collect(OPEN)
    reward.period(period(truncated=(1, 1, 1)), ALL, OPEN)
    total += reward.collect(ALL)
    np.testing.assert_allclose(total, np.array([0.2, 0.0, -0.04]) + 0.3, atol=1e-15)


@pytest.mark.parametrize(
    ("failed", "truncated", "recovered", "closed", "over", "worth"),
    [
        (True, False, False, False, True, -1.0),
        (True, False, True, True, True, -1.0),  # it fell after it had recovered
        (False, True, False, False, True, 0.3),
        (False, True, True, False, True, 1.0),
        (False, False, True, True, True, 1.0),
        (False, False, True, False, False, 0.0),  # the gate is open: what is learned still acts
        (False, False, False, True, False, 0.0),
    ],
)
def test_ends_and_what_they_are_worth(failed, truncated, recovered, closed, over, worth):
    _, reward = begun([0.0, 0.0, 0.0], [recovered, False, False])
    result = period((failed, False, False), (truncated, False, False))
    ended = reward.period(result, ALL, np.array([closed, False, False]))
    assert ended.tolist() == [over, False, False]
    np.testing.assert_allclose(reward.collect(ended), [worth, 0.0, 0.0], atol=1e-15)


def test_what_the_monitor_said_of_the_walk_before_the_push_is_no_recovery():
    episodes, reward = begun([0.0, 0.0, 0.0], [True, True, True])
    episodes.monitor.state.recovered_at[:] = 0.4, 0.5, 0.6  # the episodes begin at 0.5 s
    assert reward.period(period(), ALL, SHUT).tolist() == [False, False, True]


def test_a_robot_whose_episode_is_over_earns_nothing_more():
    _, reward = begun([0.0, 0.0, 0.0])
    first = reward.period(period(failed=(1, 0, 0)), ALL, OPEN)
    second = reward.period(period(failed=(1, 0, 0)), ~first, OPEN)
    assert not second.any()
    assert reward.collect(first).tolist() == [-1.0, 0.0, 0.0]
    assert reward.collect(OPEN).tolist() == [0.0, 0.0, 0.0]


def test_the_environments_own_reward_is_summed_while_its_episode_lasts():
    reward = EnvironmentReward(robots([0.0] * 3), GAMMA)
    reward.begin(np.arange(3))
    ended = reward.period(period(truncated=(0, 1, 0), total=(1.0, 2.0, 3.0)), ALL, SHUT)
    assert ended.tolist() == [False, True, False]
    assert not reward.period(period(total=(10.0, 20.0, 30.0)), ~ended, SHUT).any()
    assert reward.collect(ended).tolist() == [11.0, 2.0, 33.0]
    assert reward.collect(ended).tolist() == [0.0, 0.0, 0.0]
    assert (EnvironmentReward.bootstraps, RecoveryReward.bootstraps) == (True, False)


def test_a_touchdown_earns_what_recovery_is_judged_by_and_once():
    """Errors of one tolerance each: 20 / e^2; of none: 20; a robot that does not land earns nothing more."""
    episodes = robots([0.0] * 3)
    state = episodes.monitor.state
    state.touchdowns = np.array([4, 0, 7])
    state.error, state.speed_error = np.array([[0.05, 9.0, 9.0], [0.0] * 3, [0.0] * 3]), np.zeros(3)
    state.speed_error[0] = 0.15
    reward = StepReward(episodes, GAMMA)
    reward.begin(np.arange(3))
    reward.period(period(total=(1.0, 2.0, 3.0)), ALL, SHUT)
    assert reward.collect(OPEN).tolist() == [1.0, 2.0, 3.0]
    state.touchdowns += [1, 1, 0]
    reward.period(period(), ALL, SHUT)
    reward.period(period(), ALL, SHUT)
    np.testing.assert_allclose(reward.collect(OPEN), [20.0 / np.e**2, 20.0, 0.0], rtol=1e-14)
    state.touchdowns[:] = 0, 1, 9  # the first is reset, and lands; the last landed before its begin
    reward.begin(np.array([0, 2]))
    state.touchdowns[0] = 1
    reward.period(period(), ALL, SHUT)
    np.testing.assert_allclose(reward.collect(OPEN), [20.0 / np.e**2, 0.0, 0.0], rtol=1e-14)
    assert StepReward.bootstraps


class Effortless(EnvironmentReward):
    """A reward added from outside: 0.25 a period, less the robot's speed forward [m/s]."""

    def worth(self, period):
        return 0.25 - self.episodes.speed


def test_a_reward_is_added_by_a_class_and_its_name(monkeypatch):
    monkeypatch.setitem(REWARDS, "effortless", Effortless)
    settings = TrainingSettings("scratch", reward="effortless", starts="reset", n_envs=2, hold=2)
    env = make_env(settings)
    settings = completed(settings, env)
    assert settings.reward == "effortless"
    assert TrainingSettings.from_json(settings.to_json()) == settings
    robots_of_run = make_robots(settings, env, 0)
    robots_of_run.episodes.speed = np.array([0.0, 1.0])
    robots_of_run.reset()
    _, rewards, _, _ = robots_of_run.step(np.zeros((2, 7), np.float32))
    assert rewards.tolist() == [0.5, -1.5]  # of two periods
    with pytest.raises(UnknownNameError, match=r"reward 'efortless'; did you mean 'effortless'"):
        TrainingSettings(reward="efortless")


def test_a_fall_ends_an_episode_of_the_environments_own_reward():
    reward = EnvironmentReward(robots([0.0] * 3), GAMMA)
    reward.begin(np.arange(3))
    fallen = period(failed=(1, 0, 1), total=(-5.0, 2.0, 3.0))
    ended = reward.period(fallen, np.array([True, True, False]), OPEN)
    assert ended.tolist() == [True, False, False]
    assert reward.collect(ended).tolist() == [-5.0, 2.0, 0.0]
