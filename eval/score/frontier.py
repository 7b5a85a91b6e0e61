"""The largest push by direction that a policy recovers from, beside the closed-form limits F*.

A force is tried on replicas, which differ in the phase of the step at which the push begins, in the start and
in the noise. What counts is the force up to which at least 0.8 of them recover (`threshold`). A robot that
stands is pushed at rest, and the largest push that it catches without a step is found, too, beside F*_stand.

One replica is the nominal trajectory: pushed at the start of a left stance, each force of a grid, weakest
first, until `BEYOND` past the first fall. Survival is not monotone in the force, and beyond the first fall
there may be islands that are survived.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Protocol

from ...controllers.errors import InvalidValueError
from ...controllers.validation import require_integer, require_kind, require_number
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push import Body, GaitEvent, polar_push
from ...envs.scenario.scenario import EXACT, Command, Scenario, get_profile
from ..output.progress import Work, about, progress_bars, robot_seconds
from ..rollout.environments import code_digest, env_label, make_env, preset_digest, profile_on
from ..rollout.outcome import Outcome
from ..rollout.policy_source import keep_rows, open_rows, policy_sources
from ..rollout.workers import Runner, parallel
from . import threshold
from .limits import NOMINAL_STEPS, DirectionLimits, direction_limits, limit_of_phases
from .threshold import (
    BEYOND,
    FORCE_CAP,
    RECOVERED_SHARE,
    SHARES,
    Estimate,
    Replica,
    Scanned,
    Tried,
    directions_deg,
)

AT_REST_FOR, AT_REST_FOR_MORE = 0.5, 0.5  # a robot that stands, before the push, and at most by its phase [s]
LEAST_GRID = 1.0  # [N]
FORMAT = 3  # of the rows
KEY = ("policy", "psi_deg")  # of a row
IN_PLACE = Command()
Row = dict[str, Any]


@dataclass(frozen=True)
class FrontierSettings:
    """The push whose force is scanned: on a left stance after four nominal steps, at its start or any phase.

    A robot whose command is to stand is pushed after AT_REST_FOR, or up to AT_REST_FOR_MORE later.
    """

    env_id: str
    grid: float = 20.0  # [N]
    duration: float = 0.1  # [s]
    body: Body = "pelvis"
    command: Command = IN_PLACE
    errors: ModelErrors = EXACT_MODEL
    profile: str = EXACT.name
    replicas: int = 1  # of a force; of one the nominal trajectory is run
    replica_seed: int = 0  # that they are drawn from

    def __post_init__(self) -> None:
        require_number("grid [N]", self.grid, LEAST_GRID, FORCE_CAP)
        polar_push(self.grid, 0.0, self.duration, AT_REST_FOR, self.body)  # which has to be possible
        require_kind("command", self.command, Command)
        require_kind("errors", self.errors, ModelErrors)
        get_profile(self.profile)
        threshold.draw_replicas(self.replicas, self.replica_seed)

    @cached_property
    def drawn(self) -> tuple[Replica, ...]:
        """The replicas of every force, direction and policy."""
        return threshold.draw_replicas(self.replicas, self.replica_seed)

    @property
    def search(self) -> "Search":
        """How a direction is searched."""
        return Nominal(self) if self.replicas == 1 else Replicated(self)

    def scenario(self, psi_deg: float, force: float) -> Scenario:
        """The push of `force` [N] towards psi."""
        start = AT_REST_FOR if self.command.stand else GaitEvent(NOMINAL_STEPS, "left", 0.0)
        push = polar_push(force, math.radians(psi_deg), self.duration, start, self.body)
        name = f"frontier-{psi_deg:g}deg-{force:g}N"
        scenario = Scenario(name, (push,), self.command, "left", errors=self.errors)
        return profile_on(self.env_id, self.profile).applied(scenario)

    def replicated(self, psi_deg: float, force: float, index: int) -> Scenario:
        """The same push on a replica.

        Raises:
            InvalidValueError: there is no such replica.
        """
        if not 0 <= index < self.replicas:
            raise InvalidValueError(
                f"replica must be in [0, {self.replicas - 1}] of {self.replicas} replicas, got {index}"
            )
        replica, nominal = self.drawn[index], self.scenario(psi_deg, force)
        start: float | GaitEvent = GaitEvent(NOMINAL_STEPS, "left", replica.phase)
        if self.command.stand:
            start = AT_REST_FOR + AT_REST_FOR_MORE * replica.phase
        return replace(
            nominal, id=f"{nominal.id}-{index}", pushes=(replace(nominal.pushes[0], start=start),),
            start=replica.start, noise_seed=replica.noise_seed,
        )  # fmt: skip


@dataclass(frozen=True)
class ScanJob:
    """One direction of one policy; without a direction its replicas unpushed."""

    settings: FrontierSettings
    policy: str
    psi_deg: float | None


OF_A_FALL = ("failure_reason", "first_limit", "limits_met", "limit_shares")  # fields of an outcome


def scan(runner: Runner, job: ScanJob) -> Row:
    """The task of `parallel`: the row of one direction."""
    return {"policy": job.policy, "psi_deg": job.psi_deg, **job.settings.search.run(runner, job)}


class Search(Protocol):
    """How the largest push in a direction is found, and how it is reported."""

    fields: ClassVar[tuple[str, ...]]  # of a row that a report is made of
    headline: ClassVar[str]  # key of the force of an entry that counts
    share: ClassVar[str]  # key of its share of F* of the own box
    meaning: ClassVar[str]  # what that force is
    bracket_note: ClassVar[str]  # what stands in brackets behind it
    control: ClassVar[bool]  # whether replicas are run unpushed, too

    @property
    def seconds(self) -> float:
        """Simulated time that a direction of a policy takes, about [s]."""
        ...

    def run(self, runner: Runner, job: ScanJob) -> Row:
        """Fields of the row of a direction."""
        ...

    def entry(self, row: Mapping[str, Any], control: Mapping[str, Any] | None) -> Row:
        """Forces of a row for the JSON object of a policy, given the row of the unpushed."""
        ...

    def cell(self, entry: Mapping[str, Any]) -> str:
        """The force of an entry and what belongs to it, for a table."""
        ...


def stays(outcome: Outcome) -> bool:
    """Whether a robot neither fell nor stepped."""
    return outcome.survived and not outcome.measures["steps"]


def _fall(force: float, outcome: Outcome, **more: int) -> Row:
    fell = outcome.to_dict()
    return {"force_N": force, **more, **{name: fell[name] for name in OF_A_FALL}}


@dataclass(frozen=True)
class Nominal:
    """One trajectory: the force rises by the grid until BEYOND past the first fall."""

    fields: ClassVar[tuple[str, ...]] = ("survived_N", "largest_survived_N", "failed_N", "falls")
    headline: ClassVar[str] = "survived_N"
    share: ClassVar[str] = "own_fraction"
    meaning: ClassVar[str] = "largest force before the first failure"
    bracket_note: ClassVar[str] = (
        "In brackets the share of F* of the robot's own box, that of the paper's (its Tables I and II), and "
        "the largest force survived at all where that is more."
    )
    control: ClassVar[bool] = False
    settings: FrontierSettings

    @property
    def seconds(self) -> float:
        """Eighty forces [s]."""
        return 500.0

    def run(self, runner: Runner, job: ScanJob) -> Row:
        """Forces before the first failure, and falls."""
        outcomes = threshold.scan_upwards(
            lambda forces: self._outcomes(runner, job, forces),
            threshold.multiples(self.settings.grid),
            BEYOND,
            lambda outcome: outcome.survived,
        )
        found = Scanned.of({force: outcome.survived for force, outcome in outcomes.items()})
        row = {
            "survived_N": found.survived,
            "largest_survived_N": found.largest_survived,
            "failed_N": list(found.failed),
            "falls": [_fall(force, outcomes[force]) for force in found.failed],
        }
        if self.settings.command.stand:
            row["stand_N"] = Scanned.of({force: stays(one) for force, one in outcomes.items()}).survived
        return row

    def _outcomes(
        self, runner: Runner, job: ScanJob, forces: Iterator[float]
    ) -> Iterator[tuple[float, Outcome]]:
        """Outcomes of forces [N], which run side by side, as they finish."""
        begun: dict[str, float] = {}  # scenario -> force

        def scenarios() -> Iterator[Scenario]:
            for force in forces:
                scenario = self.settings.scenario(job.psi_deg or 0.0, force)
                begun[scenario.id] = force
                yield scenario

        for outcome in runner.run_all(job.policy, scenarios()):
            yield begun[outcome.scenario_id], outcome

    def entry(self, row: Mapping[str, Any], control: Mapping[str, Any] | None) -> Row:
        """Largest force before the first failure and at all; where it stands also that without a step."""
        return {name: row[name] for name in ("survived_N", "largest_survived_N", "stand_N") if name in row}

    def cell(self, entry: Mapping[str, Any]) -> str:
        """Force before the first failure, its shares of both F*, and the largest survived where more."""
        shares = (entry["own_fraction"], entry["fraction"])
        share = ", ".join("-" if part is None else f"{part:.2f}" for part in shares)
        more = entry["largest_survived_N"]
        beyond = f"; {more:.0f}" if more > entry["survived_N"] else ""
        return f"{entry['survived_N']:.0f} ({share}{beyond})"


@dataclass(frozen=True)
class Replicated:
    """Replicas: the force up to which RECOVERED_SHARE of them recover, and what else their outcomes say."""

    fields: ClassVar[tuple[str, ...]] = ("forces_N", "recovered", "falls")
    headline: ClassVar[str] = "threshold_N"
    share: ClassVar[str] = "threshold_fraction"
    meaning: ClassVar[str] = f"force up to which {RECOVERED_SHARE:g} of the replicas recover"
    bracket_note: ClassVar[str] = (
        "In brackets the 95 % interval, and the share of F* of the robot's own box: of the force that is "
        f"within it at {RECOVERED_SHARE:g} of the phases of the push. Unpushed: how many replicas recover."
    )
    control: ClassVar[bool] = True
    settings: FrontierSettings

    @property
    def seconds(self) -> float:
        """A dozen forces [s]."""
        return 60.0 * self.settings.replicas

    def run(self, runner: Runner, job: ScanJob) -> Row:
        """Outcomes of all replicas by force, a string of 0 and 1 each, and the first fall at each force."""
        if job.psi_deg is None:
            outcomes = {0.0: self._try(runner, job, 0.0)}
        else:
            outcomes = threshold.search(
                lambda force: self._try(runner, job, force), self._wanted, self.settings.grid
            )
        row: Row = {"forces_N": list(outcomes)}
        for name, yes in self._series.items():
            row[name] = ["".join("01"[yes(one)] for one in tried) for tried in outcomes.values()]
        falls = (
            next(((force, one, i) for i, one in enumerate(tried) if not one.survived), None)
            for force, tried in outcomes.items()
        )
        row["falls"] = [_fall(force, one, replica=i) for force, one, i in filter(None, falls)]
        return row

    @property
    def _series(self) -> dict[str, Callable[[Outcome], bool]]:
        series: dict[str, Callable[[Outcome], bool]] = {"recovered": lambda outcome: outcome.recovered}
        return series | ({"stood": stays} if self.settings.command.stand else {})

    def _wanted(self, outcomes: Sequence[Outcome]) -> list[tuple[threshold.Bools, tuple[float, ...]]]:
        """Outcomes of a force, and the shares that are looked for in each of their series."""
        shares = (SHARES, (RECOVERED_SHARE,))
        return [
            (threshold.bools(map(yes, outcomes)), wanted)
            for yes, wanted in zip(self._series.values(), shares, strict=False)
        ]

    def _try(self, runner: Runner, job: ScanJob, force: float) -> list[Outcome]:
        """Outcomes of a force on the replicas, in their order."""
        psi, count = job.psi_deg or 0.0, self.settings.replicas
        scenarios = [self.settings.replicated(psi, force, i) for i in range(count)]
        found = {one.scenario_id: one for one in runner.run_all(job.policy, scenarios)}
        return [found[scenario.id] for scenario in scenarios]

    def entry(self, row: Mapping[str, Any], control: Mapping[str, Any] | None) -> Row:
        """Threshold, J50 and J95 with their intervals, first failure and islands."""
        tried = self._tried("recovered", row, control)
        j95, at, j50 = tried.estimates(SHARES)
        first = tried.first_failure
        clean = [force for force in tried.forces if first is None or force < first]
        any_recovers = tried.forces[tried.recovered.any(axis=1)]
        found = {
            "threshold_N": round(at.force, 3), "threshold_ci95": _ends(at),
            "survived_N": float(max(clean, default=0.0)),
            "largest_survived_N": float(max(any_recovers, default=0.0)),
            "first_failure_N": first,
            "islands": [{"force_N": force, "replicas": count} for force, count in tried.islands.items()],
            **self._impulse("J50", j50), **self._impulse("J95", j95),
        }  # fmt: skip
        if self.settings.command.stand:
            (stood,) = self._tried("stood", row, control).estimates((RECOVERED_SHARE,))
            found |= {"stand_N": round(stood.force, 3), "stand_ci95": _ends(stood)}
        return found

    def _tried(self, name: str, row: Mapping[str, Any], control: Mapping[str, Any] | None) -> Tried:
        """Outcomes of a series by force, the unpushed first."""
        rows = (row,) if control is None else (control, row)
        bits = {force: text for one in rows for force, text in zip(one["forces_N"], one[name], strict=True)}
        return Tried.of({force: threshold.bools(bit == "1" for bit in text) for force, text in bits.items()})

    def _impulse(self, name: str, force: Estimate) -> Row:
        """An impulse with its interval [N s]."""
        lasts = self.settings.duration
        return {
            f"{name}_Ns": round(lasts * force.force, 3),
            f"{name}_ci95": [round(lasts * end, 3) for end in (force.low, force.high)],
        }

    def cell(self, entry: Mapping[str, Any]) -> str:
        """Threshold, its interval and its share of F*."""
        share, (low, high) = entry[self.share], entry["threshold_ci95"]
        of = "-" if share is None else f"{share:.2f}"
        return f"{entry['threshold_N']:.0f} ({low:.0f} to {high:.0f}; {of})"


def _ends(estimate: Estimate) -> list[float]:
    return [round(estimate.low, 3), round(estimate.high, 3)]


@dataclass(frozen=True)
class Frontier:
    """Scans of several policies in the same directions."""

    settings: FrontierSettings
    rows: dict[str, list[Row]]  # policy -> direction rows
    limits: Mapping[float, DirectionLimits]  # by direction [deg]
    directory: Path
    mass: float  # of the robot [kg]
    controls: Mapping[str, Row] = field(default_factory=dict)  # policy -> row of its replicas unpushed

    def to_dict(self, policy: str) -> Row:
        """JSON object of one policy."""
        return self._objects[policy]

    @cached_property
    def _objects(self) -> dict[str, Row]:
        return {policy: self._object(policy) for policy in self.rows}

    def _object(self, policy: str) -> Row:
        search, control, directions = self.settings.search, self.controls.get(policy), []
        for row in self.rows[policy]:
            limit, found = self.limits[row["psi_deg"]], search.entry(row, control)
            entry = {"psi_deg": row["psi_deg"], **found}
            entry |= {"limit_N": limit.paper, "fraction": _share(found["survived_N"], limit.paper)}
            entry |= {"own_limit_N": limit.own, "own_fraction": _share(found["survived_N"], limit.own)}
            entry["own_stand_limit_N"] = limit.stand
            if search.control:
                own, force = limit.own if limit.phases is None else limit.phases, found["threshold_N"]
                entry |= {"threshold_limit_N": own, "threshold_fraction": _share(force, own)}
                entry |= {f"{name}_Ns_per_kg": found[f"{name}_Ns"] / self.mass for name in ("J50", "J95")}
            directions.append(entry)
        push = {"duration": self.settings.duration, "body": self.settings.body}
        content = {"env": self.settings.env_id, "policy": policy, "push": push, "directions": directions}
        if control is None:
            return content
        replicas = {"count": self.settings.replicas, "seed": self.settings.replica_seed}
        return {**content, "replicas": replicas, "unpushed_recovered": control["recovered"][0].count("1")}


def _share(force: float, limit: float) -> float | None:
    return force / limit if limit > 0 else None


CELL = 2.0 / 3.0  # of a grid of replicas, by the mass of the robot [N/kg]


def default_grid(env_id: str, replicas: int = 1) -> float:
    """The grid of an environment [N].

    For one trajectory its own, or that of any gait environment where it names none. Of replicas, whose
    thresholds lie between the forces, CELL times the robot's mass, to 10 N.
    """
    require_integer("replicas", replicas, 1)
    with closing(make_env(env_id)) as env:
        unwrapped: Any = env.unwrapped
        if replicas > 1:
            return max(10.0 * round(CELL * unwrapped.robot.mass / 10.0), 1.0)
        episodes = getattr(unwrapped, "episodes", None)
        return float(getattr(episodes, "force_grid", GaitEpisodes.force_grid))


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
    search, angles = settings.search, directions_deg(directions)
    push = settings.duration, settings.command
    with closing(Runner(settings.env_id, sources)) as runner:
        for name in sources:
            runner.acting(name)
        runner.check_can_begin([settings.scenario(angles[0], settings.grid)])
        limits = {psi: direction_limits(runner.env, psi, *push) for psi in angles}
        if search.control and not settings.command.stand:
            phases = [replica.phase for replica in settings.drawn], RECOVERED_SHARE
            at = {psi: limit_of_phases(runner.env, math.radians(psi), *push, *phases) for psi in angles}
            limits = {psi: replace(one, phases=at[psi]) for psi, one in limits.items()}
        mass = runner.env.unwrapped.robot.mass  # type: ignore[attr-defined]
    config = {"format": FORMAT, "frontier": asdict(settings), "code": code_digest()}
    config |= preset_digest(settings.env_id)
    label = f"frontier-{env_label(settings.env_id)}"
    store, digests = open_rows(label, config, sources, KEY, search.fields, directory, overwrite)
    wanted = [None, *angles] if search.control else angles
    jobs = [
        ScanJob(settings, name, psi) for name in sources for psi in wanted if (name, psi) not in store.rows
    ]
    cost = sum(sources[job.policy].cost for job in jobs)
    length = about(robot_seconds(settings.env_id, cost * search.seconds, workers))
    work = Work(f"{directions} directions for {', '.join(sources)}", length, store.directory)
    count = {name: sum((name, psi) in store.rows for psi in wanted) for name in sources}
    with store, progress_bars(list(sources), len(wanted), work, count) as bars:
        found = parallel(settings.env_id, scan, jobs, workers, sources)
        keep_rows(store, found, digests, bars, count, partial(_note, search))
    rows = {name: [store.rows[name, psi] for psi in angles] for name in sources}
    controls = {name: store.rows[name, None] for name in sources if search.control}
    return Frontier(settings, rows, limits, store.directory, mass, controls)


def _note(search: Search, row: Mapping[str, Any]) -> str:
    """What a row says, for a progress bar."""
    if row["psi_deg"] is None:
        return f"unpushed: {row['recovered'][0].count('1')} of {len(row['recovered'][0])}"
    return f"{row['psi_deg']:g} deg: {search.entry(row, None)[search.headline]:.0f} N"
