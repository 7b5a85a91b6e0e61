"""Copies of a robot against the robot itself, in scenarios that differ in what is still to come."""

from dataclasses import replace

import numpy as np
import pytest
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import Kick, Push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario
from push_recovery.eval.sampling_mpc import SamplingMpcSettings
from push_recovery.eval.search import CrossEntropy, Forecast, SequenceRule, as_text, begun, state_of, worth


def method(seed: int = 0, population: int = 40, elites: int = 5, least: float = 0.05) -> CrossEntropy:
    settings = SamplingMpcSettings(population=population, elites=elites, least_spread=least)
    return CrossEntropy(np.random.default_rng(seed), np.zeros(3), np.full(3, 0.8), settings)


def test_candidates_are_normal_and_clipped():
    drawn = method(population=10_000).ask()
    assert drawn.dtype == np.float32
    assert np.abs(drawn).max() == 1.0
    inside = np.abs(drawn) < 1.0
    assert abs(inside.mean() - 0.789) < 0.01  # P(|z| < 1 / 0.8)
    assert np.abs(np.median(drawn, axis=0)).max() < 0.03


def test_files_hold_candidates_exactly():
    drawn = method().ask()
    told = as_text(drawn)
    assert max(len(repr(number)) for row in told for number in row) <= len("-0.1234")
    np.testing.assert_array_equal(np.array(told, np.float32), drawn)


def test_the_next_generation_is_drawn_about_the_elites():
    search = method(population=4, elites=2)
    candidates = np.array([[0, 0, 0], [0.4, 0.2, 1], [9, 9, 9], [0.6, 0.2, 0]], np.float32)
    search.tell(candidates, np.array([1.0, 5.0, -3.0, 4.0]))
    np.testing.assert_allclose(search.mean, [0.5, 0.2, 0.5], atol=1e-7)
    np.testing.assert_allclose(search.spread, [0.1, 0.05, 0.5], atol=1e-7)


def test_of_equal_candidates_the_first_are_taken():
    search = method(population=3, elites=2, least=1e-9)
    search.tell(np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]], np.float32), np.zeros(3))
    np.testing.assert_allclose(search.mean, [0.0, 0.5, 0.5])


def test_it_finds_a_maximum_and_the_same_one_again():
    goal, found = np.array([0.6, -0.9, 0.1]), []
    for _ in range(2):
        search = method(seed=3)
        for _ in range(15):
            candidates = search.ask()
            search.tell(candidates, -np.abs(candidates - goal).max(axis=1))
        found.append(search.mean)
    assert np.abs(found[0] - goal).max() < 0.05
    assert found[0].tolist() == found[1].tolist()


RULE = SequenceRule("two-stage", BIPED, BIPED_LIMITS, "biped", 1.0)
PERIODS = 60
FIRST = Push((300.0, 100.0, 0.0), 0.08, 0.105)
SCENARIO = Scenario("one", (FIRST,), Command(0.1), duration=3.0)


