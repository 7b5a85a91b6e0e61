import math
from types import SimpleNamespace

import numpy as np
import pytest
from push_recovery.controllers.whole_body.kinematics import TRUNK
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.protocols.kick import (
    BEYOND,
    FORCES,
    KickWatcher,
    Measures,
    every_kick,
    jump_of,
    kick_scenarios,
)
from push_recovery.eval.rollout.outcome import Ending, Outcome
from push_recovery.eval.score.suites import get_suite


def test_levels_are_the_papers():
    jumps = [jump_of(force) for force in FORCES]
    assert jumps == pytest.approx([0.143, 0.286, 0.429, 0.571, 0.714, 0.857], abs=5e-4)
    assert [jump_of(force) for force in BEYOND] == pytest.approx([1.2, 1.6, 2.0])


@pytest.mark.parametrize("form", ["stated", "coded"])
def test_two_hundred_kicks_a_level(form):
    levels = kick_scenarios(form)
    assert [len(level) for level in levels.values()] == [200] * 9
    starts = []
    for force, level in levels.items():
        for i, scenario in enumerate(level):
            (kick,) = scenario.kicks
            x, y, z = kick.velocity
            assert math.hypot(x, y) == pytest.approx(jump_of(force), abs=2e-6)
            assert (scenario.duration, scenario.pushes, scenario.command.vx) == (10.0, (), 0.0)
            starts.append(kick.start)
            if form == "stated":
                assert z == 0.0
                assert math.degrees(math.atan2(y, x)) % 360 == pytest.approx(45 * (i % 8) % 360, abs=1e-3)
    assert 2.0 <= min(starts) < 2.01
    assert 2.99 < max(starts) <= 3.0
    assert np.mean(starts) == pytest.approx(2.5, abs=0.03)
    name = "kick" if form == "stated" else "kick-coded"
    assert get_suite(name).scenarios == every_kick(form)


def test_as_coded_every_direction_and_a_vertical_part():
    kicks = np.array([s.kicks[0].velocity for s in kick_scenarios("coded")[300]])
    rise = kicks[:, 2] / jump_of(300)
    assert -0.1 <= rise.min() < -0.08
    assert 0.18 < rise.max() <= 0.2
    psi = np.arctan2(kicks[:, 1], kicks[:, 0])
    assert np.histogram(psi, bins=8, range=(-math.pi, math.pi))[0].min() > 10


def test_as_a_force_with_the_same_impulse():
    for force, kick in zip(kick_scenarios("force")[200], kick_scenarios("stated")[200], strict=True):
        (push,), (jump,) = force.pushes, kick.kicks
        assert (push.start, push.duration, push.body) == (jump.start, 0.1, "pelvis")
        assert np.array(push.impulse) / 60.0 == pytest.approx(np.array(jump.velocity), abs=1e-6)
        assert not force.kicks


def test_fewer_episodes_are_the_first_of_each_level():
    few, all_of_them = kick_scenarios("stated", 3), kick_scenarios("stated")
    assert few == {force: level[:3] for force, level in all_of_them.items()}


def measured(*moments: tuple[float, float, float, float], fell: bool = False) -> dict:
    """Entries of (time, height, speed, tilt), kicked at 2 s from a standing height of 0.79 m."""
    episode = Measures(2.0, 0.0, 0.79)
    for moment in moments:
        episode.take(*moment)
    ending = Ending(fell, moments[-1][0], None, "too_low" if fell else None, 0.0)
    return episode.entries(Outcome.of(Scenario("kick"), "p", ending, len(moments)))


def test_time_to_stable_and_tilt_count_from_the_kick():
    before = (1.0, 0.79, 0.05, 0.9), (2.0, 0.79, 0.1, 0.2)
    told = measured(*before, (2.1, 0.7, 0.5, 0.3), (2.5, 0.7, 0.14, 0.1), (2.6, 0.7, 0.01, 0.2))
    peak = pytest.approx(math.degrees(0.3), abs=1e-3)
    assert told == {"stood": True, "time_to_stable": 0.5, "peak_tilt_deg": peak}
    # one that never is stable counts what was left
    assert measured((2.5, 0.79, 0.3, 0.1), (10.0, 0.79, 0.2, 0.1))["time_to_stable"] == 8.0


