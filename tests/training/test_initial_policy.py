"""A run begins as a policy: by file, or by name, of the folder of its fellows before that of the package."""

import dataclasses

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.eval.rollout import load_policy as names
from push_recovery.training.ppo import train
from push_recovery.training.settings import TrainingSettings


@pytest.fixture
def settings(toy):
    return TrainingSettings(
        kind="scratch", env_id=toy, timesteps=128, n_envs=2, n_steps=32, hold=1, policy_layers=(8,),
        value_layers=(8,), evaluation_scenarios=2,
    )  # fmt: skip


@pytest.fixture
def first(tmp_path, settings):
    """A policy that has learned something, as other/first.safetensors."""
    result = train(settings, tmp_path / "run")
    policy = NetworkPolicy.load(result.policy)
    assert np.any(policy.network.weights[-1])
    return policy.save(tmp_path / "other" / "first")


def test_an_untrained_run_acts_as_the_policy_that_it_begins_as(tmp_path, settings, first):
    begun = dataclasses.replace(settings, initial=str(first), timesteps=0)
    mine, given = (NetworkPolicy.load(path) for path in (train(begun, tmp_path / "begun").policy, first))
    rows = np.random.default_rng(0).normal(size=(20, 36))
    np.testing.assert_array_equal(mine.predict(rows)[0], given.predict(rows)[0])


def test_a_name_is_of_the_fellows_first_and_then_of_the_package(tmp_path, settings, first, monkeypatch):
    begun = dataclasses.replace(settings, initial="first", timesteps=0)
    found = train(begun, tmp_path / "a", own=first.parent).policy
    assert NetworkPolicy.load(found).network.weights[0].any()
    monkeypatch.setattr(names, "NAMES", ("first",))
    monkeypatch.setattr(names, "FOLDER", first.parent)
    assert train(begun, tmp_path / "b", own=tmp_path).policy.read_bytes() == found.read_bytes()
    monkeypatch.setattr(names, "FOLDER", tmp_path)
    with pytest.raises(InvalidValueError, match="policy 'first' does not come with this version"):
        train(begun, tmp_path / "c", own=tmp_path)


@pytest.mark.parametrize(
    ("change", "told"),
    [({"hold": 2}, "whose hold is 1, not 2"), ({"policy_layers": (9,)}, "set policy_layers")],
)
def test_a_policy_that_does_not_fit_is_refused(tmp_path, settings, first, change, told):
    with pytest.raises(InvalidValueError, match=told):
        train(dataclasses.replace(settings, initial=str(first), **change), tmp_path / "begun")


def test_a_residual_does_not_begin_as_what_acts_alone(tmp_path, settings, first):
    residual = dataclasses.replace(settings, kind="residual", initial=str(first), inputs=("observation",))
    with pytest.raises(InvalidValueError, match="whose residual is False, not True"):
        train(residual, tmp_path / "begun")


def test_the_settings_of_a_run_of_before_are_read(settings):
    values = settings.to_json()
    assert values.pop("initial") is None
    assert values.pop("critic") == []
    assert TrainingSettings.from_json(values) == settings
    for wrong in (values | {"more": 1}, {k: v for k, v in values.items() if k != "gamma"}):
        with pytest.raises(InvalidValueError, match="must have the keys"):
            TrainingSettings.from_json(wrong)


def test_a_run_has_one_teacher():
    with pytest.raises(InvalidValueError, match="initial must be None beside a teacher, got 'joint'"):
        TrainingSettings("joint", teacher=True, initial="joint")
