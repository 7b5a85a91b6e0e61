"""Worker processes, here and on Ray: the same results, whatever becomes of them, and clear errors."""

import multiprocessing
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError
from push_recovery.controllers.settings import load_preset
from push_recovery.eval.output import processes
from push_recovery.eval.output.processes import RayPool, RayWorkers, WorkerError, WorkerPool, ray_workers
from push_recovery.eval.rollout.policy_source import policy_sources
from push_recovery.eval.rollout.workers import installation, named_files, same_installation, same_runner
from push_recovery.eval.score.evaluate import evaluate
from push_recovery.eval.score.suites import Suite, get_suite
from push_recovery.eval.tuning.pushes import PENDULUM, Scorer
from worker_jobs import add, base, complain, die, die_once, end, refuse, rest

SUITE = Suite("head", "1", get_suite("standard").scenarios[:16])
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


def workers_here():
    return [child for child in multiprocessing.active_children() if child.name.startswith("Spawn")]


def test_results_come_with_the_numbers_of_their_jobs():
    with WorkerPool(2, base, 10) as pool:
        for jobs in (range(7), (), range(3)):
            assert dict(pool.run(add, jobs)) == {number: 10 + number for number in jobs}
        workers = workers_here()
        assert len(workers) == 2
    assert [worker.exitcode for worker in workers] == [0, 0]


@pytest.mark.parametrize(
    ("number", "task", "job", "words"),
    [
        (-1, add, 1, "^ValueError: no state from -1$"),
        (0, add, -1, "^KeyError: 'no such thing'$"),
        (0, complain, 3, "^no push at 3$"),
        (0, refuse, 2, "Can't pickle local object"),
        (0, end, 0, "^a worker process ended before its work was done"),
        (0, die, 0, "^a worker process ended before its work was done"),
    ],
)
def test_errors_are_told_in_the_words_of_the_worker(number, task, job, words):
    with WorkerPool(1, base, number) as pool, pytest.raises(WorkerError, match=words):
        list(pool.run(task, [job]))


def test_a_worker_at_work_is_not_waited_for():
    with WorkerPool(2, base, 0) as pool:
        results = pool.run(rest, [0, 1000])
        assert next(results) == (0, None)
        workers, begun = workers_here(), time.monotonic()
        assert len(workers) == 2
    assert time.monotonic() - begun < 20.0
    assert not any(worker.is_alive() for worker in workers)


def test_it_works_in_a_thread():
    def work():
        with WorkerPool(1, base, 1) as pool:
            return list(pool.run(add, [1]))

    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(work).result() == [(0, 2)]


PARENT = """
import sys
sys.path.insert(0, sys.argv[1])
import worker_jobs
from push_recovery.eval.output.processes import WorkerPool
if __name__ == "__main__":
    pool = WorkerPool(2, worker_jobs.base, 0)
    print(*pool.run(worker_jobs.rest, [0, 0]), flush=True)
    list(pool.run(worker_jobs.rest, [1000, 1000]))
"""


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_workers_end_with_the_process_that_started_them(tmp_path, sent):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, str(script), str(Path(__file__).parents[1])], stdout=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # which nohup ignores
    )  # fmt: skip
    assert parent.stdout is not None
    assert "(1, None)" in parent.stdout.readline()
    parent.send_signal(sent)
    assert parent.communicate(timeout=60)[0] == ""  # the pipe, which the workers hold too, is closed
    assert parent.returncode == -sent


@pytest.fixture(scope="module")
def workers():
    if find_spec("ray") is None:
        pytest.skip("the extra ray is not installed")
    found = ray_workers("local", 2)
    yield found
    import ray

    ray.shutdown()


def test_a_cluster_gives_the_same_results_and_errors_whatever_becomes_of_a_worker(
    workers, tmp_path, monkeypatch, capfd
):
    assert (workers, isinstance(workers, RayWorkers)) == (2, True)
    with RayPool(base, 10) as pool:
        for jobs in (range(40), (), range(3)):
            assert sorted(pool.run(add, jobs)) == [(number, 10 + number) for number in jobs]
        jobs = [(number, tmp_path / "died") for number in range(40)]
        found = list(pool.run(die_once, jobs))
        assert (tmp_path / "died").exists()
        assert sorted(found) == [(number, 10 + number) for number in range(40)]
        with pytest.raises(WorkerError, match="KeyError: 'no such thing'"):
            list(pool.run(add, [-1]))
    with RayPool(base, -1) as pool, pytest.raises(WorkerError, match="ValueError: no state from -1"):
        list(pool.run(add, [1]))
    monkeypatch.setattr(processes, "RETRIES", 0)
    with RayPool(base, 0) as pool, pytest.raises(WorkerError, match="a worker of the Ray cluster"):
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
    monkeypatch.setattr(processes, "find_spec", lambda name: None if name == "ray" else find_spec(name))
    with pytest.raises(MissingExtraError, match=r"^ray is not installed.*pip install 'push-recovery\[ray\]'"):
        ray_workers("local", 2)


@pytest.mark.parametrize(
    "address", ["nonsense", "nonsense:port", ":6379", "127.0.0.1:9", "ray://127.0.0.1:9"]
)
def test_an_address_without_a_cluster_is_refused_at_once(address):
    with pytest.raises(InvalidValueError, match=f"^no Ray cluster at '{address}': "):
        processes._connect(pytest.importorskip("ray"), address, 2)
