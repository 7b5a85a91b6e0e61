"""Held actions, and what users add to episodes: reward terms and measures."""

from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.model.observation import DCM
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.episodes import hold_action
from push_recovery.envs.episode.period_end import REWARD_TERMS
from push_recovery.envs.joint.env import JointEpisodes
from push_recovery.envs.pendulum.env import PendulumEnv, PendulumEpisodes, make_pendulum_vector
from push_recovery.envs.scenario.push import SIDES, Kick, Push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario


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
    episodes, seen, ends_seen = Counting(ends), [], []

    def act(live):
        seen.append(live.tolist())
        return np.zeros((3, 7), np.float32)

    def at_end(over, left, held):
        ends_seen.append((over.tolist(), left, held.reward.tolist()))

    held = hold_action(episodes, np.array(live), periods, act, at_end)
    return episodes, held, seen, ends_seen


def test_rewards_add_up_to_the_end_of_each_episode():
    episodes, held, seen, ends_seen = run([9, 2, 3], 4)
    assert held.reward.tolist() == [4.0, 20.0, 300.0]
    assert held.terms[:, 6].tolist() == [4.0, 20.0, 300.0]
    assert held.failed.tolist() == [False, True, False]
    assert held.truncated.tolist() == [False, False, True]
    assert seen == [[True] * 3, [True] * 3, [True, False, True], [True, False, False]]
    assert ends_seen == [
        ([False, True, False], 2, [2.0, 20.0, 200.0]),
        ([False, False, True], 1, [3.0, 20.0, 300.0]),
    ]
    assert episodes.periods == 4


def test_it_stops_where_all_have_ended():
    episodes, held, _, ends_seen = run([1, 1, 1], 5)
    assert (episodes.periods, held.reward.tolist()) == (1, [1.0, 10.0, 100.0])
    assert ends_seen == [([True, True, True], 4, [1.0, 10.0, 100.0])]


def test_robots_that_wait_count_for_nothing_and_all_waiting_costs_one_period():
    episodes, held, _, ends_seen = run([1, 1, 9], 2, live=(False, False, True))
    assert (held.reward.tolist(), held.failed.any(), held.truncated.any(), ends_seen) == (
        [0, 0, 200],
        False,
        False,
        [],
    )
    episodes, held, _, _ = run([1, 1, 1], 3, live=(False, False, False))
    assert (episodes.periods, held.reward.tolist()) == (1, [0.0, 0.0, 0.0])


def leaning(episodes):
    """-|horizontal distance of the DCM from the stance sole| [m]."""
    return -np.hypot(*episodes.core.truth[:, DCM].T)


@pytest.mark.parametrize("robots", [PendulumEpisodes, JointEpisodes])
def test_a_reward_term_of_the_users_counts_beside_the_others(robots):
    plain, own = robots(2), robots(2)
    own.add_reward_term(leaning)
    own.add_reward_term(lambda episodes: np.array([1.0, 2.0]), "place")
    assert own.reward_terms == (*plain.reward_terms, "leaning", "place")
    copies = own.clone(1), plain.clone(1)
    assert copies[0].reward_terms == own.reward_terms
    for episodes in (plain, own):
        for k in range(2):
            episodes.begin(k, Scenario("a", stance_side=SIDES[k]))
    action = np.zeros((2, own.action_size), np.float32)
    for _ in range(3):
        before, reward = plain.step(action).reward, own.step(action).reward
        expected = leaning(own), [1.0, 2.0]
        np.testing.assert_array_equal(reward.terms[:, :-2], before.terms)
        np.testing.assert_array_equal(reward.terms[:, -2:].T, expected)
        np.testing.assert_allclose(reward.total, before.total + expected[0] + expected[1], rtol=1e-15)
    with pytest.raises(InvalidValueError, match="has a term 'alive' already: alive, fall"):
        own.add_reward_term(leaning, "alive")


@pytest.mark.parametrize("vector", [True, False])
def test_users_terms_and_measures_are_in_info(vector):
    env = make_pendulum_vector(2) if vector else PendulumEnv()
    env.episodes.add_reward_term(leaning)
    env.episodes.add_measure(leaning, "distance")
    env.episodes.add_measure(lambda episodes: episodes.core.world[:, :2], "place")
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros(env.action_space.shape))
    expected = leaning(env.episodes)
    total = sum(info["reward_terms"][name] for name in env.episodes.reward_terms)
    np.testing.assert_allclose(reward, total)
    np.testing.assert_array_equal(info["distance"], expected if vector else expected[0])
    np.testing.assert_array_equal(info["place"], env.core.world[:, :2] if vector else env.core.world[0, :2])
    assert not vector or info["_distance"].all()


@pytest.mark.parametrize("rate", [np.int64(50), np.float32(50.0), 50])
def test_rate_and_number_of_robots_may_be_numpys(rate):
    episodes = PendulumEpisodes(np.int32(2), control_hz=rate)
    assert (episodes.n, episodes.control_hz, episodes.core.dt) == (2, 50.0, 0.02)


