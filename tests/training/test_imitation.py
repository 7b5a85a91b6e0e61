"""The learner: what it sees, what it gives, and that it comes close to what it is shown.

Rounds of imitation on the biped: who leads, what is kept, and that a run is repeatable.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.joint_control import PREVIOUS_ACTION
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.joint.taught import TaughtEpisodes
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.training.imitation import (
    HIDDEN,
    Collector,
    ImitationSettings,
    Round,
    Student,
    imitate,
    imitate_once,
    normalisation_of,
)


def linear_task(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Observations, and targets that are a linear function of those that are not hidden."""
    rng = np.random.default_rng(1)
    observations = rng.normal(2.0, 3.0, (n, 58)).astype(np.float32)
    weights = rng.normal(0.0, 0.005, (58, 14))
    weights[HIDDEN] = 0.0
    return observations, (observations @ weights).astype(np.float32)


def test_it_comes_close_to_what_it_is_shown():
    observations, targets = linear_task(2000)
    student = Student(ImitationSettings(layers=(32,)))
    student.normalisation = normalisation_of(observations)
    losses = [student.fit(observations, targets, 3e-3) for _ in range(300)]
    assert losses[-1] < 0.01 * losses[0]
    np.testing.assert_allclose(student.act(observations.astype(float)), targets, atol=0.1)


def test_the_previous_action_is_hidden():
    observations, _ = linear_task(100)
    student = Student(ImitationSettings())
    student.normalisation = normalisation_of(observations)
    changed = observations.astype(float)
    changed[:, HIDDEN] += 1.0
    np.testing.assert_allclose(student.act(changed), student.act(observations.astype(float)), atol=1e-5)
    assert (HIDDEN.start, HIDDEN.stop) == (PREVIOUS_ACTION, 55)


def test_other_entries_have_their_mean_and_variance():
    observations, _ = linear_task(5000)
    seen = normalisation_of(observations).apply(observations.astype(float))
    rest = np.delete(seen, HIDDEN, axis=1)
    np.testing.assert_allclose(rest.mean(axis=0), 0.0, atol=1e-3)
    np.testing.assert_allclose(rest.std(axis=0), 1.0, atol=1e-3)


def test_its_numpy_network_gives_the_same_targets():
    observations, _ = linear_task(10)
    student = Student(ImitationSettings())
    student.normalisation = normalisation_of(observations)
    forward = student.mlp().forward(student.normalisation.apply(observations.astype(float)))
    np.testing.assert_allclose(np.clip(forward, -1, 1), student.act(observations.astype(float)), atol=1e-6)


def test_the_mean_of_the_weights_is_the_result_once_it_has_begun():
    """w <- w + share (v - w) after each step, v what the steps lead to."""
    observations, targets = linear_task(64)
    student = Student(ImitationSettings(layers=(8,)))
    student.normalisation = normalisation_of(observations)
    student.begin_mean(0.25)
    mean, found = None, None
    for _ in range(3):
        student.fit(observations, targets, 1e-2)
        now = student.network[0].weight.detach().numpy().copy()
        mean = now if mean is None else mean + 0.25 * (now - mean)
        found = student.mlp().weights[0]
    np.testing.assert_allclose(found, mean, atol=1e-6)
    assert np.abs(found - now).max() > 1e-4


def test_weights_follow_from_the_seed_alone():
    first, again, other = (Student(ImitationSettings(seed=seed)).mlp().weights for seed in (3, 3, 4))
    assert all((a == b).all() for a, b in zip(first, again, strict=True))
    assert (first[0] != other[0]).any()


