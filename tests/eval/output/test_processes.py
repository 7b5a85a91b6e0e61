"""Ctrl-C, once and again, where code looks up and where it does not.

Worker processes: what they tell, and that they end.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from push_recovery.eval.output.processes import (
    INTERRUPTED,
    STOPPED,
    CtrlC,
    WorkerError,
    WorkerPool,
    ctrl_c_held_back,
)

INT = signal.SIGINT


@pytest.fixture(autouse=True)
def handler():
    """Python's own, which a parent such as nohup may have taken away."""
    before = signal.signal(INT, signal.default_int_handler)
    yield signal.default_int_handler
    signal.signal(INT, before)


def test_the_first_one_raises_and_the_others_do_nothing(handler):
    ctrl_c, cleared = CtrlC(), []

    def work():
        with ctrl_c:
            try:
                signal.raise_signal(INT)
            finally:
                cleared.extend(signal.raise_signal(INT) for _ in range(3))

    with pytest.raises(KeyboardInterrupt):
        work()
    assert len(cleared) == 3
    assert ctrl_c.came
    assert signal.getsignal(INT) is handler
    with CtrlC() as quiet:
        pass
    assert not quiet.came


def test_where_it_is_ignored_it_stays_so():
    signal.signal(INT, signal.SIG_IGN)
    with CtrlC(), ctrl_c_held_back():
        signal.raise_signal(INT)
    assert signal.getsignal(INT) == signal.SIG_IGN


def test_held_back_it_comes_at_the_end_and_children_are_deaf():
    deaf = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    heard = []

    def work():
        with ctrl_c_held_back():
            signal.raise_signal(INT)
            heard.append(subprocess.check_output([sys.executable, "-c", deaf], text=True))

    with pytest.raises(KeyboardInterrupt):
        work()
    assert heard == ["True\n"]
    assert subprocess.check_output([sys.executable, "-c", deaf], text=True) == "False\n"


def run(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )


STUCK = {
    "swallowed": """
while True:
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(100)
    except KeyboardInterrupt:
        pass""",
    "compiled": """
threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
hashlib.pbkdf2_hmac("sha1", b"", b"", 2**31 - 1)""",
    "lost": """
class Lost:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0)
del (kept := [Lost()])[0]
time.sleep(100)""",
    "at exit": """
threading.Thread(target=time.sleep, args=(100,)).start()
os.kill(os.getpid(), signal.SIGINT)
time.sleep(100)""",
}


@pytest.mark.parametrize("name", STUCK)
def test_a_process_that_does_not_end_by_itself_is_ended(name):
    code = (
        "import hashlib, os, signal, sys, threading, time\n"
        "from push_recovery.eval.output import processes\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "processes.GRACE = 0.2\n"
        "try:\n"
        "    with processes.CtrlC(last=True):\n"
        + STUCK[name].replace("\n", "\n        ")
        + "\nexcept KeyboardInterrupt:\n    raise SystemExit(130)\n"
    )
    done = run(code)
    assert done.returncode == INTERRUPTED, done.stderr
    assert done.stderr == f"{STOPPED}\n"


def test_after_the_last_block_it_has_no_effect():
    code = (
        "import os, signal\n"
        "from push_recovery.eval.output.processes import CtrlC\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "with CtrlC(last=True): pass\n"
        "os.kill(os.getpid(), signal.SIGINT); print('done')"
    )
    done = run(code)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def base(number):
    if number < 0:
        raise ValueError(f"no state from {number}")
    return number


def add(state, job):
    return state + job


def refuse(state, job):
    if job == 1:
        raise KeyError("no such thing")
    return lambda: job  # which can't be handed back


def end(state, job):
    os._exit(3)


def rest(state, seconds):
    time.sleep(seconds)


@pytest.fixture
def here(monkeypatch):
    """Spawned processes find this module by its name."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setitem(sys.modules, Path(__file__).stem, sys.modules[__name__])
    for work in (base, add, refuse, end, rest):
        monkeypatch.setattr(work, "__module__", Path(__file__).stem)


@pytest.mark.usefixtures("here")
def test_results_come_with_the_numbers_of_their_jobs():
    with WorkerPool(2, base, 10) as pool:
        for jobs in (range(7), (), range(3)):
            assert dict(pool.run(add, jobs)) == {number: 10 + number for number in jobs}
        workers = [worker.process for worker in pool._workers]
        assert len({worker.pid for worker in workers}) == 2
    assert not any(worker.is_alive() for worker in workers)


@pytest.mark.usefixtures("here")
def test_errors_are_told_in_the_words_of_the_worker():
    with WorkerPool(1, base, -1) as pool, pytest.raises(WorkerError, match="ValueError: no state from -1"):
        list(pool.run(add, [1]))
    with WorkerPool(1, base, 0) as pool:
        for job, words in ((1, "KeyError: 'no such thing'"), (2, "Can't pickle local object")):
            with pytest.raises(WorkerError, match=words):
                list(pool.run(refuse, [job]))
            pool._busy.clear()
        with pytest.raises(WorkerError, match="a worker process ended before its work was done"):
            list(pool.run(end, [0]))


@pytest.mark.usefixtures("here")
def test_a_worker_at_work_is_not_waited_for():
    with WorkerPool(2, base, 0) as pool:
        results = pool.run(rest, [0, 1000])
        assert next(results) == (0, None)
        workers = [worker.process for worker in pool._workers]
    assert sorted(worker.exitcode for worker in workers) == [-signal.SIGKILL, 0]


@pytest.mark.usefixtures("here")
def test_it_works_in_a_thread():
    found = []

    def work():
        with WorkerPool(1, base, 1) as pool:
            found.extend(pool.run(add, [1]))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(0, 2)]


PARENT = """
import sys
sys.path.insert(0, sys.argv[1])
import test_processes
from push_recovery.eval.output.processes import WorkerPool
if __name__ == "__main__":
    pool = WorkerPool(2, test_processes.base, 0)
    print(*pool.run(test_processes.rest, [0, 0]), flush=True)
    list(pool.run(test_processes.rest, [1000, 1000]))
"""


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_workers_end_with_the_process_that_started_them(tmp_path, sent):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, str(script), str(Path(__file__).parent)], stdout=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # which nohup ignores
    )  # fmt: skip
    assert parent.stdout is not None
    assert "(1, None)" in parent.stdout.readline()
    parent.send_signal(sent)
    assert parent.communicate(timeout=60)[0] == ""  # the pipe, which the workers hold too, is closed
    assert parent.returncode == -sent
