"""A recorded episode against its rollout, the simulation and its mirror image; its files and its words."""

import csv
import io
import json

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.whole_body import gait_machine
from push_recovery.controllers.whole_body.kinematics import TRUNK, sole_position
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.pendulum import dynamics
from push_recovery.envs.scenario.disturbances import Impactor, Slip
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.api import rollout
from push_recovery.eval.cli.main import main
from push_recovery.eval.record import plot, style
from push_recovery.eval.record import record as records
from push_recovery.eval.record import words as wording
from push_recovery.eval.record.plot import write_plot
from push_recovery.eval.record.record import record
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.rollout.outcome import NOT_SETTLED, REASONS, Ending, Outcome, reason_words

PUSH = Push((90.0, 160.0, 0.0), 0.1, GaitEvent(2, "left", 0.4))
SHOVED = Scenario("shoved", (PUSH, Push((0.0, -80.0, 0.0), 0.033, 1.6)), Command(0.15), settle_time=1.0)
PENDULUM, BIPED = "PushRecovery/Pendulum-v0", "PushRecovery/Biped-v0"


@pytest.fixture(scope="module")
def shoved():
    return record("two-stage", SHOVED)


@pytest.mark.parametrize("env", [PENDULUM, BIPED])
def test_the_outcome_is_that_of_the_rollout_bit_for_bit(env, shoved):
    found = shoved if env == BIPED else record("two-stage", SHOVED, env)
    assert found.outcome == rollout("two-stage", SHOVED, env)
    assert len(found) == found.outcome.env_steps + 1
    assert found["time"][-1] == found.outcome.end_time
    assert set(found.columns) == set(found.units)
    assert not found["dcm_x"].flags.writeable


def test_pushes_deliver_their_impulses(shoved):
    periods = np.diff(shoved["time"])
    asked = np.sum([push.impulse for push in SHOVED.pushes], axis=0)
    for axis, impulse in zip("xyz", asked, strict=True):
        assert shoved[f"push_{axis}"][1:] @ periods == pytest.approx(impulse, abs=1e-9)
    acting = shoved["time"][shoved["push_x"] > 0.0]
    assert acting[0] > shoved.push_starts[0]
    assert acting[-1] < shoved.push_starts[0] + PUSH.duration + 0.01


def test_what_follows_a_law_is_recorded_as_it_is_delivered():
    """The outcome is the rollout's; the impulse of the columns is the measured, not the nominal one."""
    hit, slip = Impactor(10.0, 5.0, 0.5, direction=1.0), Slip("left", 0.1, 0.6, 0.2)
    scenario = Scenario("hit", disturbances=(hit, slip), settle_time=0.5)
    found = record("two-stage", scenario)
    assert found.outcome == rollout("two-stage", scenario)
    impulses = [found[f"push_{axis}"][1:] @ np.diff(found["time"]) for axis in "xyz"]
    delivered = found.outcome.measures["delivered"]
    assert np.linalg.norm(impulses) == pytest.approx(delivered, abs=1e-5)
    assert 50.0 < delivered < 75.0
    assert found.outcome.impulse == pytest.approx(50.0)
    assert found.push_starts == (0.5, 0.6)
    assert wording.push_words(found).startswith("50.0 N s (0.83 N s/kg) forward and to the left and 1 more")
    assert wording.describe(found).startswith("no push: ")  # the latest one is the slip
    assert "delivered" not in rollout("two-stage", SHOVED).measures


def test_limits_met_are_those_of_the_outcome(shoved):
    periods = np.diff(shoved["time"])
    outcome, since = shoved.outcome, shoved["time"][-1] - min(shoved.push_starts)
    for name in shoved.columns:
        if name.startswith(records.LIMIT):
            share = outcome.limit_shares.get(name.removeprefix(records.LIMIT), 0.0)
            assert shoved[name][1:] @ periods == pytest.approx(share * since, abs=1e-4)
    assert outcome.limit_shares


