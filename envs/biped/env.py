"""`PushRecovery/Biped-v0`: the 60 kg MuJoCo biped under a gait action."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from typing import Any, ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...controllers.array_table import COMMON, NO_STATE, SENSED
from ...controllers.jit import source_digest
from ...controllers.model.robot import Similarity
from ...controllers.settings import preset_config
from ...controllers.validation import require_kind
from ...controllers.whole_body.gait_machine import FAILURES
from ..episode.episodes import GaitEpisodes, Ints
from ..episode.gym_env import GaitEnv
from ..episode.period_end import Motion
from ..episode.vector_env import vector_maker
from ..robots.compiled_robot import compiled_robot
from ..robots.description import RobotDescription, check_preset, robot_description
from ..scenario.distribution import PushDistribution
from ..scenario.push import FLOOR_LAWS
from ..scenario.scenario import Scenario, get_profiles
from ..snapshot import Arrays, RobotSnapshot, arrays_of, digest_of, model_digest
from .core import BIPED, BIPED_LIMITS, BipedCore, biped_settings
from .floor import tile_places
from .laws import floor_state, put_floor_state

__all__ = ["BIPED", "BIPED_LIMITS", "BipedConfig", "BipedEnv", "BipedEpisodes", "make_biped_vector"]

# Rows of a snapshot that are in no array
SIMULATION, TILES, KICKED = "simulation.state", "simulation.tiles", "kicks.done"
FLOOR = "simulation.floor"


@cache
def _version() -> str:
    """Name the code that the future of a robot follows from, besides its state and settings."""
    code = source_digest(BipedCore.__module__)
    return f"push-recovery {version('push-recovery')} {code}, mujoco {mujoco.__version__}"


@dataclass(frozen=True)
class BipedConfig:
    """Which bipeds: robot, settings, planning rate, and what is true of them in scenarios."""

    preset: str | None = None  # of the robot's settings and its planner's, by name or file; None: its own
    control_hz: float = 100.0  # planning rate [Hz]; divides the physics rate of 500 Hz
    robot: str | RobotDescription = "biped"  # or the place of another's description, `module:attribute`
    profile: str | Sequence[str] = "exact"  # of robots in scenarios that are drawn, one of several alike
    sensing: str | None = None  # in every scenario, above what it says; None: what it says
    variant: str = ""  # policy whose own robot they are, where the preset has one for it


class BipedEpisodes(GaitEpisodes[BipedCore]):
    """Episodes of n robots of a config; `config` with all that its defaults stand for."""

    failures, name = FAILURES, "PushRecovery/Biped-v0"
    takes_kicks = takes_laws = walks = stands = has_double_support = True
    core_of: ClassVar[type[BipedCore]] = BipedCore
    config_of = BipedConfig  # whose fields the constructor takes, too

    def __init__(self, n: int, config: BipedConfig | None = None, threads: int = 1, **changes: Any):
        """Build the robots.

        Args:
            n: number of robots.
            config: which; None: the biped.
            threads: that share their physics, and change nothing else.
            changes: of single fields of the config.

        Raises:
            PushRecoveryError: an unknown name or an impossible value.
        """
        config = BipedConfig() if config is None else require_kind("config", config, BipedConfig)
        config = replace(config, **changes)
        self.description = robot_description(config.robot)
        body = compiled_robot(self.description)
        self.profile = get_profiles(config.profile).scaled(Similarity.of(body.robot))
        preset = self.description.preset if config.preset is None else config.preset
        self.config = replace(config, preset=preset, robot=self.description)
        settings = biped_settings(preset, config.variant).of_robot(body.robot)
        check_preset(preset, body.robot, settings.limits)
        super().__init__(n, body.robot, settings.limits, preset, config.control_hz, config.variant)
        self.core = self.core_of(
            self.n, self.robot, self.limits, self.control_hz, threads, body, config.sensing
        )
        self.core.configure(settings, preset_config(preset, config.variant))

    def _options(self) -> dict[str, Any]:
        """Further arguments of the constructor that made these."""
        return {}

    def _clone(self, n: int, threads: int) -> Self:
        return type(self)(n, self.config, threads, **self._options())

    def _arrays(self, k: int) -> Arrays:
        core = self.core
        estimate = core.senses.kinds[core.senses.of(k)].estimate
        own = arrays_of(core.own, {NO_STATE, COMMON}) | super()._arrays(k)
        if not estimate:
            return arrays_of(core.arena_of(k), {NO_STATE, COMMON, SENSED}) | own
        estimates = {f"estimate.{name}": array for name, array in estimate._asdict().items()}
        return arrays_of(core.arena_of(k), {NO_STATE, COMMON}) | estimates | own

    def _beside_arrays(self, k: int) -> Arrays:
        simulations = self.core.simulations
        tiles, floor = tile_places(simulations.models[k]).copy(), floor_state(simulations.models[k])
        kicked = np.array(self.core.kicks.done[k])
        return {SIMULATION: simulations.state(k), TILES: tiles, FLOOR: floor, KICKED: kicked}

    def _put_beside_arrays(self, k: int, snapshot: RobotSnapshot) -> None:
        simulations = self.core.simulations
        tile_places(simulations.models[k])[:] = snapshot.rows[TILES]
        if np.isin(self.core.pushes.law[k], FLOOR_LAWS).any():
            put_floor_state(simulations.models[k], snapshot.rows[FLOOR])
        self.core.put_back(k, snapshot.rows[SIMULATION])
        self.core.kicks.pass_over(k, snapshot.rows[KICKED].item())

    def _made_for(self, scenario: Scenario) -> dict[str, str]:
        core = self.core
        common = arrays_of(core.arena_of(0), {NO_STATE, SENSED}, only=COMMON)
        settings = [array.tobytes() for _, array in sorted(common.items())]
        return {
            "robot": f"{self.description.name} {model_digest(core.body.model)}",
            "form of the biped": self.name,
            "settings": digest_of(self._constants.tobytes(), core.constants.tobytes(), *settings),
            "planning rate": f"{self.control_hz:g} Hz",
            "sensing": self.config.sensing or scenario.sensing,
            "version": _version(),
        }

    def more_info(self) -> dict[str, tuple[NDArray[Any], NDArray[np.bool_]]]:
        """What any robot has, and the impulse so far of those whose pushes follow laws, (n, 3) [N s]."""
        found = super().more_info()
        felt: Any = self.core.pushes.law.any(axis=1)
        if felt.any():
            found["delivered"] = self.core.pushes.delivered.sum(axis=1), felt
        return found

    def motion(self) -> Motion:
        """Steps, CoM, time and stance sides."""
        gait = self.core.gait
        return Motion(gait.steps, self.core.com, gait.time, gait.stance, gait.heading)

    def failure(self) -> Ints:
        """Index into FAILURES, (n,)."""
        return self.core.gait.failure


class BipedEnv(GaitEnv):
    """Torque-controlled biped with waist and flat feet; whole-body control realises the gait action.

    The robot's own gait limits are narrower than the paper's where its legs are: see `BIPED_LIMITS`.
    """

    make_episodes: Callable[..., BipedEpisodes] = BipedEpisodes

    def __init__(
        self,
        render_mode: str | None = None,
        control_hz: float = 100.0,
        preset: str | None = None,
        push_distribution: dict[str, Any] | PushDistribution | None = None,
        robot: str | RobotDescription = "biped",
        profile: str | Sequence[str] = "exact",
        sensing: str | None = None,
        variant: str = "",
    ):
        """Build one biped.

        Args:
            render_mode: "human", "rgb_array" or None.
            control_hz: planning rate [Hz]; divides the physics rate of 500 Hz.
            preset: of the planner that belongs to this environment, and of the robot's settings; by name or
                file, by default the robot's own.
            push_distribution: of the scenarios that `reset` draws, as an object or its dict.
            robot: another one than the biped: see `BipedConfig`.
            profile: of the robots in scenarios that `reset` draws: "exact", as the planner takes them to be,
                "collisions", whose legs, arms and trunk collide, or "hardware", with its own sensors,
                losses, delay and finer physics, too; of several each scenario draws one.
            sensing: what planner and control act on in every scenario, the true state ("exact") or what the
                robot's own sensors tell ("onboard"); None: what the scenario says.
            variant: the policy that will act, for its own robot where the preset has one (`arms.NAME.biped`).
        """
        config = BipedConfig(preset, control_hz, robot, profile, sensing, variant)
        super().__init__(self.make_episodes(1, config), render_mode, push_distribution)
        self.variant = variant

    def _make_picture(self, window: bool) -> Any:
        from .view import BipedView

        return BipedView(self.core.body, window=window)

    def _draw(self) -> NDArray[np.uint8] | None:
        return self._picture.draw(self.core)


make_biped_vector = vector_maker(BipedEnv, BipedEpisodes)  # of PushRecovery/Biped-v0
