"""Recorded episodes: the recorder, its time histories as columns with units, and their files."""

import csv
import io
import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.files import write_atomically
from ...controllers.model import gait_box, observation
from ...controllers.policies.interface import Policy
from ...controllers.whole_body.limits import LIMIT_NAMES
from ...envs.biped.env import BipedEpisodes
from ...envs.episode import period_end
from ...envs.episode.episodes import GaitEpisodes
from ...envs.robots.indices import MISSING
from ...envs.scenario.scenario import Scenario
from ..rollout import DEFAULT_ENV, environments, policy_source
from ..rollout.episodes import Watch, rollout
from ..rollout.outcome import Outcome

Array = NDArray[np.float64]
Row = dict[str, float]

TORQUE, LIMIT = "torque_", "limit_"  # what the names of torques and of limits begin with
UNITS = {  # of the columns that every robot has; places are in the world, x forward and y left at heading 0
    "time": "s", "step": "1", "stance_side": "1", "heading": "rad",
    "com_x": "m", "com_y": "m", "com_z": "m", "dcm_x": "m", "dcm_y": "m",
    "cop_x": "m", "cop_y": "m", "cmp_x": "m", "cmp_y": "m", "capture_margin": "m",
    "left_sole_x": "m", "left_sole_y": "m", "left_sole_z": "m",
    "right_sole_x": "m", "right_sole_y": "m", "right_sole_z": "m",
    "left_contact": "1", "right_contact": "1",
    "trunk_pitch": "rad", "trunk_roll": "rad", "trunk_pitch_rate": "rad/s", "trunk_roll_rate": "rad/s",
    "planned_step_x": "m", "planned_step_y": "m", "planned_duration": "s", "planned_cop_x": "m",
    "planned_cop_y": "m", "planned_trunk_pitch_acceleration": "rad/s^2",
    "planned_trunk_roll_acceleration": "rad/s^2",
    "command_vx": "m/s", "command_vy": "m/s", "command_turn": "rad/s", "command_stand": "1",
    "push_x": "N", "push_y": "N", "push_z": "N",
}  # fmt: skip
NAN = float("nan")


