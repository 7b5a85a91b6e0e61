"""The digest of a module sees what its kernels can be made of, and costs next to nothing."""

import importlib
import sys
import types

import pytest
from push_recovery.controllers import jit as digests

TEXTS = {
    "pack": "",
    "pack.room": "",
    "pack.room.deep": "from ..far import (\n    x,\n    near,\n)\n",
    "pack.far": "import heavy\n\n\ndef f():\n    from .unused import y\n",
    "pack.far.near": "A = 1\n",
    "pack.unused": "Y = 1\n",
    "pack.tables": 'NAME = "numbers.json"\n',
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Writes modules into `sys.modules` and gives a function: the digest of one of them, read anew."""
    for name in ("heavy", *TEXTS):
        module = types.ModuleType(name)
        module.__path__ = [str(tmp_path)]
        module.__file__ = str(tmp_path / name)
        module.__version__ = "1"
        monkeypatch.setitem(sys.modules, name, module)
        (tmp_path / name).write_text(TEXTS.get(name, ""))
    (tmp_path / "numbers.json").write_text("{}")

    def digest(name):
        digests.source_digest.cache_clear()
        digests.data_digest.cache_clear()
        return digests.source_digest(name)

    yield tmp_path, digest
    digests.source_digest.cache_clear()
    digests.data_digest.cache_clear()


@pytest.mark.parametrize("changed", ["pack.room.deep", "pack.far", "pack.far.near"])
def test_a_change_of_what_a_module_imports_changes_its_digest(package, changed):
    folder, digest = package
    before = digest("pack.room.deep")
    assert digest("pack.room.deep") == before
    (folder / changed).write_text(TEXTS[changed] + "# edited\n")
    assert digest("pack.room.deep") != before


@pytest.mark.parametrize("changed", ["pack.unused", "pack.tables", "numbers.json"])
def test_a_change_of_what_it_does_not_import_does_not(package, changed):
    folder, digest = package
    before = digest("pack.room.deep")
    (folder / changed).write_text("# edited\n")
    assert digest("pack.room.deep") == before


def test_data_files_count_where_a_module_names_any(package):
    folder, digest = package
    before = digest("pack.tables")
    (folder / "numbers.json").write_text("[]")
    assert digest("pack.tables") != before


def test_another_version_of_an_outside_package_counts(package, monkeypatch):
    _, digest = package
    before = digest("pack.far")
    monkeypatch.setattr(sys.modules["heavy"], "__version__", "2")
    assert digest("pack.far") != before


def test_the_modules_that_an_import_may_mean():
    found = digests.imported_modules("push_recovery.controllers.math3", 1, "jit", "njit")
    assert found == {"push_recovery.controllers.jit"}
    found = digests.imported_modules("push_recovery.controllers.math3", 1, "", "jit, x")
    assert found == {"push_recovery.controllers", "push_recovery.controllers.jit"}


def test_every_import_of_a_kernel_s_module_is_seen():
    """Against what Python holds: whatever of this project a module's globals came from is in its digest."""
    importlib.import_module("push_recovery.envs.biped.period")
    seen, wait = set(), ["push_recovery.envs.biped.period"]
    while wait:
        name = wait.pop()
        seen.add(name)
        for dots, base, names, _ in digests.IMPORT.findall(b"\n" + digests.source_of(name)):
            if dots:
                wait += digests.imported_modules(name, len(dots), base.decode(), names.decode()) - seen
    for name in seen:
        for value in vars(sys.modules[name]).values():
            origin = str(getattr(value, "__module__", ""))
            assert origin in seen or not origin.startswith("push_recovery."), (name, value)