@pytest.mark.parametrize(
    ("height", "tilt", "fell", "stood"),
    [(0.31, 1.19, False, True), (0.29, 0, False, False), (0.79, 1.21, False, False), (0.79, 0, True, False)],
)
def test_fallen_by_height_or_tilt(height, tilt, fell, stood):
    assert measured((2.1, height, 0.2, tilt), (3.0, 0.79, 0.0, 0.0), fell=fell)["stood"] is stood


def test_a_watcher_takes_linear_speed_and_the_trunks_tilt_from_the_push_on():
    """sqrt(3) x 0.1 = 0.173 m/s is too fast, 0.139 is not; of the tilt 0.3 rad = 17.2 degrees count."""
    state = SimpleNamespace(qpos=np.zeros((1, 7)), qvel=np.zeros((1, 6)), xmat=np.zeros((1, 20, 9)))
    core = SimpleNamespace(gait=SimpleNamespace(time=np.zeros(1)), true_state=lambda k: state)
    state.qpos[0, 2], watcher = 0.79, KickWatcher()
    watcher.begin(core, 0, Scenario("k", (polar_push(100.0, 0.0, 0.1, 2.0),)))
    for time, speed, spin, tilt in (
        (1.0, 0.0, 0.0, 0.5),
        (2.1, 0.1, 0.0, 0.3),
        (2.3, 0.1, 0.0, 0.2),
        (2.5, 0.08, 9.0, 0.1),
    ):
        core.gait.time[0], state.qvel[0] = time, [speed] * 3 + [spin] * 3
        state.xmat[0] = np.eye(3).ravel()
        state.xmat[0, TRUNK, 8] = math.cos(tilt)
        watcher.look(core, 0)
    told = watcher.end(core, 0, Outcome.of(Scenario("k"), "p", Ending(False, 10.0, None, None, 0.0), 1000))
    assert told == {"stood": True, "time_to_stable": 0.5, "peak_tilt_deg": pytest.approx(17.1887)}


@pytest.mark.parametrize(
    ("start", "duration", "moments", "stable"),
    [
        # it comes in the period from 2.01 s on, so the look at 2.01 s is before it
        (2.0034, 0.0, ((2.0, 0.0), (2.01, 0.0), (2.02, 0.8), (4.0, 0.1)), 1.9966),
        (2.0, 0.1, ((2.0, 0.0), (2.05, 0.1), (2.1, 0.1), (2.2, 0.1)), 0.2),  # a push lasts
    ],
)
def test_no_moment_before_its_end_is_stable(start, duration, moments, stable):
    measures = Measures(start, duration, 0.79)
    for time, speed in moments:
        measures.take(time, 0.79, speed, 0.0)
    outcome = Outcome.of(Scenario("k"), "p", Ending(False, 10.0, None, None, 0.0), 1)
    assert measures.entries(outcome)["time_to_stable"] == pytest.approx(stable)


def test_a_force_gives_a_lighter_robot_the_same_jump():
    pairs = zip(kick_scenarios("force", 2, 30.0)[200], kick_scenarios("stated", 2)[200], strict=True)
    for force, kick in pairs:
        (push,), (jump,) = force.pushes, kick.kicks
        assert np.array(push.impulse) / 30.0 == pytest.approx(np.array(jump.velocity), abs=1e-5)


def test_stable_is_slower_than_fifteen_centimetres_a_second():
    moments = (2.1, 0.79, 0.5, 0.0), (2.5, 0.79, 0.151, 0.0), (2.7, 0.79, 0.149, 0.0)
    assert measured(*moments)["time_to_stable"] == pytest.approx(0.7)
