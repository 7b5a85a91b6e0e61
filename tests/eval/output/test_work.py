from pathlib import Path

import pytest
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.output.progress import Work, about, episode_seconds, robot_seconds

FORCE = (100.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.0, "nothing is left to run"),
        (0.1, "a few seconds"),
        (9.9, "a few seconds"),
        (12.0, "about 10 seconds"),
        (43.0, "about 40 seconds"),
        (89.0, "about 90 seconds"),
        (91.0, "about 2 minutes"),
        (13 * 60.0, "about 15 minutes"),
        (44 * 60.0, "about 40 minutes"),
        (91 * 60.0, "about 2 hours"),
    ],
)
def test_a_guess_is_told_as_people_say_it(seconds, words):
    assert about(seconds) == words


def test_work_says_what_how_long_and_where():
    assert str(Work("3 films", "about 2 minutes")) == "3 films: about 2 minutes"
    there = str(Work("3 films", "about 2 minutes", Path("runs") / "films"))
    assert there == f"3 films: about 2 minutes; output in {Path('runs') / 'films'}"


def test_the_guess_is_linear_in_what_is_simulated_and_in_the_processes():
    one = robot_seconds("PushRecovery/Biped-v0", 100.0)
    assert robot_seconds("PushRecovery/Biped-v0", 300.0) == pytest.approx(3.0 * one)
    assert robot_seconds("PushRecovery/Biped-v0", 100.0, 4) == pytest.approx(one / 4.0)
    assert robot_seconds("PushRecovery/Pendulum-v0", 100.0) < one < robot_seconds("mine:Robot-v0", 100.0)


def test_an_episode_lasts_until_its_robot_has_had_time_to_settle():
    env = "PushRecovery/Biped-v0"
    pushed = Scenario("a", (Push(FORCE, 0.5, 3.5),), settle_time=4.0)
    assert episode_seconds(env, [pushed]) == pytest.approx(robot_seconds(env, 8.0))
    fixed = Scenario("b", (Push(FORCE, 0.5, 3.5),), Command(0.2), duration=20.0)
    assert episode_seconds(env, [pushed, fixed]) == pytest.approx(robot_seconds(env, 28.0))
    waits = Scenario("c", (Push(FORCE, 0.5, GaitEvent(4, "left", 0.0)),), settle_time=4.0)
    assert robot_seconds(env, 4.5) < episode_seconds(env, [waits]) < robot_seconds(env, 8.5)
    assert episode_seconds(env, []) == 0.0
