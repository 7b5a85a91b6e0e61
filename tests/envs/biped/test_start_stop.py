"""The biped starts, walks at the commanded speed, stops, and stays where it is."""

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.scenario import Command, CommandChange, Scenario

COMMANDS = (Command(0.5), Command(-0.25), Command(0.0, 0.2), Command(0.0, -0.2))
START, STOP, END = 1.0, 5.0, 9.0  # [s]
PERIODS = 100  # a second


@pytest.fixture(scope="module")
def walk():
    """Bipeds that are told to walk at START and to stop at STOP: episodes, CoM (periods + 1, n, 2)."""
    episodes = BipedEpisodes(len(COMMANDS))
    policy = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
    for k, command in enumerate(COMMANDS):
        changes = CommandChange(START, command), CommandChange(STOP, Command())
        episodes.begin(k, Scenario(f"{k}", changes=changes, duration=100.0))
    com = [episodes.motion().com.copy()]
    for _ in range(round(PERIODS * END)):
        episodes.step(policy.predict(episodes.core.observation)[0])
        com.append(episodes.motion().com.copy())
    return episodes, np.array(com)


def mean_velocity(com: np.ndarray, first: float, last: float) -> np.ndarray:
    """(n, 2) [m/s]."""
    return (com[round(PERIODS * last)] - com[round(PERIODS * first)]) / (last - first)


def test_nobody_falls_and_all_count_as_recovered_from_the_stop(walk):
    episodes, _ = walk
    assert not episodes.failure().any()
    assert all(STOP < episodes.monitor.recovered_at(k) < STOP + 2.0 for k in range(len(COMMANDS)))


def test_the_speed_settles_to_the_command(walk):
    """Two steps, over which the sway cancels, take 0.76 s in place and forward, 0.63 s sideways."""
    commanded = np.array([[command.vx, command.vy] for command in COMMANDS])
    found = mean_velocity(walk[1], START + 1.5, STOP)
    np.testing.assert_allclose(found[:2], commanded[:2], atol=0.02)
    np.testing.assert_allclose(found[2:], commanded[2:], atol=0.025)


def test_after_the_stop_it_steps_in_place(walk):
    found = mean_velocity(walk[1], STOP + 1.5, END)
    np.testing.assert_allclose(found, 0.0, atol=0.02)
    way = walk[1][round(PERIODS * END)] - walk[1][round(PERIODS * STOP)]
    speeds = [np.hypot(command.vx, command.vy) for command in COMMANDS]
    assert (np.hypot(*way.T) < np.multiply(speeds, 0.8) + 0.05).all()  # in the way of 0.8 s, and the sway