def test_the_learner_takes_over_bit_by_bit():
    settings = ImitationSettings(shown_rounds=3, growth=0.03, free_share=0.9, rounds=100, learning_rate=1e-3)
    assert [settings.free(number) for number in (0, 2, 3, 10, 90)] == pytest.approx([0, 0, 0.19, 0.4, 0.9])
    assert [settings.rate(number) for number in (0, 50, 99)] == pytest.approx([1e-3, 5e-4, 1e-4])
    assert [settings.last_rate(batch) for batch in (0, 4000, 8000)] == pytest.approx([1e-3, 5e-4, 0.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"robots": 0}, "robots must be an integer"),
        ({"rounds": -1}, "rounds must be an integer"),
        ({"free_share": 1.1}, r"free_share must be in \[0, 1\], got 1.1"),
        ({"learning_rate": float("nan")}, "learning_rate must be positive and finite"),
        ({"layers": (0,)}, "layers must be widths >= 1"),
        ({"pushes": 3}, "pushes must be"),
    ],
)
def test_impossible_settings_are_refused(change, message):
    with pytest.raises(InvalidValueError, match=message):
        ImitationSettings(**change)


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


class Taught:
    """Three robots beside a teacher whose targets are a test's.

    Robot 2 falls in the first period, and robot 0 comes to its end in the second.
    """

    n, control_hz = 3, 100.0

    def __init__(self):
        gait = SimpleNamespace(time=np.array([0.5, 0.0, 3.0]), stance=np.array([0, 1, 0]))
        self.core = SimpleNamespace(gait=gait, walk=SimpleNamespace(stance=np.array([0, 0, 0])))
        self.seen, self.targets = np.zeros((3, 58)), np.zeros((3, 14))
        self.led, self.actions, self.begun = [], [], []

    def drawn(self, pushes, rng):
        return Scenario("x", pushes=(polar_push(100.0, 0.0, 0.1, 0.3),))

    def begin(self, k, scenario):
        self.begun.append((k, scenario))

    def lead(self, robots):
        self.led.append(robots.tolist())

    def step(self, actions):
        self.actions.append(actions.copy())
        self.seen = self.seen + 1.0
        self.targets = np.repeat([[0.5], [1.2], [-0.25]], 14, axis=1)
        failed = np.array([False, False, len(self.actions) == 1])
        truncated = np.array([len(self.actions) == 2, False, False])
        return SimpleNamespace(failed=failed, truncated=truncated)


def test_the_teacher_leads_up_to_a_robots_turn_and_what_it_asked_is_then_the_action():
    episodes = Taught()
    settings = ImitationSettings(robots=3, periods=1, shown_rounds=0, unpushed=0.0)
    collector = Collector(settings, episodes, np.random.default_rng(0))
    collector._begun, collector._turn[:] = True, (1.0, 0.0, 3.0)
    episodes.targets = np.repeat([[-1.4], [0.3], [0.3]], 14, axis=1)
    shown = collector.collect(lambda seen: np.full((3, 14), 0.125, np.float32), 5)
    assert episodes.led == [[True, False, False]]  # robots 1 and 2 are past their turn
    np.testing.assert_array_equal(episodes.actions[0][:, 0], np.float32([-1.0, 0.125, 0.125]))
    # robot 1 stands on another foot than its teacher, robot 2 has fallen: robot 0 alone is a sample
    np.testing.assert_array_equal(shown.observations, np.zeros((1, 58), np.float32))
    np.testing.assert_array_equal(shown.targets, np.full((1, 14), 0.5, np.float32))
    assert shown.alone == pytest.approx(0.02)  # two robots, a period of 0.01 s
    assert shown.falls == 1
    assert [k for k, _ in episodes.begun] == [2]
    assert episodes.begun[0][1].pushes


def test_targets_out_of_reach_are_no_samples_and_the_others_are_clipped():
    episodes = Taught()
    episodes.core.walk.stance[1] = 1  # now the teacher and robot 1 stand on the same foot
    collector = Collector(
        ImitationSettings(robots=3, periods=2, largest=1.1), episodes, np.random.default_rng(0)
    )
    collector._begun = True
    shown = collector.collect(nothing, 5)
    assert shown.targets[:, 0].tolist() == [0.5, 0.5, -0.25]  # 1.2 of robot 1 is beyond 1.1
    assert shown.observations[:, 0].tolist() == [0.0, 1.0, 1.0]
    assert [k for k, _ in episodes.begun] == [2, 0]  # the one that fell, and then the one at its end
    wider = Collector(ImitationSettings(robots=3, periods=1, largest=1.3), Taught(), np.random.default_rng(0))
    wider._begun, wider.episodes.core.walk.stance[1] = True, 1
    assert wider.collect(nothing, 5).targets[:, 0].tolist() == [0.5, 1.0]  # within 1.3, clipped to 1


