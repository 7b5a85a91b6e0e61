"""Words of a command before and during its work, on a terminal and in a log, by a clock that a test moves."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from push_recovery.envs.scenario.model_errors import PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.output import progress


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture(autouse=True)
def compiled(monkeypatch):
    """No kernel has been compiled lately, whatever other tests of this process do."""
    monkeypatch.setattr(progress, "compiles_lately", lambda: False)


def told(lines, out):
    """The line that `tell` writes."""
    before = len(out.getvalue())
    lines.tell()
    text = out.getvalue()[before:]
    assert text.endswith("\n")
    return text[:-1]


def test_a_line_tells_all_of_it_and_what_has_moved_since_the_last_one():
    clock, out = Clock(), io.StringIO()
    lines = progress.Lines(["two-stage", "stage-1"], 100, {}, out, clock)
    clock.now += 30.0
    lines.set("two-stage", 50, "recovered 0.900")
    assert told(lines, out) == "50/200 in 0:00:30, about 0:01:30 left (two-stage 50/100 recovered 0.900)"
    clock.now += 30.0
    assert told(lines, out) == "50/200 in 0:01:00, about 0:03:00 left"
    lines.set("two-stage", 100, "recovered 0.910")
    lines.set("stage-1", 20)
    assert told(lines, out) == (
        "120/200 in 0:01:00, about 0:00:34 left (two-stage 100/100 recovered 0.910, stage-1 20/100)"
    )
    lines.set("stage-1", 100)
    assert told(lines, out) == "200/200 in 0:01:00 (stage-1 100/100)"


def test_what_comes_before_the_first_piece_counts_for_no_rate():
    """A start-up of 30 s, then 1 % a second."""
    clock, out = Clock(), io.StringIO()
    lines = progress.Lines(["training"], 1000, {}, out, clock)
    clock.now += 30.0
    lines.set("training", 10)
    assert told(lines, out) == "10/1000 in 0:00:30 (training)"
    clock.now += 9.0
    lines.set("training", 100)
    assert told(lines, out) == "100/1000 in 0:00:39, about 0:01:30 left (training)"


def test_what_was_there_before_counts_as_done_but_took_no_time():
    clock, out = Clock(), io.StringIO()
    lines = progress.Lines(["ceiling"], 60, {"ceiling": 40}, out, clock)
    clock.now += 3600.0
    assert told(lines, out) == "40/60 in 1:00:00"
    lines.set("ceiling", 50, "answered 9")
    assert told(lines, out) == "50/60 in 1:00:00, about 1:00:00 left (ceiling answered 9)"


def test_while_it_compiles_it_says_so_until_the_first_piece_is_done(monkeypatch):
    clock, out = Clock(), io.StringIO()
    monkeypatch.setattr(progress, "compiles_lately", lambda: True)
    lines = progress.Lines(["two-stage"], 10, {}, out, clock)
    clock.now += 30.0
    assert told(lines, out) == "0/10 in 0:00:30, compiling, about 2 minutes"
    lines.set("two-stage", 5)
    assert told(lines, out) == "5/10 in 0:00:30, about 0:00:30 left (two-stage)"
    there = progress.Lines(["two-stage"], 10, {"two-stage": 10}, out, clock)
    assert told(there, out) == "10/10 in 0:00:00"


FORCE = (100.0, 0.0, 0.0)


GUESSES = {
    "nothing is left to run": (0.0,),
    "a few seconds": (0.1, 9.9),
    "about 10 seconds": (10.0, 12.0),
    "about 15 seconds": (17.0,),
    "about 20 seconds": (19.0, 20.0, 24.0),
    "about 40 seconds": (43.0,),
    "about 90 seconds": (89.0,),
    "about 2 minutes": (90.0, 91.0),
    "about 9 minutes": (9.4 * 60.0,),
    "about 15 minutes": (13 * 60.0,),
    "about 40 minutes": (44 * 60.0,),
    "about 90 minutes": (89 * 60.0,),
    "about 2 hours": (90 * 60.0, 91 * 60.0),
}


@pytest.mark.parametrize(("words", "lasting"), GUESSES.items())
def test_a_guess_is_told_as_people_say_it(words, lasting):
    assert {progress.about(seconds) for seconds in lasting} == {words}


def test_work_says_what_how_long_and_where():
    assert str(progress.Work("3 films", "about 2 minutes")) == "3 films: about 2 minutes"
    there = str(progress.Work("3 films", "about 2 minutes", Path("runs") / "films"))
    assert there == f"3 films: about 2 minutes; output in {Path('runs') / 'films'}"


def test_the_guess_is_linear_in_what_is_simulated_and_in_the_processes():
    one = progress.robot_seconds("PushRecovery/Biped-v0", 100.0)
    assert progress.robot_seconds("PushRecovery/Biped-v0", 300.0) == pytest.approx(3.0 * one)
    assert progress.robot_seconds("PushRecovery/Biped-v0", 100.0, 4) == pytest.approx(one / 4.0)
    assert progress.robot_seconds("PushRecovery/Biped-v0", 100.0, 0) == one
    assert one == pytest.approx(1.5)  # 15 ms of a core for a second of a biped
    assert (
        progress.robot_seconds("PushRecovery/Pendulum-v0", 100.0)
        < one
        < progress.robot_seconds("mine:Robot-v0", 100.0)
    )


def test_an_episode_lasts_until_its_robot_has_had_time_to_settle():
    env = "PushRecovery/Biped-v0"
    pushed = Scenario("a", (Push(FORCE, 0.5, 3.5),), settle_time=4.0)
    assert progress.episode_seconds(env, [pushed]) == pytest.approx(progress.robot_seconds(env, 8.0))
    fixed = Scenario("b", (Push(FORCE, 0.5, 3.5),), Command(0.2), duration=20.0)
    assert progress.episode_seconds(env, [pushed, fixed]) == pytest.approx(progress.robot_seconds(env, 28.0))
    waits = Scenario("c", (Push(FORCE, 0.5, GaitEvent(4, "left", 0.0)),), settle_time=4.0)
    assert progress.episode_seconds(env, [waits]) == pytest.approx(
        progress.robot_seconds(env, 6.5)
    )  # at about 2 s
    onboard = replace(waits, sensing="onboard", physics=PhysicsOptions(time_step=0.0005))
    assert progress.episode_seconds(env, [onboard]) == pytest.approx(
        4.0 * progress.SENSING * progress.episode_seconds(env, [waits])
    )
    twice = Scenario("d", (Push(FORCE, 0.5, 3.5), Push(FORCE, 0.1, 1.0)), settle_time=4.0)
    assert progress.episode_seconds(env, [twice]) == pytest.approx(progress.robot_seconds(env, 8.0))
    assert progress.episode_seconds(env, [pushed], 2) == pytest.approx(progress.robot_seconds(env, 4.0))
    assert progress.episode_seconds(env, []) == 0.0


WORK = progress.Work("3 films", "about a minute")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch):
    """Makes a terminal of standard error."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    return sys.stderr


