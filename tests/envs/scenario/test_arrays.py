"""Commands that change while the robot walks.

Arrays of pushes of several robots: each has its own, whatever the others get.

What pushes deliver in a span of time, when their gait events come, and how they turn with the heading.
"""

import itertools
import math

import numpy as np
import pytest
from push_recovery.controllers.model.observation import COMMAND
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.episodes import GaitEpisodes
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.arrays import (
    Pushes,
    assign_changes,
    assign_pushes,
    empty_pushes,
    empty_schedule,
    follow,
    may_stay,
    mean_force,
    resolve_starts,
    turn_forces,
)
from push_recovery.envs.scenario.push import PENDING, GaitEvent, Kick, Push, polar_push
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario

ROBOTS = (PendulumEpisodes, BipedEpisodes)
START, STOP = CommandChange(1.0, Command(0.3)), CommandChange(4.0, Command())


def changes(*pairs: tuple[float, Command]) -> tuple[CommandChange, ...]:
    return tuple(CommandChange(*pair) for pair in pairs)


def walk(episodes: GaitEpisodes, scenarios: list[Scenario], seconds: float, policy: str = "stage-1"):
    """Observations (ticks, n, 36) and CoM (ticks, n, 2) from the reset on, and which had fallen (n,)."""
    planner = make_policy(policy, episodes.robot, episodes.limits, episodes.preset)
    for k, scenario in enumerate(scenarios):
        episodes.begin(k, scenario)
    seen, com = [episodes.core.observation.copy()], [episodes.motion().com.copy()]
    for _ in range(round(seconds * episodes.control_hz)):
        episodes.step(planner.predict(episodes.core.observation)[0])
        seen.append(episodes.core.observation.copy())
        com.append(episodes.motion().com.copy())
    return np.array(seen), np.array(com), episodes.failure() != 0


def test_the_latest_command_that_is_due_is_in_force():
    schedule = empty_schedule(3)
    many = Scenario(
        "a", changes=changes((1.0, Command(0.1)), (1.005, Command(0.2)), (2.0, Command(0.3, 0.1)))
    )
    schedule = assign_changes(schedule, 1, many)
    grown, command = (
        assign_changes(schedule, 0, Scenario("b", changes=changes((0.5, Command(0.4))))),
        np.zeros(3),
    )
    assert grown is schedule  # there was room
    seen = []
    for now in (0.0, 0.99, 1.0 - 1e-12, 1.01, 1.99, 2.0, 9.0):
        follow(schedule, 1, now, command)
        seen.append(tuple(command[:2].tolist()))
    assert seen == [(0.0, 0.0)] * 2 + [(0.1, 0.0), (0.2, 0.0), (0.2, 0.0), (0.3, 0.1), (0.3, 0.1)]
    assign_changes(schedule, 1, Scenario("c"))
    follow(schedule, 1, 9.0, command)
    assert tuple(command[:2]) == (0.3, 0.1)  # nothing left


def test_a_schedule_that_grows_keeps_how_far_the_others_have_come():
    schedule, command = empty_schedule(2, 1), np.zeros(3)
    schedule = assign_changes(schedule, 0, Scenario("a", changes=changes((1.0, Command(0.1)))))
    follow(schedule, 0, 1.0, command)
    assert (schedule.next[0], command[0]) == (1, 0.1)
    many = Scenario("b", changes=changes((0.5, Command(0.2)), (0.7, Command(0.3, 0.1, 0.2))))
    schedule = assign_changes(schedule, 1, many)
    assert schedule.next.tolist() == [1, 0]
    command[:] = -1.0
    follow(schedule, 0, 9.0, command)
    assert command.tolist() == [-1.0, -1.0, -1.0]  # nothing is told twice
    follow(schedule, 1, 0.7, command)
    assert command.tolist() == [0.3, 0.1, 0.2]
    schedule = assign_changes(schedule, 1, Scenario("c", changes=changes((0.6, Command(0.4)))))
    follow(schedule, 1, 0.6, command)
    assert command.tolist() == [0.4, 0.0, 0.0]  # it begins at the first one again


