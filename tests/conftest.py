"""Bipeds to test: a robot in any state beside MuJoCo's own data of that state, and episodes."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.model.nominal_gait import nominal_gait, nominal_start
from push_recovery.envs.biped.core import BIPED, BIPED_LIMITS, BipedCore
from push_recovery.envs.biped.posture import posture
from push_recovery.envs.robots.biped import biped, biped_model
from push_recovery.envs.scenario.scenario import Scenario

WITHOUT_BIPED = (
    "envs/pendulum",
    "controllers/stage_2",
    "controllers/policies",
    "eval/output",
    "eval/reproduction",
)
BATCHES = 8  # into which pytest-xdist divides the tests for two workers, each of which begins with one


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the second of two workers begin without a biped, whose kernels the first one compiles meanwhile.

    The examples and the site, which take longest, come before `eval`, so that both workers end together.
    """
    others = [item for name in WITHOUT_BIPED for item in items if item.path.parent.as_posix().endswith(name)]
    found, first = set(others), len(items) // BATCHES
    biped = [item for item in items if item not in found]
    later = biped[first:]
    root = [item for item in later if item.path.parent == Path(__file__).parent]
    rest = [item for item in later if item.path.parent != Path(__file__).parent]
    before = next((i for i, item in enumerate(rest) if "eval" in item.path.parts), len(rest))
    items[:] = [*biped[:first], *others, *rest[:before], *root, *rest[before:]]


@pytest.fixture(scope="session")
def random_state() -> Callable:
    """State (qpos, qvel) of a crouching robot, coordinates off by `spread`, rates by twice that."""

    def draw(rng: np.random.Generator, spread: float = 0.2):
        soles = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
        soles[:, :2] += rng.uniform(-0.08, 0.08, (2, 2))
        com = np.array([0.0, 0.0, 0.78]) + rng.uniform(-0.03, 0.03, 3)
        qpos, qvel = posture(biped(), com, rng.normal(0.0, 0.3, 3), soles)
        mujoco.mj_integratePos(biped_model(), qpos, rng.normal(0.0, spread, 20), 1.0)
        return qpos, qvel + rng.normal(0.0, 2.0 * spread, 20)

    return draw


@pytest.fixture(scope="session")
def robot_in(biped_core) -> Callable:
    """A core of one robot in a state (qpos, qvel), and MuJoCo's data of the same state."""
    core = biped_core(1)

    def put(qpos: np.ndarray, qvel: np.ndarray, stance: int = 0):
        core.put(0, qpos, qvel)
        for field in core.gait:
            field[0] = 0
        core.gait.stance[0] = stance
        data = mujoco.MjData(biped_model())
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(biped_model(), data)
        mujoco.mj_subtreeVel(biped_model(), data)
        return core, data

    return put


@pytest.fixture(scope="session")
def biped_core() -> Callable:
    """A core of n robots."""

    def make(n: int = 1, control_hz: float = 100.0, threads: int = 1) -> BipedCore:
        return BipedCore(n, BIPED, BIPED_LIMITS, control_hz, threads)

    return make


@pytest.fixture(scope="session")
def begin() -> Callable:
    """Put robot k of a core at the start of a scenario; returns the nominal gait (7,) of its command."""

    def start(core: BipedCore, k: int, scenario: Scenario) -> np.ndarray:
        sign = -1.0 if scenario.stance_side == "left" else 1.0
        nominal = nominal_gait(BIPED, BIPED_LIMITS, (scenario.command.vx, sign * scenario.command.vy))
        gait = np.array([nominal.length, nominal.width, nominal.duration, 0, 0, 0, 0])
        action = BIPED_LIMITS.to_action(gait).astype(np.float64)
        core.reset(k, scenario, nominal_start(nominal, BIPED.pelvis_width, BIPED.omega), gait, action)
        return gait

    return start