@dataclass(frozen=True, eq=False)
class EpisodeRecord:
    """Time histories of one episode; a sample after reset and after every environment step, n of them.

    `record["dcm_y"]` is a column, `len(record)` the number of samples; iteration gives the columns' names.
    """

    scenario: Scenario
    outcome: Outcome
    columns: Mapping[str, Array]  # (n,) each, read-only
    units: Mapping[str, str]  # of every column
    bounds: Mapping[str, float]  # how far some columns may go both ways, in their units
    sole: tuple[float, float]  # length, width [m]
    push_starts: tuple[float, ...]  # of the scenario's forces [s], inf: its gait event has not come
    mass: float  # [kg]

    def __getitem__(self, name: str) -> Array:
        """One column.

        Raises:
            UnknownNameError: no such column; lists the valid ones.
            TypeError: an index of samples.
        """
        if not isinstance(name, str):
            raise TypeError(
                f"a record is indexed by the name of a column, got {name!r}; for samples index the column: "
                f"record['time'][{name if isinstance(name, int) else '...'}]"
            )
        if name not in self.columns:
            raise UnknownNameError("column", name, self.columns)
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the columns, in their order."""
        return iter(self.columns)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.columns["time"])

    def points(self, name: str) -> Array:
        """The columns NAME_x and NAME_y side by side, (n, 2)."""
        return np.column_stack([self[f"{name}_x"], self[f"{name}_y"]])


class Recorder:
    """Keeps a row of numbers of robot 0 of some episodes at each call; it only looks.

    Call it after reset and after every planning period, or hand it to `rollout` as `watch`. Pushes are the
    mean force since the row before, so that their sum times the period is the impulse. A limit's column is
    the share of that time for which it was met; limits count from the first push on. Torques are those of the
    last physics step. The plan is NaN where a step has just begun.

    Args:
        episodes: whose robot is recorded.
        keep: how many rows are kept, the latest ones; None: all.
    """

    def __init__(self, episodes: GaitEpisodes, keep: int | None = None):
        self._episodes, robot = episodes, episodes.robot
        self.rows: deque[Row] = deque(maxlen=keep)
        self.sole = robot.foot_length, robot.foot_width  # [m]
        names = (f"{TORQUE}trunk_pitch", f"{TORQUE}trunk_roll")
        self.torques = dict.fromkeys(names, robot.trunk_torque_max)  # column -> largest torque [N m]
        limits: dict[str, str] = {}
        if isinstance(episodes, BipedEpisodes):
            body = episodes.core.body
            self.sole = 2.0 * body.half_sole[0], 2.0 * body.half_sole[1]
            self.torques = {
                TORQUE + body.model.joint(joint).name: float(bound)
                for joint, bound in zip(body.indices.joints[1:], body.motors[0], strict=True)
                if joint != MISSING
            }
            self._motors = [i for i, motor in enumerate(body.indices.motors) if motor != MISSING]
            limits = {LIMIT + name: "1" for name in LIMIT_NAMES}
        self._limits = tuple(limits)
        self.units = {**UNITS, **dict.fromkeys(self.torques, "N m"), **limits}

    @property
    def bounds(self) -> dict[str, float]:
        """How far columns may go both ways, in their units, where the robot has such a bound."""
        lean = self._episodes.robot.trunk_angle_max
        return {"trunk_pitch": lean, "trunk_roll": lean, **self.torques}

    def __call__(self, robot: object = None) -> None:
        """Keep a row of the present moment; `robot`, which `rollout` hands over, is not needed."""
        if not self.rows:
            self._note_present()
        self.rows.append(self._row())
        self._note_present()

    def finish(self, scenario: Scenario, outcome: Outcome) -> EpisodeRecord:
        """The record of an episode that has ended."""
        columns = {name: np.array([row[name] for row in self.rows]) for name in self.units}
        for column in columns.values():
            column.flags.writeable = False
        starts = self._episodes.core.pushes.start[0, : len(scenario.forces)].tolist()
        mass = self._episodes.robot.mass
        return EpisodeRecord(
            scenario, outcome, columns, self.units, self.bounds, self.sole, tuple(starts), mass
        )

    def _note_present(self) -> None:
        """Take the present moment as the one before the next row."""
        core: Any = self._episodes.core
        motion = self._episodes.motion()
        self._time, self._step = float(motion.time[0]), int(motion.steps[0])
        self._delivered = core.pushes.delivered[0].sum(axis=0)
        self._met = core.limits_record.span[0].copy() if self._limits else np.empty(0)

    def _row(self) -> Row:
        """The numbers of now, by column."""
        core: Any = self._episodes.core
        info, truth, motion = self._episodes.info_rows()[0], core.truth[0], self._episodes.motion()
        stance, heading, com = int(motion.side[0]), float(motion.heading[0]), motion.com[0]
        frame, sign = observation.canonical_frame(heading, stance), float(observation.side_sign(stance))
        soles = np.zeros((2, 3))  # centres in the world, heights over the floor [m]
        soles[stance, :2] = com - np.array(observation.in_world(frame, *truth[observation.COM].tolist()))
        origin = soles[stance, :2].tolist()
        x, y, z = truth[observation.SWING_POSITION].tolist()
        soles[1 - stance] = (*observation.point_in_world(frame, *origin, x, y), z)
        row: Row = {
            "time": info[period_end.TIME], "step": motion.steps[0], "stance_side": stance, "heading": heading,
            "capture_margin": info[period_end.MARGIN],
            "com_z": self._episodes.robot.com_height + truth[observation.COM_HEIGHT_ERROR],
        }  # fmt: skip

        def put(form: str, parts: str, values: Any) -> None:
            row.update(zip((form.format(part) for part in parts.split()), values, strict=True))

        put("com_{}", "x y", com)
        put("dcm_{}", "x y", info[period_end.DCM])
        put("cop_{}", "x y", info[period_end.COP])
        put("cmp_{}", "x y", info[period_end.CMP])
        put("{}_contact", "left right", info[period_end.LOADED])
        put("command_{}", "vx vy turn stand", core.command[0])
        put("left_sole_{}", "x y z", soles[0])
        put("right_sole_{}", "x y z", soles[1])
        put("trunk_{}", "pitch roll", truth[observation.TRUNK_ANGLE] * (1.0, sign))  # roll to the left
        put("trunk_{}_rate", "pitch roll", truth[observation.TRUNK_RATE] * (1.0, sign))
        plan = (core.gait if self._limits else core.state).plan[0]
        unknown = int(motion.steps[0]) != self._step
        for form, place in (("planned_step_{}", gait_box.STEP), ("planned_cop_{}", gait_box.COP)):
            point = observation.point_in_world(frame, *origin, float(plan[place]), float(plan[place + 1]))
            put(form, "x y", (NAN, NAN) if unknown else point)
        row["planned_duration"] = NAN if unknown else plan[gait_box.DURATION]
        turn = (NAN, NAN) if unknown else plan[gait_box.TRUNK : gait_box.TRUNK + 2] * (1.0, sign)
        put("planned_trunk_{}_acceleration", "pitch roll", turn)
        row.update(zip(self.torques, self._torque(row), strict=True))
        span = row["time"] - self._time
        push = core.pushes.delivered[0].sum(axis=0) - self._delivered
        put("push_{}", "x y z", push / span if span > 0.0 else np.zeros(3))
        if self._limits:
            met = core.limits_record.span[0] - self._met
            share = np.clip(met / span, 0.0, 1.0) if span > 0.0 else np.zeros(len(LIMIT_NAMES))
            row.update(zip(self._limits, share, strict=True))
        return {name: float(row[name]) for name in self.units}

    def _torque(self, row: Row) -> Array:
        """Torques of the motors; of a pendulum's trunk m g (cmp - cop), towards forward and left [N m]."""
        core: Any = self._episodes.core
        if self._limits:
            return core.physics.ctrl[0, self._motors]
        offset = row["cmp_x"] - row["cop_x"], row["cmp_y"] - row["cop_y"]
        turned = observation.canonical(observation.heading_frame(row["heading"]), *offset)
        return self._episodes.robot.weight * np.array(turned)