@pytest.mark.parametrize("robots", ROBOTS)
def test_the_policy_sees_a_command_from_the_first_period_that_begins_when_it_is_due(robots):
    scenario = Scenario("a", (), Command(0.1), "right", changes=changes((0.204, Command(0.2, 0.1))))
    seen, _, _ = walk(robots(1), [scenario], 0.3)
    np.testing.assert_array_equal(seen[:21, 0, COMMAND], [[0.1, 0.0]] * 21)
    np.testing.assert_array_equal(seen[21:, 0, COMMAND], [[0.2, 0.1]] * 10)


@pytest.mark.parametrize("robots", ROBOTS)
def test_starting_and_stopping_are_changes(robots):
    episodes = robots(1)
    _, com, fell = walk(episodes, [Scenario("a", changes=(START, STOP))], 7.0)
    assert not fell.any()
    assert com[100, 0, 0] == pytest.approx(0.0, abs=0.05)
    assert (com[400, 0, 0] - com[250, 0, 0]) / 1.5 == pytest.approx(0.3, abs=0.1)
    assert (com[700, 0, 0] - com[500, 0, 0]) / 2.0 == pytest.approx(0.0, abs=0.05)
    assert episodes.monitor.recovered_at(0) > STOP.time


@pytest.mark.parametrize("robots", ROBOTS)
def test_a_robots_commands_do_not_depend_on_the_others_and_a_reset_forgets_them(robots):
    scenarios = [
        Scenario("a", (Push((50.0, 20.0, 0.0), 0.1, 0.3),), changes=(START,)),
        Scenario("b", (), Command(0.2), "right"),
        Scenario("c", changes=changes((0.3, Command(0.0, 0.1)), (0.8, Command(-0.2)), (1.1, Command(0.4)))),
    ]
    together, episodes = walk(robots(3), scenarios, 1.5)[0], robots(1)
    for k in (2, 1, 0):
        alone = walk(episodes, [scenarios[k]], 1.5)[0]
        assert alone[:, 0].tobytes() == together[:, k].tobytes()


def test_a_mirrored_scenario_is_seen_alike():
    scenario = Scenario("a", (), Command(0.1, 0.05), changes=changes((0.5, Command(0.3, -0.1))))
    seen, _, _ = walk(PendulumEpisodes(2), [scenario, scenario.mirrored()], 2.0)
    np.testing.assert_allclose(seen[:, 0], seen[:, 1], atol=1e-9)


def test_recovery_is_judged_by_the_command_in_force():
    """A gait that goes on in place has recovered until it is told to walk at more than the tolerance."""
    episodes, recovered = PendulumEpisodes(1), []
    episodes.begin(0, Scenario("a", changes=changes((3.0, Command(0.4)))))
    in_place = episodes.limits.to_action(np.array([*_in_place(episodes), 0.0, 0.0, 0.0, 0.0]))
    for _ in range(500):
        episodes.step(in_place[None].astype(np.float32))
        recovered.append(episodes.monitor.state.speed_error[0])
    assert recovered[290] == pytest.approx(0.0, abs=1e-6)
    assert recovered[450] == pytest.approx(0.4, abs=1e-6)


def _in_place(episodes: GaitEpisodes) -> tuple[float, float, float]:
    gait = episodes.nominal(0.0, 0.0)
    return gait.length, gait.width, gait.duration


ONE = Push((1.0, 2.0, 3.0), 0.1, 0.5)
TWO = Push((4.0, 5.0, 6.0), 0.2, GaitEvent(2, "right", 0.25), "trunk", (0.1, 0.2, 0.3), "heading")


def one_robot(*pushes: Push) -> Pushes:
    """The arrays of one robot that starts on its left foot, without the axis of robots."""
    return Pushes(*(field[0] for field in assign_pushes(empty_pushes(1, 1), 0, Scenario("a", pushes))))


def of(pushes, k):
    """What robot k has, field by field, as lists."""
    return [field[k].tolist() for field in pushes]


