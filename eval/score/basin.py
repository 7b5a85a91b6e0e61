"""The N-step capture basin: from which DCM how many steps bring a robot to where it need not step.

A kick at the start of a left stance moves the DCM to a point of a grid. What is measured is the number of
steps until the DCM first lies where CoP and trunk alone would catch it; what theory says is the least N of
`n_step_offset` that holds the point. A controller that takes more steps than that has time, or errs.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.model.capturability import (
    OffsetBounds,
    capture_constants,
    constants_of,
    n_step_offset,
    recoverable_offset,
    trunk_reserve,
)
from ...controllers.model.nominal_gait import step_start_dcm
from ...controllers.model.observation import DCM, TRUNK_ANGLE, TRUNK_RATE
from ...controllers.validation import require_integer
from ...envs.scenario.push import GaitEvent, Push
from ...envs.scenario.scenario import IN_PLACE, Scenario
from ..output.progress import Work, about, progress_bars, robot_seconds
from ..output.tables import Table, markdown_page, named_apart, write_pictures, write_reports
from ..rollout.environments import code_digest, env_label, make_env, preset_digest
from ..rollout.episodes import Observer
from ..rollout.outcome import Outcome
from ..rollout.policy_source import keep_rows, open_rows, policy_sources
from ..rollout.workers import Runner, parallel
from .limits import NOMINAL_STEPS, nominal_gait_in_use

KICK_TIME = 1e-4  # of the push that stands for a jump of the velocity [s]
SETTLE = 3.0  # that an episode goes on after it [s]
MOST_STEPS = 4  # from which on steps are counted together
MARGIN = 1.15  # of the grid, over the bounds of any number of steps
FORMAT, KEY = 1, ("policy", "y_m")  # of the rows
Steps = Sequence[Sequence[int | None]]  # by y, then x; None: never


def theory_bounds(env: gym.Env) -> list[OffsetBounds]:
    """Bounds of what 0, 1, ... MOST_STEPS - 1 steps catch, and last of what any number of them does."""
    unwrapped: Any = env.unwrapped
    robot, limits = unwrapped.robot, unwrapped.limits
    return [*(n_step_offset(robot, limits, n) for n in range(MOST_STEPS)), recoverable_offset(robot, limits)]


@dataclass(frozen=True)
class Grid:
    """Points of the DCM at the start of a left stance, canonical frame [m]."""

    x: tuple[float, ...]  # forward
    y: tuple[float, ...]  # towards the swing side

    @classmethod
    def around(cls, env: gym.Env, points: int) -> "Grid":
        """`points` along each axis, beyond the bounds of what any number of steps catches."""
        unwrapped: Any = env.unwrapped
        bounds = recoverable_offset(unwrapped.robot, unwrapped.limits)
        axes = (
            tuple(np.round(np.linspace(MARGIN * low, MARGIN * high, points), 4).tolist())
            for low, high in zip(bounds.low, bounds.high, strict=True)
        )
        return cls(*axes)

    def closed_form(self, env: gym.Env) -> list[list[int | None]]:
        """The least number of steps of theory, MOST_STEPS for as many or more; None: none catches it."""
        bounds = theory_bounds(env)

        def least(point: NDArray[np.float64]) -> int | None:
            holds = ((one.low <= point).all() and (point <= one.high).all() for one in bounds)
            return next((n for n, inside in enumerate(holds) if inside), None)

        return [[least(np.array([x, y])) for x in self.x] for y in self.y]


def kicked(env: gym.Env, x: float, y: float) -> Scenario:
    """The scenario whose DCM is at (x, y) [m] when the fifth step begins, on the left foot."""
    unwrapped: Any = env.unwrapped
    robot, gait = unwrapped.robot, nominal_gait_in_use(env, IN_PLACE)
    start = step_start_dcm(gait, robot.pelvis_width, robot.omega)
    per_metre = robot.mass * robot.omega / KICK_TIME
    force = per_metre * (x - float(start[0])), -per_metre * (y - float(start[1])), 0.0
    push = Push(force, KICK_TIME, GaitEvent(NOMINAL_STEPS, "left", 0.0))
    return Scenario(f"basin-{x:g}-{y:g}", (push,), settle_time=SETTLE)


class StepsToCapture(Observer):
    """Counts the steps of robots from the push on until CoP and trunk alone would catch the DCM."""

    def __init__(self, env: gym.Env) -> None:
        unwrapped: Any = env.unwrapped
        self._constants = constants_of(capture_constants(unwrapped.robot, unwrapped.limits))
        self.steps: dict[str, int] = {}  # by scenario
        self._scenarios: dict[int, str] = {}

    def begin(self, robots: Any, k: int, scenario: Scenario) -> None:
        """Remember what robot k has begun."""
        self._scenarios[k] = scenario.id

    def after_step(self, robots: Any, rows: Any) -> None:
        """Look whether the robots `rows` are there."""
        episodes = robots.episodes
        motion, core = episodes.motion(), episodes.core
        for k in rows.tolist():
            name = self._scenarios[k]
            pushed = core.pushes.start[k].min() < motion.time[k] - 1e-9
            if name not in self.steps and pushed and self._stays(core.truth[k]):
                self.steps[name] = int(motion.steps[k]) - NOMINAL_STEPS

    def _stays(self, seen: NDArray[np.float64]) -> bool:
        """Whether CoP and what the trunk has left catch an observation (36,) without noise."""
        c = self._constants
        axes = zip(
            seen[DCM].tolist(), seen[TRUNK_ANGLE].tolist(), seen[TRUNK_RATE].tolist(),
            (c.cop_x_max, c.cop_y_max), (c.trunk_pitch_max, c.trunk_roll_max), strict=True,
        )  # fmt: skip
        for dcm, angle, rate, sole, push in axes:
            side = 1.0 if dcm > 0.0 else -1.0
            if abs(dcm) > sole + trunk_reserve(side * angle, side * rate, push, c):
                return False
        return True


@dataclass(frozen=True)
class BasinJob:
    """A line of the grid, of one policy."""

    policy: str
    x: tuple[float, ...]
    y: float


def measure(runner: Runner, job: BasinJob) -> dict[str, Any]:
    """The task of `parallel`: steps along a line of the grid, None where a robot fell or got not so far."""
    seen = StepsToCapture(runner.env)
    scenarios = [kicked(runner.env, x, job.y) for x in job.x]
    outcomes: dict[str, Outcome] = {
        one.scenario_id: one for one in runner.run_all(job.policy, scenarios, seen)
    }
    steps = [seen.steps.get(one.id) if outcomes[one.id].survived else None for one in scenarios]
    return {"policy": job.policy, "y_m": job.y, "steps": steps}


@dataclass(frozen=True)
class Basin:
    """Numbers of steps over a grid, of theory and of policies."""

    env_id: str
    grid: Grid
    closed_form: Steps
    measured: Mapping[str, Steps]  # by policy
    directory: Path

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types; rows go with y, columns with x."""
        places = {"x_m": list(self.grid.x), "y_m": list(self.grid.y)}
        return {
            "env": self.env_id,
            **places,
            "closed_form": self.closed_form,
            "policies": dict(self.measured),
        }


