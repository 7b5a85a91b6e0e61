"""Checks of user input, and robots that differ, in words."""

import json
import math
from dataclasses import asdict, dataclass

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers import validation
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError, is_finite_number, shown
from push_recovery.controllers.jit import RangeThreads
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.controllers.policies.learned import NetworkPolicy, PolicyDescription
from push_recovery.controllers.policies.two_stage import TwoStagePolicy
from push_recovery.controllers.settings import PlannerConfig, load_preset
from push_recovery.controllers.validation import differences, parse_json, require_integer, require_number
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.envs.wrappers import ActionHold
from push_recovery.eval.ceiling import Answers
from push_recovery.eval.score.suites import load_suite

BEYOND_FLOATS = 10**400
BEYOND_TEXT = 10**5000  # more digits than Python writes


@pytest.mark.parametrize("value", [BEYOND_FLOATS, -BEYOND_FLOATS, BEYOND_TEXT], ids=["+", "-", "text"])
def test_an_integer_that_no_float_holds_is_no_finite_number(value):
    assert not is_finite_number(value)
    with pytest.raises(InvalidValueError, match=r"^x \[m\] must be finite"):
        require_number("x [m]", value)


def test_a_refused_integer_of_thousands_of_digits_gets_its_message():
    with pytest.raises(InvalidValueError, match=r"n must be an integer in \[0, 5\], got a int of thousands"):
        require_integer("n", BEYOND_TEXT, high=5)
    with pytest.raises(UnknownNameError, match="unknown preset a int of thousands of digits"):
        validation.require_choice("preset", BEYOND_TEXT, ("biped",))


def test_long_values_are_cut_in_messages():
    assert shown("a" * 1000) == "'" + "a" * 199 + "... (1002 characters)"
    assert shown([1, 2]) == "[1, 2]"


@pytest.mark.parametrize("value", [-1, 6, 2.0, True, "3", None])
def test_integers_lie_within_their_bounds(value):
    with pytest.raises(InvalidValueError, match=r"n must be an integer in \[0, 5\]"):
        require_integer("n", value, high=5)


@pytest.mark.parametrize("value", [0, 5, np.int64(3)])
def test_integers_within_their_bounds_pass(value):
    assert type(require_integer("n", value, high=5)) is int
    assert require_integer("n", value, high=5) == value


NUMPY_INTEGERS = [np.int64(2), np.uint8(2), np.int32(2)]
NUMPY_NUMBERS = [*NUMPY_INTEGERS, np.float64(2.0), np.float32(2.0), np.float16(2.0)]
NO_NUMBERS = [True, np.bool_(True), np.array(2), "2", None]


@pytest.mark.parametrize("value", NUMPY_NUMBERS, ids=lambda value: type(value).__name__)
def test_a_number_of_numpy_is_taken_wherever_one_of_python_is_and_becomes_it(value):
    """A float32 kept as it is would make the planner's constants single precision, and is no JSON."""
    assert is_finite_number(value)
    assert type(require_number("x", value)) is float
    robot = RobotModel(com_height=value)
    assert robot.omega == RobotModel(com_height=2.0).omega
    config = PlannerConfig(beta_dcm=value, beta_cop=value)
    limits = GaitLimits(length_max=value)
    for record in (robot, config, limits):
        assert json.loads(json.dumps(asdict(record))) == asdict(record)
    env = gym.make("PushRecovery/Pendulum-v0", control_hz=value * type(value)(50))
    plain = gym.make("PushRecovery/Pendulum-v0", control_hz=100.0)
    assert env.unwrapped.dt == plain.unwrapped.dt  # type: ignore[attr-defined]


@pytest.mark.parametrize("value", NUMPY_INTEGERS, ids=lambda value: type(value).__name__)
def test_an_integer_of_numpy_is_taken_wherever_one_of_python_is_and_becomes_it(value):
    about = PolicyDescription("PushRecovery/Pendulum-v0", RobotModel(), GaitLimits(), hold=value)
    held = ActionHold(gym.make("PushRecovery/Pendulum-v0"), value)
    found = [require_integer("n", value), RangeThreads(value).threads, PlannerConfig(tail_intervals=value)
             .tail_intervals, about.hold, held.periods]  # fmt: skip
    assert found == [2] * 5
    assert {type(one) for one in found} == {int}
    assert TwoStagePolicy(threads=value).predict(np.zeros(36))[0].shape == (7,)


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_what_is_no_number_is_refused(value):
    assert not is_finite_number(value)
    for make in (
        lambda: require_number("x", value), lambda: require_integer("n", value), lambda: RangeThreads(value),
        lambda: PlannerConfig(tail_intervals=value), lambda: PlannerConfig(beta_dcm=value),
        lambda: RobotModel(mass=value), lambda: GaitLimits(length_max=value),
        lambda: ActionHold(gym.make("PushRecovery/Pendulum-v0"), value),  # type: ignore[arg-type]
        lambda: PolicyDescription("PushRecovery/Pendulum-v0", RobotModel(), GaitLimits(), hold=value),
    ):  # fmt: skip
        with pytest.raises(InvalidValueError):
            make()


