"""RecoverFormer's push table on robots of this package: jumps of the whole robot's velocity, by level.

Source: github.com/ZihuiLiu/RecoverFormer, commit 70eabd2, and its paper, Table I. A "push of F for 0.1 s"
adds F x 0.1 s / m to the velocity of a Unitree G1's base, which is an impulse through its CoM in no time. The
jump [m/s] is the level here, so that robots of another mass meet the same. Three forms of the grid:

- "stated", as the paper says: 8 directions in turn, no vertical part;
- "coded", as the program does: direction uniform, vertical part uniform in -0.1 to 0.2 of the jump;
- "force", which the paper says too: a force on the pelvis for 0.1 s with the impulse of "stated".

The measures of an episode are RecoverFormer's, too: fallen by its criterion, time to stable, largest tilt.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...controllers.model.robot import REFERENCE
from ...controllers.whole_body.kinematics import TRUNK
from ...envs.biped.core import BipedCore
from ...envs.scenario.push import GaitEvent, Kick, Push
from ...envs.scenario.scenario import Scenario
from ..rollout.outcome import Outcome

FORCES = (50, 100, 150, 200, 250, 300)  # [N], of which each for 0.1 s on the G1 is a level, as published
BEYOND = (420, 560, 700)  # 1.2, 1.6 and 2.0 m/s: levels of our own, for robots that stand up to all of those
LEVELS = (*FORCES, *BEYOND)
G1_MASS, DURATION = 35.0, 0.1  # [kg] as the paper states it, [s]
DIRECTIONS = 8
EARLIEST, LATEST = 2.0, 3.0  # of the kick [s]
END = 10.0  # of an episode [s]
DOWN, UP = -0.1, 0.2  # least and most of the vertical part, as a share of the jump
EPISODES = 200  # a level
SEED = 20261209  # of the draws; a level adds its place


def jump_of(force: float) -> float:
    """The jump of a level, named by its force on the G1 [N], in m/s."""
    return force * DURATION / G1_MASS


def uniforms(seed: int, *shape: int) -> NDArray[np.float64]:
    """Uniforms in [0, 1) from raw bits of PCG64, whose stream numpy guarantees across versions."""
    generator = np.random.PCG64(np.random.SeedSequence(seed))
    raw = np.asarray(generator.random_raw(math.prod(shape)), dtype=np.uint64)
    return ((raw >> np.uint64(11)).astype(np.float64) * 2.0**-53).reshape(shape)


@cache
def kick_scenarios(
    form: str, episodes: int = EPISODES, mass: float = REFERENCE.mass
) -> dict[int, tuple[Scenario, ...]]:
    """Level of LEVELS (the force on the G1 [N]) -> its scenarios in place, for a robot of a mass [kg]."""
    return {
        force: tuple(
            _scenario(form, mass, force, i, *u)
            for i, u in enumerate(uniforms(SEED + place, EPISODES, 3).tolist()[:episodes])
        )
        for place, force in enumerate(LEVELS)
    }


def _scenario(
    form: str, mass: float, force: int, index: int, time: float, turn: float, lift: float
) -> Scenario:
    """Episode `index` of a level, from three numbers in [0, 1)."""
    start = round(EARLIEST + time * (LATEST - EARLIEST), 4)
    psi = 2.0 * math.pi * (turn if form == "coded" else index % DIRECTIONS / DIRECTIONS)
    rise = DOWN + lift * (UP - DOWN) if form == "coded" else 0.0
    jump = jump_of(force)
    x, y, z = (round(jump * share, 6) + 0.0 for share in (math.cos(psi), math.sin(psi), rise))
    label = f"kick-{form}-{force}-{index:03d}"
    if form != "force":
        return Scenario(label, duration=END, noise_seed=index, kicks=(Kick((x, y, z), start),))
    scale = mass / DURATION
    push = Push((round(scale * x, 3) + 0.0, round(scale * y, 3) + 0.0, 0.0), DURATION, start)
    return Scenario(label, (push,), duration=END, noise_seed=index)


def every_kick(form: str) -> tuple[Scenario, ...]:
    """The published levels of a form, the weakest first."""
    levels = kick_scenarios(form)
    return tuple(scenario for force in FORCES for scenario in levels[force])


LOWEST = 0.30 / 0.79  # height of the pelvis at which it counts as fallen, share of that in which it stands
STEEPEST = 1.2  # tilt of the trunk at which it does [rad]
STILL = 0.15  # speed of the base below which it counts as stable [m/s]
ON_GRID = 1e-9  # within which a period begins with a disturbance [s]
UPRIGHT = 8  # entry of a body's rotation matrix: the cosine of its tilt


class KickWatcher:
    """Watches pelvis and trunk of each robot, at the true state, from the disturbance on."""

    def __init__(self) -> None:
        self._episodes: dict[int, Measures] = {}

    def begin(self, core: BipedCore, k: int, scenario: Scenario) -> None:
        """Robot k has begun a scenario with one kick or one push at a time."""
        spans = [(kick.start, 0.0) for kick in scenario.kicks]
        spans += [(push.start, push.duration) for push in scenario.pushes]
        times = [(start, duration) for start, duration in spans if not isinstance(start, GaitEvent)]
        standing = float(core.true_state(k).qpos[k, 2])
        self._episodes[k] = Measures(*min(times, default=(math.inf, 0.0)), standing)

    def look(self, core: BipedCore, k: int) -> None:
        """Take in where robot k is."""
        state = core.true_state(k)
        self._episodes[k].take(
            float(core.gait.time[k]),
            float(state.qpos[k, 2]),
            float(np.linalg.norm(state.qvel[k, :3])),
            math.acos(min(max(float(state.xmat[k, TRUNK, UPRIGHT]), -1.0), 1.0)),
        )

    def end(self, core: BipedCore, k: int, outcome: Outcome) -> dict[str, Any]:
        """RSR, TTS and PTT of the episode."""
        return self._episodes.pop(k).entries(outcome)


class Measures:
    """Measures of an episode: a disturbance at `start` of a `duration` [s], a pelvis `standing` high [m].

    It acts from the first period on that begins at its start or later, so a moment counts as stable after it
    only where a whole period lies between.
    """

    def __init__(self, start: float, duration: float, standing: float):
        self._start, self._over, self._last, self._standing = start, start + duration, 0.0, standing
        self._lowest, self._steepest, self._tilt, self._stable = standing, 0.0, 0.0, math.nan

    def take(self, time: float, height: float, speed: float, tilt: float) -> None:
        """Count one moment: [s], [m], [m/s], [rad]."""
        self._lowest, self._steepest = min(self._lowest, height), max(self._steepest, tilt)
        after, self._last = self._last >= self._over - ON_GRID, time
        if time > self._start:
            self._tilt = max(self._tilt, tilt)
            if after and math.isnan(self._stable) and speed < STILL:
                self._stable = time

    def entries(self, outcome: Outcome) -> dict[str, Any]:
        """Entries of a row; the time to stable of one that never was is what was left of its episode."""
        stands = outcome.survived and self._lowest >= LOWEST * self._standing and self._steepest <= STEEPEST
        stable = outcome.end_time if math.isnan(self._stable) else self._stable
        after = math.isfinite(self._start)
        return {
            "stood": stands,
            "time_to_stable": round(stable - self._start, 6) if after else None,
            "peak_tilt_deg": round(math.degrees(self._tilt), 4) if after else None,
        }
