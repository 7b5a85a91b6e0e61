"""The learner: what it sees, what it gives, and that it comes close to what it is shown."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.joint_control import PREVIOUS_ACTION
from push_recovery.training.imitation import HIDDEN, ImitationSettings, Student, normalisation_of


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
    student.see(observations)
    losses = [student.fit(observations, targets, 3e-3) for _ in range(300)]
    assert losses[-1] < 0.01 * losses[0]
    np.testing.assert_allclose(student.act(observations.astype(float)), targets, atol=0.1)


def test_the_previous_action_is_hidden():
    observations, _ = linear_task(100)
    student = Student(ImitationSettings())
    student.see(observations)
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
    student.see(observations)
    forward = student.mlp().forward(student.normalisation.apply(observations.astype(float)))
    np.testing.assert_allclose(np.clip(forward, -1, 1), student.act(observations.astype(float)), atol=1e-6)


def test_the_mean_of_the_weights_is_the_result_once_it_has_begun():
    """w <- w + share (v - w) after each step, v what the steps lead to."""
    observations, targets = linear_task(64)
    student = Student(ImitationSettings(layers=(8,)))
    student.see(observations)
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
