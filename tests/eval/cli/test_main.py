"""The command line: options, errors in one line, Ctrl-C, what is said first, one writer a directory."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import fields
from itertools import permutations
from pathlib import Path
from unittest.mock import Mock

import pytest
import toy_gait_env as toy
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import COMMANDS, main, parse
from push_recovery.eval.cli.options import PushOptions
from push_recovery.eval.cli.score import Frontier
from push_recovery.eval.cli.tools import Names, Tune
from push_recovery.eval.output.rows import LOCK, Writer
from push_recovery.eval.rollout import SUITE_NAMES
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.suites import KINDS, SUITES, Suite, get_suite
from push_recovery.eval.tuning.study import TuningSettings

import push_recovery


def test_options_are_the_fields_of_a_dataclass():
    options = parse(
        "frontier", ["--policy", "a", "b", "--vx", "-0.5", "--grid", "5", "--body", "trunk", "--json"]
    )
    assert options == Frontier(policies=("a", "b"), vx=-0.5, grid=5.0, body="trunk", json=True)
    assert parse("frontier", ["--policies", "a", "b"]) == Frontier(policies=("a", "b"))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -2.01, 2.01])
def test_bounds_hold_for_options_made_in_python_too(value):
    assert PushOptions(vx=-2.0, vy=2.0).vy == 2.0
    with pytest.raises(InvalidValueError, match=r"--vy must be a number in \[-2, 2\]"):
        PushOptions(vy=value)


def test_tune_has_the_defaults_of_its_settings():
    tune, settings = Tune().settings, TuningSettings(Tune().env, *Tune().policies)
    for field in fields(TuningSettings):
        assert getattr(tune, field.name) == getattr(settings, field.name)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_text(name, capsys):
    with pytest.raises(SystemExit) as leave:
        parse(name, ["--help"])
    assert leave.value.code == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for option in re.sub(r" -{3,}", "", text).split(" --")[2:]:  # without the line below a group's title
        assert len(option.partition("(default")[0].split()) > 1, option
    assert not [form for form in ("{None}", "{[", "[INT", "[FLOAT") if form in text]


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_errors_are_the_same_on_every_terminal(encoding):
    done = subprocess.run(
        [sys.executable, "-m", "push_recovery", "evaluate", "--sute", "quick"],
        capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == ("push-recovery: error: unrecognized option --sute; did you mean --suite?\n")


@pytest.fixture
def suite(tmp_path):
    path = tmp_path / "suite.json"
    Suite("head", "1", get_suite("standard").scenarios[:6]).save(path)
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


def lines_of(err):
    """Lines of standard error, without the one that tells of a compilation."""
    return [line for line in err.splitlines() if "compiling kernels" not in line]


def test_evaluate_says_what_it_does_and_prints_the_contracts_object(suite, policy, tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["evaluate", "--env", toy.ENV_ID, "--policies", policy, "--suite", suite, "--workers", "1"]
    what = f"head: 6 episodes of {policy}"
    assert main([*argv, "--out", str(out), "--json"]) == 0
    told = capsys.readouterr()
    first, *_, last = lines_of(told.err)
    assert first == f"{what}: a few seconds; output in {out}"
    assert last.startswith("6/6 in 0:")
    content = json.loads(told.out)
    assert set(content) == {"suite", "env", "policies", "out"}
    assert content["suite"]["name"] == "head"
    assert content["policies"][policy]["episodes"] == 6
    assert content["out"] == str(out)
    report = json.loads((out / "report.json").read_text())
    assert report["policies"][policy]["recovered"] == content["policies"][policy]["recovered"]
    assert report["policies"][policy]["survived"] == content["policies"][policy]["survived"]
    assert "Wilson" in (out / "report.md").read_text()
    assert main([*argv, "--out", str(out)]) == 0
    text, err = capsys.readouterr()
    assert lines_of(err)[0] == f"{what}: nothing is left to run; output in {out}"
    assert f"report: {out / 'report.md'}" in text
    assert text.strip().endswith(f"page: {out / 'report.html'}")
    page = (out / "report.html").read_text()
    assert f"push-recovery evaluate --env {toy.ENV_ID} --suite {suite} --policies {policy}" in page
    assert "95 % interval" in text


def test_compare_json(suite, tmp_path, capsys):
    a, b = (toy.save_policy(tmp_path / f"{gain}.safetensors", gain) for gain in (9, 1))
    argv = ["compare", a, b, "--env", toy.ENV_ID, "--suite", suite]
    argv += ["--workers", "1", "--out", str(tmp_path / "c")]
    assert main([*argv, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["a"], content["b"], content["suite"], content["pairs"]) == (a, b, "head", 6)
    (page,) = (tmp_path / "c").glob("*.html")  # --json has written it, too
    assert page.name.startswith("compare-")
    page.unlink()
    assert main(argv) == 0
    assert "McNemar" in capsys.readouterr().out
    assert f"push-recovery compare {a} {b} --env" in page.read_text()


def test_a_comparison_leaves_the_files_of_an_evaluation_as_they_are(suite, tmp_path, capsys):
    """Both keep their rows in the same directory, and an index names the pages of both."""
    policies = [toy.save_policy(tmp_path / f"{gain}.safetensors", gain) for gain in (9, 1, 2)]
    shared = ["--env", toy.ENV_ID, "--suite", suite, "--workers", "1", "--out", str(tmp_path / "c")]
    assert main(["evaluate", "--policies", *policies, *shared]) == 0
    assert not (tmp_path / "c" / "index.html").exists()
    written = {path.name: path.read_bytes() for path in (tmp_path / "c").iterdir() if path.is_file()}
    assert main(["compare", *policies[:2], *shared]) == 0
    after = {path.name: path.read_bytes() for path in (tmp_path / "c").iterdir() if path.is_file()}
    assert {name: after[name] for name in written} == written
    (page,) = (name for name in after if name.startswith("compare-"))
    assert set(after) - set(written) == {page, "index.html"}
    for name in ("report.html", page):
        assert f'<a href="{name}">' in after["index.html"].decode()
    assert main(["evaluate", "--policies", *policies, *shared]) == 0
    assert (tmp_path / "c" / page).read_bytes() == after[page]


def test_list(capsys):
    assert main(["list", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "PushRecovery/Biped-v0" in content["envs"]
    assert "two-stage" in content["policies"]
    assert [s["name"] for s in content["suites"]] == list(SUITE_NAMES)
    assert main(["list"]) == 0
    assert get_suite("quick").sha256 in capsys.readouterr().out


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
        (["evaluate", "--workers", "two"], ["--workers must be an integer, got 'two'"]),
        (["frontier", "--vx", "fast"], ["--vx must be a number, got 'fast'"]),
        (["compare", "two-stage"], ["required: B"]),
        (["suite", "new", "--out", "x.json"], ["required: --seed"]),
        (["compare", "a", "b", "c"], ["unrecognized arguments: c"]),
        (["frontier", "--policy"], ["--policies", "at least one"]),
        (["compare", "two-stage", "two-stage", "--env", toy.ENV_ID], ["more than once"]),
        (["frontier", "--directions", "0"], ["--directions must be an integer in [1, 3600], got 0"]),
        (["reproduce", "--directions", "3601"], ["--directions must be an integer in [1, 3600]"]),
        (["frontier", "--body", "head"], ["--body", "'head'", "'pelvis', 'trunk'"]),
        (["frontier", "--vx", "nan"], ["--vx", "nan"]),
        (["play", "--out", "film.avi", "--env", toy.ENV_ID], [".avi", ".mp4", ".png"]),
        (["play", "--suite", "quick", "--scenario", "quick-9999"], ["quick-9999", "quick-0000"]),
        (["train", "everything"], ["everything", "residual", "scratch"]),
        (["train", "residual", "--timesteps", "-1"], ["timesteps", "in [0, "]),
        (["train", "--pushes.impulse-min", "x"], ["--pushes.impulse-min must be a number, got 'x'"]),
        (["train", "--pushes.impulse-mi", "1"], ["did you mean --pushes.impulse-min?"]),
        (["train", "--hold", "long"], ["--hold must be an integer, got 'long'"]),
        (["train", "--log-std", "x"], ["--log-std x", "train --help"]),
        (["bench", "--seconds", "0"], ["--seconds", "0.1"]),
        (["evaluate", "--sute", "quick"], ["--sute", "did you mean --suite?"]),
        (["evaluate", "--policies"], ["--policies", "at least one"]),
        (["reproduce", "--out"], ["--out: expected one argument"]),
        (
            ["protocol", "tour", "--no-punches", "--episodes", "ten"],
            ["--episodes must be an integer, got 'ten'"],
        ),
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


def test_the_overview_names_every_command_and_the_version_is_that_of_the_package(capsys):
    assert main([]) == 0
    overview = capsys.readouterr().out
    assert all(f"  {name} " in overview for name in COMMANDS)
    assert main(["evaluate", "--help"]) == 0
    assert "usage: push-recovery evaluate" in capsys.readouterr().out
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"push-recovery {push_recovery.__version__}\n"


@pytest.mark.parametrize(
    "words", [("suite", "new"), ("robot", "new"), ("policy", "inspect"), ("protocol", "tour"), ("evaluate",)]
)
def test_a_usage_begins_as_the_command_does_that_asked_for_it(words, capsys):
    assert main([*words, "--help"]) == 0
    assert capsys.readouterr().out.startswith(f"usage: push-recovery {' '.join(words)} [-h]")


def test_the_help_of_suite_names_every_kind_that_it_draws(capsys):
    assert main(["suite", "new", "--help"]) == 0
    told = set(re.findall(r"[\w-]+", capsys.readouterr().out))
    assert {kind for kind in KINDS if not kind.startswith("shift-")} <= told


def test_flags_that_switch_something_off_say_so(capsys):
    assert main(["protocol", "--help"]) == 0
    told = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--no-punches Walk the tour without punches." in told
    assert "--no-collisions Let only feet and shanks collide (by default all legs" in told
    assert "(default: True)" not in told


def slow_ones_after(code):
    """What a process prints that does something with the command line, and then names its slow packages."""
    lines = ["import importlib, sys", "from push_recovery.eval.cli import main", code]
    lines += ["print(sorted({'matplotlib', 'mujoco', 'numba', 'scipy'} & sys.modules.keys()))"]
    argv = [sys.executable, "-c", "\n".join(lines)]
    return subprocess.run(argv, capture_output=True, text=True, timeout=60, check=True).stdout


def test_the_overview_loads_no_planner():
    """What is slow to load waits for a command that needs it."""
    assert slow_ones_after("main.main(['--help'])").endswith("[]\n")
    assert tuple(SUITES) == SUITE_NAMES


def test_options_are_read_before_anything_slow_is_loaded():
    """`--help` and a wrong word are answered at once; what a command needs is loaded when it runs."""
    own = [module for module, *_ in COMMANDS.values() if module.count(".") == 1]  # training is an extra
    code = "".join(f"importlib.import_module({name!r}, 'push_recovery.eval.cli')\n" for name in own)
    assert slow_ones_after(code) == "[]\n"


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (RuntimeError("broken\nin two lines"), 1, "RuntimeError: broken in two lines"),
        # what a file holds moves no cursor
        (InvalidValueError("for \x1b[2J\x1b]0;t\x07 and \ud800, not ψ"), 2,
         "for \\x1b[2J\\x1b]0;t\\x07 and \\ud800, not ψ"),
    ],
)  # fmt: skip
def test_an_error_inside_is_one_line_without_traceback(monkeypatch, capsys, error, code, line):
    monkeypatch.setattr(Names, "run", Mock(side_effect=error))
    assert main(["list"]) == code
    assert capsys.readouterr().err == f"push-recovery: error: {line}\n"


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


SCRIPT = "from push_recovery_command import main; raise SystemExit(main())"
MODULE = "runpy.run_module('push_recovery', run_name='__main__')"


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("command", "module"),
    [
        (SCRIPT, "gymnasium"), (SCRIPT, "push_recovery.eval.cli.main"), (SCRIPT, "numba"),
        (SCRIPT, "push_recovery.eval.cli.tools"), (MODULE, "numba"), (MODULE, "push_recovery.eval.cli.tools"),
        (MODULE, "push_recovery.eval.cli.main"),
    ],
)  # fmt: skip
def test_interrupt_while_the_command_starts_leaves_no_traceback(command, module):
    """Ctrl-C comes when the command is about to import a module."""
    code = f"""
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
sys.argv = ["push-recovery", "list"]
{command}
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 130, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "interrupted" in done.stderr


