"""The largest recoverable push by direction, beside the closed-form limit F* of two boxes of steps.

A robot that stands is pushed at rest, and the largest push that it catches without a step is found, too,
beside F*_stand, the limit of every controller that takes none.

Forces of a grid are tried, weakest first, until `BEYOND` past the first failure: survival is not monotone in
the force, and beyond the first failure there may be islands that are survived.

F* of the robot's own box of steps says what its controller could at best have reached. F* of the paper's box
(Tables I and II, l_p 0.2 m, foot 0.2 x 0.1 m) is the same for every robot and cannot be moved by choosing
other limits.
"""

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import gymnasium as gym
import numpy as np

from ...controllers.errors import InvalidValueError
from ...controllers.files import write_atomically
from ...controllers.model.capturability import max_recoverable_force, recoverable_offset
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.nominal_gait import NominalGait, nominal_gait, step_start_dcm
from ...controllers.model.robot import RobotModel
from ...controllers.model.standing import max_standing_force
from ...controllers.whole_body.limits import LIMIT_NAMES
from ...envs.episode.episodes import GaitEpisodes
from ...envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from ...envs.scenario.push import Body, GaitEvent, Push, polar_push
from ...envs.scenario.scenario import EXACT, Command, Scenario, get_profile
from ..output.progress import Work, about, progress_bars, robot_seconds
from ..output.tables import Table, markdown_page, write_reports
from ..rollout.environments import code_digest, env_label, make_env, preset_digest, profile_on
from ..rollout.outcome import Outcome, limit_words
from ..rollout.policy_source import open_rows, policy_sources
from ..rollout.workers import Runner, parallel
from .draw import feet_at_first

BEYOND = 100.0  # how far past the first failure a direction is scanned [N]
FORCE_CAP = 4000.0  # no scan goes further [N]
NOMINAL_STEPS = 4  # before the push
AT_REST_FOR = 0.5  # a robot that stands, before the push [s]
TOLERANCE = 1e-9  # of strengths that are multiples of a grid
T = TypeVar("T")


@dataclass(frozen=True)
class Scanned:
    """Result of a scan, in the unit of its strengths."""

    survived: float  # largest before the first failure; 0 where none was survived
    largest_survived: float  # at all
    failed: tuple[float, ...]  # rising

    @classmethod
    def of(cls, survives: Mapping[float, bool]) -> Self:
        """From whether each strength was survived."""
        failed = tuple(sorted(strength for strength, ok in survives.items() if not ok))
        survived = [strength for strength, ok in survives.items() if ok]
        before = [strength for strength in survived if not failed or strength < failed[0]]
        return cls(max(before, default=0.0), max(survived, default=0.0), failed)


def scan_upwards(
    run: Callable[[Iterator[float]], Iterable[tuple[float, T]]],
    strengths: Iterable[float],
    beyond: float,
    survived: Callable[[T], bool],
) -> dict[float, T]:
    """Outcomes of rising strengths up to `beyond` past the first failure, in rising order.

    Several may run at once, so that a weaker one fails late; what was tried past the end that it sets is left
    out. So what comes out does not depend on how many run at once.

    Args:
        run: takes strengths when it has room for them; gives (strength, outcome) in any order.
        strengths: rising.
        beyond: in their unit.
        survived: whether an outcome counts as survived.
    """
    end, found = float("inf"), {}

    def wanted() -> Iterator[float]:
        for strength in strengths:
            if strength > end + TOLERANCE:
                return
            yield strength

    for strength, outcome in run(wanted()):
        found[strength] = outcome
        if not survived(outcome):
            end = min(end, strength + beyond)
    return {strength: found[strength] for strength in sorted(found) if strength <= end + TOLERANCE}


def multiples(grid: float) -> Iterator[float]:
    """The multiples of a grid [N] from the first up to FORCE_CAP."""
    return (k * grid for k in range(1, int(FORCE_CAP / grid + TOLERANCE) + 1))


def directions_deg(count: int) -> list[float]:
    """`count` directions counter-clockwise from forward [deg].

    Raises:
        InvalidValueError: fewer than one.
    """
    if count < 1:
        raise InvalidValueError(f"directions must be >= 1, got {count}")
    return [360.0 * k / count for k in range(count)]


OWN, PAPER, POINT_FOOT = "F* of the robot's own box", "F* of the paper's box", "own box, point foot"
STAND = "F*_stand of the robot's own soles and trunk"


@dataclass(frozen=True)
class DirectionLimits:
    """F* and F*_stand in one direction [N]."""

    own: float  # of the robot's own gait limits
    paper: float  # of the paper's robot and gait limits
    stand: float  # of the robot's own soles and trunk, at rest on both feet, without a step


