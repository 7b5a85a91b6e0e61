import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import main
from push_recovery.eval.cli.tools import Names
from push_recovery.eval.rollout.names import SUITE_NAMES
from push_recovery.eval.score.suites import SUITES, Suite, quick_suite, standard_suite

import push_recovery


@pytest.fixture
def suite(tmp_path):
    path = tmp_path / "suite.json"
    Suite("head", "1", standard_suite().scenarios[:6]).save(path)
    return str(path)


@pytest.fixture
def policy(tmp_path):
    return toy.save_policy(tmp_path / "strong.safetensors", 8.0)


def bad_input(capsys, *argv):
    """Exit code 2, nothing on standard output, one line on standard error; returns that line."""
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert "Traceback" not in err
    assert "usage" not in err
    return err


def test_evaluate_json_is_the_contracts_object(suite, policy, tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", policy, "--suite", suite, "--workers", "1"]
    assert main([*argv, "--out", str(out), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert set(content) == {"suite", "env", "policies", "out"}
    assert content["suite"]["name"] == "head"
    assert content["policies"][policy]["episodes"] == 6
    assert content["out"] == str(out)
    report = json.loads((out / "report.json").read_text())
    assert report["policies"][policy]["recovered"] == content["policies"][policy]["recovered"]
    assert report["policies"][policy]["survived"] == content["policies"][policy]["survived"]
    assert "Wilson" in (out / "report.md").read_text()
    assert main([*argv, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert f"report: {out / 'report.md'}" in text
    assert text.strip().endswith(f"page: {out / 'report.html'}")
    page = (out / "report.html").read_text()
    assert f"push-recovery evaluate --env {toy.ENV_ID} --suite {suite} --policies {policy}" in page
    assert "95 % interval" in text


def test_compare_json(suite, tmp_path, capsys):
    a, b = (toy.save_policy(tmp_path / f"{gain}.safetensors", gain) for gain in (9, 1))
    argv = [
        "compare",
        a,
        b,
        "--env",
        toy.ENV_ID,
        "--suite",
        suite,
        "--workers",
        "1",
        "--out",
        str(tmp_path / "c"),
    ]
    assert main([*argv, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["a"], content["b"], content["suite"], content["pairs"]) == (a, b, "head", 6)
    (tmp_path / "c" / "report.html").unlink()  # --json has written it, too
    assert main(argv) == 0
    assert "McNemar" in capsys.readouterr().out
    assert f"push-recovery compare {a} {b} --env" in (tmp_path / "c" / "report.html").read_text()


def test_list(capsys):
    assert main(["list", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "PushRecovery/Biped-v0" in content["envs"]
    assert "two-stage" in content["policies"]
    assert [s["name"] for s in content["suites"]] == list(SUITE_NAMES)
    assert main(["list"]) == 0
    assert quick_suite().sha256 in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["evaluat"], ["evaluat", "evaluate", "compare", "frontier"]),
        (["evaluate", "--suite", "quik"], ["quik", "quick", "standard"]),
        (["evaluate", "--env", "Biped"], ["Biped", "PushRecovery/Biped-v0"]),
        (["evaluate", "--env", "nowhere:Biped-v0"], ["nowhere"]),
        (["evaluate", "--env", "..:x"], ["'..:x'", "PushRecovery/Biped-v0", "MODULE:ID"]),
        (["evaluate", "--env", f"{toy.ENV_ID}@"], ["preset", "@"]),
        (["evaluate", "--suite", "q" * 5000], ["unknown suite", "quick"]),
        (["evaluate", "--suite", "\udce9"], ["unknown suite", "quick"]),
        (["evaluate", "--env", toy.ENV_ID, "--policies", "p" * 5000], ["unknown policy", "two-stage"]),
        (["play", "--env", toy.ENV_ID, "--scenario", ""], ["scenario", "''", "quick-0000"]),
        (["train", "residual", "--env", ""], ["environment", "''", "PushRecovery/Biped-v0"]),
        (["evaluate", "--env", toy.ENV_ID, "--policies", "two-stag"], ["two-stag", "two-stage", "passive"]),
        (["evaluate", "--env", toy.ENV_ID, "--policies", "no.safetensors"], ["no.json"]),
        (["evaluate", "--workers", "0"], ["--workers", ">= 1", "0"]),
        (["evaluate", "--workers", "two"], ["--workers", "two"]),
        (["compare", "two-stage"], ["B"]),
        (["compare", "two-stage", "two-stage", "--env", toy.ENV_ID], ["more than once"]),
        (["frontier", "--directions", "0"], ["--directions", ">= 1"]),
        (["frontier", "--body", "head"], ["head", "pelvis", "trunk"]),
        (["frontier", "--vx", "nan"], ["--vx", "nan"]),
        (["play", "--out", "film.avi", "--env", toy.ENV_ID], [".avi", ".mp4", ".png"]),
        (["play", "--suite", "quick", "--scenario", "quick-9999"], ["quick-9999", "quick-0000"]),
        (["train", "everything"], ["everything", "residual", "scratch"]),
        (["train", "residual", "--timesteps", "-1"], ["timesteps", ">= 0"]),
        (["bench", "--seconds", "0"], ["--seconds", "0.1"]),
        (["evaluate", "--sute", "quick"], ["--sute", "did you mean --suite?"]),
        (["evaluate", "--policies"], ["--policies", "at least one"]),
        (["reproduce", "--out"], ["--out", "Expected 1"]),
    ],
)
def test_bad_input_is_one_line_with_the_valid_choices(argv, words, capsys):
    line = bad_input(capsys, *argv)
    assert all(word in line for word in words), line


def test_bad_output_directory_is_bad_input(suite, policy, tmp_path, capsys):
    (tmp_path / "file").write_text("here already")
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", policy, "--suite", suite]
    assert "can't write to the directory" in bad_input(capsys, *argv, "--out", str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "here already"


def test_every_command_has_help(capsys):
    commands = ("evaluate", "compare", "frontier", "bench", "list", "play", "train")
    assert main([]) == 0
    overview = capsys.readouterr().out
    for name in commands:
        assert name in overview
        assert main([name, "--help"]) == 0
        assert "usage: push-recovery " + name in capsys.readouterr().out


def test_the_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"push-recovery {push_recovery.__version__}\n"


def test_the_overview_loads_no_planner():
    """What is slow to load waits for a command that needs it."""
    code = (
        "import sys; from push_recovery.eval.cli.main import main; main(['--help'])\n"
        "print([name for name in ('numba', 'scipy', 'mujoco', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.endswith("[]\n")
    assert tuple(SUITES) == SUITE_NAMES


def test_failures_inside_are_exit_1_without_traceback(monkeypatch, capsys):
    def fail(options):
        raise RuntimeError("broken\nin two lines")

    monkeypatch.setattr(Names, "run", fail)
    assert main(["list"]) == 1
    assert capsys.readouterr().err == "push-recovery: error: RuntimeError: broken in two lines\n"


def test_an_error_says_what_a_file_holds_without_moving_the_cursor(monkeypatch, capsys):
    def fail(options):
        raise InvalidValueError("made for \x1b[2J\x1b]0;title\x07 and \ud800, not ψ")

    monkeypatch.setattr(Names, "run", fail)
    assert main(["list"]) == 2
    assert capsys.readouterr().err == (
        "push-recovery: error: made for \\x1b[2J\\x1b]0;title\\x07 and \\ud800, not ψ\n"
    )


def test_play_writes_a_contact_sheet(policy, tmp_path, capsys):
    out = tmp_path / "push.png"
    argv = ["play", "--env", toy.ENV_ID, "--policy", policy, "--force", "20", "--out", str(out)]
    assert main(argv) == 0
    assert out.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "recovered" in capsys.readouterr().out


def start(*argv):
    """The command line in a process group of its own."""
    code = (
        f"import signal, sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r})\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent such as nohup may ignore it\n"
        "from push_recovery.eval.cli.main import main; raise SystemExit(main())"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, *argv], stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def interrupt(process):
    """Ctrl-C as a terminal gives it, to every process of the group, three times; returns standard error.

    It ends when no process of the group holds it any more.
    """
    for _ in range(3):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.02)
    return process.communicate(timeout=60)[1]


def wait_for(condition):
    deadline = time.monotonic() + 300
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_interrupt_keeps_what_was_done_and_exits_130(policy, tmp_path, workers):
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", policy, "--suite", "standard"]
    process = start(*argv, "--workers", workers, "--out", str(tmp_path))
    rows = tmp_path / "outcomes.jsonl"
    wait_for(lambda: rows.exists() and rows.read_text().count("\n") > 5)
    err = interrupt(process)
    assert process.returncode == 130
    assert "Traceback" not in err
    kept = rows.read_text().splitlines()
    assert 5 < len(kept) < 1024
    assert all(json.loads(line)["policy"] == policy for line in kept)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interrupt_while_workers_start_leaves_no_traceback(policy, tmp_path):
    argv = ["evaluate", "--env", toy.ENV_ID, "--suite", "standard", "--policies", policy]
    process = start(*argv, "--workers", "2", "--out", str(tmp_path))
    wait_for((tmp_path / "config.json").exists)
    time.sleep(0.15)
    err = interrupt(process)
    assert process.returncode == 130
    assert "Traceback" not in err


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("module", ["gymnasium", "numba", "push_recovery.eval.cli.tools"])
def test_interrupt_while_the_command_starts_leaves_no_traceback(module):
    """Ctrl-C comes when the command is about to import a module."""
    code = f"""
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
sys.argv = ["-m", "list"]
runpy.run_module("push_recovery", run_name="__main__")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 130, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "interrupted" in done.stderr


def said(capsys):
    """Lines on standard error, without the one that tells of a compilation."""
    return [line for line in capsys.readouterr().err.splitlines() if "compiling kernels" not in line]


def test_evaluate_says_first_what_it_does_and_where_its_output_goes(suite, policy, tmp_path, capsys):
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", policy, "--suite", suite, "--workers", "1"]
    argv += ["--out", str(tmp_path / "out"), "--json"]
    what = f"head: 6 episodes of {policy}"
    assert main(argv) == 0
    first, *_, last = said(capsys)
    assert first == f"{what}: a few seconds; output in {tmp_path / 'out'}"
    assert last.startswith("6/6 in 0:")
    assert main(argv) == 0
    assert said(capsys)[0] == f"{what}: nothing is left to run; output in {tmp_path / 'out'}"


def test_play_says_first_what_it_writes(policy, tmp_path, capsys):
    argv = ["play", "--env", toy.ENV_ID, "--policy", policy, "--force", "20"]
    assert main([*argv, "--out", str(tmp_path / "push.png")]) == 0
    assert said(capsys)[0] == f"one episode of {policy}: about 20 seconds"
