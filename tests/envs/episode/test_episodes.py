from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.episode.episodes import check_hold, hold_action


class Counting:
    """Three robots whose reward is 1, 10, 100 a period; robot k ends after `ends[k]` periods, 1 by a fall."""

    def __init__(self, ends):
        self.n, self.ends, self.periods, self.actions = 3, np.array(ends), 0, []
        self.reward_terms = tuple("abcdefg")

    def step(self, actions):
        self.periods += 1
        self.actions.append(actions.copy())
        total, over = np.array([1.0, 10.0, 100.0]), self.ends <= self.periods
        failed = over & np.array([False, True, False])
        terms = np.repeat(total[:, None], 7, axis=1)
        return SimpleNamespace(
            reward=SimpleNamespace(total=total, terms=terms), failed=failed, truncated=over & ~failed
        )


def run(ends, periods, live=(True, True, True)):
    episodes, seen, came = Counting(ends), [], []

    def act(live):
        seen.append(live.tolist())
        return np.zeros((3, 7), np.float32)

    def at_end(over, left, held):
        came.append((over.tolist(), left, held.reward.tolist()))

    held = hold_action(episodes, np.array(live), periods, act, at_end)
    return episodes, held, seen, came


def test_rewards_add_up_to_the_end_of_each_episode():
    episodes, held, seen, came = run([9, 2, 3], 4)
    assert held.reward.tolist() == [4.0, 20.0, 300.0]
    assert held.terms[:, 6].tolist() == [4.0, 20.0, 300.0]
    assert held.failed.tolist() == [False, True, False]
    assert held.truncated.tolist() == [False, False, True]
    assert seen == [[True] * 3, [True] * 3, [True, False, True], [True, False, False]]
    assert came == [
        ([False, True, False], 2, [2.0, 20.0, 200.0]),
        ([False, False, True], 1, [3.0, 20.0, 300.0]),
    ]
    assert episodes.periods == 4


def test_it_stops_where_all_have_ended():
    episodes, held, _, came = run([1, 1, 1], 5)
    assert (episodes.periods, held.reward.tolist()) == (1, [1.0, 10.0, 100.0])
    assert came == [([True, True, True], 4, [1.0, 10.0, 100.0])]


def test_robots_that_wait_count_for_nothing_and_all_waiting_costs_one_period():
    episodes, held, _, came = run([1, 1, 9], 2, live=(False, False, True))
    assert (held.reward.tolist(), held.failed.any(), held.truncated.any(), came) == (
        [0, 0, 200],
        False,
        False,
        [],
    )
    episodes, held, _, _ = run([1, 1, 1], 3, live=(False, False, False))
    assert (episodes.periods, held.reward.tolist()) == (1, [0.0, 0.0, 0.0])


@pytest.mark.parametrize("periods", [0, -1, 1.0, True, "2", None])
def test_an_action_is_held_for_whole_periods(periods):
    with pytest.raises(InvalidValueError, match="whole number of periods >= 1"):
        check_hold(periods)


def test_a_hold_passes():
    assert check_hold(3) == 3
