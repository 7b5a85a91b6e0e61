"""Ctrl-C, once and again, where code looks up and where it does not; an import leaves it alone."""

import signal
import subprocess
import sys

import pytest
from push_recovery.eval.output.interrupt import INTERRUPTED, STOPPED, CtrlC, ctrl_c_held_back

import push_recovery_command

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


def run(code, *words, folder=None):
    argv = [sys.executable, *(words or ("-c", code))]
    return subprocess.run(argv, cwd=folder, capture_output=True, text=True, timeout=60, check=False)


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
        "from push_recovery.eval.output import interrupt\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "interrupt.GRACE = 0.2\n"
        "try:\n"
        "    with interrupt.CtrlC(last=True):\n"
        + STUCK[name].replace("\n", "\n        ")
        + "\nexcept KeyboardInterrupt:\n    raise SystemExit(130)\n"
    )
    done = run(code)
    assert done.returncode == INTERRUPTED, done.stderr
    assert done.stderr == f"{STOPPED}\n"


AFTER = """
import os, signal
from push_recovery.eval.output.interrupt import CtrlC
signal.signal(signal.SIGINT, signal.default_int_handler)
with CtrlC(last=True): pass
os.kill(os.getpid(), signal.SIGINT); print('done')
"""


def test_after_the_last_block_it_has_no_effect():
    done = run(AFTER)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


IMPORTING = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent such as nohup may ignore it
import push_recovery
import push_recovery.eval.cli.main
from push_recovery import evaluate
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("its own")
"""


@pytest.mark.parametrize("words", [["push-recovery"], ["-m", "mine"], ["-m", "push_recovery_tools"]])
def test_a_program_that_imports_the_package_keeps_its_own_ctrl_c(tmp_path, words):
    path = tmp_path / (words[-1] if words[0] != "-m" else f"{words[-1]}/__init__.py")
    path.parent.mkdir(exist_ok=True)
    path.write_text(IMPORTING)
    (path.parent / "__main__.py").write_text("")
    done = run("", *words, folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "its own\n"), done.stderr


def test_the_command_says_the_same_before_and_after_it_has_loaded():
    said = push_recovery_command.INTERRUPTED, push_recovery_command.LINE.decode()
    assert said == (INTERRUPTED, f"{STOPPED}\n")
