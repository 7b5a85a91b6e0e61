"""Row files: what is written is on disk, and what cannot be read is named."""

import json
import os
import resource
import signal

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.rows import RowFile, UnwrittenRowError

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
    assert synced == ["", lines[0], "".join(lines)]  # the name of the file, then each row


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


@pytest.fixture
def disk_of():
    """Lets files of this process grow to so many bytes, as a disk does that is nearly full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_a_full_disk_leaves_whole_rows_and_the_next_one_can_be_written(tmp_path, disk_of):
    """A part of the line fits; it must not stay, or the next row would be glued to it."""
    first, long = {"policy": "a", "recovered": True}, {"policy": "b" * 500, "recovered": True}
    with store(tmp_path) as rows:
        rows.append(first)
        disk_of(200)
        with pytest.raises(UnwrittenRowError, match=r"can't write to .*outcomes.jsonl.* is kept"):
            rows.append(long)
        assert (tmp_path / "outcomes.jsonl").read_text() == json.dumps(first) + "\n"
        disk_of(10_000)
        rows.append(long)
    with store(tmp_path) as again:
        assert list(again.rows.values()) == [first, long]


def test_a_second_writer_is_refused_and_takes_nothing_away(tmp_path):
    row = {"policy": "a", "recovered": True}
    with store(tmp_path) as first:
        first.append(row)
        for overwrite in (False, True):
            with pytest.raises(InvalidValueError, match="another run"):
                store(tmp_path, overwrite=overwrite)
        first.append({**row, "policy": "b"})
    with store(tmp_path) as second:
        assert list(second.rows) == [("a",), ("b",)]


@pytest.mark.parametrize("name", ["outcomes.jsonl", "config.json"])
def test_a_pipe_in_place_of_a_file_is_refused(tmp_path, name):
    store(tmp_path).close()
    if name == "outcomes.jsonl":
        (tmp_path / "config.json").unlink()
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    with pytest.raises(InvalidValueError, match=rf"not a regular file.*{name}"):
        store(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]  # no configuration of what was refused


def test_a_refusal_leaves_no_new_folder(tmp_path):
    with pytest.raises(TypeError):
        RowFile(tmp_path / "a" / "b", {"suite": object()}, ("policy",))
    assert list(tmp_path.iterdir()) == []
