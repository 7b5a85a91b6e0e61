"""What a command says before and during its work: on a terminal, and where standard error is a log."""

import io
import sys

import pytest
from push_recovery.eval.output import progress
from push_recovery.eval.output.progress import INTERVAL, Work, progress_bars, repeat

WORK = Work("3 films", "about a minute")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminal(monkeypatch):
    """Makes a terminal of standard error."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    return sys.stderr


def test_a_log_gets_the_work_first_and_at_its_end_what_was_done(capsys):
    with progress_bars(["films"], 3, WORK, {"films": 1}) as bars:
        assert capsys.readouterr().err == f"{WORK}\n"
        bars.set("films", 3, "both fall")
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "3/3 in 0:00:00 (films both fall)\n"


def test_an_error_is_not_followed_by_a_count(capsys):
    with pytest.raises(KeyError), progress_bars(["films"], 3):
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
    with progress_bars(["search"], 10):
        pass
    assert INTERVAL == 30.0
    assert asked == [INTERVAL] * 5
    assert capsys.readouterr().err.splitlines() == ["0/10 in 0:00:00"] * 5


def test_lines_end_with_the_work():
    waits, told = iter([False, False, True]), []
    repeat(lambda: told.append("line"), lambda seconds: next(waits))
    assert told == ["line"] * 2


def test_a_terminal_gets_the_work_first_and_bars(monkeypatch):
    shown = terminal(monkeypatch)
    with progress_bars(["two-stage", "stage-1"], 3, WORK) as bars:
        bars.set("stage-1", 2, "recovered 0.5")
    text = shown.getvalue()
    assert text.startswith(f"{WORK}\n")
    assert "two-stage" in text
    assert "2/3" in text
    assert "recovered 0.5" in text
    assert " in 0:00:00" not in text


def test_work_that_is_timed_gets_lines_on_a_terminal_too(monkeypatch):
    shown = terminal(monkeypatch)
    with progress_bars(["bench"], 1, WORK, moving=False) as bars:
        bars.set("bench", 1)
    assert shown.getvalue() == f"{WORK}\n1/1 in 0:00:00 (bench)\n"
