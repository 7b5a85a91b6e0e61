import ast
import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("controllers", "envs", "eval", "training")
FOLDERS = {name: Path(importlib.import_module(f"push_recovery.{name}").__path__[0]) for name in PACKAGES}
# A room imports from rooms before it only: the flow of the data, read from its source.
ROOMS = (
    "controllers",  # errors, files, validation
    "controllers.compiled",
    "controllers.solvers",
    "controllers.model",
    "controllers.settings",
    "controllers.stage_1",
    "controllers.stage_2",
    "controllers.baselines",
    "controllers.policies",
    "controllers.learned",
    "controllers.whole_body",
    "controllers.estimation",
    "controllers.joints",
    "envs",
    "envs.scenario",
    "envs.physics",
    "envs.sensing",
    "envs.snapshot",
    "envs.episode",
    "envs.pendulum",
    "envs.biped.robots",
    "envs.biped.robots.biped",
    "envs.biped.robots.variants",
    "envs.biped.robots.adapted",
    "envs.biped.plant",  # body and floor as they are
    "envs.biped",
    "envs.residual",
    "envs.joint",
    "eval",
    "eval.processes",
    "eval.output",
    "eval.measures",  # of robots at work
    "eval.shipped",
    "eval.sampling_mpc",
    "eval.rollout",
    "eval.robots",
    "eval.export",
    "eval.protocols",  # those of others
    "eval.score",
    "eval.leaderboard",
    "eval.frontier",
    "eval.sensitivity",
    "eval.ceiling",
    "eval.api",
    "eval.bench",
    "eval.tuning",
    "eval.reproduction",  # jobs and their tables
    "eval.reproduction.pendulum",
    "eval.reproduction.figures",
    "eval.reproduction.sections",
    "eval.reproduction.report",
    "eval.record",
    "eval.learned",
    "eval.film",
    "eval.report",
    "eval.report.parts",
    "eval.report.pages",
    "eval.play",  # a session, without a viewer
    "eval.play.browser",
    "eval.cli",
    "eval.cli.tools",
    "eval.cli.commands",
    "eval.cli.sharing",
    "training.robots",
    "training.networks",
    "training.imitation",
    "training",
    "training.cli",
)
MODULES_IN_A_ROOM = 12
FORBIDDEN = {
    "controllers": {"gymnasium", "mujoco", "torch", "stable_baselines3", "matplotlib", "rich"},
    "envs": {"torch", "stable_baselines3", "rich"},
    "eval": {"torch", "stable_baselines3"},
    "training": set(),
}


def room_of(path: Path, package: str, folder: Path) -> str:
    return ".".join([package, *path.relative_to(folder).parent.parts])


def imports(path: Path, package: str, folder: Path) -> set[str]:
    """Names imported anywhere in a file: those of this project in full, of others the top level."""
    inside = ["push_recovery", *room_of(path, package, folder).split(".")]
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


def rooms(names: set[str]) -> set[str]:
    """The rooms that imported names of this project lie in."""
    inside = {name.removeprefix("push_recovery.") for name in names if name.startswith("push_recovery.")}
    return {max((room for room in ROOMS if f"{name}.".startswith(f"{room}.")), key=len) for name in inside}


def files_of(package: str) -> list[Path]:
    return sorted(FOLDERS[package].rglob("*.py"))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_room_imports_from_rooms_before_it(package):
    for path in files_of(package):
        found = imports(path, package, FOLDERS[package])
        room = room_of(path, package, FOLDERS[package])
        later = {other for other in rooms(found) if ROOMS.index(other) > ROOMS.index(room)}
        assert not later, f"{room}/{path.name} imports from {later}"
        assert not found & FORBIDDEN[package], f"{path.name} imports {found & FORBIDDEN[package]}"
        assert "push_recovery" not in found, f"{path.name} imports the root instead of its parts"


@pytest.mark.parametrize("room", ROOMS)
def test_the_files_of_a_room_import_in_no_circle(room):
    package = room.split(".")[0]
    files = [path for path in files_of(package) if room_of(path, package, FOLDERS[package]) == room]
    prefix = f"push_recovery.{room}."
    waits = {}
    for path in files:
        inside = [name.removeprefix(prefix) for name in imports(path, package, FOLDERS[package])
                  if name.startswith(prefix)]  # fmt: skip
        waits[path.stem] = {name.split(".")[0] for name in inside} & {other.stem for other in files}
    while free := {name for name, others in waits.items() if not others & waits.keys()}:
        waits = {name: others for name, others in waits.items() if name not in free}
    assert not waits


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_is_listed_packaged_and_small(package):
    folder = FOLDERS[package]
    found = {room_of(path, package, folder) for path in files_of(package)}
    assert found == {room for room in ROOMS if room.split(".")[0] == package}
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert {f"push_recovery.{room}" for room in found} <= set(packaged)
    for room in found:
        names = [path for path in files_of(package)
                 if room_of(path, package, folder) == room and path.name != "__init__.py"]  # fmt: skip
        assert len(names) <= MODULES_IN_A_ROOM, f"{room} has {len(names)} modules"


@pytest.mark.parametrize("package", PACKAGES)
def test_kernels_are_compiled_by_the_projects_own_njit(package):
    """Numba's own njit keeps code that a changed callee in another file does not renew."""
    for path in files_of(package):
        if path.name != "kernels.py":
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"from numba import .*\bn?jit\b|numba\.n?jit\(", text), (
                f"{path.name}: import njit from controllers.compiled.kernels"
            )


def test_the_check_sees_relative_imports(tmp_path):
    path = tmp_path / "score" / "module.py"
    path.parent.mkdir()
    path.write_text("def f():\n    from ...training.ppo import x\nfrom . import y\nimport torch.nn\n")
    found = imports(path, "eval", tmp_path)
    assert found == {"push_recovery.training.ppo.x", "push_recovery.eval.score.y", "torch"}
    assert rooms(found) == {"training", "eval.score"}


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
