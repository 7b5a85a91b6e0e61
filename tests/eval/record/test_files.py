"""What is written of an episode is what was recorded."""

import csv
import io
import json

import numpy as np
import pytest
from push_recovery.controllers.whole_body import gait_machine
from push_recovery.envs.pendulum import dynamics
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.cli.main import main
from push_recovery.eval.record.plot import write_plot
from push_recovery.eval.record.record import LOG_FORMATS, log_bytes, record
from push_recovery.eval.record.words import (
    FALLS,
    describe,
    direction_words,
    fall_words,
    impulse_words,
    push_words,
)

PENDULUM = "PushRecovery/Pendulum-v0"
PUSH = Push((0.0, 150.0, 0.0), 0.1, 0.5)


@pytest.fixture(scope="module")
def episode():
    return record("two-stage", Scenario("aside", (PUSH,), settle_time=0.5), PENDULUM)


def test_arrays_come_back_by_name_with_units(episode):
    with np.load(io.BytesIO(log_bytes(episode, ".npz")), allow_pickle=False) as file:
        assert file["columns"].tolist() == list(episode.columns)
        assert dict(zip(file["columns"].tolist(), file["units"].tolist(), strict=True)) == episode.units
        for name, column in episode.columns.items():
            np.testing.assert_array_equal(file[name], column)
        assert Scenario.from_json(str(file["scenario"])) == episode.scenario
        assert json.loads(str(file["outcome"]))["recovered"] == episode.outcome.recovered


def test_text_comes_back_to_the_last_bit(episode):
    rows = list(csv.reader(io.StringIO(log_bytes(episode, ".csv").decode())))
    assert rows[0][:4] == ["time [s]", "step [1]", "stance_side [1]", "heading [rad]"]
    numbers = np.array(rows[1:], dtype=np.float64)
    np.testing.assert_array_equal(numbers, np.stack(list(episode.columns.values()), axis=1))


@pytest.mark.parametrize("suffix", LOG_FORMATS)
def test_the_same_episode_gives_the_same_bytes(episode, suffix):
    assert log_bytes(episode, suffix) == log_bytes(episode, suffix)


def test_a_figure_is_a_picture_and_the_same_twice(episode, tmp_path):
    for name, head in (("a.png", b"\x89PNG\r\n\x1a\n"), ("a.svg", b"<?xml")):
        write_plot(episode, tmp_path / name)
        once = (tmp_path / name).read_bytes()
        assert once.startswith(head)
        write_plot(episode, tmp_path / name)
        assert (tmp_path / name).read_bytes() == once


def test_play_writes_log_and_plot_and_opens_no_window(tmp_path, capsys):
    log, plot = tmp_path / "episode.csv", tmp_path / "episode.png"
    argv = ["play", "--env", PENDULUM, "--force", "20", "--log", str(log), "--plot", str(plot)]
    assert main(argv) == 0
    out = capsys.readouterr().out
    assert "recovered" in out
    assert str(log) in out
    assert log.read_text().startswith("time [s],")
    assert plot.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("option", "name", "words"),
    [("--log", "a.txt", [".txt", ".npz", ".csv"]), ("--plot", "a.gif", [".gif", ".png", ".svg"])],
)
def test_another_format_is_refused_before_the_episode(option, name, words, tmp_path, capsys):
    assert main(["play", "--env", PENDULUM, option, str(tmp_path / name)]) == 2
    err = capsys.readouterr().err
    assert all(word in err for word in words)
    assert list(tmp_path.iterdir()) == []


def test_words_for_people(episode):
    assert impulse_words(PUSH, 60.0) == "15.0 N s (0.25 N s/kg) to the left"
    assert push_words(episode) == "15.0 N s (0.25 N s/kg) to the left"
    assert direction_words(-1.0, -0.9) == "backward and to the right"
    assert direction_words(-1.0, 0.1) == "backward"


def test_every_fall_has_words_and_one_of_another_environment_keeps_its_name():
    assert set(FALLS) == {*gait_machine.FAILURES, *dynamics.FAILURES} - {""}
    assert fall_words("tripped") == "tripped"


def test_an_episode_in_one_line_counts_from_its_last_push():
    push = {"impulse": (0.0, -52.8, 0.0), "start": 1.5}
    told = {"push": push, "time": 5.0, "failure_reason": None, "recovered_at": 2.9}
    assert describe(told) == "52.8 N s to the right: recovered after 1.4 s"
    assert describe({**told, "recovered_at": None}) == (
        "52.8 N s to the right: still up after 3.5 s, but does not walk as told"
    )
    fell = {**told, "recovered_at": None, "failure_reason": "com_height", "time": 2.3}
    assert describe(fell) == "52.8 N s to the right: fell after 0.8 s (sank too low)"
    assert describe({**told, "push": None}) == "no push: recovered after 2.9 s"
    assert describe({**told, "recovered_at": 1.4}).endswith("recovered after 0.0 s")
