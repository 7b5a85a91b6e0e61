"""The episode loop on robots that only count: what the policy is handed, and who is begun when."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout import episodes as loop
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout, run_episodes
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.outcome import Ending


class Counting:
    """Robots that end after as many steps as their scenario's id says; slot k observes its own count."""

    def __init__(self, n):
        self.n = n
        self.left = np.zeros(n, np.int64)
        self.calls = []

    def begin(self, k, scenario):
        self.left[k] = int(scenario.id)
        self.calls.append(("begin", k, scenario.id))

    def rest(self, k):
        self.calls.append(("rest", k))

    def observe(self, rows):
        return self.left[rows]

    def step(self, rows, actions):
        assert (actions == 10 * self.left[rows]).all()
        self.left[rows] -= 1
        return rows[self.left[rows] == 0].tolist()

    def ending(self, k):
        return Ending(k == 1, 0.1 * k, None, "low" if k == 1 else None, -1.0)


class Remembering:
    """Its state counts the steps of each robot; notes what it was handed."""

    def __init__(self):
        self.handed = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = np.zeros(len(observation), np.int64) if state is None else state[0]
        assert len(count) == len(observation)
        count = np.where(episode_start, 1, count + 1)
        self.handed.append((observation.tolist(), episode_start.tolist(), count.tolist()))
        return 10 * observation, (count,)


def test_a_free_robot_begins_the_next_scenario():
    robots, policy = Counting(2), Remembering()
    found = list(run_episodes(robots, policy, [Scenario(str(steps)) for steps in (2, 1, 3)], "p"))
    assert [(number, out.scenario_id, out.env_steps) for number, out in found] == [
        (1, "1", 1),
        (0, "2", 2),
        (2, "3", 3),
    ]
    assert [out.failure_reason for _, out in found] == ["low", None, "low"]
    assert [out.survived for _, out in found] == [False, True, False]
    assert robots.calls == [
        ("begin", 0, "2"), ("begin", 1, "1"), ("begin", 1, "3"), ("rest", 0), ("rest", 1),
    ]  # fmt: skip
    assert policy.handed == [
        ([2, 1], [True, True], [1, 1]),
        ([1, 3], [False, True], [2, 1]),
        ([2], [False], [2]),  # robot 0 rests, and its row of the state is gone
        ([1], [False], [3]),
    ]


def test_more_robots_than_scenarios():
    robots = Counting(3)
    assert [n for n, _ in run_episodes(robots, Remembering(), [Scenario("1")], "p")] == [0]
    assert robots.calls == [("begin", 0, "1"), ("rest", 1), ("rest", 2), ("rest", 0)]
    assert list(run_episodes(Counting(2), Remembering(), [], "p")) == []


def test_an_episode_that_never_ends_is_named(monkeypatch):
    monkeypatch.setattr(loop, "MAX_STEPS", 4)
    assert len(list(run_episodes(Counting(1), Remembering(), [Scenario("4")], "p"))) == 1
    with pytest.raises(InvalidValueError, match="'5' did not end within 4 steps"):
        list(run_episodes(Counting(2), Remembering(), [Scenario("1"), Scenario("5")], "p"))


def test_a_watch_sees_the_start_and_every_step():
    env, seen = make_env("PushRecovery/Pendulum-v0"), []
    policy = load_policy("passive", env)
    scenario = Scenario("short", duration=0.05)
    watched = rollout(
        env, policy, scenario, "p", lambda robot: seen.append((robot.info["time"], robot.ended))
    )
    np.testing.assert_allclose([time for time, _ in seen], 0.01 * np.arange(6), atol=1e-12)
    assert [ended for _, ended in seen] == [False] * 5 + [True]
    assert watched == rollout(env, policy, scenario, "p")
