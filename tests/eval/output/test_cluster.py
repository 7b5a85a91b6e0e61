"""A Ray cluster: the same rows as without it, whatever becomes of its workers, and clear errors."""

import os
import signal
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError
from push_recovery.controllers.settings import load_preset
from push_recovery.eval.output import cluster
from push_recovery.eval.output.cluster import RayPool, RayWorkers, jobs_a_task, ray_workers
from push_recovery.eval.output.processes import WorkerError
from push_recovery.eval.rollout.policy_source import policy_sources
from push_recovery.eval.rollout.workers import installation, named_files, same_installation, same_runner
from push_recovery.eval.score.evaluate import evaluate
from push_recovery.eval.score.suites import Suite, standard_suite
from push_recovery.eval.tuning.scorer import PENDULUM, Scorer

ray = pytest.importorskip("ray", reason="the extra ray is not installed")
SUITE = Suite("head", "1", standard_suite().scenarios[:16])
MORTAL = """
import os, pathlib, signal
import numpy as np

class Mortal:
    '''Does nothing, and dies in the middle of an episode where nobody has died before.'''

    def __init__(self):
        self.steps = 0

    def predict(self, observation):
        self.steps += 1
        flag = pathlib.Path("died")
        if self.steps == 60 and not flag.exists():
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return np.zeros(7)
"""


@pytest.fixture(scope="module")
def workers():
    found = ray_workers("local", 2)
    yield found
    ray.shutdown()


@pytest.fixture
def here(monkeypatch):
    """Workers find this module by its name."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setitem(sys.modules, Path(__file__).stem, sys.modules[__name__])
    for work in (base, add, die_once, die):
        monkeypatch.setattr(work, "__module__", Path(__file__).stem)


def base(number):
    if number < 0:
        raise ValueError(f"no state from {number}")
    return number


def add(state, job):
    if job < 0:
        raise KeyError("no such thing")
    return state + job


def die_once(state, job):
    number, flag = job
    if number == 3 and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return state + number


def die(state, job):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.usefixtures("here")
def test_results_come_with_the_numbers_of_their_jobs_and_errors_in_the_words_of_the_worker(
    workers, tmp_path, monkeypatch, capfd
):
    assert (workers, isinstance(workers, RayWorkers)) == (2, True)
    with RayPool(workers, base, 10) as pool:
        for jobs in (range(40), (), range(3)):
            assert sorted(pool.run(add, jobs)) == [(number, 10 + number) for number in jobs]
        jobs = [(number, tmp_path / "died") for number in range(40)]  # five a task
        found = list(pool.run(die_once, jobs))
        assert (tmp_path / "died").exists()
        assert sorted(found) == [(number, 10 + number) for number in range(40)]
        with pytest.raises(WorkerError, match="KeyError: 'no such thing'"):
            list(pool.run(add, [-1]))
        assert pool._waiting == []  # cancelled while it ends, a task can bring Ray and this process down
    with RayPool(workers, base, -1) as pool, pytest.raises(WorkerError, match="ValueError: no state from -1"):
        list(pool.run(add, [1]))
    monkeypatch.setattr(cluster, "RETRIES", 0)
    with RayPool(workers, base, 0) as pool, pytest.raises(WorkerError, match="a worker of the Ray cluster"):
        list(pool.run(die, [1]))
    assert capfd.readouterr().out == ""  # where a command's result goes, and nothing else


def test_one_process_two_and_ray_give_the_same_rows_also_where_a_worker_is_killed(
    workers, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mortal.py").write_text(MORTAL)
    weak = str(toy.save_policy(tmp_path / "weak.safetensors", 0.2))
    died = tmp_path / "died"
    died.touch()
    asked = SUITE, toy.ENV_ID, [weak, "mortal:Mortal"]
    alone = evaluate(*asked, 1, tmp_path / "alone").rows
    assert 0 < sum(row["survived"] for row in alone[weak]) < len(SUITE.scenarios)
    assert evaluate(*asked, 2, tmp_path / "two").rows == alone
    died.unlink()
    assert evaluate(*asked, workers, tmp_path / "ray").rows == alone
    assert died.exists()


def test_a_preset_is_worth_the_same_on_ray(workers, tmp_path):
    preset = tmp_path / "preset.json"
    load_preset("default").save(preset)
    with Scorer(PENDULUM, "stage-1") as here, Scorer(PENDULUM, "stage-1", workers) as there:
        values = here.values(preset, SUITE.scenarios)
        assert len(set(values)) > 1
        assert there.values(preset, SUITE.scenarios) == values


def test_a_worker_of_another_installation_or_with_other_files_is_refused(tmp_path):
    policy = str(toy.save_policy(tmp_path / "weak.safetensors", 0.2))
    ours = installation()
    assert same_installation(ours, base, 3) == 3
    with pytest.raises(InvalidValueError, match="would give other rows: code, mujoco differ there"):
        same_installation({**ours, "mujoco": "1.0", "code": "0"}, base, 3)
    sources = policy_sources([policy])
    files = named_files(toy.ENV_ID, sources)
    same_runner(files, toy.ENV_ID, sources).close()
    toy.save_policy(tmp_path / "weak.safetensors", 0.3)
    with pytest.raises(InvalidValueError, match=r"policy .*weak.safetensors differ there"):
        same_runner(files, toy.ENV_ID, sources)


def test_without_ray_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda name: None if name == "ray" else find_spec(name))
    with pytest.raises(MissingExtraError, match=r"^ray is not installed.*pip install 'push-recovery\[ray\]'"):
        ray_workers("local", 2)


@pytest.mark.parametrize(
    "address", ["nonsense", "nonsense:port", ":6379", "127.0.0.1:9", "ray://127.0.0.1:9"]
)
def test_an_address_without_a_cluster_is_refused_at_once(address):
    with pytest.raises(InvalidValueError, match=f"^no Ray cluster at '{address}': "):
        cluster._connect(ray, address, 2)


@pytest.mark.parametrize(
    ("jobs", "workers", "size"), [(1, 4, 1), (7, 2, 1), (16, 2, 2), (127, 2, 15), (9999, 2, 16), (80, 100, 1)]
)
def test_a_task_has_several_jobs_as_long_as_every_worker_gets_four(jobs, workers, size):
    assert jobs_a_task(jobs, workers) == size