def test_arrays_that_grow_keep_what_the_others_have():
    pushes = empty_pushes(3, 1)
    for k in (0, 2):
        pushes = assign_pushes(pushes, k, Scenario("a", (ONE,)))
        pushes.delivered[k, 0] = 0.5 + k
    before = [of(pushes, k) for k in (0, 2)]
    grown = assign_pushes(pushes, 1, Scenario("b", (TWO, ONE)))
    assert grown.start.shape == (3, 2)
    for k, fields in zip((0, 2), before, strict=True):
        assert [field[:1] for field in of(grown, k)] == fields
        assert grown.start[k, 1] == PENDING
        assert grown.step[k, 1] == -1  # never comes
    assert grown.force[1].tolist() == [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]
    assert grown.start[1].tolist() == [PENDING, 0.5]
    assert grown.step[1].tolist() == [3, -1]  # from the left foot, step 3 is the first on the right one
    assert (grown.fraction[1, 0], grown.body[1].tolist(), grown.frame[1].tolist()) == (0.25, [1, 0], [1, 0])
    assert grown.offset[1, 0].tolist() == [0.1, 0.2, 0.3]


def test_a_jump_is_marked_where_it_comes_by_a_push_without_a_force_behind_the_forces():
    first, second = Kick((0.5, 0.0, 0.0), 1.5), Kick((0.0, 0.5, 0.0), 0.2)
    scenario = Scenario("a", (ONE,), kicks=(first,), disturbances=(second,))
    pushes = assign_pushes(empty_pushes(1, 1), 0, scenario)
    assert pushes.start[0].tolist() == [0.5, 1.5, 0.2]
    assert pushes.duration[0].tolist() == [0.1, 0.001, 0.001]
    assert pushes.force[0].tolist() == [[1.0, 2.0, 3.0], [0.0] * 3, [0.0] * 3]
    assert pushes.step[0].tolist() == [-1] * 3


def test_fewer_pushes_leave_nothing_of_those_before():
    pushes = assign_pushes(empty_pushes(1, 1), 0, Scenario("a", (TWO, ONE)))
    pushes.delivered[:] = 7.0
    again = assign_pushes(pushes, 0, Scenario("b", (ONE,), stance_side="right"))
    assert again is pushes  # there was room
    assert again.start[0].tolist() == [0.5, PENDING]
    assert not again.delivered.any()
    assert not again.force[0, 1].any()
    np.testing.assert_array_equal(again.step[0], [-1, -1])


def delivered(push: Push, edges: np.ndarray) -> np.ndarray:
    """Impulse summed over a partition of time."""
    arrays = one_robot(push)
    total, force = np.zeros(3), np.zeros(3)
    for t0, t1 in itertools.pairwise(edges):
        mean_force(arrays.force, arrays.duration, arrays.start, 0, t0, t1, force)
        total += force * (t1 - t0)
    return total


@pytest.mark.parametrize("rate", [10.0, 33.0, 50.0, 100.0, 240.0, 500.0, 997.0])
@pytest.mark.parametrize(("start", "duration"), [(2.6, 0.1), (0.0, 0.05), (1.23456, 0.0301), (3.0, 0.0004)])
def test_impulse_is_exact_at_every_rate(rate, start, duration):
    push = Push((123.0, -456.0, 7.0), duration, start)
    edges = np.arange(int(5 * rate) + 1) / rate
    np.testing.assert_allclose(delivered(push, edges), push.impulse, rtol=0, atol=1e-9)


def test_impulse_is_exact_on_random_partitions():
    rng = np.random.default_rng(0)
    push = Push((500.0, 300.0, -20.0), 0.1, 1.7)
    for _ in range(20):
        edges = np.concatenate([[0.0], np.sort(rng.uniform(0, 4, 300)), [4.0]])
        np.testing.assert_allclose(delivered(push, edges), push.impulse, rtol=0, atol=1e-9)


def test_no_force_outside_the_push():
    arrays = one_robot(Push((10.0, 0.0, 0.0), 0.1, 1.0))
    out = np.ones(3)
    for t0, t1 in [(0.0, 1.0), (1.1, 1.2), (5.0, 6.0)]:
        assert not mean_force(arrays.force, arrays.duration, arrays.start, 0, t0, t1, out)
        assert not out.any()


