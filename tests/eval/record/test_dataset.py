"""Data sets hold what happened: their actions, played to the environment again, give the same numbers."""

import os
import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError, UnknownNameError
from push_recovery.controllers.settings import PresetFile
from push_recovery.envs.scenario.push import GaitEvent, polar_push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import dataset
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.suites import Suite, get_suite

minari = pytest.importorskip("minari", reason="needs the extra data")
BIPED, PENDULUM = "PushRecovery/Biped-v0", "PushRecovery/Pendulum-v0"


def pushed(name: str, force: float, **more) -> Scenario:
    return Scenario(name, (polar_push(force, 1.2, 0.1, GaitEvent(2, "left", 0.2)),), settle_time=1.0, **more)


SCENARIOS = (
    pushed("far", 2500.0),
    pushed("weak", 200.0, command=Command(vx=0.2), noise_seed=7),
    pushed("mid", 600.0),
)


class Silent:
    def set(self, name, completed, note=""):
        """Show nothing."""


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv(dataset.ROOT, str(tmp_path / "minari"))
    return tmp_path / "minari"


def written(policies, scenarios=SCENARIOS, env_id=BIPED, name="mine", root=None, threads=1):
    return dataset.write_datasets(Suite(name, "1", scenarios), env_id, policies, root, threads, Silent())


@pytest.mark.parametrize(
    ("env_id", "policy"), [(BIPED, "two-stage"), (BIPED, "residual"), (PENDULUM, "two-stage"),
                           ("PushRecovery/BipedJointResidual-v0", "joint-residual")],
)  # fmt: skip
def test_the_actions_played_again_give_every_number_again(root, env_id, policy):
    (found,) = written(policy, env_id=env_id)
    there = minari.load_dataset(found.id)
    told = list(there.storage.get_episode_metadata(range(len(SCENARIOS))))
    assert found.episodes == len(SCENARIOS) == there.total_episodes
    assert found.transitions == there.total_steps == sum(len(one.rewards) for one in there)
    with closing(there.recover_environment()) as env:
        for scenario, episode, about in zip(SCENARIOS, there, told, strict=True):
            assert Scenario.from_json(about["options"]["scenario"]) == scenario
            observation, _ = env.reset(seed=about["seed"], options={"scenario": scenario})
            np.testing.assert_array_equal(episode.observations[0], observation)
            for t, action in enumerate(episode.actions):
                observation, reward, terminated, truncated, info = env.step(action)
                np.testing.assert_array_equal(episode.observations[t + 1], observation)
                assert (reward, terminated, truncated) == (
                    episode.rewards[t], episode.terminations[t], episode.truncations[t]
                )  # fmt: skip
            assert terminated != truncated
            assert bool(about["recovered"]) == (info["recovered_at"] is not None and not terminated)
    assert [bool(about["survived"]) for about in told][:2] == [False, True]
    assert found.recovered == sum(bool(about["recovered"]) for about in told)


def test_threads_change_nothing(root, tmp_path):
    for threads, place in ((1, None), (2, tmp_path / "other")):
        written("two-stage", threads=threads, root=place)
    first = minari.load_dataset("push-recovery/biped/mine-two-stage-v0")
    os.environ[dataset.ROOT] = str(tmp_path / "other")
    second = minari.load_dataset("push-recovery/biped/mine-two-stage-v0")
    for one, other in zip(first, second, strict=True):
        for part in ("observations", "actions", "rewards", "terminations", "truncations"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))


def test_a_data_set_that_is_there_is_kept_and_another_one_not_replaced(root, monkeypatch):
    (first,) = written("two-stage", env_id=PENDULUM)
    monkeypatch.setattr(dataset, "collect", None)  # nothing runs again
    (again,) = written("two-stage", env_id=PENDULUM)
    assert again == first
    with pytest.raises(InvalidValueError) as refused:
        written("two-stage", SCENARIOS[:1], env_id=PENDULUM)
    place = root / "push-recovery/pendulum/mine-two-stage-v0"
    assert str(refused.value) == (
        f"{str(place)!r} is a data set of another suite_sha256: delete it, or choose another --out"
    )


def test_what_is_stopped_leaves_nothing_half_written(root, monkeypatch):
    run = dataset.collect

    def stopped(*words):
        yield next(run(*words))
        raise KeyboardInterrupt

    monkeypatch.setattr(dataset, "collect", stopped)
    with pytest.raises(KeyboardInterrupt):
        written("two-stage", env_id=PENDULUM)
    assert list(root.iterdir()) == []
    assert os.environ[dataset.ROOT] == str(root)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        (".", b""), ("data", None), ("data/metadata.json", None), ("data/metadata.json", b"{"),
        ("data/metadata.json", b"[]"), ("data/metadata.json", b"{}"), ("data/main_data.hdf5", None),
        ("data/main_data.hdf5", b"garbage"),
    ],
)  # fmt: skip
def test_a_damaged_data_set_is_named_and_left(root, file, content):
    """What is wrong is told in Minari's words, which are its own business; some are none."""
    written("two-stage", SCENARIOS[:1], env_id=PENDULUM)
    place = root / "push-recovery/pendulum/mine-two-stage-v0"
    path = place / file
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    if content is not None:
        path.write_bytes(content)
    there = list(root.rglob("*"))
    said = rf"^'{place}' is no whole data set \(\w+\(.*\)?.*\): delete it, or choose another --out$"
    with pytest.raises(InvalidValueError, match=said):
        written("two-stage", SCENARIOS[:1], env_id=PENDULUM)
    assert list(root.rglob("*")) == there


