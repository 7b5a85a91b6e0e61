"""Row files survive a kill, a directory has one writer, and what cannot be written is refused beforehand."""

import fcntl
import hashlib
import json
import os
import platform
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import main
from push_recovery.eval.output import rows as store_rows
from push_recovery.eval.output.rows import RowFile, Writer
from push_recovery.eval.reproduction.run import reproduce


def test_a_folder_is_made_and_nothing_else_and_what_cannot_be_written_is_named(tmp_path):
    store_rows.require_place(tmp_path / "a" / "b" / "film.mp4")
    assert list((tmp_path / "a").rglob("*")) == [tmp_path / "a" / "b"]
    (tmp_path / "file").touch()
    (tmp_path / "x.png").mkdir()
    for name, words in (("file/x.png", "its folder is a file"), ("x.png", "Is a directory")):
        with pytest.raises(InvalidValueError, match=rf"can't write to '{tmp_path / name}': {words}"):
            store_rows.require_place(tmp_path / name)


def test_play_and_reproduce_ask_first(capsys, monkeypatch, tmp_path):
    def work(*arguments, **options):
        raise AssertionError("began to work")

    monkeypatch.setattr("push_recovery.eval.rollout.policy_source.acting_in", work)
    monkeypatch.setattr("push_recovery.eval.reproduction.run.open_store", work)
    assert main(["play", "--out", "/dev/null/x.png"]) == 2
    assert capsys.readouterr().err.startswith("push-recovery: error: can't write to '/dev/null/x.png': ")
    (tmp_path / "file").touch()
    with pytest.raises(InvalidValueError, match="can't write"):
        reproduce(directory=tmp_path, page=tmp_path / "file" / "page.md")


def test_versions_are_those_in_use_and_the_kind_of_a_machine_does_not_name_it():
    used = {"numpy": np.__version__, "mujoco": mujoco.__version__, "python": platform.python_version()}
    assert store_rows.versions().items() >= used.items()
    assert platform.node() not in store_rows.machine_kind() or not platform.node()
    assert platform.machine() in store_rows.machine_kind()


def git(folder, *words):
    subprocess.run(["git", "-c", "user.name=x", "-c", "user.email=x", *words], cwd=folder, check=True)  # noqa: S607


def test_the_commit_is_that_of_the_repository_that_tracks_the_file(tmp_path):
    file = tmp_path / "code.py"
    file.write_text("1")
    assert store_rows.source_commit(file) is None
    git(tmp_path, "init", "-q")
    assert (
        store_rows.source_commit(file) is None
    )  # a repository that does not know it, such as one around a venv
    git(tmp_path, "add", "code.py")
    git(tmp_path, "commit", "-qm", "x")
    git(tmp_path, "tag", "-a", "v1", "-m", "x")
    commit = store_rows.source_commit(file)
    assert commit is not None
    assert re.fullmatch("[0-9a-f]{40}", commit)
    file.write_text("2")
    assert store_rows.source_commit(file) == f"{commit}-dirty"
    assert store_rows.source_commit(Path("/nowhere/code.py")) is None
    commit = store_rows.source_commit(Path(__file__))
    assert commit is None or len(commit.removesuffix("-dirty")) == 40


HOLD = (
    "import sys, time; from pathlib import Path; from push_recovery.eval.output.rows import Writer\n"
    "held = Writer(Path(sys.argv[1])); print('held', flush=True); time.sleep(60)"
)


