"""Commands that change while the robot walks."""

import numpy as np
import pytest
from push_recovery.controllers.model.observation import COMMAND
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode.episodes import GaitEpisodes
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.arrays import assign_changes, empty_schedule, follow
from push_recovery.envs.scenario.push import Push
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
