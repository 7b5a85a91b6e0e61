"""Where kernels are kept: a directory nobody else can write, and no more versions than are of use."""

import os
from pathlib import Path

import pytest
from push_recovery.controllers import jit as cache_place


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(cache_place.tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_the_least_lately_used_versions_of_a_module_are_deleted(tmp_path):
    digests = [f"{k:016x}" for k in range(cache_place.KEPT + 2)]
    for age, digest in enumerate(digests):
        path = tmp_path / f"controllers.a-{digest}"
        path.mkdir()
        (path / "kernel.nbi").write_text("")
        os.utime(path, (1000.0 - age, 1000.0 - age))
    others = ["controllers.a_b-00", "controllers.a.b-00", "lock"]
    for name in others:
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1.0, 1.0))
    new = tmp_path / f"controllers.a-{digests[-1]}"  # the oldest by its time, and the one just made
    cache_place.make_room(new)
    kept = {f"controllers.a-{digest}" for digest in [*digests[: cache_place.KEPT - 1], digests[-1]]}
    assert {path.name for path in tmp_path.iterdir()} == kept | set(others)


def test_a_version_in_use_counts_as_new(tmp_path, monkeypatch):
    monkeypatch.setattr(cache_place, "cache_root", lambda: tmp_path)
    path = tmp_path / "controllers.a-00"
    path.mkdir()
    os.utime(path, (1.0, 1.0))
    assert cache_place.module_directory("push_recovery.controllers.a", "00") == path
    assert path.stat().st_mtime > 1.0
    assert not cache_place.module_directory("push_recovery.controllers.a", "11").exists()


@pytest.mark.parametrize("given", [True, False])
def test_the_directory_is_the_users_or_the_one_that_is_named(tmp_path, monkeypatch, given):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    if given:
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "named"))
    elif os.name != "posix" or os.uname().sysname == "Darwin":
        pytest.skip("XDG is a convention of Linux")
    path = cache_place.cache_root.__wrapped__()
    assert path == tmp_path / ("named" if given else "xdg") / "push-recovery"
    assert path.is_dir()


def test_the_place_for_temporary_files_is_closed_to_others(temporary):
    path = cache_place.own_temporary_directory()
    assert path.parent == temporary
    assert path.stat().st_mode & 0o777 == 0o700
    assert cache_place.own_temporary_directory() == path


@pytest.mark.parametrize("planted", ["open", "link", "file"])
def test_what_another_may_have_planted_is_not_used(temporary, planted):
    path = cache_place.own_temporary_directory()
    path.rmdir()
    if planted == "open":
        path.mkdir()
        path.chmod(0o777)
    elif planted == "link":
        (temporary / "elsewhere").mkdir(mode=0o700)
        path.symlink_to(temporary / "elsewhere")
    else:
        path.write_text("")
    other = cache_place.own_temporary_directory()
    assert other not in (path, temporary / "elsewhere")
    assert Path(other).stat().st_mode & 0o777 == 0o700