def hold(directory):
    """Another process that writes to a directory."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(directory)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    return process


def test_a_second_writer_is_refused_until_the_first_is_killed(tmp_path):
    first = hold(tmp_path)
    try:
        for _ in range(2):  # the refusal itself takes nothing away from the first
            with pytest.raises(InvalidValueError, match=rf"another run \(process {first.pid}\) is writing"):
                Writer(tmp_path)
    finally:
        first.send_signal(signal.SIGKILL)
        first.wait()
        first.stdout.close()
    assert (tmp_path / store_rows.LOCK).exists()  # a kill leaves it behind, and it holds nobody off
    Writer(tmp_path).release()
    assert list(tmp_path.iterdir()) == []


def test_a_second_writer_in_the_same_process_is_refused(tmp_path):
    with Writer(tmp_path) as first:
        with pytest.raises(InvalidValueError, match=rf"process {os.getpid()}"):
            Writer(tmp_path)
        first.release()
        with Writer(tmp_path):
            first.release()  # the second time; the lock is no longer its own
            with pytest.raises(InvalidValueError, match="another run"):
                Writer(tmp_path)


def test_a_lock_on_a_file_that_has_been_removed_is_none(tmp_path, monkeypatch):
    """The one who held it before released it between our opening of the file and our lock."""
    lock, seen, kept = fcntl.flock, [], []

    def removed_once(file, how):
        if not seen:
            seen.append((tmp_path / store_rows.LOCK).stat().st_ino)
            kept.append((tmp_path / store_rows.LOCK).open())  # so that its number is not given anew
            (tmp_path / store_rows.LOCK).unlink()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", removed_once)
    with Writer(tmp_path):
        assert (tmp_path / store_rows.LOCK).stat().st_ino not in seen
        with pytest.raises(InvalidValueError, match="another run"):
            Writer(tmp_path)
    kept[0].close()


def test_another_directory_is_free(tmp_path):
    with Writer(tmp_path / "a"), Writer(tmp_path / "b"), Writer(tmp_path / "a" / "below"):
        assert (tmp_path / "a" / "below" / store_rows.LOCK).is_file()


def test_folders_made_for_it_go_where_nothing_was_written(tmp_path):
    Writer(tmp_path / "a" / "b").release()
    assert not (tmp_path / "a").exists()
    with Writer(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "rows").touch()
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["rows"]
    (tmp_path / "mine").mkdir()
    Writer(tmp_path / "mine").release()
    assert (tmp_path / "mine").is_dir()


def test_a_directory_that_cannot_be_written_to_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InvalidValueError, match=r"can't write to the directory .*file/out"):
        Writer(tmp_path / "file" / "out")
    (tmp_path / store_rows.LOCK).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InvalidValueError, match="can't write"):
        Writer(tmp_path)
    assert not (tmp_path / "elsewhere").exists()


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
    for text, message in (
        ('{"policy": "a", "recovered": true}\n{"policy": "b"}\n', "line 2 is no outcome: .*lacks recovered"),
        ('{"recovered": true}\n', "line 1 is no outcome: .*lacks policy"),
        ("7\n", "line 1 is no outcome"),
    ):
        (tmp_path / "outcomes.jsonl").write_text(text)
        with pytest.raises(InvalidValueError, match=message):
            store(tmp_path)


def test_rows_that_a_check_refuses_are_named_by_their_line(tmp_path):
    """The first of two rows of one key is the one that counts."""
    store(tmp_path).close()
    rows = [{"policy": name, "recovered": ok} for name, ok in (("a", True), ("a", 1), ("b", 2))]
    (tmp_path / "outcomes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))

    def check(row):
        if row["recovered"] is not True:
            raise InvalidValueError(f"recovered is {row['recovered']}")

    with store(tmp_path) as kept, pytest.raises(InvalidValueError) as refused:
        kept.check_rows(check)
    assert str(refused.value) == f"'{tmp_path}/outcomes.jsonl' line 3 is no outcome: recovered is 2"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.json", "outcomes.jsonl"]


@pytest.mark.parametrize("mine", [True, False])
def test_a_run_that_fails_before_its_first_row_leaves_nothing(tmp_path, mine):
    place = tmp_path / "a" / "b"
    if mine:
        place.mkdir(parents=True)
    with pytest.raises(InvalidValueError, match="no such push"), store(place):
        raise InvalidValueError("no such push")
    assert list(tmp_path.rglob("*")) == ([place.parent, place] if mine else [])


def test_a_run_that_fails_leaves_its_rows_and_a_directory_that_was_there(tmp_path):
    store(tmp_path / "empty").close()
    for place, rows in ((tmp_path / "empty", ()), (tmp_path / "new", ("a",))):
        begun = store(place)
        for name in rows:
            begun.append({"policy": name, "recovered": True})
        with pytest.raises(InvalidValueError, match="no such push"), begun:
            raise InvalidValueError("no such push")
        assert (place / "config.json").is_file()
        with store(place) as again:
            assert list(again.rows) == [(name,) for name in rows]


def test_a_name_that_no_file_can_have_is_refused():
    with pytest.raises(InvalidValueError) as refused:
        store_rows.read_content(Path("a\0.json"), "preset file")
    assert str(refused.value) == "cannot read preset file 'a\\x00.json': embedded null byte"


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


def test_rows_without_a_configuration_are_refused_and_an_empty_file_is_none(tmp_path):
    path = tmp_path / "outcomes.jsonl"
    path.touch()
    store(tmp_path).close()
    (tmp_path / "config.json").unlink()
    path.write_text('{"policy": "a", "recovered": true}\n')
    with pytest.raises(InvalidValueError, match=r"has no config\.json beside it"):
        store(tmp_path)
    for place in (tmp_path, tmp_path / "new"):  # what is not there can be overwritten, too
        with store(place, overwrite=True) as rows:
            assert rows.rows == {}


def test_rows_of_a_policy_that_is_not_evaluated_now_may_be_of_any_content(tmp_path):
    with store(tmp_path) as rows:
        rows.append({"policy": "a", "recovered": True, "policy_sha256": "1"})
        rows.check_policies({"b": "2"})
        rows.check_policies({"a": "1"})
        with pytest.raises(InvalidValueError, match="another content of policy 'a'"):
            rows.check_policies({"a": "2"})


def test_a_directory_is_named_by_its_label_and_configuration():
    """Whatever the order of its entries; of a label that is too long for a file system, the beginning."""
    digest = hashlib.sha256(b'{"a": 1, "b": 2}').hexdigest()[:8]
    named = store_rows.default_directory("x" * 300, {"b": 2, "a": 1})
    assert named == Path("runs") / ("x" * 150 + "-" + digest)


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
        with pytest.raises(store_rows.UnwrittenRowError, match=r"can't write to .*outcomes.jsonl.* is kept"):
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


def test_overwriting_removes_what_tells_of_frontiers_and_basins_too(tmp_path):
    told = ["frontier-B.json", "frontier.svg", "basin-p.png", "report.html"]
    for name in (*told, "notes.md"):
        (tmp_path / name).touch()
    RowFile(tmp_path, {}, ("policy",), overwrite=True).close()
    assert not [name for name in told if (tmp_path / name).exists()]
    assert (tmp_path / "notes.md").exists()


def test_packages_after_one_that_is_not_installed_are_told_too():
    found = store_rows.versions(("no-such-package-anywhere", "numpy"))
    assert found["numpy"] == np.__version__
    assert "no-such-package-anywhere" not in found


def test_a_row_that_json_does_not_know_is_refused_and_leaves_nothing(tmp_path):
    with store(tmp_path) as rows, pytest.raises(ValueError, match="JSON compliant"):
        rows.append({"policy": "a", "recovered": True, "share": float("nan")})
    with store(tmp_path) as again:
        assert again.rows == {}


def test_overwriting_removes_every_page_and_leaves_folders_and_other_files(tmp_path):
    pages = "compare-a-b.md", "index.html", "profiles.png", "report-a.json", "frontier.md"
    for name in (*pages, "frontier.txt"):
        (tmp_path / name).touch()
    (tmp_path / "basin.svg").mkdir()
    RowFile(tmp_path, {}, ("policy",), overwrite=True).close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["basin.svg", "config.json", "frontier.txt"]


def test_what_differs_is_what_is_other_or_missing_on_either_side():
    assert store_rows.differing({"a": 1, "b": 2, "c": 3}, {"a": 1, "b": 0, "d": 4}) == ["b", "c", "d"]