def test_pending_push_has_no_force():
    arrays = one_robot(Push((10.0, 0.0, 0.0), 0.1, GaitEvent(4, "left")))
    out = np.ones(3)
    assert arrays.start[0] == PENDING
    assert not mean_force(arrays.force, arrays.duration, arrays.start, 0, 0.0, 100.0, out)
    assert not out.any()


@pytest.mark.parametrize("tick", [0.01, 0.004, 0.1])
def test_event_resolves_to_its_moment(tick):
    push = Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.3))
    arrays = one_robot(push)
    duration = 0.65
    for k in range(int(4 * duration / tick)):
        t0 = k * tick
        index = int(t0 / duration + 1e-9)
        resolve_starts(
            arrays.start, arrays.step, arrays.fraction, index, index * duration, duration, t0, (k + 1) * tick
        )
    assert arrays.start[0] == pytest.approx(2.3 * duration, abs=1e-12)


def test_event_missed_by_an_early_touchdown_fires_at_once():
    arrays = one_robot(Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.9)))
    resolve_starts(arrays.start, arrays.step, arrays.fraction, 2, 1.0, 0.6, 1.4, 1.41)
    assert arrays.start[0] == PENDING
    resolve_starts(arrays.start, arrays.step, arrays.fraction, 3, 1.415, 0.6, 1.42, 1.43)
    assert arrays.start[0] == 1.42


@pytest.mark.parametrize(
    ("asked", "start"),
    [(0.6, 1.3), (0.4, 1.25), (0.8, 1.4)],  # as planned; cut so that the moment is over; made longer
)
def test_an_event_follows_the_duration_that_is_planned_in_mid_step(asked, start):
    """Step 2 began at 1 s with T = 0.6 s; at 1.25 s another T is asked for."""
    arrays = one_robot(Push((10.0, 0.0, 0.0), 0.1, GaitEvent(2, "left", 0.5)))
    for tick in range(100):
        t0 = 1.0 + 0.01 * tick
        duration = 0.6 if tick < 25 else asked
        resolve_starts(arrays.start, arrays.step, arrays.fraction, 2, 1.0, duration, t0, t0 + 0.01)
    assert arrays.start[0] == pytest.approx(start, abs=1e-12)


def test_a_force_turns_with_the_heading_once_when_its_push_starts():
    along, fixed = polar_push(10.0, 0.3, 0.1, 1.0, frame="heading"), polar_push(10.0, 0.3, 0.1, 1.0)
    late = Push((0.0, 10.0, -3.0), 0.1, GaitEvent(4, "left"), frame="heading")
    arrays = one_robot(along, fixed, late)
    before = arrays.force.copy()
    turn_forces(arrays.force, arrays.frame, arrays.start, 2.0, 1.0)  # none has started yet
    np.testing.assert_array_equal(arrays.force, before)
    for heading in (2.0, 2.5):  # the second time nothing is left to turn
        turn_forces(arrays.force, arrays.frame, arrays.start, heading, 1.002)
        np.testing.assert_allclose(arrays.force[0], [10 * math.cos(2.3), 10 * math.sin(2.3), 0.0], atol=1e-12)
    np.testing.assert_array_equal(arrays.force[1:], before[1:])
    arrays.start[2] = 3.0
    turn_forces(arrays.force, arrays.frame, arrays.start, math.pi / 2, 3.002)
    np.testing.assert_allclose(arrays.force[2], [-10.0, 0.0, -3.0], atol=1e-12)


def test_at_heading_0_the_frames_are_the_same():
    force = (123.4, -56.7, 8.9)
    arrays = one_robot(Push(force, 0.1, 1.0, frame="heading"))
    turn_forces(arrays.force, arrays.frame, arrays.start, 0.0, 1.002)
    assert tuple(arrays.force[0]) == force


@pytest.mark.parametrize(
    ("command", "stays"),
    [
        ((0.0, 0.0, 0.0, 1.0), True), ((0.1, 0.0, 0.0, 0.0), True), ((0.0, -0.1, 0.0, 0.0), True),
        ((0.0, 0.0, 0.2, 0.0), False), ((0.0, 0.0, 0.0, 0.0), False),
    ],
)  # fmt: skip
def test_who_is_to_walk_to_any_side_may_stand_until_a_step_is_planned(command, stays):
    assert may_stay(np.array(command)) is stays