def test_a_log_gets_the_work_first_and_at_its_end_what_was_done(capsys):
    with progress.progress_bars(["films"], 3, WORK, {"films": 1}) as bars:
        assert capsys.readouterr().err == f"{WORK}\n"
        bars.set("films", 3, "both fall")
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "3/3 in 0:00:00 (films both fall)\n"


def test_an_error_is_not_followed_by_a_count(capsys):
    with pytest.raises(KeyError), progress.progress_bars(["films"], 3):
        raise KeyError
    assert capsys.readouterr() == ("", "")


def test_a_line_comes_every_half_minute_while_one_piece_of_work_lasts(capsys, monkeypatch):
    """The time between two counts may be long: who waits for a line does not wait for a count."""
    asked = []

    class Over:
        def wait(self, seconds):
            asked.append(seconds)
            return len(asked) > 4

        def set(self):
            pass

    monkeypatch.setattr(progress, "Event", Over)
    with progress.progress_bars(["search"], 10):
        pass
    assert progress.INTERVAL == 30.0
    assert asked == [progress.INTERVAL] * 5
    assert capsys.readouterr().err.splitlines() == ["0/10 in 0:00:00"] * 5


def test_lines_end_with_the_work():
    waits, told = iter([False, False, True]), []
    progress.repeat(lambda: told.append("line"), lambda seconds: next(waits))
    assert told == ["line"] * 2


def test_a_terminal_gets_the_work_first_and_bars(monkeypatch):
    shown = terminal(monkeypatch)
    with progress.progress_bars(["two-stage", "stage-1"], 3, WORK) as bars:
        bars.set("stage-1", 2, "recovered 0.5")
    text = shown.getvalue()
    assert text.startswith(f"{WORK}\n")
    assert all(words in text for words in ("two-stage", "2/3", "recovered 0.5"))
    assert " in 0:00:00" not in text


def test_bars_run_to_and_fro_until_the_first_piece_is_done(monkeypatch):
    shown = terminal(monkeypatch)
    monkeypatch.setattr(progress, "compiles_lately", lambda: True)
    with progress.progress_bars(["two-stage", "stage-1"], 3, begun={"stage-1": 1}) as bars:
        assert [task.total for task in bars.tasks] == [None, 3]
        bars.refresh()
        assert shown.getvalue().count("compiling, about 2 minutes") == 1
        bars.set("two-stage", 1)
        assert [(task.total, task.completed) for task in bars.tasks] == [(3, 1), (3, 1)]


def test_work_that_is_timed_gets_lines_on_a_terminal_too(monkeypatch):
    shown = terminal(monkeypatch)
    with progress.progress_bars(["bench"], 1, WORK, moving=False) as bars:
        bars.set("bench", 1)
    assert shown.getvalue() == f"{WORK}\n1/1 in 0:00:00 (bench)\n"