def test_bounds_of_a_vector_hold_for_every_entry_and_both_ways():
    assert validation.require_vector("v", [2.0, -2.0, 0.0], 2.0) == (2.0, -2.0, 0.0)
    for i, value in ((0, 2.1), (1, -2.1), (2, math.inf)):
        entries = [0.0, 0.0, 0.0]
        entries[i] = value
        with pytest.raises(InvalidValueError, match=rf"v\[{i}\]"):
            validation.require_vector("v", entries, 2.0)


def test_a_choice_may_be_anything_and_is_refused_by_name():
    with pytest.raises(UnknownNameError, match=r"unknown side \['left'\] \(valid: left, right\)"):
        validation.require_choice("side", ["left"], ("left", "right"))
    with pytest.raises(UnknownNameError, match="unknown side 'middle'"):
        validation.require_choice("side", "middle", ("left", "right"))
    validation.require_choice("side", "left", ("left", "right"))


def test_kinds_are_named():
    assert validation.require_kind("limits", 3, int) == 3
    with pytest.raises(InvalidValueError, match="limits must be a dict, got 3"):
        validation.require_kind("limits", 3, dict)


NESTED = "[" * 100_000
DIGITS = '{"id": ' + "1" * 5000 + "}"
TEXTS = {"nested": NESTED, "digits": DIGITS, "torn": '{"id": ', "empty": ""}


@pytest.mark.parametrize("text", [b'{"a": [1, "\xc3\xa4"]}', '{"a": [1, "\u00e4"]}'])
def test_json_is_read_from_text_and_from_bytes(text):
    assert parse_json("it", text) == {"a": [1, "\u00e4"]}


def test_bytes_that_are_no_utf_8_are_refused():
    with pytest.raises(InvalidValueError, match="it is not valid JSON: 'utf-8'"):
        parse_json("it", b"\xff")


@pytest.mark.parametrize("kind", TEXTS)
def test_every_reader_of_json_refuses_what_is_none(kind, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(TEXTS[kind])
    (tmp_path / "x.safetensors").write_bytes(b"")
    for read, what in (
        (Scenario.from_json, TEXTS[kind]),
        (ModelErrors.from_json, TEXTS[kind]),
        (load_suite, path),
        (load_preset, str(path)),
        (NetworkPolicy.load, path),
        (Answers.load, path),
    ):
        with pytest.raises(InvalidValueError, match="is not valid JSON"):
            read(what)


def test_a_key_that_comes_twice_is_refused_by_name():
    words = r"^it is not valid JSON: the key 'b' stands in an object more than once$"
    for text in ('{"b": 1, "a": 2, "b": 1}', '[{"a": {"b": 1, "b": 2}}]'):
        with pytest.raises(InvalidValueError, match=words):
            parse_json("it", text)
    assert parse_json("it", '[{"b": 1}, {"b": {"b": 2}}]') == [{"b": 1}, {"b": {"b": 2}}]


@pytest.mark.parametrize("value", ["abc", b"abc", bytearray(b"abc")])
def test_text_is_no_list_of_numbers(value):
    for require in validation.require_vector, validation.require_pair:
        with pytest.raises(InvalidValueError, match=r"^v must have [23] entries.*got "):
            require("v", value[: 3 if require is validation.require_vector else 2])


def test_objects_of_a_class_become_a_tuple():
    assert validation.require_all("v", (i for i in (1, 2)), int) == (1, 2)
    for value in 3, None, "abc", b"abc":
        with pytest.raises(InvalidValueError, match=rf"^v must be a sequence of int, got {value!r}$"):
            validation.require_all("v", value, int)
    with pytest.raises(InvalidValueError, match=r"^v must hold int objects, got 'a'$"):
        validation.require_all("v", [1, "a"], int)


def test_a_number_that_no_float_holds_is_refused_where_a_force_stands():
    text = json.dumps({"id": "a", "pushes": [{"force": [10**400, 0, 0], "duration": 0.1, "start": 1.0}]})
    with pytest.raises(InvalidValueError, match=r"Push\.force"):
        Scenario.from_json(text)


@dataclass
class Thing:
    name: str
    size: float = 1.0
    colour: str | None = None


def test_changed_fields_are_those_off_their_default_in_order():
    assert validation.changed_fields(Thing("a")) == {"name": "a"}
    assert list(validation.changed_fields(Thing("a", colour="red", size=2.0)).items()) == [
        ("name", "a"), ("size", 2.0), ("colour", "red"),
    ]  # fmt: skip


def test_entries_that_differ_are_told_with_both_values():
    there = {"mass": 60.0, "trunk_pitch": True, "foot_length": 0.2, "name": "biped"}
    here = {"mass": 33.341142, "trunk_pitch": False, "foot_length": 0.2, "name": "g1"}
    told = "mass 60 there and 33.34 here, trunk_pitch True there and False here, name biped there and g1 here"
    assert differences(there, here) == told


def test_rounding_and_entries_of_one_side_are_no_difference():
    assert differences({"mass": 60.0, "old": 1}, {"mass": 60.0 + 1e-12, "new": 2}) == ""
    assert differences({"steps": 2}, {"steps": 3}) == "steps 2 there and 3 here"
    assert differences({"flag": True}, {"flag": 1.0}) == ""


def test_a_pair_has_no_negative_zero():
    assert [math.copysign(1.0, x) for x in validation.require_pair("p", (-0.0, -0.0))] == [1.0, 1.0]