def nominal_gait_in_use(env: gym.Env, command: Command) -> NominalGait:
    """Nominal gait of an environment for a command, on left stance (its y axis points right)."""
    unwrapped: Any = env.unwrapped
    return nominal_gait(unwrapped.robot, unwrapped.limits, (command.vx, -command.vy))


def own_limit_force(
    env: gym.Env, psi: float, duration: float, command: Command, point_foot: bool = False
) -> float:
    """F* [N] of the environment's own robot and gait limits; arguments as for `limit_force`.

    A point foot has no sole to shift the CoP in and no trunk to swing.
    """
    unwrapped: Any = env.unwrapped
    gait, moved = nominal_gait_in_use(env, command), not point_foot
    return float(
        max_recoverable_force(
            unwrapped.robot, psi, duration, limits=unwrapped.limits, gait=gait, foot=moved, flywheel=moved
        )
    )


def limit_force(env: gym.Env, psi: float, duration: float, command: Command) -> float:
    """F* [N] within the paper's limits, from the nominal gait of the environment.

    Args:
        env: decides the nominal gait.
        psi: direction of the push, counter-clockwise from forward, at the start of a left stance [rad].
        duration: of the push [s].
        command: commanded velocity.
    """
    gait = nominal_gait_in_use(env, command)
    return float(max_recoverable_force(RobotModel(), psi, duration, gait=gait))


def standing_limit_force(env: gym.Env, psi: float, duration: float) -> float:
    """F*_stand [N] of the environment's own soles and trunk; arguments as for `limit_force`."""
    unwrapped: Any = env.unwrapped
    return max_standing_force(unwrapped.robot, psi, duration, limits=unwrapped.limits)


def direction_limits(env: gym.Env, psi_deg: float, duration: float, command: Command) -> DirectionLimits:
    """All limits towards psi [deg]; the other arguments as for `limit_force`."""
    push = math.radians(psi_deg), duration, command
    stand = standing_limit_force(env, *push[:2])
    return DirectionLimits(own_limit_force(env, *push), limit_force(env, *push), stand)


def limit_curves(
    env: gym.Env, psi_deg: Sequence[float], duration: float, command: Command
) -> dict[str, list[float]]:
    """Limits [N] over directions [deg]: both yardsticks, the own box with a point foot, and F*_stand."""
    pushes = [(math.radians(psi), duration, command) for psi in psi_deg]
    return {
        OWN: [own_limit_force(env, *push) for push in pushes],
        PAPER: [limit_force(env, *push) for push in pushes],
        POINT_FOOT: [own_limit_force(env, *push, point_foot=True) for push in pushes],
        STAND: [standing_limit_force(env, *push[:2]) for push in pushes],
    }


@dataclass(frozen=True)
class PushedStart:
    """A nominal step when a push begins, in its canonical frame."""

    elapsed: float  # of the step [s]
    dcm: np.ndarray  # (2,) [m]
    shift: np.ndarray  # (2,) that the push counts as [m]


def pushed_start(robot: RobotModel, limits: GaitLimits, push: Push, command: Command) -> PushedStart | None:
    """Where a push finds the DCM, and what it does to it: F (1 - exp(-omega d)) / (m omega^2).

    None for a push at a time, whose step is not known.
    """
    if not isinstance(push.start, GaitEvent):
        return None
    swing = -1.0 if push.start.side == "left" else 1.0  # side of the swing foot, left is positive
    gait = nominal_gait(robot, limits, (command.vx, swing * command.vy))
    elapsed = push.start.fraction * gait.duration
    dcm = np.array(step_start_dcm(gait, robot.pelvis_width, robot.omega)) * math.exp(robot.omega * elapsed)
    force = np.array([push.force[0], swing * push.force[1]])
    shift = force * -math.expm1(-robot.omega * push.duration) / (robot.mass * robot.omega**2)
    return PushedStart(elapsed, dcm, shift)


def limit_share(env: gym.Env, push: Push, command: Command) -> float | None:
    """The push as a share of F* of the robot's own box, at its moment of the nominal step.

    The share is that by which the shift of `pushed_start` must be divided so that the DCM ends on the nearest
    of its bounds; at the start of a left stance it is F / F* of the frontier. The pendulum's limit: no turn,
    no legs. None where there is no such limit: the push comes at a time, or the unpushed gait is out of
    bounds.
    """
    unwrapped: Any = env.unwrapped
    start = pushed_start(unwrapped.robot, unwrapped.limits, push, command)
    if start is None:
        return None
    bounds = recoverable_offset(unwrapped.robot, unwrapped.limits, start.elapsed)
    room = np.where(start.shift > 0.0, bounds.high - start.dcm, start.dcm - bounds.low)
    if (room <= 0.0).any():
        return None
    return float(np.max(np.abs(start.shift) / room))


