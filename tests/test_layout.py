import ast
import subprocess
import sys
from pathlib import Path

import push_recovery.controllers
import push_recovery.envs
import push_recovery.eval
import push_recovery.training
import pytest

import push_recovery

ORDER = ("controllers", "envs", "eval", "training")
FOLDERS = {
    "controllers": Path(push_recovery.controllers.__path__[0]),
    "envs": Path(push_recovery.envs.__path__[0]),
    "eval": Path(push_recovery.eval.__path__[0]),
    "training": Path(push_recovery.training.__path__[0]),
}
FORBIDDEN = {
    "controllers": {"gymnasium", "mujoco", "torch", "stable_baselines3", "matplotlib", "rich"},
    "envs": {"torch", "stable_baselines3", "rich"},
    "eval": {"torch", "stable_baselines3"},
    "training": set(),
}


def imports(path: Path, package: str, folder: Path) -> set[str]:
    """Top-level names imported anywhere in a file; parts of this project as 'push_recovery.PART'."""
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
            parts = name.split(".")
            found.add(".".join(parts[:2]) if parts[0] == "push_recovery" else parts[0])
    return found


@pytest.mark.parametrize("package", ORDER)
def test_imports_point_one_way(package):
    later = {f"push_recovery.{name}" for name in ORDER[ORDER.index(package) + 1 :]}
    folder = FOLDERS[package]
    files = sorted(folder.rglob("*.py"))
    assert files
    for path in files:
        found = imports(path, package, folder)
        assert not found & later, f"{path.name} imports {found & later}"
        assert not found & FORBIDDEN[package], f"{path.name} imports {found & FORBIDDEN[package]}"
        assert "push_recovery" not in found, f"{path.name} imports the root instead of its parts"


def test_the_check_sees_relative_imports(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("def f():\n    from ..training.ppo import x\nfrom . import y\nimport torch.nn\n")
    assert imports(path, "eval", tmp_path) == {"push_recovery.training", "push_recovery.eval", "torch"}


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
