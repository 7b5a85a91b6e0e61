"""One writer a directory, whatever becomes of the one that was there before."""

import fcntl
import os
import signal
import subprocess
import sys

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.rows import LOCK, Writer

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
    assert (tmp_path / LOCK).exists()  # a kill leaves it behind, and it holds nobody off
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
    lock, seen = fcntl.flock, []

    def removed_once(file, how):
        if not seen:
            seen.append((tmp_path / LOCK).stat().st_ino)
            (tmp_path / LOCK).rename(tmp_path / "removed")
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", removed_once)
    with Writer(tmp_path):
        assert (tmp_path / LOCK).stat().st_ino not in seen
        with pytest.raises(InvalidValueError, match="another run"):
            Writer(tmp_path)


def test_another_directory_is_free(tmp_path):
    with Writer(tmp_path / "a"), Writer(tmp_path / "b"), Writer(tmp_path / "a" / "below"):
        assert (tmp_path / "a" / "below" / LOCK).is_file()


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
    (tmp_path / LOCK).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InvalidValueError, match="can't write"):
        Writer(tmp_path)
    assert not (tmp_path / "elsewhere").exists()
