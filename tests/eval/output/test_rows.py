"""Row files: what is written is on disk, and what cannot be read is named."""

import json
import os

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.rows import RowFile

CONFIG = {"suite": "quick"}


def store(directory, **kwargs):
    return RowFile(directory, CONFIG, ("policy",), fields=("recovered",), **kwargs)


def test_a_row_is_synced_before_append_returns(tmp_path, monkeypatch):
    synced = []
    rows = store(tmp_path)
    monkeypatch.setattr(os, "fsync", lambda number: synced.append((tmp_path / "outcomes.jsonl").read_text()))
    rows.append({"policy": "a", "recovered": True})
    rows.append({"policy": "a", "recovered": False})  # is there already
    rows.append({"policy": "b", "recovered": False})
    rows.close()
    lines = [json.dumps({"policy": name, "recovered": ok}) + "\n" for name, ok in (("a", True), ("b", False))]
    assert synced == [lines[0], "".join(lines)]


def test_rows_with_missing_fields_are_named(tmp_path):
    store(tmp_path).close()
    (tmp_path / "outcomes.jsonl").write_text('{"policy": "a", "recovered": true}\n{"policy": "b"}\n')
    with pytest.raises(InvalidValueError, match=r"line 2 is no outcome: .*lacks recovered"):
        store(tmp_path)
    (tmp_path / "outcomes.jsonl").write_text('{"recovered": true}\n')
    with pytest.raises(InvalidValueError, match=r"line 1 is no outcome: .*lacks policy"):
        store(tmp_path)
    (tmp_path / "outcomes.jsonl").write_text("7\n")
    with pytest.raises(InvalidValueError, match="line 1 is no outcome"):
        store(tmp_path)


def test_a_configuration_that_is_no_text_is_named(tmp_path):
    (tmp_path / "config.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(InvalidValueError, match=r"config\.json"):
        store(tmp_path)
    assert not (tmp_path / "outcomes.jsonl").exists()


def test_a_torn_last_line_is_dropped(tmp_path):
    rows = store(tmp_path)
    rows.append({"policy": "a", "recovered": True})
    rows.close()
    with (tmp_path / "outcomes.jsonl").open("a") as file:
        file.write('{"policy": "b", "rec')
    assert list(store(tmp_path).rows) == [("a",)]
    assert (tmp_path / "outcomes.jsonl").read_text().count("\n") == 1


def test_of_two_rows_of_one_key_the_first_counts(tmp_path):
    """Two runs on one directory may both have written it; what was read once stays."""
    store(tmp_path).close()
    rows = [{"policy": "a", "recovered": True}, {"policy": "a", "recovered": False}]
    (tmp_path / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert store(tmp_path).rows == {("a",): rows[0]}