def test_an_episode_that_does_not_say_what_became_of_it_is_damage(root):
    h5py = pytest.importorskip("h5py")
    written("two-stage", SCENARIOS[:1], env_id=PENDULUM)
    place = root / "push-recovery/pendulum/mine-two-stage-v0"
    with h5py.File(place / "data/main_data.hdf5", "a") as file:
        del file["episode_0"].attrs["recovered"]
    with pytest.raises(InvalidValueError) as refused:
        written("two-stage", SCENARIOS[:1], env_id=PENDULUM)
    assert str(refused.value) == (
        f"{str(place)!r} is no whole data set (KeyError('recovered')): delete it, or choose another --out"
    )


@pytest.mark.parametrize(
    ("out", "file"), [("file", "file"), ("file/x", "file"), ("sets", "sets/push-recovery")]
)
def test_a_place_that_cannot_be_written_to_is_named_before_anything_is_run(tmp_path, monkeypatch, out, file):
    monkeypatch.setattr(dataset, "collect", None)
    (tmp_path / "sets").mkdir()
    (tmp_path / file).touch()
    with pytest.raises(InvalidValueError) as refused:
        written("two-stage", env_id=PENDULUM, root=tmp_path / out)
    place = tmp_path / file / "mine-two-stage-v0"
    assert str(refused.value) == f"can't write to '{place}': its folder is a file"


def test_policies_of_which_one_is_none_or_has_the_name_of_another_are_not_run(root, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "collect", None)
    with pytest.raises(UnknownNameError, match="unknown policy 'x'"):
        written(["two-stage", "x"], env_id=PENDULUM)
    with pytest.raises(InvalidValueError) as refused:
        written({"a b": "two-stage", "a+b": "two-stage"}, env_id=PENDULUM)
    assert str(refused.value) == (
        "policies 'a b' and 'a+b' would have one data set, 'push-recovery/pendulum/mine-a-b-v0': write them "
        "apart, or rename a file"
    )
    assert not root.exists()


def test_names_are_those_that_minari_takes():
    with closing(make_env(BIPED)) as env:
        assert dataset.dataset_id("hard", env, "stage-1+cop") == "push-recovery/biped/hard-stage-1-cop-v0"
        assert dataset.dataset_id("my pushes", env, "runs/a b/policy.safetensors") == (
            "push-recovery/biped/my-pushes-policy-v0"
        )


def test_the_ceiling_is_of_the_pushes_with_a_stored_answer_and_recovers_from_them():
    suite = get_suite("hard")
    scenarios, policy = dataset._answered(suite, BIPED)
    lost = [one.id for one in scenarios]
    assert 0 < len(lost) < len(suite.scenarios)
    assert [one.id for one in suite.scenarios if one.id in set(lost)] == lost
    with closing(make_env(BIPED)) as env:
        ((one, outcome),) = dataset.collect(env, policy, scenarios[:1], "ceiling")
    assert outcome.recovered
    assert len(one.observations) == len(one.actions) + 1 == outcome.env_steps + 1
    with pytest.raises(InvalidValueError) as refused:
        written("ceiling")
    assert str(refused.value) == (
        "no answers of a search are stored for suite 'mine' on PushRecovery/Biped-v0, and ceiling replays "
        "them; choose suite hard on PushRecovery/Biped-v0"
    )


def test_without_minari_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "minari", None)
    with pytest.raises(MissingExtraError) as refused:
        written("two-stage")
    assert str(refused.value) == (
        "minari is not installed; install it with: pip install 'push-recovery[data]'"
    )


def test_the_command_prints_where_each_data_set_is(root, tmp_path, capsys):
    Suite("two", "1", SCENARIOS[:2]).save(tmp_path / "two.json")
    words = ["--suite", str(tmp_path / "two.json"), "--env", PENDULUM, "--policies", "two-stage", "stage-1"]
    assert main(["dataset", *words, "--out", str(tmp_path / "sets")]) == 0
    said = capsys.readouterr().out.splitlines()
    for name in ("two-stage", "stage-1"):
        place = tmp_path / "sets/push-recovery/pendulum" / f"two-{name}-v0"
        assert f"{place}: minari.load_dataset('push-recovery/pendulum/two-{name}-v0')" in said
        assert (Path(place) / "data/main_data.hdf5").is_file()


def test_a_data_set_of_a_preset_that_has_changed_is_another_one(root, tmp_path):
    path = tmp_path / "own.json"
    PresetFile(planner={"push_carry": 0.05}).save(path)
    written("two-stage", env_id=f"{PENDULUM}@{path}")
    PresetFile(planner={"push_carry": 0.1}).save(path)
    with pytest.raises(InvalidValueError, match="another preset_sha256"):
        written("two-stage", env_id=f"{PENDULUM}@{path}")