def basin(
    env_id: str,
    policies: Any,
    points: int,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Basin:
    """Measure the basin of all policies on a grid of `points` x `points`; lines that are there are kept.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration.
    """
    require_integer("points", points, 2, 400)
    sources = policy_sources(policies)
    with closing(Runner(env_id, sources)) as runner:
        for name in sources:
            runner.acting(name)
        grid = Grid.around(runner.env, points)
        closed_form = grid.closed_form(runner.env)
    config = {"format": FORMAT, "basin": {"env_id": env_id, **asdict(grid)}, "code": code_digest()}
    config |= preset_digest(env_id)
    label = f"basin-{env_label(env_id)}"
    store, digests = open_rows(label, config, sources, KEY, ("steps",), directory, overwrite)
    jobs = [BasinJob(name, grid.x, y) for name in sources for y in grid.y if (name, y) not in store.rows]
    simulated = (NOMINAL_STEPS + SETTLE) * points * sum(sources[job.policy].cost for job in jobs)
    length = about(robot_seconds(env_id, simulated, workers))
    work = Work(f"{points} x {points} kicks for {', '.join(sources)}", length, store.directory)
    count = {name: sum((name, y) in store.rows for y in grid.y) for name in sources}
    with store, progress_bars(list(sources), points, work, count) as bars:
        found = parallel(env_id, measure, jobs, workers, sources)
        keep_rows(store, found, digests, bars, count, lambda row: f"y {row['y_m']:g} m")
    measured = {name: [store.rows[name, y]["steps"] for y in grid.y] for name in sources}
    return Basin(env_id, grid, closed_form, measured, store.directory)


def basin_table(found: Basin) -> Table:
    """How many points of the grid are caught with how many steps, by theory and by policy."""
    theory = _flat(found.closed_form)
    lines = []
    for name, steps in {"closed form": found.closed_form, **found.measured}.items():
        own = _flat(steps)
        counts = [sum(own == n) for n in range(MOST_STEPS)]
        more = sum((own >= MOST_STEPS) & np.isfinite(own))
        both = np.isfinite(own) & np.isfinite(theory)
        fewer = sum(own[both] < theory[both])
        lines.append((name, *map(str, (*counts, more, sum(np.isinf(own)), fewer))))
    columns = (
        "", *(f"{n} steps" for n in range(MOST_STEPS)), f"{MOST_STEPS} or more", "not", "fewer than theory"
    )  # fmt: skip
    note = (
        "Points of the DCM at the start of a left stance, by the number of steps until CoP and trunk alone "
        "catch it, or until the robot has fallen or does not come so far."
    )
    return Table(f"{found.env_id}: N-step capture basin, {len(theory)} points", columns, lines, note)


def _flat(steps: Steps) -> NDArray[np.float64]:
    """Numbers of steps in a row, inf for never."""
    return np.array([math.inf if n is None else n for line in steps for n in line])


def write_basin_reports(found: Basin) -> Path:
    """Write report.md, whose path is returned, and report.json."""
    return write_reports(
        found.directory, found.to_dict(), markdown_page("Capture basin", [basin_table(found)])
    )


def save_basin(found: Basin) -> list[Path]:
    """Write basin.png and basin.svg: the maps side by side, theory first, and its bounds over each."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch, Rectangle

    colors = ["#0b5394", "#4a86c5", "#8fb8de", "#c9dcef", "#f2d9bd", "#d9d9d9"]
    maps = {"closed form": found.closed_form, **found.measured}
    figure = Figure(figsize=(3.1 * len(maps) + 0.6, 5.2), layout="constrained")
    with closing(make_env(found.env_id)) as env:
        bounds = theory_bounds(env)
    for number, (name, steps) in enumerate(maps.items()):
        axes: Any = figure.add_subplot(1, len(maps), number + 1)
        flat = _flat(steps)
        level = np.where(np.isinf(flat), MOST_STEPS + 1, np.minimum(flat, MOST_STEPS))
        level = level.reshape(len(found.grid.y), len(found.grid.x))
        axes.pcolormesh(
            found.grid.y, found.grid.x, level.T, cmap=ListedColormap(colors), vmin=-0.5,
            vmax=MOST_STEPS + 1.5, shading="nearest",
        )  # fmt: skip
        for one in bounds:
            (low_x, low_y), (high_x, high_y) = one.low, one.high
            axes.add_patch(
                Rectangle((low_y, low_x), high_y - low_y, high_x - low_x, fill=False, linewidth=0.7)
            )
        axes.set(aspect="equal", title=name, xlabel="towards the swing side [m]")
        if number == 0:
            axes.set_ylabel("DCM forward of the stance sole [m]")
    labels = [*map(str, range(MOST_STEPS)), f"{MOST_STEPS} or more", "not caught"]
    handles = [Patch(color=color, label=label) for color, label in zip(colors, labels, strict=True)]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize="small", title="steps")
    figure.suptitle(f"{found.env_id}: steps until none is needed", fontsize="medium")
    return write_pictures(figure, found.directory, f"basin{named_apart(found.directory, found.measured)}")
