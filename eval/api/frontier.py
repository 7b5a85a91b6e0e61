"""The largest recoverable push by direction."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push import Body
from ...envs.scenario.scenario import Command
from ..frontier.scan import Frontier, FrontierSettings, default_grid
from ..frontier.scan import frontier as scan_directions
from ..rollout.names import DEFAULT_ENV

IN_PLACE = Command()


def frontier(
    policies: Any = "two-stage",
    directions: int = 16,
    env: str = DEFAULT_ENV,
    *,
    grid: float | None = None,
    duration: float = 0.1,
    body: Body = "pelvis",
    command: Command = IN_PLACE,
    errors: ModelErrors = EXACT_MODEL,
    profile: str = "exact",
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
) -> Frontier:
    """Scan the force of a push by direction, at the start of a left stance after four nominal steps.

    Args:
        policies: as those of `evaluate`.
        directions: how many, counter-clockwise from forward.
        env: id of a gait environment.
        grid: step of the force [N]; by default 10 on the pendulum, 20 elsewhere.
        duration: of the push [s].
        body: that is pushed.
        command: velocity that is walked at.
        errors: what robot and floor are off from what the planner believes.
        profile: of the robot, "exact" or "hardware"; `errors` stand where both say something.
        workers: processes, see `evaluate`.
        out: directory of the results; by default one under runs/ named after the configuration.
        overwrite: start over where the directory holds results.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration, a policy that can't act.
    """
    settings = FrontierSettings(
        env, default_grid(env) if grid is None else grid, duration, body, command, errors, profile
    )
    directory = None if out is None else Path(out)
    return scan_directions(settings, policies, directions, workers, directory, overwrite)