@pytest.mark.parametrize("side", ["left", "right"])
def test_places_and_leans_are_those_of_the_simulation(side):
    """While the robot turns, on either foot: soles, trunk and torques from MuJoCo's own state."""
    env = make_env(BIPED)
    episodes = env.unwrapped.episodes
    assert isinstance(episodes, BipedEpisodes)
    policy, core = load_policy("two-stage", env), episodes.core
    push = Push((40.0, 60.0, 0.0), 0.1, 0.7)
    observation, _ = env.reset(options={"scenario": Scenario("turn", (push,), Command(0.2, 0.0, 0.5), side)})
    recorder, data = records.Recorder(episodes, keep=1), core.simulations.data[0]
    for _ in range(130):
        observation, *_ = env.step(policy.predict(observation)[0])
        recorder()
    (row,) = recorder.rows
    assert row["heading"] > 0.3
    for leg, name in enumerate(("left", "right")):
        sole = sole_position(core.true_state(0), 0, leg)
        assert [row[f"{name}_sole_{axis}"] for axis in "xy"] == pytest.approx(sole[:2], abs=1e-9)
    up, heading = core.physics.xmat[0, TRUNK].reshape(3, 3)[:, 2], row["heading"]
    forward = up[0] * np.cos(heading) + up[1] * np.sin(heading)
    left = up[1] * np.cos(heading) - up[0] * np.sin(heading)
    assert row["trunk_pitch"] == pytest.approx(np.arcsin(forward), abs=2e-3)
    assert row["trunk_roll"] == pytest.approx(np.arcsin(left), abs=2e-3)
    assert abs(row["trunk_roll"]) > 0.01
    for joint in ("waist_pitch", "left_knee", "right_hip_roll"):
        assert row[records.TORQUE + joint] == data.actuator(joint).ctrl[0]
    assert recorder.bounds[records.TORQUE + "left_knee"] == 300.0
    env.close()


def test_a_planned_step_is_where_the_foot_lands(shoved):
    landed = np.flatnonzero(np.diff(shoved["step"])) + 1
    assert len(landed) >= 5
    for i in landed:
        side = ("left", "right")[int(shoved["stance_side"][i])]
        place = [shoved[f"{side}_sole_{axis}"][i] for axis in "xy"]
        planned = [shoved[f"planned_step_{axis}"][i - 1] for axis in "xy"]
        assert np.hypot(*np.subtract(place, planned)) < 0.04
        assert np.isnan(shoved["planned_step_x"][i])


def test_the_mirrored_episode_is_the_mirror_image():
    found, other = (record("two-stage", s, PENDULUM) for s in (SHOVED, SHOVED.mirrored()))
    for name in ("dcm", "cop", "cmp", "com", "planned_step", "push"):
        np.testing.assert_allclose(found[f"{name}_x"], other[f"{name}_x"], atol=1e-6)
        np.testing.assert_allclose(found[f"{name}_y"], -other[f"{name}_y"], atol=1e-6)
    np.testing.assert_allclose(found["left_sole_y"], -other["right_sole_y"], atol=1e-6)
    np.testing.assert_allclose(found["trunk_roll"], -other["trunk_roll"], atol=1e-6)
    np.testing.assert_allclose(found["torque_trunk_roll"], -other["torque_trunk_roll"], atol=1e-4)


def test_a_record_is_iterated_and_indexed_by_the_names_of_its_columns(shoved):
    assert list(shoved) == list(shoved.columns)
    assert "dcm_x" in shoved
    assert "dmc_x" not in shoved
    with pytest.raises(UnknownNameError, match="did you mean 'dcm_x'"):
        shoved["dmc_x"]
    with pytest.raises(TypeError, match=r"name of a column, got 3; .*record\['time'\]\[3\]"):
        shoved[3]
    with pytest.raises(TypeError, match="name of a column, got slice"):
        shoved[1:3]
    np.testing.assert_array_equal(shoved.points("cop"), np.stack([shoved["cop_x"], shoved["cop_y"]], axis=1))


