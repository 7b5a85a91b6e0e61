"""The largest recoverable push by direction, beside the closed-form limit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...controllers.errors import InvalidValueError
from ...envs.episode.episodes import GaitEpisodes
from ...envs.episode.profile import EXACT, get_profile
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push import Body, GaitEvent, polar_push
from ...envs.scenario.scenario import Command, Scenario
from ..output.progress import progress_bars
from ..output.work import Work, about, robot_seconds
from ..rollout.environments import code_digest, env_label, make_env, preset_digest, profile_on
from ..rollout.outcome import Outcome
from ..rollout.policy_source import open_rows, policy_sources
from ..rollout.workers import Runner, parallel
from ..score.bounds_met import fall_bounds
from .closed_form import DirectionLimits, direction_limits
from .grid import BEYOND, FORCE_CAP, NOMINAL_STEPS, Scanned, directions_deg, multiples, scan_upwards

FORMAT = 2  # of the rows
KEY = ("policy", "psi_deg")  # of a row
FOUND = ("survived_N", "largest_survived_N", "failed_N", "falls")  # fields that a report is made of
IN_PLACE = Command()
SIMULATED = 500.0  # seconds of a robot that one direction of a policy takes, about: eighty forces


@dataclass(frozen=True)
class FrontierSettings:
    """The push whose force is scanned: at the start of a left stance after four nominal steps."""

    env_id: str
    grid: float = 20.0  # [N]
    duration: float = 0.1  # [s]
    body: Body = "pelvis"
    command: Command = IN_PLACE
    errors: ModelErrors = EXACT_MODEL
    profile: str = EXACT.name

    def __post_init__(self) -> None:
        if not 0 < self.grid <= FORCE_CAP:
            raise InvalidValueError(f"grid must be in (0, {FORCE_CAP:g}] N, got {self.grid}")
        get_profile(self.profile)

    def scenario(self, psi_deg: float, force: float) -> Scenario:
        """The push of `force` [N] towards psi."""
        event = GaitEvent(NOMINAL_STEPS, "left", 0.0)
        push = polar_push(force, math.radians(psi_deg), self.duration, event, self.body)
        name = f"frontier-{psi_deg:g}deg-{force:g}N"
        scenario = Scenario(name, (push,), self.command, "left", errors=self.errors)
        return profile_on(self.env_id, self.profile).applied(scenario)


@dataclass(frozen=True)
class ScanJob:
    """One direction of one policy."""

    settings: FrontierSettings
    policy: str
    psi_deg: float


def scan(runner: Runner, job: ScanJob) -> dict[str, Any]:
    """The row of one direction: raise the force by the grid until BEYOND past the first failure."""
    outcomes = scan_upwards(
        lambda forces: _outcomes(runner, job, forces),
        multiples(job.settings.grid),
        BEYOND,
        lambda outcome: outcome.survived,
    )
    found = Scanned.of({force: outcome.survived for force, outcome in outcomes.items()})
    return {
        "policy": job.policy,
        "psi_deg": job.psi_deg,
        "survived_N": found.survived,
        "largest_survived_N": found.largest_survived,
        "failed_N": list(found.failed),
        "falls": [fall_bounds(force, outcomes[force]) for force in found.failed],
    }


def _outcomes(runner: Runner, job: ScanJob, forces: Iterator[float]) -> Iterator[tuple[float, Outcome]]:
    """Outcomes of forces [N], which run side by side, as they finish."""
    begun: dict[str, float] = {}  # scenario -> force

    def scenarios() -> Iterator[Scenario]:
        for force in forces:
            scenario = job.settings.scenario(job.psi_deg, force)
            begun[scenario.id] = force
            yield scenario

    for outcome in runner.run_all(job.policy, scenarios()):
        yield begun[outcome.scenario_id], outcome


@dataclass(frozen=True)
class Frontier:
    """Scans of several policies in the same directions."""

    settings: FrontierSettings
    rows: dict[str, list[dict[str, Any]]]  # policy -> direction rows
    limits: Mapping[float, DirectionLimits]  # F* by direction [deg]
    directory: Path

    def to_dict(self, policy: str) -> dict[str, Any]:
        """The contract's object of one policy."""
        directions = []
        for row in self.rows[policy]:
            limit, force = self.limits[row["psi_deg"]], row["survived_N"]
            directions.append(
                {
                    "psi_deg": row["psi_deg"],
                    "survived_N": force,
                    "largest_survived_N": row["largest_survived_N"],
                    "limit_N": limit.paper,
                    "fraction": limit.share(force, limit.paper),
                    "own_limit_N": limit.own,
                    "own_fraction": limit.share(force, limit.own),
                }
            )
        push = {"duration": self.settings.duration, "body": self.settings.body}
        return {"env": self.settings.env_id, "policy": policy, "push": push, "directions": directions}


def default_grid(env_id: str) -> float:
    """The environment's own grid [N]; that of any gait environment where it names none."""
    env: Any = make_env(env_id)
    grid = float(getattr(getattr(env.unwrapped, "episodes", None), "force_grid", GaitEpisodes.force_grid))
    env.close()
    return grid


def frontier(
    settings: FrontierSettings,
    policies: Any,
    directions: int = 16,
    workers: int = 1,
    directory: Path | None = None,
    overwrite: bool = False,
) -> Frontier:
    """Scan all directions for all policies; directions done before in the directory are kept.

    Raises:
        PushRecoveryError: unknown names, a directory of another configuration.
    """
    sources = policy_sources(policies)
    angles = directions_deg(directions)
    runner = Runner(settings.env_id, sources)
    for name in sources:
        runner.policy(name)
    limits = {psi: direction_limits(runner.env, psi, settings.duration, settings.command) for psi in angles}
    runner.close()
    config = {"format": FORMAT, "frontier": asdict(settings), "code": code_digest()}
    config |= preset_digest(settings.env_id)
    label = f"frontier-{env_label(settings.env_id)}"
    store, digests = open_rows(label, config, sources, KEY, FOUND, directory, overwrite)
    jobs = [
        ScanJob(settings, name, psi) for name in sources for psi in angles if (name, psi) not in store.rows
    ]
    cost = sum(sources[job.policy].cost for job in jobs)
    length = about(robot_seconds(settings.env_id, cost * SIMULATED, workers))
    work = Work(f"{directions} directions for {', '.join(sources)}", length, store.directory)
    count = {name: sum((name, psi) in store.rows for psi in angles) for name in sources}
    with store, progress_bars(list(sources), len(angles), work, count) as bars:
        for row in parallel(settings.env_id, scan, jobs, workers, sources):
            store.append({**row, "policy_sha256": digests[row["policy"]]})
            count[row["policy"]] += 1
            bars.set(row["policy"], count[row["policy"]], f"{row['psi_deg']:g} deg: {row['survived_N']:g} N")
    rows = {name: [store.rows[name, psi] for psi in angles] for name in sources}
    return Frontier(settings, rows, limits, store.directory)
