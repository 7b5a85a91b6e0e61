"""Bad input, rule by rule: what each module refuses stands in its own tests.

Here: physical constants and limits, the error classes, atomic files, and the command.
"""

import json
import math
import re
import subprocess
import sys
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import (
    InvalidValueError,
    MissingExtraError,
    PushRecoveryError,
    UnknownNameError,
)
from push_recovery.controllers.files import write_atomically
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel, natural_frequency
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.mlp import Mlp, Normalisation
from push_recovery.controllers.settings import PlannerConfig
from push_recovery.eval.cli.main import main
from push_recovery.eval.score.suites import Suite, get_suite

PENDULUM = "PushRecovery/Pendulum-v0"


def save_network(path, inputs=36, robot=None):
    """A policy file that asks for the middle of the box, made for `inputs` observations and a robot."""
    network = Mlp((np.zeros((7, inputs), dtype=np.float32),), (np.zeros(7, dtype=np.float32),))
    about = PolicyDescription(PENDULUM, robot or RobotModel(), GaitLimits())
    NetworkPolicy(network, Normalisation(np.zeros(inputs), np.ones(inputs)), about).save(path)
    return str(path)


def numbers_of(kind):
    """Names of the fields that are numbers."""
    return [field.name for field in fields(kind) if isinstance(field.default, float)]


# Limits and physical constants


@pytest.mark.parametrize("name", numbers_of(RobotModel))
@pytest.mark.parametrize("value", [-60.0, 0.0, math.nan, math.inf])
def test_physical_constants_are_positive_and_finite(name, value):
    with pytest.raises(InvalidValueError, match=rf"RobotModel\.{name} must be positive.*{value}"):
        RobotModel(**{name: value})


@pytest.mark.parametrize("name", ["length", "width", "duration"])
@pytest.mark.parametrize("gap", [0.0, -0.1])
def test_a_range_whose_ends_meet_or_cross_is_refused(name, gap):
    with pytest.raises(InvalidValueError, match=rf"{name}_min must be below {name}_max, got 0\.7 >= 0\.[67]"):
        GaitLimits(**{f"{name}_min": 0.7, f"{name}_max": 0.7 + gap})


@pytest.mark.parametrize("name", numbers_of(GaitLimits))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_limits_are_finite(name, value):
    with pytest.raises(InvalidValueError, match=rf"GaitLimits\.{name} must be finite, got {value}"):
        GaitLimits(**{name: value})


@pytest.mark.parametrize("name", ["duration_min", "cop_x_max", "cop_y_max", "trunk_acceleration_max"])
@pytest.mark.parametrize("value", [0.0, -0.1])
def test_times_and_symmetric_bounds_are_positive(name, value):
    with pytest.raises(InvalidValueError, match=rf"GaitLimits\.{name} must be (positive|at least).*{value}"):
        GaitLimits(**{name: value})


@pytest.mark.parametrize("kind", [RobotModel, GaitLimits, PlannerConfig])
@pytest.mark.parametrize("value", ["heavy", None, True, [1.0]])
def test_constants_are_numbers(kind, value):
    name = next(field.name for field in fields(kind) if isinstance(field.default, float))
    with pytest.raises(InvalidValueError, match=rf"{kind.__name__}\.{name}.*{re.escape(repr(value))}"):
        kind(**{name: value})


@pytest.mark.parametrize("value", [-1, -1.0, math.nan])
@pytest.mark.parametrize("name", [f.name for f in fields(PlannerConfig) if isinstance(f.default, float)])
def test_weights_and_margins_are_not_negative(name, value):
    with pytest.raises(InvalidValueError, match=rf"PlannerConfig\.{name}.*{value}"):
        PlannerConfig(**{name: value})


@pytest.mark.parametrize("name", ["form", "solver", "jerk_cost"])
def test_an_unknown_option_of_the_planner_is_no_silent_default(name):
    with pytest.raises(UnknownNameError, match=rf"PlannerConfig\.{name} 'other'.*valid: "):
        PlannerConfig(**{name: "other"})


@pytest.mark.parametrize("values", [{"tail_intervals": -1}, {"tail_intervals": 1.5}, {"use_cop": "no"}])
def test_counts_and_switches_of_the_planner(values):
    with pytest.raises(InvalidValueError, match=f"PlannerConfig.{next(iter(values))}"):
        PlannerConfig(**values)


