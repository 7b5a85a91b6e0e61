"""Walks that are put back at the moment of a push."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.joint.env import JointResidualEpisodes
from push_recovery.envs.scenario.distribution import PushDistribution
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.score.kinds import DRAWS, SuiteDistribution
from push_recovery.training.starts import (
    DIRECTIONS,
    EARLIEST,
    LATEST,
    STEPS,
    PushStarts,
    ResetStarts,
    SuccessTable,
    pushes_from,
    relative,
    relative_push,
    take_walks,
    total_impulse,
)


def test_pushes_of_even_odds_are_all_taken_and_sure_ones_by_the_floor():
    table = SuccessTable(100.0, 0.1)
    for share, probability in ((0.0, 0.1), (0.5, 1.0), (1.0, 0.1), (0.25, 0.1 + 0.9 * 0.75)):
        table.shares[2, 3] = share
        assert table.probability((2, 3)) == pytest.approx(probability)
    assert SuccessTable(100.0, 1.0).probability((0, 0)) == 1.0


@pytest.mark.parametrize("size", [1.0, 0.5])
def test_bins_are_eighths_of_a_turn_and_twenty_newton_seconds_of_the_biped(size):
    table = SuccessTable(size * 90.0, 0.1, size * 20.0)
    assert table.shares.shape == (DIRECTIONS, 5)
    degrees = {
        (0, 0): (0, 0),
        (44.9, 19.9): (0, 0),
        (45.1, 20): (1, 1),
        (-1e-7, 90): (7, 4),
        (-96, 1e3): (5, 4),
    }
    for (psi, impulse), expected in degrees.items():
        assert table.bin_of(math.radians(psi), size * impulse) == expected


def test_a_share_follows_what_is_told_of_its_bin_alone():
    table = SuccessTable(40.0, 0.1)
    table.update((1, 0), True)
    table.update((4, 1), False)
    assert table.shares[1, 0] == pytest.approx(0.525)
    assert table.shares[4, 1] == pytest.approx(0.475)
    assert (table.shares == 0.5).sum() == table.shares.size - 2
    for _ in range(200):
        table.update((1, 0), True)
    assert table.shares[1, 0] == pytest.approx(1.0, abs=1e-4)


HARD = PushDistribution(impulse_min=100.0, impulse_max=110.0, settle_time=1.5)
EASY = PushDistribution(impulse_min=5.0, impulse_max=6.0, push_duration=0.2, settle_time=1.0)


@pytest.fixture(scope="module")
def episodes():
    return BipedEpisodes(4)


@pytest.fixture(scope="module")
def walks(episodes):
    planner = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    return take_walks(episodes, planner, HARD, 6, np.random.default_rng(3))


def test_walks_are_of_their_own_robot_command_and_moment_and_unpushed(walks):
    assert len(walks) == 6
    assert len({walk.time for walk in walks}) == 6
    assert len({walk.scenario.noise_seed for walk in walks}) == 6
    assert len({walk.scenario.command for walk in walks}) > 3
    assert all(EARLIEST <= walk.time <= LATEST + 0.01 and not walk.scenario.pushes for walk in walks)


def test_uncorrected_joints_walk_as_their_planner_does(episodes, walks):
    """Row for row of what both robots have: the one planner is outside, the other within."""
    corrected = JointResidualEpisodes(4)
    own = take_walks(corrected, corrected.planner, HARD, 6, np.random.default_rng(3))
    for mine, planned in zip(own, walks, strict=True):
        assert mine.scenario == planned.scenario
        for name in ("simulation.state", "gait.stance", "gait.heading"):
            np.testing.assert_array_equal(mine.rows[name], planned.rows[name])


def starts(episodes, walks, easy_share, floor=1.0, seed=0, **options):
    return PushStarts(episodes, HARD, EASY, easy_share, floor, np.random.default_rng(seed), walks, **options)


def scenario_of(episodes, k):
    return episodes.state_snapshot(k).scenario


@pytest.mark.parametrize(("easy_share", "pushes"), [(0.0, HARD), (1.0, EASY)])
def test_a_robot_goes_on_from_a_walk_and_is_pushed_within_the_period(episodes, walks, easy_share, pushes):
    beginning = starts(episodes, walks, easy_share)
    for k in range(4):
        beginning.begin(k)
        now, scenario = episodes.motion().time[k], scenario_of(episodes, k)
        assert any(now == walk.time for walk in walks)
        (push,) = scenario.pushes
        assert now <= push.start < now + 0.01
        assert push.duration == pushes.push_duration
        assert pushes.impulse_min <= math.hypot(*push.force[:2]) * push.duration <= pushes.impulse_max
        assert (scenario.duration, scenario.settle_time) == (None, pushes.settle_time)


def test_only_hard_pushes_are_counted(episodes, walks):
    hard, easy = starts(episodes, walks, 0.0), starts(episodes, walks, 1.0)
    for beginning in (hard, easy):
        beginning.begin(0)
        beginning.ended(0, True)
    assert (hard.tables["pelvis"].shares != 0.5).sum() == 1
    assert (easy.tables["pelvis"].shares == 0.5).all()


def test_kinds_that_are_always_recovered_from_are_drawn_seldom(episodes, walks):
    """Half of the directions at the floor of 0.05: of 200 pushes about 1 in 21 comes from there."""
    beginning = starts(episodes, walks, 0.0, floor=0.05)
    beginning.tables["pelvis"].shares[:4] = 1.0
    seen = []
    for _ in range(200):
        beginning.begin(0)
        seen.append(beginning._bins[0][1][0])
    assert 2 <= sum(place < 4 for place in seen) <= 22


def test_each_body_has_a_table_of_its_own(episodes, walks):
    """A foot that is always recovered from is drawn at the floor of 0.05."""
    pushes = replace(HARD, bodies=("trunk", "left_foot"))
    beginning = PushStarts(episodes, pushes, EASY, 0.0, 0.05, np.random.default_rng(0), walks)
    beginning.tables["left_foot"].shares[:] = 1.0
    seen = []
    for _ in range(200):
        beginning.begin(0)
        (push,) = scenario_of(episodes, 0).pushes
        assert beginning._bins[0][0] == push.body
        seen.append(push.body)
    assert 2 <= seen.count("left_foot") <= 22
    beginning.ended(0, True)
    assert (beginning.tables["trunk"].shares != 0.5).sum() == (seen[-1] == "trunk")


def test_later_pushes_come_in_the_steps_after_that_of_the_walk(episodes, walks):
    """And the push is counted by the impulse of all of them together, of either kind of start."""
    pushes = replace(HARD, pushes_max=3, push_duration=0.05, push_duration_ratio=4.0)
    parts = pushes, EASY, 0.0, 1.0
    at_push = PushStarts(episodes, *parts, np.random.default_rng(2), walks)
    at_reset = ResetStarts(episodes, *parts, np.random.default_rng(2))
    counts = set()
    for _ in range(40):
        for beginning in (at_push, at_reset):
            beginning.begin(0)
            _, (_, impulses) = beginning._bins[0]
            assert impulses == 5  # 100 to 110 N s, in bins of 20
        at_push.begin(0)
        first, *later = scenario_of(episodes, 0).pushes
        counts.add(1 + len(later))
        assert 0.05 <= first.duration <= 0.2
        step, side = episodes.core.gait.steps.item(0), episodes.core.gait.stance.item(0)
        for push in later:
            pause = push.start.step - step
            assert 1 <= pause <= 4
            step, side = push.start.step, (side + pause) % 2
            assert push.start.side == ("left", "right")[side]
    assert counts == {1, 2, 3}


@pytest.mark.parametrize(
    ("stance", "psi", "expected"),
    [
        (1, 0.7, 0.5),  # on the right foot 0.5 rad to the left of the heading of 0.2
        (0, 0.7, -0.5),  # on the left foot that is outward, as -0.5 is on the right one
        (1, 0.7 + math.tau, 0.5),
        (0, 0.2 + 3.5, math.tau - 3.5),
    ],
)
def test_directions_are_of_the_heading_and_mirrored_on_the_left_foot(stance, psi, expected):
    walk = SimpleNamespace(rows={"gait.stance": np.array(stance), "gait.heading": np.array(0.2)})
    assert relative(psi, walk) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("kind", "impulses", "following"),
    [
        (PushStarts, [76.19560423507, 60.93064537112, 60.70328653556, 74.31544350510, 5.81633810382,
                      61.22832082920], 0.8740770261495044),
        (ResetStarts, [77.05493774705, 72.23314052436, 5.83004772980, 60.66665129211, 5.40249829810,
                       63.19068772877], 0.5476351992137353),
    ],
)  # fmt: skip
def test_pushes_of_runs_that_are_over_are_drawn_again(episodes, walks, kind, impulses, following):
    """First pushes of older code, and the number that its stream goes on with."""
    bodies = ("pelvis", "trunk")
    pushes = replace(HARD, bodies=bodies, pushes_max=3, push_duration=0.05, push_duration_ratio=4.0)
    rng, more = np.random.default_rng(7), (walks,) if kind is PushStarts else ()
    beginning, seen = kind(episodes, pushes, EASY, 0.3, 0.3, rng, *more), []
    for i in range(6):
        beginning.begin(0)
        seen.append(scenario_of(episodes, 0).pushes[0].impulse_magnitude)
        beginning.ended(0, i % 2 == 0)
    np.testing.assert_allclose(seen, impulses, rtol=1e-12)
    assert rng.random() == following


LIKE = SuiteDistribution(("quick",), 1.5)


def test_a_walk_is_pushed_as_a_suite_says_as_many_steps_apart(episodes, walks):
    """All but the moments is the scenario's own; three of four pushes come on the same foot as the first."""
    beginning = starts(episodes, walks, 0.0, like=LIKE)
    rng, counts = np.random.default_rng(0), set()
    for _ in range(30):
        walk = walks[rng.integers(6)]
        rng.random()  # whether it is an easy one
        drawn = LIKE.sample(rng)
        rng.random()  # whether it is taken, which all are
        beginning.begin(0)
        now, scenario = episodes.motion().time[0], scenario_of(episodes, 0)
        assert scenario == replace(walk.scenario, pushes=scenario.pushes, duration=None, settle_time=1.5)
        assert now <= scenario.pushes[0].start == now + 0.01 * rng.random()
        timeless = [[replace(p, start=0.0) for p in one.pushes] for one in (drawn, scenario)]
        assert timeless[0] == timeless[1]
        counts.add(len(drawn.pushes))
        step, side = episodes.core.gait.steps.item(0), episodes.core.gait.stance.item(0)
        for before, push in itertools.pairwise(drawn.pushes):
            pause = push.start.step - before.start.step_index(drawn.stance_side)
            moved = scenario.pushes[drawn.pushes.index(push)].start
            assert moved.step == (step := step + pause)
            assert moved.side == ("left", "right")[side := (side + pause) % 2]
            assert moved.fraction == push.start.fraction
    assert counts == {1, 2, 4}


