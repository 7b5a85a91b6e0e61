"""Runs of training: their files, going on after an interrupt, beginning as a policy, and their progress."""

import dataclasses
import errno
import json
import os
from contextlib import closing
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.robot import Similarity
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.eval.output.rows import Writer
from push_recovery.eval.rollout import load_policy as names
from push_recovery.eval.rollout.episodes import rollout
from push_recovery.eval.score.kinds import SuiteDistribution
from push_recovery.training.builders import completed, make_env
from push_recovery.training.run import (
    CurvePoint,
    Progress,
    Run,
    curve_scenarios,
    find_checkpoints,
    initial_policy,
    load_checkpoint,
    read_curve,
    resume,
    train,
    write_curve,
)
from push_recovery.training.settings import TrainingSettings, difference, get_recipe
from safetensors.numpy import save


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


@pytest.fixture
def training_run_settings(toy):
    return TrainingSettings(
        kind="scratch", env_id=toy, timesteps=1024, n_envs=4, n_steps=64, hold=1, policy_layers=(16, 16),
        value_layers=(16,), log_std=-1.0, learning_rate=5e-4, learning_rate_end=5e-5,
        checkpoint_every=256, evaluate_every=512, evaluation_scenarios=4,
    )  # fmt: skip


def test_a_run_leaves_a_policy_a_curve_and_two_checkpoints(tmp_path, training_run_settings):
    seen = []
    result = train(training_run_settings, tmp_path / "run", lambda steps, share: seen.append(steps))
    assert result.timesteps == 1024
    assert seen == [0, 256, 512, 768, 1024]
    assert [p.timesteps for p in result.curve] == [0, 512, 1024]
    assert read_curve(tmp_path / "run" / "curve.csv") == list(result.curve)
    assert [load_checkpoint(c).timesteps for c in find_checkpoints(tmp_path / "run")] == [768, 1024]
    files = {f.suffix for f in (tmp_path / "run" / "checkpoints").rglob("*") if f.is_file()}
    assert files == {".json", ".safetensors"}  # nothing there can run code
    note = json.loads((tmp_path / "run" / "policy.json").read_text())["training"]
    assert note["timesteps"] == 1024
    open_ones = {"inputs": ("observation",), "starts": "reset", "reward": "environment", "teacher": False}
    whole = dataclasses.replace(training_run_settings, **open_ones)
    assert TrainingSettings.from_json(note["settings"]) == whole  # what was left open is said
    assert any((tmp_path / "run" / "tensorboard").rglob("events*"))


