import ast
import importlib
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("controllers", "envs", "eval", "training")
FOLDERS = {name: Path(importlib.import_module(f"push_recovery.{name}").__path__[0]) for name in PACKAGES}
MODULES = 200  # at most, packages included
DEPTH = 2  # folders below a package at most
IMPORT_SHARE = 0.10  # of the lines of code, at most
FORBIDDEN = {
    "controllers": {"gymnasium", "mujoco", "torch", "stable_baselines3", "matplotlib", "rich"},
    "envs": {"torch", "stable_baselines3", "rich"},
    "eval": {"torch", "stable_baselines3"},
    "training": set(),
}


def module_of(path: Path, package: str, folder: Path) -> str:
    """Dotted name of a file below the project's root, as `controllers.model.robot`."""
    parts = [package, *path.relative_to(folder).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, package: str, folder: Path) -> set[str]:
    """Names imported anywhere in a file: those of this project in full, of others the top level."""
    inside = ["push_recovery", package, *path.relative_to(folder).parent.parts]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level + 1] if node.level else []
            module = [*base, *(node.module.split(".") if node.module else [])]
            names = [".".join([*module, alias.name]) for alias in node.names]
        else:
            continue
        for name in names:
            found.add(name if name.startswith("push_recovery") else name.split(".")[0])
    return found


def files_of(package: str) -> list[Path]:
    return sorted(FOLDERS[package].rglob("*.py"))


def graph() -> dict[str, set[str]]:
    """The modules of this project that each of them imports, at its top level or inside functions."""
    paths = {module_of(path, package, FOLDERS[package]): (path, package)
             for package in PACKAGES for path in files_of(package)}  # fmt: skip
    arrows = {}
    for module, (path, package) in paths.items():
        names = {name.removeprefix("push_recovery.") for name in imports(path, package, FOLDERS[package])}
        arrows[module] = {part for name in names for part in (name, name.rpartition(".")[0])} & paths.keys()
    return arrows


def circles(arrows: dict[str, set[str]]) -> dict[str, set[str]]:
    """What is left of a graph when all that waits for nothing is taken away, again and again."""
    while free := {name for name, others in arrows.items() if not others & arrows.keys() - {name}}:
        arrows = {name: others for name, others in arrows.items() if name not in free}
    return arrows


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_downwards_and_only_what_they_may(package):
    for path in files_of(package):
        found = imports(path, package, FOLDERS[package])
        above = PACKAGES[PACKAGES.index(package) + 1 :]
        upward = {name for name in found if name.startswith(tuple(f"push_recovery.{one}" for one in above))}
        assert not upward, f"{path.name} imports {upward}"
        assert not found & FORBIDDEN[package], f"{path.name} imports {found & FORBIDDEN[package]}"
        assert "push_recovery" not in found, f"{path.name} imports the root instead of its parts"


def test_modules_import_in_no_circle():
    assert circles(graph()) == {}


def test_folders_import_in_no_circle():
    """A folder below a package, or a module that lies in the package itself, is one node."""

    def node(module: str) -> str:
        return ".".join(module.split(".")[:2])

    folders: dict[str, set[str]] = {}
    for module, others in graph().items():
        folders.setdefault(node(module), set()).update(node(other) for other in others if "." in other)
    assert circles(folders) == {}


def lines_of_code(text: str) -> set[int]:
    """Numbers of the lines that hold code: neither blank nor comment nor docstring."""
    names = ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")
    silent = {getattr(tokenize, name) for name in names}
    found = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in silent:
            found.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        described = isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
        if described and ast.get_docstring(node) is not None:
            found -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return found


def import_lines(text: str) -> int:
    found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    return sum((node.end_lineno or 0) - node.lineno + 1 for node in found)


def test_the_house_stays_small():
    files = [(path, package) for package in PACKAGES for path in files_of(package)]
    assert len(files) <= MODULES
    for path, package in files:
        assert len(path.relative_to(FOLDERS[package]).parts) - 1 <= DEPTH, path
    texts = [path.read_text(encoding="utf-8") for path, _ in files]
    code = sum(len(lines_of_code(text)) for text in texts)
    assert sum(import_lines(text) for text in texts) <= IMPORT_SHARE * code


def test_every_folder_is_packaged():
    packaged = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    folders = {
        module_of(path, package, FOLDERS[package])
        for package in PACKAGES
        for path in files_of(package)
        if path.name == "__init__.py"
    }
    assert {f"push_recovery.{folder}" for folder in folders} | {"push_recovery"} == packaged


@pytest.mark.parametrize("package", PACKAGES)
def test_kernels_are_compiled_by_the_projects_own_njit(package):
    """Numba's own njit keeps code that a changed callee in another file does not renew."""
    for path in files_of(package):
        if path.name != "jit.py":
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"from numba import .*\bn?jit\b|numba\.n?jit\(", text), (
                f"{path.name}: import njit from controllers.jit"
            )


def test_the_checks_see_relative_imports_and_circles(tmp_path):
    path = tmp_path / "score" / "module.py"
    path.parent.mkdir()
    path.write_text("def f():\n    from ...training.ppo import x\nfrom . import y\nimport torch.nn\n")
    found = imports(path, "eval", tmp_path)
    assert found == {"push_recovery.training.ppo.x", "push_recovery.eval.score.y", "torch"}
    assert module_of(path, "eval", tmp_path) == "eval.score.module"
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == {"a": {"b"}, "b": {"c"}, "c": {"b"}}
    assert circles({"a": {"b", "a"}, "b": set()}) == {}


def run(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=60
    ).stdout


def test_import_loads_nothing_but_gymnasium():
    out = run(
        "import sys, gymnasium\n"
        "before = set(sys.modules)\n"
        "import push_recovery\n"
        "print(sorted(set(sys.modules) - before))"
    )
    assert out == "['push_recovery']\n"


def test_import_registers_and_loads_nothing_heavy():
    heavy = {"torch", "stable_baselines3", "mujoco", "numba", "scipy", "matplotlib"}
    out = run(
        "import sys, gymnasium, push_recovery\n"
        "print(sorted(i for i in gymnasium.registry if i.startswith('PushRecovery/')))\n"
        f"print(sorted({heavy} & set(sys.modules)))"
    )
    ids, loaded = out.splitlines()
    for name in ("Pendulum", "Biped", "BipedResidual"):
        assert f"'PushRecovery/{name}-v0'" in ids
    assert loaded == "[]"
