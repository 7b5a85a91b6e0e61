import json
from dataclasses import dataclass

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.settings import load_preset
from push_recovery.controllers.validation import changed_fields, parse_json
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.ceiling import Answers
from push_recovery.eval.score.suites import load_suite

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
    assert changed_fields(Thing("a")) == {"name": "a"}
    assert list(changed_fields(Thing("a", colour="red", size=2.0)).items()) == [
        ("name", "a"), ("size", 2.0), ("colour", "red"),
    ]  # fmt: skip
