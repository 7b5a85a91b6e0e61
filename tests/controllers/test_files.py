"""Files that others have made: read as a whole, or refused before they are opened."""

import errno
import os
import stat

import pytest
from push_recovery.controllers import files
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.files import read_file, write_atomically
from push_recovery.controllers.policies.learned import NetworkPolicy
from push_recovery.controllers.settings import load_preset
from push_recovery.eval.ceiling import Answers
from push_recovery.eval.score.suites import load_suite


def test_a_file_and_a_link_to_one_are_read(tmp_path):
    (tmp_path / "file").write_bytes(b"\0one\r\n")
    (tmp_path / "link").symlink_to("file")
    assert read_file(tmp_path / "file") == read_file(str(tmp_path / "link")) == b"\0one\r\n"


def test_what_never_ends_or_never_answers_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero", "."):
        with pytest.raises(OSError, match="not a regular file") as caught:
            read_file(tmp_path / name)
        assert caught.value.errno == errno.EINVAL


def test_a_file_larger_than_the_bound_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "LARGEST", 4)
    path = tmp_path / "file"
    path.write_bytes(b"1234")
    assert read_file(path) == b"1234"
    path.write_bytes(b"12345")
    with pytest.raises(OSError, match="it has 5 bytes, more than 4"):
        read_file(path)


@pytest.mark.parametrize("read", [NetworkPolicy.load, load_preset, load_suite, Answers.load])
def test_every_reader_of_a_users_file_refuses_a_pipe(tmp_path, read):
    path = tmp_path / "mine.json"
    os.mkfifo(path)
    with pytest.raises(InvalidValueError, match="not a regular file"):
        read(str(path) if read in {NetworkPolicy.load, load_preset} else path)


def test_a_planted_link_is_not_written_through(tmp_path):
    other = tmp_path / "other"
    other.write_bytes(b"another's")
    (tmp_path / f".report.md.{os.getpid()}.tmp").symlink_to(other)
    write_atomically(tmp_path / "report.md", b"new")
    assert other.read_bytes() == b"another's"
    assert (tmp_path / "report.md").read_bytes() == b"new"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["other", "report.md"]


def test_content_and_name_are_on_disk_when_it_returns(tmp_path, monkeypatch):
    kept, sync = [], os.fsync

    def note(number):
        kept.append(stat.S_ISDIR(os.fstat(number).st_mode))
        sync(number)

    monkeypatch.setattr(os, "fsync", note)
    write_atomically(tmp_path / "report.md", b"new")
    assert kept == [False, True]  # the file, and then the folder that holds its name