@pytest.mark.parametrize(
    ("robots", "changes", "kicks", "end"),
    [
        (PendulumEpisodes, (0.1, 0.2), (), 0.3),
        (BipedEpisodes, (), (0.2, 0.1), 0.3),
        (BipedEpisodes, (0.1,), (0.2,), 0.3),
        (BipedEpisodes, (0.2,), (0.1,), 0.3),
        (BipedEpisodes, (), (0.02,), 0.15),  # the push ends later
    ],
)
def test_an_episode_ends_some_time_after_its_last_event(robots, changes, kicks, end):
    episodes, push = robots(1), Push((1.0, 0.0, 0.0), 0.03, 0.02)
    scenario = Scenario(
        "a", (push,), settle_time=0.1, kicks=tuple(Kick((0.01, 0.0, 0.0), start) for start in kicks),
        changes=tuple(CommandChange(time, Command(0.1)) for time in changes),
    )  # fmt: skip
    episodes.begin(0, scenario)
    ends = [episodes.step(np.zeros((1, 7), np.float32)).truncated.item() for _ in range(32)]
    assert ends.index(True) + 1 == round(100 * end)


def test_the_last_sudden_change_is_that_of_command_or_kick():
    """An episode waits for the later one of the two, and never for less."""
    change = (CommandChange(0.4, Command(0.1)),)
    for changes, kicks, last in (
        ((), (), 0.0), (change, (), 0.4), ((), (0.7, 0.2), 0.7), (change, (0.2,), 0.4), (change, (0.7,), 0.7)
    ):  # fmt: skip
        scenario = Scenario("a", changes=changes, kicks=tuple(Kick((0.01, 0, 0), start) for start in kicks))
        assert scenario.last_sudden_change == last
        assert scenario.end_time(0.1) == max(last, 0.1) + scenario.settle_time


def test_the_first_action_is_compared_with_that_of_the_nominal_step_whatever_came_before():
    """-0.02 |a - a_before|^2: 0 for the nominal one, and -0.02 x 0.1^2 where one entry is off by 0.1."""
    episodes, column = PendulumEpisodes(1), REWARD_TERMS.index("smoothness")
    for before in (0.0, 0.5, -0.5):
        episodes.begin(0, Scenario("a"))
        nominal = episodes.core.previous_action.astype(np.float32)
        assert episodes.step(nominal).reward.terms[0, column] == pytest.approx(0.0, abs=1e-9)
        changed = nominal + np.float32(0.1) * np.eye(7, dtype=np.float32)[:1]
        assert episodes.step(changed).reward.terms[0, column] == pytest.approx(-2e-4, rel=1e-4)
        episodes.step(np.full((1, 7), before, np.float32))


@pytest.mark.parametrize("turns", [(-0.2, 0.0), (0.0, -0.2), (0.1, -0.2)])
def test_a_turn_to_either_side_at_any_time_is_refused_where_robots_do_not_turn(turns):
    first, then = (Command(turn=turn) for turn in turns)
    with pytest.raises(InvalidValueError, match=r"does not turn: .* got -0\.2 in scenario 'a'"):
        PendulumEpisodes(1).begin(0, Scenario("a", command=first, changes=(CommandChange(1.0, then),)))


def test_a_clone_counts_terms_and_measures_of_the_users():
    def leaning(episodes):
        return np.abs(episodes.core.state.com[:, 1])

    own = PendulumEpisodes(1)
    own.add_reward_term(leaning)
    own.add_measure(leaning, "distance")
    copy = own.clone(2)
    for k in (0, 1):
        copy.begin(k, Scenario("a"))
    terms = copy.step(np.zeros((2, 7), np.float32)).reward.terms
    np.testing.assert_array_equal(terms[:, -1], leaning(copy))
    assert terms[:, -1].min() > 0.0
    assert list(copy.more_info()) == ["distance"]


def test_standing_has_no_step_before_it():
    """The action before the first is that of the longest step, which a stander never ends."""
    episodes = PendulumEpisodes(1)
    episodes.begin(0, Scenario("a", command=Command(stand=True)))
    assert episodes.core.previous_action[0, 2] == 1.0


def test_the_callers_mask_of_robots_is_left_alone():
    live = np.ones(3, np.bool_)
    hold_action(Counting([1, 2, 3]), live, 3, lambda live: np.zeros((3, 7), np.float32), lambda *_: None)
    assert live.all()


@pytest.mark.parametrize(("entry", "cop"), [(1.0, 0.25), (-1.0, -0.05)])
def test_a_robot_that_will_stand_later_may_put_its_cop_between_both_soles_then(entry, cop):
    """Soles 0.2 m apart and 0.1 m wide: from -0.05 to 0.25 m."""
    episodes = PendulumEpisodes(1)
    later = CommandChange(1.0, Command(stand=True))
    episodes.begin(0, Scenario("a", changes=(later,)))
    seen = episodes.core.observation
    seen[0, 0], seen[0, 9:11] = -1.0, (0.0, 0.2)  # on both feet, the other one beside it
    gait = episodes.gaits(np.array([[0.0, 0.0, 1.0, 0.0, entry, 0.0, 0.0]]))[0]
    assert gait[4] == pytest.approx(cop)