def test_each_body_and_number_of_pushes_has_a_table_of_its_own(episodes, walks):
    """Single ones at the trunk, a quarter of all, are always recovered from: 1 in 61 is one of them."""
    beginning = starts(episodes, walks, 0.0, floor=0.05, like=LIKE)
    beginning.tables["trunk single"].shares[:] = 1.0
    seen = []
    for _ in range(300):
        beginning.begin(0)
        seen.append(beginning._bins[0][0])
    bodies, numbers = ("pelvis", "trunk"), ("single", "double", "repeated")
    assert set(seen) == {f"{body} {number}" for body in bodies for number in numbers}
    assert seen.count("trunk single") <= 14
    assert 65 <= seen.count("pelvis single") <= 135


def test_what_is_lost_comes_again_as_often_as_stated_and_counts_once(episodes, walks):
    beginning = starts(episodes, walks, 0.0, retries=2, like=LIKE)
    seen = []
    for recovered in (False, False, False, True, True):
        beginning.begin(0)
        seen.append(scenario_of(episodes, 0))
        beginning.ended(0, recovered)
    assert seen[0] == seen[1] == seen[2]
    assert len({scenario.pushes for scenario in seen}) == 3
    shares = np.concatenate([table.shares.ravel() for table in beginning.tables.values()])
    assert sorted(shares[shares != 0.5]) == [0.475, 0.525, 0.525]