def test_play_says_first_what_it_writes_and_writes_a_contact_sheet(policy, tmp_path, capsys):
    out = tmp_path / "push.png"
    argv = ["play", "--env", toy.ENV_ID, "--policy", policy, "--force", "20", "--out", str(out)]
    assert main(argv) == 0
    assert out.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    told = capsys.readouterr()
    assert "recovered" in told.out
    assert lines_of(told.err)[0] == f"one episode of {policy}: about 20 seconds"


TOY = ("--env", toy.ENV_ID, "--suite", "SUITE", "--workers", "1")
PENDULUM = ("--env", "PushRecovery/Pendulum-v0", "--policies", "stage-1")
COMMANDS_ONE_WRITER = {
    "evaluate": ("evaluate", *TOY, "--policies", "POLICY"),
    "profiles": ("evaluate", *TOY, "--policies", "POLICY", "--profile", "hardware", "exact"),
    "compare": ("compare", "POLICY", "random", *TOY),
    "sensitivity": ("sensitivity", *TOY, "--sample", "2", "--policies", "POLICY"),
    "frontier": ("frontier", *PENDULUM, "--directions", "1", "--workers", "1"),
    "reproduce": ("reproduce", "limits", "--workers", "1"),
    "tune": ("tune", *PENDULUM, "--trials", "1", "--workers", "1"),
}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("name", COMMANDS_ONE_WRITER)
def test_a_second_writer_is_refused(tmp_path, capsys, name, overwrite):
    Suite("head", "1", get_suite("standard").scenarios[:2]).save(tmp_path / "suite.json")
    stands_for = {"SUITE": str(tmp_path / "suite.json")}
    stands_for["POLICY"] = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    words = [stands_for.get(word, word) for word in COMMANDS_ONE_WRITER[name]]
    out = tmp_path / "out"
    place = out / "hardware" if name == "profiles" else out
    with Writer(place):
        assert main([*words, "--out", str(out), *(["--overwrite"] if overwrite else [])]) == 2
        assert [path.name for path in place.iterdir()] == [LOCK]
    (line,) = capsys.readouterr().err.splitlines()  # nothing is announced that will not be done
    assert line.startswith("push-recovery: error: another run (process ")