def test_an_environment_of_another_project_is_refused():
    with pytest.raises(InvalidValueError, match="this project's own environments"):
        record("two-stage", SHOVED, "toy_gait_env:PushRecovery/Toy-v0")


ASIDE = Push((0.0, 150.0, 0.0), 0.1, 0.5)


@pytest.fixture(scope="module")
def episode():
    return record("two-stage", Scenario("aside", (ASIDE,), settle_time=0.5), PENDULUM)


def test_arrays_come_back_by_name_with_units(episode):
    with np.load(io.BytesIO(records.log_bytes(episode, ".npz")), allow_pickle=False) as file:
        assert file["columns"].tolist() == list(episode.columns)
        assert dict(zip(file["columns"].tolist(), file["units"].tolist(), strict=True)) == episode.units
        for name, column in episode.columns.items():
            np.testing.assert_array_equal(file[name], column)
        assert Scenario.from_json(str(file["scenario"])) == episode.scenario
        assert json.loads(str(file["outcome"]))["recovered"] == episode.outcome.recovered


def test_text_comes_back_to_the_last_bit(episode):
    rows = list(csv.reader(io.StringIO(records.log_bytes(episode, ".csv").decode())))
    assert rows[0][:4] == ["time [s]", "step [1]", "stance_side [1]", "heading [rad]"]
    numbers = np.array(rows[1:], dtype=np.float64)
    np.testing.assert_array_equal(numbers, np.stack(list(episode.columns.values()), axis=1))


def test_the_same_episode_gives_the_same_bytes_and_a_figure_is_a_picture(episode, tmp_path):
    for suffix in records.LOG_FORMATS:
        assert records.log_bytes(episode, suffix) == records.log_bytes(episode, suffix)
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
    assert all(words in out for words in ("recovered", str(log)))
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


def test_words_for_people_and_for_every_fall(episode):
    said = "15.0 N s (0.25 N s/kg) to the left"
    assert wording.impulse_words(ASIDE, 60.0) == wording.push_words(episode) == said
    assert wording.direction_words(-1.0, -0.9) == "backward and to the right"
    assert wording.direction_words(-1.0, 0.1) == "backward"
    assert set(REASONS) - {NOT_SETTLED} == {*gait_machine.FAILURES, *dynamics.FAILURES} - {""}
    assert reason_words("tripped") == "tripped"


@pytest.mark.parametrize("pushes", [(), (PUSH,), SHOVED.pushes, (Push((0.0, 900.0, 0.0), 0.1, 0.5),)])
def test_a_record_is_described_as_its_last_info(pushes):
    env, infos = make_env(PENDULUM), []
    scenario, policy = Scenario("x", pushes, settle_time=1.0, duration=3.0), load_policy("two-stage", env)
    found = records.record_episode(env, policy, scenario, "x", lambda robot: infos.append(robot.info))
    env.close()
    assert wording.describe(found) == wording.describe(infos[-1])


def test_an_episode_in_one_line_counts_from_its_last_push():
    push = {"impulse": (0.0, -52.8, 0.0), "start": 1.5}
    told = {"push": push, "time": 5.0, "failure_reason": None, "recovered_at": 2.9}
    lost = {"recovered_at": None, "failure_reason": "com_height", "time": 2.3}
    for changed, words in (
        ({}, "52.8 N s to the right: recovered after 1.4 s"),
        (
            {"recovered_at": None},
            "52.8 N s to the right: still up after 3.5 s, but does not walk as commanded",
        ),
        (lost, "52.8 N s to the right: fell after 0.8 s (sank too low)"),
        ({"push": None}, "no push: recovered after 2.9 s"),
        ({"recovered_at": 1.4}, "52.8 N s to the right: recovered after 0.0 s"),
    ):
        assert wording.describe({**told, **changed}) == words