def test_no_easy_push_comes_again(episodes, walks):
    beginning = starts(episodes, walks, 1.0, retries=2)
    seen = set()
    for _ in range(5):
        beginning.begin(0)
        seen.add(scenario_of(episodes, 0).pushes)
        beginning.ended(0, False)
    assert len(seen) == 5


class Clockwork:
    """Two robots whose walks last as long as a test says: robot 0 falls after 0.5 s, robot 1 never."""

    n = 2

    def __init__(self):
        self.time, self.begun = np.zeros(2), []

    def drawn(self, pushes, rng):
        return Scenario(f"{len(self.begun)}", pushes=(polar_push(100.0, 0.0, 0.1, 0.3),), duration=2.0)

    def begin(self, k, scenario):
        self.begun.append((k, scenario))
        self.time[k] = 0.0

    def walk(self, planner):
        assert planner == "planner"
        self.time += 0.25
        return SimpleNamespace(failed=np.array([self.time[0] >= 0.5, False]))

    def motion(self):
        return SimpleNamespace(time=self.time)

    def state_snapshot(self, k):
        return k, float(self.time[k]), [scenario for row, scenario in self.begun if row == k][-1].id


class Moments:
    """Random moments as a test says them."""

    def __init__(self, *moments):
        self.moments = list(moments)

    def uniform(self, low, high):
        assert (low, high) == (1.2, 3.6)
        return self.moments.pop(0)


