"""Lines of progress, by a clock that the test moves."""

import io

import pytest
from push_recovery.eval.output.progress import Lines


class Clock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def told(lines, out):
    """The line that `tell` writes."""
    before = len(out.getvalue())
    lines.tell()
    text = out.getvalue()[before:]
    assert text.endswith("\n")
    return text[:-1]


def test_a_line_tells_all_of_it_and_what_has_moved_since_the_last_one(clock):
    out = io.StringIO()
    lines = Lines(["two-stage", "stage-1"], 100, {}, out, clock)
    clock.now += 30.0
    lines.set("two-stage", 50, "recovered 0.900")
    assert told(lines, out) == "50/200 in 0:00:30, about 0:01:30 left (two-stage 50/100 recovered 0.900)"
    clock.now += 30.0
    assert told(lines, out) == "50/200 in 0:01:00, about 0:03:00 left"
    lines.set("two-stage", 100, "recovered 0.910")
    lines.set("stage-1", 20)
    assert told(lines, out) == (
        "120/200 in 0:01:00, about 0:00:40 left (two-stage 100/100 recovered 0.910, stage-1 20/100)"
    )
    lines.set("stage-1", 100)
    assert told(lines, out) == "200/200 in 0:01:00 (stage-1 100/100)"


def test_what_was_there_before_counts_as_done_but_took_no_time(clock):
    out = io.StringIO()
    lines = Lines(["ceiling"], 60, {"ceiling": 40}, out, clock)
    clock.now += 3600.0
    assert told(lines, out) == "40/60 in 1:00:00"
    lines.set("ceiling", 50, "answered 9")
    assert told(lines, out) == "50/60 in 1:00:00, about 1:00:00 left (ceiling answered 9)"