def test_contacts_rates_and_planned_cop(shoved, episode):
    """A foot in the air has no contact, the other has one; rates are derivatives; the CoP is as asked."""
    for side, other in (("left", "right"), ("right", "left")):
        up = shoved[f"{side}_sole_z"] > 0.02
        assert up.sum() > 20
        assert not shoved[f"{side}_contact"][up].any()
        assert shoved[f"{other}_contact"][up].min() == 1.0
    for axis in ("pitch", "roll"):
        rate = np.gradient(shoved[f"trunk_{axis}"], shoved["time"])[1:-1]
        np.testing.assert_allclose(shoved[f"trunk_{axis}_rate"][1:-1], rate, atol=0.05)
    off = episode.points("planned_cop")[:-1] - episode.points("cop")[1:]
    assert np.nanmedian(np.abs(off)) < 1e-9


def test_commands_and_heights_are_recorded_by_their_names(shoved, episode):
    found = record("stage-1", Scenario("w", command=Command(0.1, -0.05, 0.2), duration=0.05))
    assert [found[f"command_{name}"][-1] for name in ("vx", "vy", "turn", "stand")] == [0.1, -0.05, 0.2, 0.0]
    sinks = record("passive", Scenario("x", duration=4.0))
    assert sinks.outcome.failure_reason == "com_height"
    assert sinks["com_z"][-1] < 0.7 < 0.79 < sinks["com_z"][0]
    assert shoved.sole == episode.sole == (0.2, 0.1)


def test_a_pendulum_does_what_was_planned():
    """A step lasts as long as planned, and the trunk's rate changes by the planned acceleration."""
    found = record("two-stage", SHOVED, PENDULUM)
    landed = np.flatnonzero(np.diff(found["step"])) + 1
    planned = found["planned_duration"][landed[1:] - 1]
    np.testing.assert_allclose(planned, np.diff(found["time"][landed]), atol=0.0101)
    within = np.diff(found["step"]) == 0
    for axis in ("roll", "pitch"):
        came = np.diff(found[f"trunk_{axis}_rate"]) / np.diff(found["time"])
        asked = found[f"planned_trunk_{axis}_acceleration"]
        np.testing.assert_allclose(asked[1:][within], came[within], atol=1e-6)
        assert np.isnan(asked[landed]).all()  # of the step that has ended
    largest = np.abs(found["planned_trunk_roll_acceleration"][1:][within]).max()
    assert largest == pytest.approx(150.0 / 8.0)


def test_a_figure_draws_touchdowns_pushes_soles_and_torques(episode, monkeypatch):
    spans = []
    monkeypatch.setattr(style, "shade_push", lambda axes, *span: spans.append(span))
    with style.print_style():
        left, forward, trunk, torques = plot.draw(episode).axes
    assert set(spans) == {(0.5, 0.1)}
    landed = episode["time"][np.flatnonzero(np.diff(episode["step"])) + 1]
    marks = [line.get_xdata()[0] for line in trunk.lines if line.get_color() == style.STEP_COLOUR]
    assert marks == landed.tolist()
    largest = np.maximum(*(np.abs(episode[f"torque_trunk_{lean}"]) for lean in ("pitch", "roll")))
    np.testing.assert_allclose(torques.lines[0].get_ydata(), largest / 150.0)
    for axes, axis, half in ((left, "y", 0.05), (forward, "x", 0.1)):
        soles = np.array([episode[f"{side}_sole_{axis}"] for side in ("left", "right")])
        low = min(soles.min() - half, episode[f"com_{axis}"].min())
        assert axes.get_ylim()[0] == pytest.approx(low - 0.06)


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (Ending(False, 6.0, 4.25, None, 0.0), "recovered, from 4.25 s on"),
        (Ending(False, 6.0, None, None, 0.0), "survived 6.00 s, not settled"),
        (Ending(True, 3.5, 2.0, "com_height", 0.0), "fell after 3.50 s (sank too low)"),
    ],
)
def test_a_verdict_says_how_an_episode_ended(ending, words):
    assert wording.verdict(Outcome.of(Scenario("a"), "p", ending, 1)) == words