def test_a_walk_is_taken_at_its_moment_and_none_that_fell():
    """Robot 1 is due at 1.3 s and at 2.5 s; robot 0 falls every half a second and begins anew."""
    robots = Clockwork()
    taken = take_walks(robots, "planner", HARD, 2, Moments(9.0, 1.3, *3 * [9.0], 2.5, *99 * [9.0]))
    walks = [scenario.id for k, scenario in robots.begun if k == 1]
    assert taken == [(1, 1.5, walks[0]), (1, 2.5, walks[1])]
    assert len([k for k, _ in robots.begun if k == 0]) == 9  # 4 s: the first, and one after each fall
    assert all(not one.pushes and one.duration == 60.0 for _, one in robots.begun)


@pytest.mark.parametrize(("easy_share", "pushes"), [(0.0, HARD), (1.0, EASY)])
def test_starts_at_a_reset_are_drawn_from_the_distribution(episodes, easy_share, pushes):
    beginning = ResetStarts(episodes, HARD, EASY, easy_share, 1.0, np.random.default_rng(5))
    beginning.begin(1)
    rng = np.random.default_rng(5)
    rng.random()  # whether it is an easy one
    assert scenario_of(episodes, 1) == pushes.sample(rng)
    assert episodes.motion().time[1] == 0.0
    beginning.ended(1, True)
    assert (beginning.tables["pelvis"].shares != 0.5).sum() == 1 - easy_share