def standing_share(env: gym.Env, scenario: Scenario) -> float:
    """The first push of a scenario in which the robot stands at rest, as a share of its own F*_stand."""
    unwrapped: Any = env.unwrapped
    robot, push = unwrapped.robot, scenario.pushes[0]
    feet = feet_at_first(robot, scenario.stance_side, scenario.stride)
    limit = max_standing_force(robot, push.direction, push.duration, limits=unwrapped.limits, feet=feet)
    return math.hypot(*push.force[:2]) / limit


FORMAT = 2  # of the rows
KEY = ("policy", "psi_deg")  # of a row
FOUND = ("survived_N", "largest_survived_N", "failed_N", "falls")  # fields that a report is made of
IN_PLACE = Command()
SIMULATED = 500.0  # seconds of a robot that one direction of a policy takes, about: eighty forces


@dataclass(frozen=True)
class FrontierSettings:
    """The push whose force is scanned: at the start of a left stance after four nominal steps.

    A robot whose command is to stand is pushed after AT_REST_FOR.
    """

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
        start = AT_REST_FOR if self.command.stand else GaitEvent(NOMINAL_STEPS, "left", 0.0)
        push = polar_push(force, math.radians(psi_deg), self.duration, start, self.body)
        name = f"frontier-{psi_deg:g}deg-{force:g}N"
        scenario = Scenario(name, (push,), self.command, "left", errors=self.errors)
        return profile_on(self.env_id, self.profile).applied(scenario)


@dataclass(frozen=True)
class ScanJob:
    """One direction of one policy."""

    settings: FrontierSettings
    policy: str
    psi_deg: float


OF_A_FALL = ("failure_reason", "first_limit", "limits_met", "limit_shares")  # fields of an outcome


def scan(runner: Runner, job: ScanJob) -> dict[str, Any]:
    """The row of one direction: raise the force by the grid until BEYOND past the first failure."""
    outcomes = scan_upwards(
        lambda forces: _outcomes(runner, job, forces),
        multiples(job.settings.grid),
        BEYOND,
        lambda outcome: outcome.survived,
    )
    found = Scanned.of({force: outcome.survived for force, outcome in outcomes.items()})
    row = {
        "policy": job.policy,
        "psi_deg": job.psi_deg,
        "survived_N": found.survived,
        "largest_survived_N": found.largest_survived,
        "failed_N": list(found.failed),
        "falls": [
            {"force_N": force, **{name: fell[name] for name in OF_A_FALL}}
            for force, fell in ((force, outcomes[force].to_dict()) for force in found.failed)
        ],
    }
    if job.settings.command.stand:
        stayed = {force: seen.survived and not seen.measures["steps"] for force, seen in outcomes.items()}
        row["stand_N"] = Scanned.of(stayed).survived
    return row


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
    limits: Mapping[float, DirectionLimits]  # by direction [deg]
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
                    "fraction": force / limit.paper if limit.paper > 0 else None,
                    "own_limit_N": limit.own,
                    "own_fraction": force / limit.own if limit.own > 0 else None,
                    "own_stand_limit_N": limit.stand,
                    **{name: row[name] for name in ("stand_N",) if name in row},
                }
            )
        push = {"duration": self.settings.duration, "body": self.settings.body}
        return {"env": self.settings.env_id, "policy": policy, "push": push, "directions": directions}


def default_grid(env_id: str) -> float:
    """The environment's own grid [N]; that of any gait environment where it names none."""
    with closing(make_env(env_id)) as env:
        episodes = getattr(env.unwrapped, "episodes", None)
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
    angles = directions_deg(directions)
    push = settings.duration, settings.command
    with closing(Runner(settings.env_id, sources)) as runner:
        for name in sources:
            runner.acting(name)
        limits = {psi: direction_limits(runner.env, psi, *push) for psi in angles}
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


def fall_cell(falls: Sequence[Mapping[str, Any]]) -> str:
    """Fall of the weakest force that failed: the limit met first, the three met for the longest time."""
    if not falls or falls[0]["first_limit"] is None:
        return "-"
    shares = falls[0]["limit_shares"]
    longest = sorted(shares, key=lambda name: (-shares[name], LIMIT_NAMES.index(name)))[:3]
    at = ", ".join(f"{limit_words(name)} {shares[name]:.2f}" for name in longest)
    return f"{limit_words(falls[0]['first_limit'])}; {at}"


def _force_cell(entry: Mapping[str, Any]) -> str:
    """Force before the first failure, its shares of both F*, and the largest survived where that is more."""
    shares = (entry["own_fraction"], entry["fraction"])
    share = ", ".join("-" if part is None else f"{part:.2f}" for part in shares)
    more = entry["largest_survived_N"]
    return f"{entry['survived_N']:.0f} ({share}" + (f"; {more:.0f})" if more > entry["survived_N"] else ")")