def walk(episodes: BipedEpisodes, periods: int, corrections=None) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (periods, ..) of robot 0 under corrections from now on, and what it stood for.

    Standing counts by the capture margin: from 0 at -0.3 m to 0.35 at 0.05 m, times 10 ms.
    """
    core, states, stood = episodes.core, [], []
    rows = np.zeros((episodes.n, 0, 7), np.float32) if corrections is None else corrections
    progress = begun(rows)
    for _ in range(periods):
        actions, progress = RULE.act(core.observation, progress)
        episodes.step(actions)
        states.append(np.concatenate([core.physics.qpos[0], core.physics.qvel[0]]))
        if episodes.failure()[0] == 0:
            stood.append(0.01 * min(max(core.margin[0] + 0.3, 0.0), 0.35))
    return np.array(states), np.array(stood)


def robot(scenario: Scenario, periods: int) -> BipedEpisodes:
    episodes = BipedEpisodes(1)
    episodes.begin(0, scenario)
    walk(episodes, periods)
    return episodes


def forecast(n: int = 1, outlast: float = 0.0, periods: int = PERIODS) -> Forecast:
    return Forecast(BipedEpisodes(n), RULE, periods, outlast)


def test_a_future_is_what_becomes_of_the_robot_itself():
    """Each copy under its own corrections, from the middle of a step on; three of four fall."""
    corrections = np.random.default_rng(1).uniform(-1, 1, (4, 2, 7)).astype(np.float32)
    corrections[0] = 0.0
    corrections[3] = np.array([-1, 1, 1, -1, -1, -1, 1], np.float32)
    one = robot(replace(SCENARIO, pushes=(replace(FIRST, force=(1900.0, 0.0, 0.0)),)), 25)
    now = one.state_snapshot(0)
    came = forecast(4).run(now, corrections)
    assert came.stands.tolist() == [True, False, False, False]
    for rows, value, stands in zip(corrections, came.values, came.stands, strict=True):
        one.restore(0, now)
        _, stood = walk(one, PERIODS, rows[None])
        assert value == pytest.approx(stood.sum(), rel=1e-12)
        assert stands == (len(stood) == PERIODS and one.core.margin[0] >= -0.02)
        assert len(stood) > 10


def test_a_robot_that_stands_on_without_hope_does_not_stand():
    """Its capture margin at the end of the horizon decides, not that it has not come down yet."""
    one = robot(replace(SCENARIO, pushes=(replace(FIRST, force=(4000.0, 0.0, 0.0)),)), 19)
    came = forecast(periods=5).run(one.state_snapshot(0), np.zeros((1, 1, 7), np.float32))
    _, stood = walk(one, 5)
    assert len(stood) == 5
    assert one.core.margin[0] < -0.02
    assert not came.stands[0]


@pytest.mark.parametrize(
    "coming",
    [
        {"pushes": (FIRST, Push((500.0, 0.0, 0.0), 0.1, 0.4))},
        {"pushes": (FIRST, Push((500.0, 0.0, 0.0), 0.1, 0.2501))},
        {"kicks": (Kick((0.5, 0.0, 0.0), 0.4),)},
        {"changes": (CommandChange(0.4, Command(0.3)),)},
        {"duration": 0.5},
    ],
)
def test_what_is_to_come_is_unknown(coming):
    one, other = robot(SCENARIO, 25), robot(replace(SCENARIO, **coming), 25)
    own = forecast()
    own.put(other.state_snapshot(0), 1.0)
    np.testing.assert_array_equal(walk(own.episodes, PERIODS)[0], walk(one, PERIODS)[0])
    np.testing.assert_array_equal(state_of(own.episodes), state_of(one))


@pytest.mark.parametrize(("outlast", "end"), [(0.0, 0.14), (0.5, 0.1575), (1.0, 0.175)])
def test_of_a_push_that_acts_the_end_is_guessed_from_its_time_so_far(outlast, end):
    """At 0.14 s it has acted for 35 ms, and so it is taken to end at 0.105 s + (1 + outlast) x 35 ms."""
    now = robot(SCENARIO, 14).state_snapshot(0)
    own = forecast()
    own.put(now, outlast)
    guessed = replace(SCENARIO, pushes=(replace(FIRST, duration=end - 0.105),))
    expected = walk(robot(guessed, 14), 20)[0]
    np.testing.assert_allclose(walk(own.episodes, 20)[0], expected, rtol=0, atol=1e-12)


def test_of_several_pushes_the_one_that_acts_goes_on():
    """Whatever their order, and nothing of the others."""
    later, over = Push((0.0, 400.0, 0.0), 0.1, 0.16), Push((0.0, -200.0, 0.0), 0.03, 0.02)
    many = replace(SCENARIO, pushes=(later, over, FIRST))
    own = forecast()
    own.put(robot(many, 14).state_snapshot(0), 1.0)
    guessed = replace(SCENARIO, pushes=(over, replace(FIRST, duration=0.07)))
    expected = walk(robot(guessed, 14), 20)[0]
    np.testing.assert_allclose(walk(own.episodes, 20)[0], expected, rtol=0, atol=1e-12)


def goes_on(now, guess: Forecast, free: Forecast) -> bool:
    """Whether a guess that the push goes on tells the next periods from one that it is over."""
    guess.put(now, 1.0)
    free.put(now, 0.0)
    return not np.array_equal(walk(guess.episodes, 5)[0], walk(free.episodes, 5)[0])


@pytest.mark.parametrize(("periods", "felt"), [(19, True), (20, False)])
def test_a_push_that_ended_within_the_last_period_is_felt_for_one_more(periods, felt):
    """It ends at 0.185 s: at 0.19 s nothing tells yet that it has, at 0.2 s its absence does."""
    assert goes_on(robot(SCENARIO, periods).state_snapshot(0), forecast(), forecast()) == felt


@pytest.mark.parametrize("periods", [20, 30, 40, 50, 60])
def test_a_push_that_ended_with_the_last_period_but_one_is_over(periods):
    """Times are sums of steps, and may lie a hair beside those of the push."""
    push = replace(FIRST, start=0.1, duration=round(0.01 * (periods - 1) - 0.1, 6), force=(30.0, 0.0, 0.0))
    now = robot(replace(SCENARIO, pushes=(push,)), periods).state_snapshot(0)
    assert not goes_on(now, forecast(), forecast())


def test_at_another_planning_rate_a_period_lasts_as_long_as_it_does():
    """At 50 Hz a push that ended at 0.185 s is felt until 0.2 s, and standing for 20 periods lasts 0.4 s."""
    episodes = BipedEpisodes(1, control_hz=50.0)
    episodes.begin(0, SCENARIO)
    walk(episodes, 10)
    now = episodes.state_snapshot(0)
    guess, free = (Forecast(BipedEpisodes(1, control_hz=50.0), RULE, 20, 0.0) for _ in range(2))
    assert goes_on(now, guess, free)
    came = free.run(now, np.zeros((1, 1, 7), np.float32))
    assert came.values[0] == pytest.approx(0.4 * 0.35)


@pytest.mark.parametrize(("margin", "stands"), [(-0.0199, True), (-0.0201, False)])
def test_a_margin_a_little_below_zero_counts_as_standing(margin, stands):
    """Looked at where the robot is, without a period of simulation."""
    one = robot(SCENARIO, 5)
    one.core.margin[0] = margin
    came = forecast(periods=0).run(one.state_snapshot(0), np.zeros((1, 1, 7), np.float32))
    assert came.stands.tolist() == [stands]
    assert came.values.tolist() == [0.0]


def test_the_worth_of_a_margin_has_ends():
    np.testing.assert_allclose(worth(np.array([-1.0, -0.3, -0.1, 0.05, 0.2])), [0, 0, 0.2, 0.35, 0.35])
