"""Pushes of every kind: the impulse is exact, and the robot answers as a body would."""

import numpy as np
import pytest
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.whole_body.kinematics import PELVIS, com_velocity
from push_recovery.controllers.whole_body.kinematics import base_angular_velocity as omega_of
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.robots.biped import biped_model
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario

POLICY = make_policy("two-stage", BIPED, BIPED_LIMITS, "biped")
START = 1.0
TRUNK_INERTIA = biped_model().body("trunk").inertia[1]  # [kg m^2]


class Walk:
    """Robots that step in place, one for each set of pushes, seen at the ends of the periods."""

    def __init__(self, *pushes: tuple[Push, ...], seconds: float):
        self.episodes, count = BipedEpisodes(len(pushes)), len(pushes)
        for k, own in enumerate(pushes):
            self.episodes.begin(k, Scenario(f"{k}", own, duration=100.0))
        velocity, turning, rate = [], [], []
        for _ in range(round(100 * seconds)):
            self.episodes.step(POLICY.predict(self.episodes.core.observation)[0])
            phys = self.episodes.core.physics
            velocity.append([com_velocity(phys, k) for k in range(count)])
            turning.append([omega_of(phys, k) for k in range(count)])
            rate.append(self.episodes.core.truth[:, 17].copy())
        self.velocity, self.turning = np.array(velocity), np.array(turning)  # (periods, n, 3)
        self.pitch_rate = np.array(rate)  # of the trunk, (periods, n)
        self.delivered = self.episodes.core.pushes.delivered  # (n, P, 3)

    def at(self, values: np.ndarray, time: float) -> np.ndarray:
        """What was seen at the end of the period that ends at `time`."""
        return values[round(100 * time) - 1]


def test_a_short_push_changes_the_velocity_by_impulse_over_mass():
    push = Push((600.0, -450.0, 0.0), 0.02, START)
    walk = Walk((push,), (), seconds=5.0)
    np.testing.assert_allclose(walk.delivered[0, 0], push.impulse, atol=1e-9)
    pushed, free = walk.at(walk.velocity, START + 0.02)
    np.testing.assert_allclose((pushed - free)[:2], np.divide(push.impulse, BIPED.mass)[:2], rtol=0.15)
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > START


def test_a_long_push_is_leant_against():
    push = Push((0.0, 30.0, 0.0), 1.0, START)
    walk = Walk((push,), (), seconds=6.0)
    np.testing.assert_allclose(walk.delivered[0, 0], push.impulse, atol=1e-9)
    drift = (walk.velocity[100:200, 0, 1] - walk.velocity[100:200, 1, 1]).mean()
    assert 0.0 < drift < 30.0 / BIPED.mass  # to the pushed side, and slower than a free body
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > START + 1.0


@pytest.mark.parametrize("aside", [0.1, -0.1])
def test_an_off_centre_push_turns_the_pelvis(aside):
    push = Push((300.0, 0.0, 0.0), 0.05, START, "pelvis", (0.0, aside, 0.0))
    centre = Push((300.0, 0.0, 0.0), 0.05, START)
    walk = Walk((push,), (centre,), seconds=4.0)
    np.testing.assert_allclose(walk.delivered[:, 0], [push.impulse] * 2, atol=1e-9)
    turning = walk.at(walk.turning, START + 0.05)[:, 2]
    assert np.sign(turning[0] - turning[1]) == -np.sign(aside)  # forward on its left turns it to the right
    assert not walk.episodes.failure().any()
    xmat = walk.episodes.core.physics.xmat[0, PELVIS]
    assert np.arctan2(xmat[3], xmat[0]) == pytest.approx(0.0, abs=0.05)  # and back


def test_a_push_high_on_the_trunk_pitches_it_at_once():
    high, middle = (Push((250.0, 0.0, 0.0), 0.1, START, "trunk", (0.0, 0.0, z)) for z in (0.25, 0.0))
    walk = Walk((high,), (middle,), (), seconds=5.0)
    np.testing.assert_allclose(walk.delivered[:2, 0], [high.impulse] * 2, atol=1e-9)
    above, centre, free = walk.at(walk.pitch_rate, START + 0.01)  # before the planner has seen it
    assert above - free > 0.05
    turning = 250.0 * 0.25 / TRUNK_INERTIA  # the moment that the push has about the trunk's CoM
    assert above - centre == pytest.approx(turning * 0.01, rel=0.1)
    assert not walk.episodes.failure().any()


def test_repeated_pushes_are_delivered_each_and_survived():
    pushes = tuple(
        Push((150.0 * np.cos(i), 150.0 * np.sin(i), 0.0), 0.1, START + 0.73 * i, ("pelvis", "trunk")[i % 2])
        for i in range(6)
    )
    walk = Walk(pushes, seconds=9.0)
    np.testing.assert_allclose(walk.delivered[0], [push.impulse for push in pushes], atol=1e-9)
    assert walk.episodes.failure()[0] == 0
    assert walk.episodes.monitor.recovered_at(0) > pushes[-1].start