@pytest.mark.parametrize("height", [0.0, -0.8, math.nan])
def test_a_pendulum_has_a_height(height):
    with pytest.raises(InvalidValueError, match=f"com_height.*{height}"):
        natural_frequency(height)


# One root, and messages that name the valid choices


@pytest.mark.parametrize("kind", [InvalidValueError, UnknownNameError])
def test_errors_of_values_and_names_are_value_errors_too(kind):
    assert issubclass(kind, PushRecoveryError)
    assert issubclass(kind, ValueError)


def test_a_missing_extra_is_an_import_error_with_the_command():
    error = MissingExtraError("torch", "train")
    assert isinstance(error, PushRecoveryError)
    assert isinstance(error, ImportError)
    assert "pip install 'push-recovery[train]'" in str(error)


def test_an_unknown_name_gets_the_nearest_and_all_valid_ones():
    text = str(UnknownNameError("policy", "two-stages", ["passive", "two-stage"]))
    assert text == "unknown policy 'two-stages'; did you mean 'two-stage'? (valid: passive, two-stage)"
    assert "did you mean" not in str(UnknownNameError("policy", "zzz", ["passive", "two-stage"]))


def test_a_film_without_imageio_names_the_extra(monkeypatch, tmp_path):
    from push_recovery.eval.cli.play import Written, show_episode

    monkeypatch.setitem(sys.modules, "imageio.v2", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'push-recovery\[view\]'"):
        show_episode(PENDULUM, "passive", get_suite("standard").scenarios[0], Written(tmp_path / "film.mp4"))
    assert list(tmp_path.iterdir()) == []


# Spaces


@pytest.mark.parametrize("env_id", ["Pendulum", "Biped", "BipedResidual"])
@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.full(7, np.nan), "finite.*nan"),
        (np.zeros(6), r"\(7,\).*\(6,\)"),
        (np.zeros((1, 7)), r"\(1, 7\)"),
        ("left", "numbers"),
    ],
)
def test_gym_make_refuses_bad_actions_in_the_projects_own_words(env_id, action, words):
    env = gym.make(f"push_recovery:PushRecovery/{env_id}-v0")
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match=words):
        env.step(action)
    env.step(np.zeros(7, np.float32))  # the episode goes on
    env.close()


@pytest.mark.parametrize("env_id", ["Pendulum", "Biped", "BipedResidual"])
def test_push_distribution_and_options_have_their_types(env_id):
    with pytest.raises(InvalidValueError, match=r"push_distribution must be.*3"):
        gym.make(f"push_recovery:PushRecovery/{env_id}-v0", push_distribution=3)
    env = gym.make(f"push_recovery:PushRecovery/{env_id}-v0")
    with pytest.raises(InvalidValueError, match="options must be a dict, got 5"):
        env.reset(options=5)
    env.close()


# Files: whole or absent