def test_a_robot_that_falls_while_the_teacher_leads_is_no_fall_of_the_learner():
    """All three are led, for ever; those that begin without a push walk for four seconds."""
    episodes = Taught()
    settings = ImitationSettings(robots=3, periods=2, shown_rounds=9, unpushed=1.0)
    collector = Collector(settings, episodes, np.random.default_rng(0))
    shown = collector.collect(nothing, 5)
    assert episodes.led == [[True] * 3] * 2
    assert (shown.falls, shown.alone) == (0, 0.0)
    assert [k for k, _ in episodes.begun] == [0, 1, 2, 2, 0]
    assert all((one.pushes, one.duration) == ((), 4.0) for _, one in episodes.begun)


def test_without_a_mean_a_step_goes_at_its_rate_and_one_at_rate_zero_nowhere():
    observations, targets = linear_task(64)
    student = Student(ImitationSettings(layers=(8,)))
    before = [weight.copy() for weight in student.mlp().weights]
    student.fit(observations, targets, 0.0)
    assert all((a == b).all() for a, b in zip(before, student.mlp().weights, strict=True))
    student.fit(observations, targets, 1e-2)  # Adam's second step: at most its rate, and of most weights near
    moved = np.abs(before[1] - student.mlp().weights[1])
    assert 0.002 < np.median(moved) < 0.0101
    assert ImitationSettings(rounds=0).rate(0) == pytest.approx(1e-3)


def test_entries_that_do_not_move_are_seen_as_zero():
    seen = normalisation_of(np.full((5, 58), 3.0, np.float32))
    assert seen.variance[0] == pytest.approx(1e-4)
    np.testing.assert_array_equal(seen.apply(np.full((1, 58), 3.0))[0, :3], 0.0)


@pytest.mark.parametrize(("error", "loss"), [(0.05, 0.0125), (0.3, 0.25)])
def test_an_error_counts_by_its_square_up_to_beta_and_then_by_its_size(error, loss):
    """e^2 / (2 beta), then e - beta / 2, with beta 0.1."""
    student = Student(ImitationSettings(layers=(4,), beta=0.1))
    for parameter in student.network[-1].parameters():
        torch.nn.init.zeros_(parameter)
    targets = np.full((2, 14), error, np.float32)
    found = student.fit(np.zeros((2, 58), np.float32), targets, 0.0)
    assert found == pytest.approx(loss, rel=1e-5)


def test_the_normalisation_is_that_of_the_first_rounds():
    """Of samples 0, then 1 twice, then 2 twice the first three have the mean 2 / 3."""
    episodes = Taught()
    episodes.robot, episodes.limits = RobotModel(), GaitLimits()
    settings = ImitationSettings(
        robots=3, rounds=3, periods=1, batches=1, batch_size=4, shown_rounds=0, settle_rounds=2,
        last_batches=0, layers=(4,), unpushed=0.0,
    )  # fmt: skip
    assert imitate(settings, episodes).normalisation.mean[0] == pytest.approx(2.0 / 3.0)


def test_a_teacher_leads_for_up_to_the_longest_lead():
    settings = ImitationSettings(robots=3, shown_rounds=0, free_share=0.0, longest_lead=0.5)
    collector, turns = Collector(settings, Taught(), np.random.default_rng(0)), []
    for _ in range(200):
        collector._begin(0, 5)
        turns.append(collector._turn[0])
    assert 0.0 <= min(turns) < 0.05
    assert 0.45 < max(turns) <= 0.5
