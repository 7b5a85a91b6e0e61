"""A file that cannot be written is refused before the work for it."""

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.cli.main import main
from push_recovery.eval.output.rows import require_place
from push_recovery.eval.reproduction.run import reproduce


def test_a_folder_is_made_and_nothing_else(tmp_path):
    require_place(tmp_path / "a" / "b" / "film.mp4")
    assert list((tmp_path / "a").rglob("*")) == [tmp_path / "a" / "b"]


def test_what_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "x.png").mkdir()
    for name, words in (("file/x.png", "its folder is a file"), ("x.png", "Is a directory")):
        with pytest.raises(InvalidValueError, match=rf"can't write to '{tmp_path / name}': {words}"):
            require_place(tmp_path / name)


def test_play_and_reproduce_ask_first(capsys, monkeypatch, tmp_path):
    def work(*arguments, **options):
        raise AssertionError("began to work")

    monkeypatch.setattr("push_recovery.eval.cli.play.acting_in", work)
    monkeypatch.setattr("push_recovery.eval.reproduction.run.open_store", work)
    assert main(["play", "--out", "/dev/null/x.png"]) == 2
    assert capsys.readouterr().err.startswith("push-recovery: error: can't write to '/dev/null/x.png': ")
    (tmp_path / "file").touch()
    with pytest.raises(InvalidValueError, match="can't write"):
        reproduce(directory=tmp_path, page=tmp_path / "file" / "page.md")