class RecordedPolicy:
    """A policy that keeps its observations and actions."""

    def __init__(self, policy: Policy):
        self._policy = policy
        self.observations: list[Array] = []
        self.actions: list[NDArray[np.float32]] = []

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Action and state of the policy."""
        action, state = self._policy.predict(observation, state, episode_start, deterministic)
        self.observations.append(np.asarray(observation, np.float64))
        self.actions.append(action)
        return action, state


def gait_episodes(env: gym.Env) -> GaitEpisodes:
    """The episodes of one of this project's environments.

    Raises:
        InvalidValueError: one of another project, whose state is unknown.
    """
    episodes = getattr(env.unwrapped, "episodes", None)
    if not isinstance(episodes, GaitEpisodes):
        raise InvalidValueError(
            f"only episodes of this project's own environments are recorded, got {env.unwrapped}"
        )
    return episodes


def record_episode(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Watch | None = None
) -> EpisodeRecord:
    """`rollout` with its time histories; the outcome is the same bit for bit."""
    recorder = Recorder(gait_episodes(env))

    def look(robot: Any) -> None:
        recorder()
        if watch is not None:
            watch(robot)

    outcome = rollout(env, policy, scenario, policy_name, look)
    return recorder.finish(scenario, outcome)


def record(
    policy: Any = "two-stage",
    scenario: Scenario = Scenario("unpushed"),  # noqa: B008  # frozen
    env: gym.Env | str = DEFAULT_ENV,
    policy_name: str | None = None,
    *,
    profile: str = "exact",
) -> EpisodeRecord:
    """Run one scenario to its end, and keep its time histories.

    Args:
        policy: a name, a file, "MODULE:ATTRIBUTE", or an object with `predict(observation)`.
        scenario: what happens.
        env: one of this project's environments, or its id.
        policy_name: of the outcome; by default the name, or the object's class.
        profile: of the robot, a name of `PROFILES`; what the scenario says itself stands.

    Returns:
        Columns by name with their units, such as `record["dcm_y"]` [m], and the outcome that `rollout` gives.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act, an environment of another project.
    """
    with policy_source.acting_in(env, policy, policy_name) as (made, acting, label):
        return record_episode(made, acting, environments.under_profile(made, scenario, profile), label)


LOG_FORMATS = (".npz", ".csv")


def log_bytes(record: EpisodeRecord, suffix: str) -> bytes:
    """An episode in one of LOG_FORMATS; the same episode gives the same bytes.

    npz: an array for each column, `columns` and `units` with their names in order, and `scenario` and
    `outcome` as JSON. csv: a head of `name [unit]`, and a line for each sample with digits enough to read the
    same numbers back.
    """
    if suffix == ".npz":
        buffer = io.BytesIO()
        about = {
            "columns": np.array(list(record.columns)),
            "units": np.array([record.units[name] for name in record.columns]),
            "scenario": np.array(record.scenario.to_json()),
            "outcome": np.array(json.dumps(record.outcome.to_dict(), sort_keys=True)),
        }
        np.savez_compressed(buffer, allow_pickle=False, **about, **record.columns)
        return buffer.getvalue()
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{record.units[name]}]" for name in record.columns])
    for row in zip(*(column.tolist() for column in record.columns.values()), strict=True):
        writer.writerow([repr(value) for value in row])
    return text.getvalue().encode()


def write_log(record: EpisodeRecord, path: Path) -> None:
    """Write an episode whole or not at all, in the format of the suffix."""
    write_atomically(path, log_bytes(record, path.suffix.lower()))