def test_the_command_takes_it_with_trust_alone(tmp_path, capsys):
    sb3 = pytest.importorskip("stable_baselines3", reason="needs the extra train")
    path, suite = tmp_path / "model.zip", tmp_path / "suite.json"
    model = sb3.PPO("MlpPolicy", make_env(toy.ENV_ID), n_steps=8, batch_size=8, device="cpu", seed=3)
    model.save(path)
    Suite("head", "1", get_suite("standard").scenarios[:4]).save(suite)
    words = ["--env", toy.ENV_ID, "--suite", str(suite), "--workers", "1"]
    given = ["evaluate", "--policies", str(path), *words]
    assert main([*given, "--out", str(tmp_path / "no")]) == 2
    assert "--trust" in capsys.readouterr().err
    assert main([*given, "--trust", "--out", str(tmp_path / "yes"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["policies"][str(path)]["episodes"] == 4
    (first, *_) = (tmp_path / "yes" / "outcomes.jsonl").read_text().splitlines()
    assert len(json.loads(first)["policy_sha256"]) == 64
    other = toy.save_policy(tmp_path / "strong.safetensors", 8.0)
    assert main(["compare", str(path), other, *words, "--trust", "--out", str(tmp_path / "two")]) == 0


PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"
SHARING = {  # commands that write into a directory that they are given, at their smallest
    "evaluate": ["evaluate", "--env", PENDULUM, "--suite", "{few}", "--policies", "stage-1", "two-stage"],
    "compare": ["compare", "two-stage", "passive", "--env", PENDULUM, "--suite", "{few}"],
    "frontier": ["frontier", "--env", PENDULUM, "--policies", "two-stage", "--directions", "1",
                 "--replicas", "2", "--grid", "200"],
    "reproduce": ["reproduce", "limits", "--directions", "1"],
    "sensitivity": ["sensitivity", "--env", BIPED, "--suite", "standard", "--sample", "1",
                    "--variations", "elliptic"],
    "protocol": ["protocol", "kick", "--env", BIPED, "--episodes", "1"],
    "corrections": ["corrections", "residual", "--suite", "standard", "--sample", "1"],
    "curves": ["curves", "residual"],
    "basin": ["basin", "--env", PENDULUM, "--points", "2"],
}  # fmt: skip


def share(name, directory, folder):
    few = folder / "few.json"
    if not few.exists():
        Suite("few", "1", get_suite("quick-1").scenarios[:2]).save(few)
    workers = [] if name in {"corrections", "curves"} else ["--workers", "1"]
    words = [word.format(few=few) for word in SHARING[name]]
    return main([*words, *workers, "--out", str(directory)])


def content_of(directory):
    files = (path for path in directory.rglob("*") if path.is_file() and path.name != LOCK)
    return {str(path.relative_to(directory)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def alone(tmp_path_factory, sketching):
    """A folder with the output of each command in a directory of its own."""
    folder = tmp_path_factory.mktemp("alone")
    with sketching():
        for name in SHARING:
            assert share(name, folder / name, folder) == 0, name
    return folder


def test_two_policies_leave_page_and_reports_of_others_in_their_directory_alone(tmp_path, sketched):
    pytest.importorskip("jinja2", reason="needs the extra report")
    assert share("evaluate", tmp_path / "shared", tmp_path) == 0
    before = content_of(tmp_path / "shared")
    words = ["evaluate", "--env", PENDULUM, "--suite", str(tmp_path / "few.json"), "--workers", "1"]
    words += ["--out", str(tmp_path / "shared"), "--policies"]
    for policies in (["two-stage", "passive"], ["stage-1", "two-stage"]):  # another question, then the first
        assert main([*words, *policies]) == 0
        after = content_of(tmp_path / "shared")
        added = {f"report-two-stage-passive.{kind}" for kind in ("html", "json", "md")} | {"index.html"}
        assert after.keys() - before.keys() == added
        assert after["report.md"] == before["report.md"]
        told, first = (json.loads(one["report.json"]) for one in (after, before))
        assert told["policies"] == first["policies"]
        assert "passive" not in after["report.html"].decode()
        assert len(after["report.html"]) == len(before["report.html"])
        assert "passive" in after["report-two-stage-passive.html"].decode()
        assert list(json.loads(after["report-two-stage-passive.json"])["policies"]) == [
            "two-stage",
            "passive",
        ]
    assert (
        main([*words, "passive", "--overwrite"]) == 0
    )  # rows of the others are gone, and so is what tells of them
    kept = content_of(tmp_path / "shared")
    assert {name for name in kept if name != "config.json"} == {
        "outcomes.jsonl", "report.html", "report.json", "report.md"
    }  # fmt: skip
    assert list(json.loads(kept["report.json"])["policies"]) == ["passive"]


FRONTIER = ["frontier", "--env", PENDULUM, "--replicas", "2", "--grid", "200", "--policies"]
PROFILES = ["evaluate", "--suite", "{few}", "--policies", "stage-1", "--profile", "exact"]
AGAIN = {  # a command, and another question of the same one in the same directory
    "evaluate": (SHARING["evaluate"], [*SHARING["evaluate"][:-2], "passive"]),
    "profiles": ([*PROFILES, "hardware"], [*PROFILES, "weighed"]),
    "frontier": ([*FRONTIER, "stage-1", "--directions", "1"], [*FRONTIER, "two-stage", "--directions", "1"]),
    "directions": ([*FRONTIER, "stage-1", "--directions", "1"], [*FRONTIER, "stage-1", "--directions", "2"]),
    "corrections": (
        SHARING["corrections"], ["corrections", "residual-hardware", *SHARING["corrections"][2:]]
    ),
    "curves": (["curves", "residual"], ["curves", "joint-residual"]),
}  # fmt: skip


@pytest.mark.parametrize("name", AGAIN)
def test_another_question_changes_nothing_that_the_first_has_left(name, tmp_path, sketched):
    few, shared = tmp_path / "few.json", tmp_path / "shared"
    Suite("few", "1", get_suite("quick-1").scenarios[:2]).save(few)
    left = []
    for words in AGAIN[name]:
        words = [word.format(few=few) for word in words]
        workers = [] if words[0] in {"corrections", "curves"} else ["--workers", "1"]
        assert main([*words, *workers, "--out", str(shared)]) == 0
        left.append(content_of(shared))
    before, after = left
    for one in [one for one in before if one.endswith("outcomes.jsonl")]:
        assert after.pop(one).startswith(before.pop(one))
    timeless = [
        {one: re.sub(rb'"wall_time_s": [0-9.]+', b"", each.get(one, b"")) for one in before} for each in left
    ]
    assert timeless[0] == timeless[1]
    assert after.keys() > before.keys()


# `corrections` is slow; where it comes second, a page and a picture of others will do
PAIRS = [
    (first, second) for first, second in permutations(SHARING, 2)
    if second != "corrections" or first in {"evaluate", "curves"}
]  # fmt: skip


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_no_command_changes_what_another_one_has_left(first, second, alone, tmp_path, sketched):
    """Rows may be added, and an index names all pages; a directory of another configuration is refused."""
    shared = tmp_path / "shared"
    shutil.copytree(alone / first, shared)
    before = content_of(shared)
    code = share(second, shared, alone)
    after = content_of(shared)
    if code:
        assert (code, after) == (2, before)
        return
    rows = "outcomes.jsonl"
    assert after.pop(rows, b"").startswith(before.pop(rows, b""))
    assert {name: after.get(name) for name in before} == before
    assert after.keys() - before.keys() <= {*content_of(alone / second), "index.html"}


def test_starting_over_removes_reports_and_nothing_else_of_the_directory(tmp_path):
    assert share("evaluate", tmp_path / "shared", tmp_path) == 0
    (tmp_path / "shared/reports").mkdir()
    (tmp_path / "shared/reports-of-mine.txt").write_text("notes")
    few = str(tmp_path / "few.json")
    words = ["evaluate", "--env", PENDULUM, "--suite", few, "--workers", "1", "--policies", "passive"]
    assert main([*words, "--out", str(tmp_path / "shared"), "--overwrite"]) == 0
    assert (tmp_path / "shared/reports").is_dir()
    assert (tmp_path / "shared/reports-of-mine.txt").read_text() == "notes"
    assert list(json.loads((tmp_path / "shared/report.json").read_text())["policies"]) == ["passive"]
