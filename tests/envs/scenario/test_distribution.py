"""Random pushes: drawn from the generator alone, within their bounds, and of sizes that a push may have."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError
from push_recovery.envs.scenario.distribution import PushDistribution


def test_distribution_is_a_function_of_the_generator():
    draw = [PushDistribution().sample(np.random.default_rng(7)) for _ in range(2)]
    assert draw[0] == draw[1]
    rng = np.random.default_rng(0)
    sample = [PushDistribution().sample(rng) for _ in range(400)]
    impulses = np.array([s.pushes[0].impulse_magnitude for s in sample])
    assert impulses.min() >= 5.0 - 1e-9
    assert impulses.max() <= 80.0 + 1e-9
    assert abs(impulses.mean() - 42.5) < 4.0
    vx = np.array([s.command.vx for s in sample])
    vy = np.array([s.command.vy for s in sample])
    assert vx.max() <= 0.5
    assert vx.min() >= -0.25
    assert np.abs(vy).max() <= 0.2
    assert 0.15 < np.mean((vx == 0) & (vy == 0)) < 0.35
    assert {s.stance_side for s in sample} == {"left", "right"}
    assert len({s.id for s in sample}) == len(sample)


def test_draws_fill_their_ranges_and_nothing_else():
    ranges = PushDistribution(direction_min=0.5, direction_max=1.5, phase_max=0.4, first_step=3)
    rng = np.random.default_rng(1)
    pushes = [ranges.sample(rng).pushes[0] for _ in range(400)]
    directions = np.array([push.direction for push in pushes])
    assert 0.5 <= directions.min() < 0.52
    assert 1.48 < directions.max() <= 1.5
    phases = np.array([push.start.fraction for push in pushes])
    assert 0.0 <= phases.min() < 0.01
    assert 0.39 < phases.max() <= 0.4
    assert {push.start.step for push in pushes} == {3}
    left = np.mean([push.start.side == "left" for push in pushes])
    assert 0.4 < left < 0.6


def test_commands_by_hand():
    """Kinds in the order in place, forward, backward, sideways, at half of their largest speeds."""
    ranges = PushDistribution(forward_speed=0.6, backward_speed=0.4, sideways_speed=0.2)
    found = [ranges.command(kind, 0.5, to_left) for kind in range(4) for to_left in (True, False)]
    pairs = [(command.vx, command.vy) for command in found]
    assert pairs == [(0, 0), (0, 0), (0.3, 0), (0.3, 0), (-0.2, 0), (-0.2, 0), (0, 0.1), (0, -0.1)]


def test_half_of_the_robots_turn_where_they_are_to():
    """To either side at up to the rate asked for; what is drawn besides is what it was without turning."""
    turning = [PushDistribution(turn=0.4).sample(np.random.default_rng(seed)) for seed in range(600)]
    straight = [PushDistribution().sample(np.random.default_rng(seed)) for seed in range(600)]
    for one, other in zip(turning, straight, strict=True):
        assert replace(one, command=replace(one.command, turn=0.0)) == other
    rates = np.array([scenario.command.turn for scenario in turning])
    assert 0.45 < np.mean(rates == 0.0) < 0.55
    assert -0.4 <= rates.min() < -0.38
    assert 0.38 < rates.max() <= 0.4
    assert abs(np.mean(rates)) < 0.02


@pytest.mark.parametrize(("share", "side", "rate"), [(0.49, 1.0, 0.0), (0.5, 1.0, 0.6), (1.0, 0.0, -0.6)])
def test_turning_by_hand(share, side, rate):
    assert PushDistribution(turn=0.6).turning(share, side) == rate


def test_pushes_act_on_the_bodies_named_as_often_as_they_are_named():
    """And are otherwise those of the pelvis alone."""
    bodies = ("trunk", "left_foot", "left_foot", "link:elbow")
    anywhere = [PushDistribution(bodies=bodies).sample(np.random.default_rng(seed)) for seed in range(800)]
    pelvis = [PushDistribution().sample(np.random.default_rng(seed)) for seed in range(800)]
    for one, other in zip(anywhere, pelvis, strict=True):
        assert replace(one, pushes=(replace(one.pushes[0], body="pelvis"),)) == other
    seen = Counter(scenario.pushes[0].body for scenario in anywhere)
    assert set(seen) == set(bodies)
    assert 360 < seen["left_foot"] < 440
    assert all(160 < seen[body] < 240 for body in ("trunk", "link:elbow"))


def test_durations_are_uniform_in_the_logarithm_and_keep_the_impulse():
    """A quarter of them in each of four ranges of equal ratio; what is drawn besides is what it was."""
    ranges = PushDistribution(push_duration=0.02, push_duration_ratio=16.0)
    pushes = [ranges.sample(np.random.default_rng(seed)).pushes[0] for seed in range(800)]
    plain = [PushDistribution().sample(np.random.default_rng(seed)).pushes[0] for seed in range(800)]
    for push, other in zip(pushes, plain, strict=True):
        assert push.impulse_magnitude == pytest.approx(other.impulse_magnitude)
        assert (push.direction, push.start) == (pytest.approx(other.direction), other.start)
    counts, _ = np.histogram([push.duration for push in pushes], [0.02, 0.04, 0.08, 0.16, 0.32])
    assert counts.sum() == 800
    assert all(160 < count < 240 for count in counts)


def test_later_pushes_share_the_impulse_and_come_within_four_steps():
    """The root of the sum of their squares is what one push alone has."""
    ranges = PushDistribution(pushes_max=3, phase_max=0.5, bodies=("trunk",))
    plain = PushDistribution(phase_max=0.5, bodies=("trunk",))
    pauses, same, fractions, counts = [], [], [], Counter()
    for seed in range(900):
        scenario, alone = (kind.sample(np.random.default_rng(seed)) for kind in (ranges, plain))
        assert replace(scenario, pushes=alone.pushes) == alone
        first, *later = scenario.pushes
        (only,) = alone.pushes
        assert (first.start, first.direction) == (only.start, pytest.approx(only.direction))
        for push in scenario.pushes:
            assert (push.duration, push.body) == (only.duration, "trunk")
            assert push.impulse_magnitude**2 * len(scenario.pushes) == pytest.approx(
                only.impulse_magnitude**2
            )
        counts[len(scenario.pushes)] += 1
        step = first.start.step_index(scenario.stance_side)
        for push in later:
            assert push.start.side == scenario.side_of_step(push.start.step)
            pauses.append(push.start.step - step)
            step = push.start.step
            same.append(push.direction == pytest.approx(first.direction))
            fractions.append(push.start.fraction)
    assert set(counts) == {1, 2, 3}
    assert all(250 < count < 350 for count in counts.values())
    assert set(pauses) == {1, 2, 3, 4}
    assert all(180 < pauses.count(pause) < 270 for pause in range(1, 5))
    assert 0.45 < np.mean(same) < 0.55
    assert 0.0 <= min(fractions) < 0.01
    assert 0.49 < max(fractions) <= 0.5


def test_other_directions_of_later_pushes_fill_the_range():
    ranges = PushDistribution(pushes_max=2, direction_min=0.5, direction_max=1.5)
    pairs = [ranges.sample(np.random.default_rng(seed)).pushes for seed in range(1200)]
    turns = [(pair[0].direction, pair[1].direction) for pair in pairs if len(pair) == 2]
    other = [later for first, later in turns if later != pytest.approx(first)]
    assert 0.5 <= min(other) < 0.52
    assert 1.48 < max(other) <= 1.5
    assert abs(np.mean(other) - 1.0) < 0.06


def test_the_draws_do_not_depend_on_the_number_of_pushes():
    """So that the scenarios after one of a single push and after one of three are the same."""
    states = {}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        count = len(PushDistribution(pushes_max=3).sample(rng).pushes)
        alone = np.random.default_rng(seed)
        PushDistribution().sample(alone)
        alone.integers(1, 4)
        alone.random(6)
        states[count] = rng.bit_generator.state == alone.bit_generator.state
    assert states == {1: True, 2: True, 3: True}


@pytest.mark.parametrize(("bodies", "words"), [((), "at least one body"), (("arm",), "push body 'arm'")])
def test_a_distribution_refuses_bodies_that_no_push_names(bodies, words):
    with pytest.raises(PushRecoveryError, match=words):
        PushDistribution(bodies=bodies)


def test_distribution_round_trip_and_bounds():
    distribution = PushDistribution(
        impulse_max=40.0, bodies=("trunk", "link:elbow"), push_duration_ratio=3.0, pushes_max=2
    )
    assert PushDistribution.from_dict(distribution.to_dict()) == distribution
    with pytest.raises(InvalidValueError, match=r"impulse_max.*\[5"):
        PushDistribution(impulse_max=1.0)
    with pytest.raises(PushRecoveryError, match="impuls"):
        PushDistribution.from_dict({"impuls_min": 1.0})


@pytest.mark.parametrize("bodies", [5, None, "pelvis"])
def test_bodies_are_a_sequence_of_names(bodies):
    message = f"PushDistribution.bodies must be a sequence of str, got {bodies!r}"
    for make in PushDistribution, lambda bodies: PushDistribution.from_dict({"bodies": bodies}):
        with pytest.raises(InvalidValueError, match=f"^{message}$"):
            make(bodies=bodies)


def test_the_hardest_push_of_a_distribution_is_one_that_a_push_may_have():
    PushDistribution(impulse_max=1e7 * 0.1, push_duration=0.1)
    for impulse, duration in ((1e6 + 1.0, 0.1), (80.0, 1e-300), (1e308, 0.1)):
        with pytest.raises(InvalidValueError, match=r"push_duration must be at most 1e\+07 N"):
            PushDistribution(impulse_max=impulse, push_duration=duration)


@pytest.mark.parametrize(
    "values",
    [
        {"direction_min": -1e308}, {"direction_max": 1e308}, {"first_step": 10**30}, {"turn": 0.7},
        {"push_duration_ratio": 0.9}, {"push_duration_ratio": 36001.0},
        {"pushes_max": 0}, {"pushes_max": 101},
    ],
)  # fmt: skip
def test_a_distribution_refuses_what_it_could_not_draw(values):
    with pytest.raises(InvalidValueError, match=rf"PushDistribution\.{next(iter(values))}"):
        PushDistribution(**values)