@pytest.mark.parametrize(
    ("shares", "best"), [((0.25, 0.75, 0.5), 512), ((0.5, 0.5, 0.5), 1024), ((0.75, 0.5, 0.25), 0)]
)
def test_the_best_of_the_curve_is_kept_the_later_one_of_equals(
    tmp_path, training_run_settings, curve_of, shares, best
):
    out, scored = tmp_path / "run", curve_of(*shares)
    train(dataclasses.replace(training_run_settings, timesteps=512), out)
    resume(out, 1024)
    note = json.loads((out / "best.json").read_text())["training"]
    assert note["timesteps"] == best
    assert [point["timesteps"] for point in note["curve"]] == [0, 512, 1024]
    assert note["command"] == "push-recovery train --recipe best.json"
    kept = NetworkPolicy.load(out / "best")
    for mine, theirs in zip(kept.network.weights, scored[best].network.weights, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    last = (out / "policy.safetensors").read_bytes()
    assert (last == (out / "best.safetensors").read_bytes()) == (best == 1024)


def test_a_run_that_goes_on_from_an_older_checkpoint_gives_up_the_best_of_later(
    tmp_path, training_run_settings, curve_of
):
    """0.75 at 1024 is given up with what followed 768; 0.25 there is the best since."""
    out = tmp_path / "run"
    curve_of(0.5, 0.5, 0.75, 0.25)
    train(training_run_settings, out)
    resume(find_checkpoints(out)[0], 1024)
    note = json.loads((out / "best.json").read_text())["training"]
    assert [(one["timesteps"], one["recovered"]) for one in note["curve"]] == [
        (0, 0.5), (512, 0.5), (1024, 0.25)
    ]  # fmt: skip
    assert (out / "best.safetensors").read_bytes() == (out / "policy.safetensors").read_bytes()


def test_what_is_given_up_is_no_best_to_beat(tmp_path, training_run_settings, curve_of):
    """The 0.75 of 1024 went with what followed 768; of the points since, 0.25 and 0.5, the latter is kept."""
    out = tmp_path / "run"
    curve_of(0.5, 0.6, 0.75, 0.25, 0.5)
    train(dataclasses.replace(training_run_settings, timesteps=1024), out)
    resume(find_checkpoints(out)[0], 1536)
    note = json.loads((out / "best.json").read_text())["training"]
    assert (note["timesteps"], note["curve"][1]["recovered"]) == (1536, 0.6)


def test_an_interrupt_of_the_last_evaluation_loses_nothing(tmp_path, training_run_settings, monkeypatch):
    out, settings = tmp_path / "run", dataclasses.replace(training_run_settings, checkpoint_every=10_000)
    run = Run(settings, out)

    def evaluate(scored=run.evaluate):
        if run.timesteps == 1024:
            raise KeyboardInterrupt
        scored()

    monkeypatch.setattr(run, "evaluate", evaluate)
    with closing(run), pytest.raises(KeyboardInterrupt):
        run.train()
    assert load_checkpoint(out).timesteps == 1024


@pytest.mark.parametrize("left", [None, b"of another moment"])
def test_a_best_that_a_kill_has_left_in_part_is_made_again(tmp_path, training_run_settings, curve_of, left):
    """Where the run is over already, its last point is scored again and stands in the curve once."""
    out = tmp_path / "run"
    curve_of(0.5, 0.5, 0.25, 0.25)
    train(training_run_settings, out)
    weights = out / "best.safetensors"
    weights.unlink() if left is None else weights.write_bytes(left)
    resume(out)
    assert [point.timesteps for point in read_curve(out / "curve.csv")] == [0, 512, 1024]
    assert NetworkPolicy.load(out / "best").network.sizes == (36, 16, 16, 7)


def test_a_run_that_starts_over_forgets_what_was_best(tmp_path, training_run_settings, curve_of):
    """One that was killed before its first checkpoint leaves no curve that a new run could compare with."""
    out = tmp_path / "run"
    curve_of(0.5, 0.25, 0.0)
    first = Run(training_run_settings, out)
    first.evaluate()
    first.close()
    train(dataclasses.replace(training_run_settings, timesteps=512), out)
    note = json.loads((out / "best.json").read_text())["training"]
    assert note["timesteps"] == 0
    assert [point["recovered"] for point in note["curve"]] == [0.25, 0.0]


def test_the_policy_file_acts_as_sb3_does(tmp_path, training_run_settings):
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    result = train(training_run_settings, tmp_path / "run")
    venv = DummyVecEnv([lambda: gym.make(training_run_settings.env_id)])
    normalise = VecNormalize.load(str(tmp_path / "run" / "sb3" / "vecnormalize.pkl"), venv)
    model = PPO.load(tmp_path / "run" / "sb3" / "model.zip", device="cpu")
    observations = np.random.default_rng(0).normal(0, 0.5, (200, 36))
    observations[:, 3:] = 0.0
    sb3, _ = model.predict(normalise.normalize_obs(observations), deterministic=True)
    mine, _ = NetworkPolicy.load(result.policy).predict(observations)
    assert np.abs(sb3).max() > 0.01
    np.testing.assert_allclose(mine, sb3, atol=2e-6)


def test_training_improves_the_toy(tmp_path, training_run_settings):
    longer = dataclasses.replace(
        training_run_settings, timesteps=8192, evaluate_every=100_000, learning_rate=2e-3, gamma=0.9
    )
    result = train(longer, tmp_path / "run")
    assert result.curve[-1].mean_reward > 1.5 * result.curve[0].mean_reward
    assert result.curve[-1].survived > result.curve[0].survived


def test_equal_seeds_give_equal_files(tmp_path, training_run_settings):
    short = dataclasses.replace(training_run_settings, timesteps=512)
    first, second, other = (
        train(dataclasses.replace(short, seed=seed), tmp_path / name).policy.read_bytes()
        for seed, name in ((3, "a"), (3, "b"), (4, "c"))
    )
    assert first == second
    assert first != other


def test_an_interrupted_run_goes_on_to_its_end(tmp_path, training_run_settings, stop_at):
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(training_run_settings, out, stop_at(768))
    assert load_checkpoint(out).timesteps == 768
    assert not (out / "policy.safetensors").exists()
    result = resume(out)
    assert result.timesteps == 1024
    assert [p.timesteps for p in result.curve] == [0, 512, 1024]
    assert NetworkPolicy.load(out / "policy").observation_size == 36


def test_a_killed_run_goes_on_from_its_last_whole_checkpoint(tmp_path, training_run_settings, stop_at):
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(training_run_settings, out, stop_at(768))
    newest = find_checkpoints(out)[-1]
    newest.rename(newest.with_name(f".{newest.name}.7.tmp"))  # a kill before the rename
    assert load_checkpoint(out).timesteps < 768
    assert resume(out).timesteps == 1024


def test_a_run_killed_before_its_first_update_goes_on(tmp_path, training_run_settings, stop_at):
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(dataclasses.replace(training_run_settings, checkpoint_every=10_000), out, stop_at(1))
    for checkpoint in find_checkpoints(out)[1:]:
        for file in checkpoint.iterdir():
            file.unlink()
        checkpoint.rmdir()
    assert load_checkpoint(out).timesteps == 0
    assert resume(out).timesteps == 1024


def test_a_finished_run_can_be_prolonged(tmp_path, training_run_settings):
    out = tmp_path / "run"
    train(dataclasses.replace(training_run_settings, timesteps=512), out)
    assert resume(out).timesteps == 512
    assert resume(out, 1024).timesteps == 1024
    assert load_checkpoint(out).settings.timesteps == 1024


def test_a_checkpoint_restores_every_tensor_and_counter(tmp_path, training_run_settings):
    out = tmp_path / "run"
    train(training_run_settings, out)
    checkpoint = load_checkpoint(out)
    run = Run(training_run_settings, tmp_path / "other")
    run.algorithm.restore(checkpoint.tensors, checkpoint.timesteps, checkpoint.updates)
    restored = run.algorithm.tensors()
    assert restored.keys() == checkpoint.tensors.keys()
    assert any(name.startswith("optimizer.") for name in restored)
    for name, value in restored.items():
        np.testing.assert_array_equal(value, checkpoint.tensors[name], err_msg=name)
    assert (run.timesteps, run.algorithm.updates) == (checkpoint.timesteps, checkpoint.updates)
    updates = 1024 // (training_run_settings.n_steps * training_run_settings.n_envs)
    assert (checkpoint.timesteps, checkpoint.updates) == (1024, updates * training_run_settings.n_epochs)
    for name, statistics in (("observation", run.venv.obs_rms), ("return", run.venv.ret_rms)):
        assert statistics.count == checkpoint.tensors[f"{name}.count"] > 1000
    assert checkpoint.seconds > 0.0
    run.close()


def test_a_run_that_goes_on_keeps_its_time_and_the_points_up_to_its_checkpoint(
    tmp_path, training_run_settings
):
    """Of points at 0, 512 and 1024 timesteps, a run that goes on from 512 keeps two."""
    out = tmp_path / "run"
    train(dataclasses.replace(training_run_settings, timesteps=512), out)
    at_512, points = load_checkpoint(out), read_curve(out / "curve.csv")
    assert [point.timesteps for point in points] == [0, 512]
    write_curve(out / "curve.csv", [*points, dataclasses.replace(points[-1], timesteps=1024)])
    run = Run(training_run_settings, out, dataclasses.replace(at_512, seconds=1000.0))
    assert run.curve == points
    assert 1000.0 < run.seconds < 1500.0
    run.close()
    fresh = Run(training_run_settings, tmp_path / "fresh")
    assert (fresh.curve, fresh.seconds < 500.0) == ([], True)
    fresh.close()


def test_a_checkpoint_of_other_layers_is_refused(tmp_path, training_run_settings):
    out = tmp_path / "run"
    train(dataclasses.replace(training_run_settings, timesteps=256), out)
    run = Run(dataclasses.replace(training_run_settings, policy_layers=(8, 8)), tmp_path / "other")
    with pytest.raises(InvalidValueError, match="does not fit"):
        run.algorithm.restore(load_checkpoint(out).tensors, 256, 5)
    run.close()


def test_a_gpu_that_is_not_there_is_refused_and_a_run_may_go_on_elsewhere(
    tmp_path, training_run_settings, monkeypatch
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    on_gpu = dataclasses.replace(training_run_settings, device="cuda:1", timesteps=0)
    with pytest.raises(InvalidValueError, match="device is 'cuda:1', and torch finds no GPU here; take cpu"):
        train(on_gpu, tmp_path / "gpu")
    out = tmp_path / "run"
    train(dataclasses.replace(training_run_settings, timesteps=0), out)
    state = find_checkpoints(out)[-1] / "state.json"
    state.write_text(state.read_text().replace('"device": "cpu"', '"device": "cuda"'))
    with pytest.raises(InvalidValueError, match="torch finds no GPU"):
        resume(out)
    assert resume(out, device="cpu").timesteps == 0
    assert difference(on_gpu, dataclasses.replace(on_gpu, device="cpu")) is None


def test_damaged_and_missing_checkpoints_are_refused(tmp_path, training_run_settings):
    with pytest.raises(InvalidValueError, match="no checkpoint in"):
        resume(tmp_path / "nowhere")
    out = tmp_path / "run"
    train(dataclasses.replace(training_run_settings, timesteps=256), out)
    newest = find_checkpoints(out)[-1]
    (newest / "tensors.safetensors").write_bytes(b"\x80\x04pickle")
    with pytest.raises(InvalidValueError, match="damaged"):
        resume(newest)
    (newest / "state.json").write_text("{")
    with pytest.raises(InvalidValueError, match="damaged"):
        resume(out)


def test_a_folder_with_a_run_is_not_overwritten(tmp_path, training_run_settings):
    train(dataclasses.replace(training_run_settings, timesteps=0), tmp_path / "run")
    with pytest.raises(InvalidValueError, match="--resume"):
        train(training_run_settings, tmp_path / "run")


@pytest.mark.parametrize(
    ("env_id", "error", "told"),
    [
        ("PushRecovery/Bipde-v0", UnknownNameError, "PushRecovery/Biped-v0"),
        ("gymnasium:Pendulum-v1", InvalidValueError, "robot"),
    ],
)
def test_environments_that_do_not_fit_are_refused(tmp_path, training_run_settings, env_id, error, told):
    with pytest.raises(error, match=told):
        train(dataclasses.replace(training_run_settings, env_id=env_id), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_run_without_a_checkpoint_is_none(tmp_path, training_run_settings, monkeypatch):
    """No space for the first checkpoint: the same command starts again, and --resume says what there is."""
    out = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr("push_recovery.training.run.save", no_space)
        with pytest.raises(OSError, match="No space"):
            train(training_run_settings, out)
    assert (out / "settings.json").exists()
    with pytest.raises(InvalidValueError, match="no checkpoint"):
        resume(out)
    assert train(dataclasses.replace(training_run_settings, timesteps=0), out).policy.is_file()
    assert [path.name for path in (out / "checkpoints").iterdir()] == ["0" * 12]


def no_space(tensors):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_second_writer_is_refused(tmp_path, training_run_settings):
    out = tmp_path / "run"
    with Writer(out), pytest.raises(InvalidValueError, match="another run"):
        train(training_run_settings, out)
    train(dataclasses.replace(training_run_settings, timesteps=0), out)
    for path in (out, *find_checkpoints(out)):
        with Writer(out), pytest.raises(InvalidValueError, match="another run"):
            resume(path)


def test_a_folder_that_cannot_be_is_refused(tmp_path, training_run_settings):
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidValueError, match="can't write"):
        train(training_run_settings, tmp_path / "file" / "run")


def test_an_untrained_network_gives_zero(tmp_path, training_run_settings):
    result = train(dataclasses.replace(training_run_settings, timesteps=0), tmp_path / "run")
    action, _ = NetworkPolicy.load(result.policy).predict(np.ones((5, 36)))
    np.testing.assert_array_equal(action, 0.0)


def test_an_untrained_residual_scores_exactly_as_its_base(tmp_path, training_run_settings):
    from push_recovery.controllers.policies.two_stage import make_policy

    result = train(
        dataclasses.replace(training_run_settings, kind="residual", timesteps=0, hold=2), tmp_path / "run"
    )
    env = gym.make(training_run_settings.env_id)
    base = make_policy("two-stage", env.unwrapped.robot, env.unwrapped.limits, env.unwrapped.preset)
    learned = NetworkPolicy.load(result.policy)
    for scenario in curve_scenarios(3):
        assert rollout(env, learned, scenario, "same") == rollout(env, base, scenario, "same")


def test_the_curve_has_the_same_distinct_scenarios_in_every_run():
    assert curve_scenarios(8) == curve_scenarios(16)[:8]
    like = curve_scenarios(8, pushes=SuiteDistribution(("quick",), 4.0))
    assert {s.pushes[0].frame for s in like} == {"heading"}
    assert len({s.pushes for s in curve_scenarios(16)}) == 16
    (first,) = curve_scenarios(1)[0].pushes  # as in runs that are over
    np.testing.assert_allclose(first.force, (-992.9920588535983, -494.7803917752399, 0.0), rtol=1e-12)


FELL = {"failure_reason": "low", "recovered_at": 1.0}  # it had recovered, and fell all the same
STOOD = {"failure_reason": None, "recovered_at": None}
RECOVERED = {"failure_reason": None, "recovered_at": 0.0}


class Logger:
    def __init__(self):
        self.values = {}

    def record(self, name, value):
        self.values[name] = value


def ended(progress: Progress, *infos) -> None:
    progress.locals = {"dones": np.ones(len(infos), np.bool_), "infos": list(infos)}
    assert progress.on_step()


def test_recovered_is_standing_and_settled(monkeypatch):
    told, logger = [], Logger()
    progress = Progress(lambda timesteps, words: told.append(words), lambda: "curve 40% -> 60%")
    monkeypatch.setattr(Progress, "logger", logger)
    progress._on_rollout_end()
    assert told == ["curve 40% -> 60%"]  # no episode has ended yet
    episodes = [{"r": 100.0}, {"r": 300.0}, {"r": 200.0}, {"r": 250.0}]  # the mean is 212.5
    progress.model = type("Model", (), {"num_timesteps": 0, "ep_info_buffer": episodes})()  # type: ignore[assignment]
    ended(progress, FELL, STOOD, RECOVERED, RECOVERED)
    progress._on_rollout_end()
    assert told[1:] == ["reward 212, recovered 50%, curve 40% -> 60%"]
    assert logger.values == {"rollout/recovered": 0.5}


def test_only_episodes_that_end_count(monkeypatch):
    progress = Progress(lambda timesteps, words: None, str)
    progress.model = type("Model", (), {"num_timesteps": 0})()  # type: ignore[assignment]
    progress.locals = {"dones": np.array([False, True, False]), "infos": [RECOVERED, FELL, RECOVERED]}
    progress.on_step()
    assert list(progress.recovered) == [False]


def test_scenarios_of_the_curve_are_of_the_robots_size_and_profile():
    """Half the mass, 0.64 of the height: forces times 0.5, times times 0.8."""
    (plain,), (small,) = curve_scenarios(1), curve_scenarios(1, size=Similarity(0.5, 0.64))
    assert small.pushes[0].force == pytest.approx(tuple(0.5 * part for part in plain.pushes[0].force))
    assert small.pushes[0].duration == pytest.approx(0.8 * plain.pushes[0].duration)
    assert {scenario.sensing for scenario in curve_scenarios(4, "hardware")} == {"onboard"}


def test_the_share_is_that_of_the_last_hundred_episodes():
    progress = Progress(lambda timesteps, words: None, str)
    progress.model = type("Model", (), {"num_timesteps": 0})()  # type: ignore[assignment]
    ended(progress, *[RECOVERED] * 30, *[FELL] * 75, *[RECOVERED] * 25)
    assert (len(progress.recovered), sum(progress.recovered)) == (100, 25)


def test_progress_names_the_first_and_the_newest_point_of_the_curve():
    shares = (0, 0.25), (1, 0.5), (2, 0.75)
    run = SimpleNamespace(curve=[CurvePoint(t, 0.0, 4, share, 1.0, 0.0) for t, share in shares])
    assert Run.judged(run) == "curve 25% -> 75%"  # type: ignore[arg-type]


def test_a_checkpoint_of_a_later_format_is_refused(tmp_path):
    state = {"format_version": 2, "settings": TrainingSettings().to_json(), "timesteps": 0, "updates": 0}
    (tmp_path / "state.json").write_text(json.dumps(state | {"seconds": 0.0}))
    (tmp_path / "tensors.safetensors").write_bytes(save({}))
    with pytest.raises(InvalidValueError, match="format 2, this version reads 1"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inputs": ("observation", "margin")}, "whose inputs"),
        ({"inputs": ("observation",), "env_id": "PushRecovery/Pendulum-v0"}, "whose environment"),
    ],
)
def test_a_run_begins_as_no_policy_of_other_inputs_or_another_environment(settings, first, change, words):
    with pytest.raises(InvalidValueError, match=words):
        initial_policy(
            dataclasses.replace(settings, initial=str(first), **change), None, gym.make(settings.env_id)
        )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gate": None}, "whose gate"),
        ({"policy": "stage-1"}, "whose policy"),
        ({"scale": (0.5,) * 7}, "whose scale"),
    ],
)
def test_a_correction_begins_as_one_of_the_same_policy_and_gate(change, words):
    for changed in ({}, change):
        settings = dataclasses.replace(get_recipe("residual-hardware"), **changed)
        with closing(make_env(settings)) as one:
            whole = completed(settings, one)
            if not changed:
                assert initial_policy(whole, None, one).description.residual.policy == "two-stage"
                continue
            with pytest.raises(InvalidValueError, match=words):
                initial_policy(whole, None, one)


