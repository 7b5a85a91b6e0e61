"""The book that is kept of robots which act only at times."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.training import gated_rollout
from push_recovery.training.gated_rollout import Choice, Streams, estimate_advantages

NOTHING = np.zeros(2, np.bool_)


def choose(streams, rows, value=0.5):
    """The robots are due at observation (k,) and choose action (k,)."""
    marks = np.array([[float(k)] for k in rows], np.float32)
    streams.observe(rows, marks)
    streams.choose(rows, marks, np.full(len(rows), value, np.float32), np.zeros(len(rows), np.float32))


def test_the_reward_of_a_walk_belongs_to_the_action_before_it():
    streams, rewards = Streams(2), np.array([1.0, 10.0], np.float32)
    choose(streams, [0])
    assert streams.step(rewards, NOTHING, NOTHING) == ([], pytest.approx(NOTHING))  # both gates are shut
    assert streams.step(rewards, NOTHING, np.array([False, True]))[0] == []  # robot 1 has not acted
    choose(streams, [1])
    complete, _ = streams.step(rewards, NOTHING, np.array([True, True]))
    assert complete == [0, 1]
    assert [made[-1].reward for made in streams.made] == [3.0, 10.0]
    assert [made[-1].ended for made in streams.made] == [False, False]


def test_an_end_completes_an_action_and_only_such_episodes_count():
    streams, rewards = Streams(2), np.array([1.0, 10.0], np.float32)
    choose(streams, [0])
    complete, acted = streams.step(rewards, np.array([True, True]), NOTHING)
    assert (complete, acted.tolist()) == ([0], [True, False])
    assert streams.made[0][0].ended
    assert streams.made[0][0].first
    choose(streams, [0])
    streams.step(rewards, NOTHING, np.array([True, False]))
    choose(streams, [0])
    streams.step(rewards, NOTHING, np.array([True, False]))
    assert [choice.first for choice in streams.made[0]] == [True, True, False]


def test_a_gate_that_never_opens_is_refused(monkeypatch):
    monkeypatch.setattr(gated_rollout, "MAX_EPISODES", 3)
    streams, both = Streams(2), np.ones(2, np.bool_)
    streams.step(np.zeros(2, np.float32), both, NOTHING)
    with pytest.raises(InvalidValueError, match="shut in 4 episodes"):
        streams.step(np.zeros(2, np.float32), both, NOTHING)


def test_an_episode_with_an_action_ends_a_row_of_idle_ones(monkeypatch):
    monkeypatch.setattr(gated_rollout, "MAX_EPISODES", 4)
    streams, rewards, both = Streams(2), np.zeros(2, np.float32), np.ones(2, np.bool_)
    streams.step(rewards, both, NOTHING)  # two idle episodes
    choose(streams, [0, 1])
    streams.step(rewards, both, NOTHING)  # none
    streams.step(rewards, both, NOTHING)  # two again
    with pytest.raises(InvalidValueError, match="shut in 4 episodes"):
        streams.step(rewards, both, NOTHING)


def test_advantages_are_sums_of_discounted_errors():
    """A_i = sum_k (gamma lambda)^k delta_i+k, up to the end of the episode."""
    rng, gamma, decay = np.random.default_rng(0), 0.9, 0.8
    rewards, values, following = rng.normal(size=6), rng.normal(size=6), 1.7
    choices = [
        Choice(np.zeros(1, np.float32), np.zeros(1, np.float32), v, 0.0, False, r)
        for v, r in zip(values, rewards, strict=True)
    ]
    choices[2].ended = True
    after = np.append(values[1:], following)
    after[2] = 0.0
    deltas = rewards + gamma * after - values
    expected = [
        sum((gamma * decay) ** (k - i) * deltas[k] for k in range(i, 3 if i < 3 else 6)) for i in range(6)
    ]
    assert estimate_advantages(choices, following, gamma, decay) == pytest.approx(expected, rel=1e-12)


def test_what_a_rollout_does_not_take_is_left_for_the_next():
    """Robot 1's third choice is one too many; its value is what follows the second."""
    streams, everyone = Streams(2), np.ones(2, np.bool_)
    for i in range(3):
        choose(streams, [0, 1], value=float(i))
        streams.step(np.ones(2, np.float32), NOTHING, everyone)
    streams.observe([0, 1], np.zeros((2, 1), np.float32))
    taken, advantages = streams.take(5, [7.0, 8.0], 0.5, 1.0)
    assert [choice.value for choice in taken] == [0.0, 1.0, 2.0, 0.0, 1.0]
    # with lambda 1: discounted rewards and what follows, less the value
    returns = [1.75 + 0.125 * 7.0, 1.5 + 0.25 * 7.0, 1.0 + 0.5 * 7.0, 1.5 + 0.25 * 2.0, 1.0 + 0.5 * 2.0]
    assert advantages + np.array([0.0, 1.0, 2.0, 0.0, 1.0]) == pytest.approx(returns)
    assert streams.count == 1
    assert streams.made[1][0].value == 2.0