def test_at_a_reset_too_what_is_never_recovered_from_is_drawn_seldom(episodes):
    """Directions are those in the world: pushes to the left are hopeless, and 1 in 21 is one of them."""
    beginning = ResetStarts(episodes, HARD, EASY, 0.0, 0.05, np.random.default_rng(5))
    beginning.tables["pelvis"].shares[:4] = 0.0
    left = 0
    for _ in range(200):
        beginning.begin(0)
        (push,) = scenario_of(episodes, 0).pushes
        left += push.force[1] > 0.0
    assert 2 <= left <= 22


def test_no_more_walks_are_taken_than_asked_for():
    """Both robots arrive in the same period."""
    taken = take_walks(Clockwork(), "planner", HARD, 1, Moments(0.2, 0.2, 9.0, 9.0))
    assert [walk[:2] for walk in taken] == [(0, 0.25)]


@pytest.mark.parametrize(("frame", "direction"), [("heading", 0.5), ("world", 0.7)])
@pytest.mark.parametrize(("stance", "expected"), [(1, 0.5), (0, -0.5)])
def test_a_push_in_either_frame_is_seen_in_that_of_the_walk(frame, direction, stance, expected):
    """Half a radian to the left of a heading of 0.2 rad; mirrored on the left foot."""
    walk = SimpleNamespace(rows={"gait.stance": np.array(stance), "gait.heading": np.array(0.2)})
    push = polar_push(100.0, direction, 0.1, 0.3, frame=frame)
    assert relative_push(push, walk) == pytest.approx(expected)


def test_starts_at_a_reset_may_be_like_those_of_a_suite(episodes):
    beginning = ResetStarts(episodes, HARD, EASY, 0.0, 1.0, np.random.default_rng(5), like=LIKE)
    rng = np.random.default_rng(5)
    rng.random()  # whether it is an easy one
    drawn = LIKE.sample(rng)
    beginning.begin(1)
    assert scenario_of(episodes, 1) == drawn
    assert beginning._bins[1][0] == "pelvis single"


def test_a_push_that_is_refused_takes_its_walk_along(episodes, walks, monkeypatch):
    beginning = starts(episodes, walks, 0.0, like=LIKE)
    left, answers = list(walks[:3]), [False, False, True]
    monkeypatch.setattr(beginning, "_walk", lambda: left.pop(0))
    monkeypatch.setattr(beginning, "_takes", lambda *_: answers.pop(0))
    walk, _ = beginning._new(0)
    assert walk is walks[2]
    assert not left


def test_a_direction_a_hair_right_of_forward_is_in_the_last_eighth():
    """-1e-20 of a turn is 1.0 turns, rounded."""
    assert SuccessTable(40.0, 0.1).bin_of(-1e-20, 0.0) == (7, 0)


def test_a_later_push_at_a_time_does_not_get_lost():
    pushes = polar_push(1.0, 0.0, 0.1, GaitEvent(2, "left", 0.5)), polar_push(1.0, 0.0, 0.1, 3.0)
    with pytest.raises(ValueError, match="at times and at moments of the gait"):
        pushes_from(Scenario("x", pushes), SimpleNamespace(rows={"gait.steps": np.array(7)}), 2.0)


def test_pushes_at_times_keep_their_pauses():
    point = np.full(12, 0.5)
    point[5] = 0.9  # repeated
    scenario = DRAWS["standing"].scenario("s", point, 0)
    walk = SimpleNamespace(time=2.0, rows={STEPS: np.array(0)}, scenario=scenario)
    found = [push.start for push in pushes_from(scenario, walk, 2.005)]
    assert len(found) == 4
    assert found[0] == 2.005
    assert np.diff(found) == pytest.approx(np.diff([push.start for push in scenario.pushes]))


def test_several_pushes_count_as_the_one_that_does_as_much():
    """30 and 40 N s are 50, whatever their directions."""
    pushes = polar_push(300.0, 0.4, 0.1, 0.5), polar_push(200.0, -2.0, 0.2, 1.5)
    assert total_impulse(Scenario("x", pushes)) == pytest.approx(50.0)
