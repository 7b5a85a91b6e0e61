"""Rounds of imitation on the biped: who leads, what is kept, and that a run is repeatable."""

from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.joint.taught import TaughtEpisodes
from push_recovery.training.imitation import Collector, ImitationSettings, Round, imitate, imitate_once

SMALL = ImitationSettings(
    robots=4, rounds=4, periods=25, batches=5, batch_size=64, layers=(16,), shown_rounds=2, last_batches=5
)


def nothing(observations: np.ndarray) -> np.ndarray:
    return np.zeros((len(observations), 14), np.float32)


@pytest.fixture(scope="module")
def runs() -> list:
    """The same run twice: its policy, and what was told of each round."""
    found = []
    for _ in range(2):
        told: list[Round] = []
        found.append((imitate(SMALL, report=told.append), told))
    return found


def test_equal_settings_give_equal_weights(runs):
    (first, told), (again, told_again) = runs
    for a, b in zip(first.network.weights, again.network.weights, strict=True):
        assert a.tobytes() == b.tobytes()
    assert told == told_again


def test_every_round_adds_its_samples(runs):
    told = runs[0][1]
    assert [one.number for one in told] == [0, 1, 2, 3]
    assert told[0].samples == 100  # the planner walks, every one of its states is good
    assert told[0].samples < told[1].samples < told[3].samples <= 400
    assert told[0].alone == told[1].alone == 0.0


def test_the_policy_acts_in_the_environment_of_joint_targets(runs):
    policy = runs[0][0]
    assert policy.description.env_id == "PushRecovery/BipedJoint-v0"
    assert policy.predict(np.zeros((3, 58)))[0].shape == (3, 14)


def test_a_run_that_is_done_is_not_done_again(tmp_path, runs):
    """What is read back is what was learned; other settings are refused, and half a policy is none."""
    path = tmp_path / "imitated"
    tiny = replace(SMALL, rounds=1, periods=5)
    first = imitate_once(tiny, path)
    told: list[Round] = []
    again = imitate_once(tiny, path, told.append)
    assert told == []
    assert again.network.weights[0].tobytes() == first.network.weights[0].tobytes()
    with pytest.raises(InvalidValueError, match="of other settings of imitation"):
        imitate_once(replace(tiny, seed=1), path)
    path.with_suffix(".json").unlink()
    imitate_once(tiny, path, told.append)
    assert len(told) == 1


def test_while_the_teacher_leads_robots_walk_whatever_the_learner_asks():
    episodes = TaughtEpisodes(4)
    collector = Collector(SMALL, episodes, np.random.default_rng(0))
    shown = [collector.collect(nothing, 0) for _ in range(4)]
    assert sum(one.falls for one in shown) == 0
    assert (episodes.core.gait.steps >= 2).all()
    assert np.abs(shown[-1].targets).max() <= 1.0


def test_a_learner_that_knows_nothing_falls_and_its_robots_begin_anew():
    episodes = TaughtEpisodes(4)
    settings = ImitationSettings(robots=4, periods=200, shown_rounds=0, free_share=1.0, growth=10.0)
    shown = Collector(settings, episodes, np.random.default_rng(0)).collect(nothing, 1)
    assert shown.alone == pytest.approx(8.0)
    assert shown.falls >= 3
    assert (episodes.failure() == 0).all()
    assert len(shown.observations) == len(shown.targets) < 800  # falls are left out


def test_what_is_shown_is_the_teachers_own_target():
    """A sample is the observation before a period and what the teacher asks in it."""
    episodes, other = TaughtEpisodes(2), TaughtEpisodes(2)
    settings = ImitationSettings(robots=2, periods=1, unpushed=1.0)
    collector = Collector(settings, episodes, np.random.default_rng(0))
    first = collector.collect(nothing, 0)
    for k in range(2):
        other.begin(k, episodes._scenarios[k])
    np.testing.assert_array_equal(first.observations, other.seen.astype(np.float32))
    other.lead(np.ones(2, np.bool_))
    other.step(np.zeros((2, 14), np.float32))
    np.testing.assert_allclose(first.targets, other.targets, atol=1e-7)