def test_a_write_that_fails_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "report.md"
    write_atomically(path, b"old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, b"half of the new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.md"]
    assert path.read_bytes() == b"old"


# The command itself


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Run a command; it must exit with 2, print one line on standard error alone, and make no file."""

    def run(*argv):
        monkeypatch.chdir(tmp_path)
        before = sorted(path.name for path in tmp_path.rglob("*"))
        assert main(argv) == 2
        printed, line = capsys.readouterr()
        assert printed == ""
        assert len(line.splitlines()) == 1, line
        assert line.startswith("push-recovery")
        assert "error: " in line
        assert sorted(path.name for path in tmp_path.rglob("*")) == before
        return line

    return run


def test_in_a_process_of_its_own_it_says_the_same(refused, tmp_path):
    argv = ["evaluate", "--env", PENDULUM, "--policies", "two-stag"]
    command = [sys.executable, "-m", "push_recovery", *argv]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", refused(*argv))


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["evaluate", "--policies", "two-stag"], ["'two-stag'", "did you mean 'two-stage'", "passive"]),
        (["evaluate", "--env", "PushRecovery/Robot-v0", "--json"], ["Robot-v0", PENDULUM]),
        (["compare", "two-stage", "stage1", "--suite", "quick"], ["'stage1'", "stage-1+momentum"]),
        (["frontier", "--env", PENDULUM, "--policy", "three-stage"], ["three-stage", "two-stage"]),
        (["play", "--env", PENDULUM, "--policy", "nobody", "--out", "a.png"], ["nobody", "passive"]),
        (["train", "residual", "--env", "PushRecovery/Bipd-v0"], ["Bipd", "PushRecovery/Biped-v0"]),
        (["evaluate", "--env", PENDULUM, "--out", ""], ["--out", "empty"]),
        (["train", "residual", "--out", ""], ["--out", "empty"]),
        (["bench", "--env", "pendulum"], ["'pendulum'", PENDULUM]),
    ],
)
def test_unknown_names_end_every_command_with_one_line_and_no_file(argv, words, refused):
    line = refused(*argv)
    assert all(word in line for word in words), line


def test_a_changed_suite_is_refused_with_both_hashes(tmp_path, refused):
    path = tmp_path / "mine.json"
    Suite("mine", "1", get_suite("standard").scenarios[:2]).save(path)
    content = json.loads(path.read_text())
    content["scenarios"][0]["pushes"][0]["force"][1] += 1.0
    path.write_text(json.dumps(content))
    line = refused("evaluate", "--env", PENDULUM, "--suite", "mine.json")
    assert content["sha256"] in line
    assert "mine.json" in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"body": "head"}, ["'head'", "pelvis", "trunk"]),
        ({"force": [0.0, math.nan, 0.0]}, ["force", "finite", "nan"]),
        ({"duration": -0.1}, ["duration", "-0.1"]),
        ({"when": 3.0}, ["'when'", "start"]),
    ],
)
def test_an_impossible_push_in_a_suite_is_named(change, words, tmp_path, refused):
    push = {"force": [1.0, 0.0, 0.0], "duration": 0.1, "start": 1.0, **change}
    suite = {"name": "mine", "version": "1", "scenarios": [{"id": "a", "pushes": [push]}]}
    (tmp_path / "mine.json").write_text(json.dumps(suite))
    line = refused("evaluate", "--env", PENDULUM, "--suite", "mine.json", "--out", "out")
    assert all(word in line for word in words), line


def test_policies_made_for_others_are_refused(tmp_path, refused):
    save_network(tmp_path / "small.safetensors", inputs=12)
    save_network(tmp_path / "heavy.safetensors", robot=RobotModel(mass=70.0))
    argv = ["evaluate", "--env", PENDULUM, "--out", "out", "--policies"]
    line = refused(*argv, "small.safetensors")
    assert all(word in line for word in ("small.safetensors", "made for 12 observations", "(36,)"))
    line = refused(*argv, "heavy.safetensors")
    assert "mass" in line
    assert "70" in line


def test_a_policy_without_its_weights_is_refused(tmp_path, refused):
    save_network(tmp_path / "p.safetensors")
    (tmp_path / "p.safetensors").unlink()
    line = refused("evaluate", "--env", PENDULUM, "--policies", "p.json")
    assert "p.safetensors" in line


def test_whole_actions_are_not_scored_as_residuals(refused):
    line = refused("evaluate", "--env", "PushRecovery/BipedResidual-v0", "--policies", "two-stage")
    assert "residuals" in line
    assert "PushRecovery/Biped-v0" in line


@pytest.mark.parametrize("name", numbers_of(RobotModel))
@pytest.mark.parametrize("value", [1e-300, 0.99e-4, 1.01e6, 1e300])
def test_physical_constants_have_bounds(name, value):
    with pytest.raises(InvalidValueError, match=rf"RobotModel\.{name} must lie in \[0.0001, 1e\+06\]"):
        RobotModel(**{name: value})


@pytest.mark.parametrize("kind", [RobotModel, GaitLimits])
def test_constants_beyond_floats_are_refused(kind):
    for name in numbers_of(kind):
        with pytest.raises(InvalidValueError, match=rf"{kind.__name__}\.{name} must be .*finite"):
            kind(**{name: 10**400})


@pytest.mark.parametrize("value", [1e-300, 0.0099, 0.0, -1.0])
def test_the_shortest_step_has_a_bound(value):
    GaitLimits(duration_min=0.01)
    with pytest.raises(InvalidValueError, match=r"GaitLimits.duration_min must be at least 0.01 s"):
        GaitLimits(duration_min=value)