def _stand_cell(entry: Mapping[str, Any]) -> str:
    """Largest force caught without a step, and its share of F*_stand."""
    return f"{entry['stand_N']:.0f} ({entry['stand_N'] / entry['own_stand_limit_N']:.2f})"


def frontier_table(
    frontier: Frontier, name_of: Callable[[float], str] = "{:g}".format, falls: bool = True
) -> Table:
    """Limits, forces of each policy, and what fells it (`falls`), by direction, named by `name_of`."""
    entries = [frontier.to_dict(name)["directions"] for name in frontier.rows]
    stands, lines = frontier.settings.command.stand, []
    for index, (psi, limit) in enumerate(frontier.limits.items()):
        forces = [_force_cell(directions[index]) for directions in entries]
        forces += [_stand_cell(directions[index]) for directions in entries if stands]
        cells = (fall_cell(rows[index]["falls"]) for rows in frontier.rows.values()) if falls else ()
        limits = (f"{force:.0f}" for force in (limit.own, limit.paper, limit.stand))
        lines.append((name_of(psi), *limits, *forces, *cells))
    names = list(frontier.rows)
    in_place = [f"{name} without a step" for name in names if stands]
    falls_by = ["falls by"] if len(names) == 1 else [f"{name} falls by" for name in names]
    return Table(
        f"{frontier.settings.env_id}: largest force before the first failure [N]",
        (
            "psi [deg]",
            "own F* [N]",
            "paper's F* [N]",
            "own F*_stand [N]",
            *names,
            *in_place,
            *(falls_by if falls else ()),
        ),
        lines,
        "In brackets the share of F* of the robot's own box, that of the paper's (its Tables I and II), and "
        "the largest force survived at all where that is more. F*_stand is what a robot at rest on both feet "
        "can at most be pushed with so that it need not step."
        + (" Without a step: in brackets the share of it." if stands else "")
        + (
            " Falls by: the limit that the first failure met first, then the three that it met for the "
            "longest share of the time."
            if falls
            else ""
        ),
    )


def write_frontier_reports(frontier: Frontier) -> Path:
    """Write report.md, whose path is returned, and report.json, with the limits of every failed force."""
    policies = {}
    for name, rows in frontier.rows.items():
        policies[name] = frontier.to_dict(name)
        for entry, row in zip(policies[name]["directions"], rows, strict=True):
            entry["falls"] = row["falls"]
    markdown = markdown_page("Frontier", [frontier_table(frontier)])
    return write_reports(frontier.directory, {"policies": policies}, markdown)


STYLES = {OWN: "k-", PAPER: "k--", POINT_FOOT: "k:", STAND: "k-."}


def save_pictures(frontier: Frontier) -> list[Path]:
    """Write frontier.png and frontier.svg into the frontier's directory.

    Forward is up, psi counter-clockwise, left stance: right pushes go towards the swing side. Where the robot
    stands, the dashed lines are what it caught without a step.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    settings = frontier.settings
    angles = np.linspace(0.0, 360.0, 361)
    with closing(make_env(settings.env_id)) as env:
        curves = limit_curves(env, angles.tolist(), settings.duration, settings.command)
    for label, curve in curves.items():
        axes.plot(np.radians(angles), curve, STYLES[label], linewidth=1, label=label)
    for policy, rows in frontier.rows.items():
        psi = [math.radians(row["psi_deg"]) for row in rows]
        force = [row["survived_N"] for row in rows]
        (line,) = axes.plot([*psi, psi[0]], [*force, force[0]], marker="o", markersize=3, label=policy)
        if settings.command.stand:
            force, color = [row["stand_N"] for row in rows], line.get_color()
            label = f"{policy} without a step"
            axes.plot([*psi, psi[0]], [*force, force[0]], "o--", color=color, markersize=3, label=label)
    moment = "at rest on both feet" if settings.command.stand else "start of a left stance"
    axes.set_title(
        f"{settings.env_id}: largest force before the first failure [N]\n"
        f"{settings.body}, {settings.duration:g} s, {moment}; forward is up"
    )
    figure.legend(loc="outside lower center", fontsize="small", ncols=2)
    paths = [frontier.directory / f"frontier.{suffix}" for suffix in ("png", "svg")]
    for path in paths:
        buffer = io.BytesIO()
        metadata = {"Date": None} if path.suffix == ".svg" else None
        figure.savefig(buffer, format=path.suffix[1:], dpi=130, metadata=metadata)
        write_atomically(path, buffer.getvalue())
    return paths