def test_later_checkpoints_are_given_up_with_the_part_of_the_run(tmp_path, training_run_settings):
    out = tmp_path / "run"
    train(training_run_settings, out)
    assert [one.name for one in find_checkpoints(out)] == ["000000000768", "000000001024"]
    resume(find_checkpoints(out)[0], 768)
    assert load_checkpoint(out).timesteps == 768


@pytest.mark.parametrize(("like", "frame"), [((), "world"), (("quick",), "heading")])
def test_a_run_is_judged_on_pushes_of_the_kinds_that_it_trains_on(tmp_path, settings, like, frame):
    with closing(Run(dataclasses.replace(settings, like=like), tmp_path / "run")) as run:
        assert {scenario.pushes[0].frame for scenario in run.scenarios} == {frame}
        assert {scenario.settle_time for scenario in run.scenarios} == {4.0}


def test_a_run_that_is_killed_goes_on_with_the_best_so_far(
    tmp_path, training_run_settings, curve_of, monkeypatch
):
    """0.75 at 512 lies between checkpoints, of which the next one never comes."""
    out, settings = tmp_path / "run", dataclasses.replace(training_run_settings, checkpoint_every=10_000)
    curve_of(0.25, 0.75, 0.5)
    run = Run(settings, out)

    def evaluate(scored=run.evaluate):
        if run.timesteps == 1024:
            raise RuntimeError("killed")
        scored()

    monkeypatch.setattr(run, "evaluate", evaluate)
    with closing(run), pytest.raises(RuntimeError, match="killed"):
        run.train()
    assert [point.recovered for point in resume(out).curve] == [0.25, 0.75, 0.5]
    assert json.loads((out / "best.json").read_text())["training"]["timesteps"] == 512
