"""A recorded episode: its columns, what records it, and its files.

What is true of a robot at one moment, as numbers by name: the columns of a recorded episode.

A recorded episode, and what records one: the ordinary rollout with somebody who looks.

A recorded episode as a file: NumPy's npz, or text with a column for each quantity.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, UnknownNameError
from ...controllers.files import write_atomically
from ...controllers.model.gait_box import COP, DURATION, STEP, TRUNK
from ...controllers.model.observation import (
    COM,
    COM_HEIGHT_ERROR,
    SWING_POSITION,
    TRUNK_ANGLE,
    TRUNK_RATE,
    canonical,
    canonical_frame,
    heading_frame,
    in_world,
    point_in_world,
    side_sign,
)
from ...controllers.policies.interface import Policy
from ...controllers.whole_body.limits import BOUNDS
from ...envs.biped.env import BipedEpisodes
from ...envs.episode.episodes import GaitEpisodes
from ...envs.episode.period_end import CMP, LOADED, MARGIN, TIME
from ...envs.episode.period_end import COP as TOLD_COP
from ...envs.episode.period_end import DCM as TOLD_DCM
from ...envs.robots.indices import MISSING
from ...envs.scenario.scenario import Scenario, get_profile
from ..rollout.environments import size_of
from ..rollout.episodes import GymRobot, Watch, rollout
from ..rollout.names import DEFAULT_ENV
from ..rollout.outcome import Outcome
from ..rollout.policy_source import acting_in

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
    "command_vx": "m/s", "command_vy": "m/s", "command_turn": "rad/s",
    "push_x": "N", "push_y": "N", "push_z": "N",
}  # fmt: skip
NAN = float("nan")


class Sampler:
    """Reads the robot 0 of episodes between two planning periods; it only looks.

    Pushes are the mean force since the sample before, so that their sum times the period is the impulse.
    A limit's column is the share of that time for which it was met; limits count from the first push on.
    Torques are those of the last physics step. The plan is not known where a step has just begun.
    """

    def __init__(self, episodes: GaitEpisodes):
        self._episodes, self._biped = episodes, isinstance(episodes, BipedEpisodes)
        self.torques = _torques(episodes)
        self.units = {**UNITS, **dict.fromkeys(self.torques, "N m")}
        if self._biped:
            self.units |= {LIMIT + name: "1" for name in BOUNDS}
        self.begin()

    @property
    def bounds(self) -> dict[str, float]:
        """How far columns may go both ways, in their units, where the robot has such a bound."""
        robot = self._episodes.robot
        return {"trunk_pitch": robot.trunk_angle_max, "trunk_roll": robot.trunk_angle_max, **self.torques}

    def begin(self) -> None:
        """Take the present moment as the one before the next sample."""
        core: Any = self._episodes.core
        self._time, self._step = -1.0, -1
        self._delivered = np.zeros(3)
        self._span = np.zeros(len(BOUNDS))
        if self._episodes.robots is not None:
            self._time = float(self._episodes.motion().time[0])
            self._step = int(self._episodes.motion().steps[0])
            self._delivered = core.pushes.delivered[0].sum(axis=0)
            if self._biped:
                self._span = core.bounds_record.span[0].copy()

    def row(self) -> Row:
        """The numbers of now, by column."""
        episodes, core = self._episodes, self._episodes.core
        told, motion = episodes.info_rows()[0], episodes.motion()
        stance, heading = int(motion.side[0]), float(motion.heading[0])
        row: Row = {
            "time": told[TIME], "step": motion.steps[0], "stance_side": stance, "heading": heading,
            "capture_margin": told[MARGIN],
        }  # fmt: skip
        _put(row, ("com_x", "com_y"), motion.com[0])
        row["com_z"] = episodes.robot.com_height + core.truth[0, COM_HEIGHT_ERROR]
        for name, place in (("dcm", TOLD_DCM), ("cop", TOLD_COP), ("cmp", CMP)):
            _put(row, (f"{name}_x", f"{name}_y"), told[place])
        _put(row, ("left_contact", "right_contact"), told[LOADED])
        _put(row, ("command_vx", "command_vy", "command_turn"), core.command[0])
        soles = self._soles(stance, heading, motion.com[0])
        for name, sole in zip(("left", "right"), soles, strict=True):
            _put(row, (f"{name}_sole_x", f"{name}_sole_y", f"{name}_sole_z"), sole)
        self._trunk(row, stance)
        self._plan(row, stance, heading, soles[stance], int(motion.steps[0]))
        self._since_before(row)
        return {name: float(row[name]) for name in self.units}

    def _soles(self, stance: int, heading: float, com: Array) -> Array:
        """Centres of both soles in the world, (2, 3) [m]; heights over the floor."""
        truth, frame = self._episodes.core.truth[0], canonical_frame(heading, stance)
        soles = np.zeros((2, 3))
        soles[stance, :2] = com - np.array(in_world(frame, *truth[COM].tolist()))
        x, y, z = truth[SWING_POSITION].tolist()
        soles[1 - stance] = (*point_in_world(frame, *soles[stance, :2].tolist(), x, y), z)
        return soles

    def _trunk(self, row: Row, stance: int) -> None:
        """Lean and its rate, roll to the left; what the pendulum's trunk gives."""
        truth, sign = self._episodes.core.truth[0], float(side_sign(stance))
        for names, place in (
            (("trunk_pitch", "trunk_roll"), TRUNK_ANGLE),
            (("trunk_pitch_rate", "trunk_roll_rate"), TRUNK_RATE),
        ):
            _put(row, names, truth[place] * (1.0, sign))
        core: Any = self._episodes.core
        if self._biped:
            indices = core.body.indices.motors
            motors = [i for i, motor in enumerate(indices) if motor != MISSING]
            _put(row, tuple(self.torques), core.physics.ctrl[0, motors])
        else:
            lever = (row["cmp_x"] - row["cop_x"], row["cmp_y"] - row["cop_y"])
            turned = canonical(heading_frame(row["heading"]), *lever)
            _put(row, tuple(self.torques), self._episodes.robot.weight * np.array(turned))

    def _plan(self, row: Row, stance: int, heading: float, sole: Array, step: int) -> None:
        """The gait variables in force; the place of the step and its CoP in the world."""
        core: Any = self._episodes.core
        plan = (core.gait if self._biped else core.state).plan[0]
        frame = canonical_frame(heading, stance)
        places = {"planned_step": plan[STEP : STEP + 2], "planned_cop": plan[COP : COP + 2]}
        begun = step != self._step and self._step >= 0
        for name, (x, y) in places.items():
            point = (NAN, NAN) if begun else point_in_world(frame, *sole[:2].tolist(), float(x), float(y))
            _put(row, (f"{name}_x", f"{name}_y"), point)
        row["planned_duration"] = NAN if begun else plan[DURATION]
        turn = plan[TRUNK : TRUNK + 2] * (1.0, float(side_sign(stance)))
        _put(row, ("planned_trunk_pitch_acceleration", "planned_trunk_roll_acceleration"), turn)

    def _since_before(self, row: Row) -> None:
        """Mean push and limits met since the sample before."""
        core: Any = self._episodes.core
        span = row["time"] - self._time
        delivered = core.pushes.delivered[0].sum(axis=0)
        push = (delivered - self._delivered) / span if span > 0.0 else np.zeros(3)
        _put(row, ("push_x", "push_y", "push_z"), push)
        if self._biped:
            met = core.bounds_record.span[0] - self._span
            share = np.clip(met / span, 0.0, 1.0) if span > 0.0 else np.zeros(len(BOUNDS))
            _put(row, tuple(LIMIT + name for name in BOUNDS), share)
        self.begin()


def _put(row: Row, names: tuple[str, ...], values: Any) -> None:
    row.update(zip(names, values, strict=True))


def _torques(episodes: GaitEpisodes) -> dict[str, float]:
    """Columns of torques and their bounds [N m]."""
    if not isinstance(episodes, BipedEpisodes):
        names = (f"{TORQUE}trunk_pitch", f"{TORQUE}trunk_roll")
        return dict.fromkeys(names, episodes.robot.trunk_torque_max)
    body = episodes.core.body
    return {
        TORQUE + body.model.joint(joint).name: float(bound)
        for joint, bound in zip(body.indices.joints[1:], body.motors[0], strict=True)
        if joint != MISSING
    }


@dataclass(frozen=True, eq=False)
class EpisodeRecord:
    """Time histories of one episode; a sample after reset and after every environment step, n of them."""

    scenario: Scenario
    outcome: Outcome
    columns: Mapping[str, Array]  # (n,) each, read-only
    units: Mapping[str, str]  # of every column
    bounds: Mapping[str, float]  # how far some columns may go both ways, in their units
    sole: tuple[float, float]  # length, width [m]
    push_starts: tuple[float, ...]  # of the scenario's pushes [s], inf: its gait event has not come
    mass: float  # [kg]

    def __getitem__(self, name: str) -> Array:
        """One column.

        Raises:
            UnknownNameError: no such column; lists the valid ones.
        """
        if name not in self.columns:
            raise UnknownNameError("column", name, self.columns)
        return self.columns[name]

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.columns["time"])


class Recorder:
    """Watches a rollout, and keeps a row of every sample; another one may look with it."""

    def __init__(self, beside: Watch | None = None):
        self._rows: list[Row] = []
        self._beside = beside
        self._sampler: Sampler | None = None

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        if self._sampler is None:
            self._sampler = Sampler(gait_episodes(robot.env))
        self._rows.append(self._sampler.row())
        if self._beside is not None:
            self._beside(robot)

    def record(self, env: gym.Env, scenario: Scenario, outcome: Outcome) -> EpisodeRecord:
        """What was seen of an episode that has ended."""
        episodes, sampler = gait_episodes(env), self._sampler
        assert sampler is not None  # noqa: S101  # a rollout looks at its start
        columns = {name: np.array([row[name] for row in self._rows]) for name in sampler.units}
        for column in columns.values():
            column.flags.writeable = False
        starts = episodes.core.pushes.start[0, : len(scenario.pushes)].tolist()
        return EpisodeRecord(
            scenario, outcome, columns, sampler.units, sampler.bounds, _sole(episodes), tuple(starts),
            episodes.robot.mass,
        )  # fmt: skip


def gait_episodes(env: gym.Env) -> GaitEpisodes:
    """The episodes of one of this project's environments.

    Raises:
        InvalidValueError: one of another kind, which does not tell its state.
    """
    episodes = getattr(env.unwrapped, "episodes", None)
    if not isinstance(episodes, GaitEpisodes):
        raise InvalidValueError(
            f"only episodes of this project's own environments are recorded, got {env.unwrapped}"
        )
    return episodes


def _sole(episodes: GaitEpisodes) -> tuple[float, float]:
    if isinstance(episodes, BipedEpisodes):
        length, width = episodes.core.body.half_sole
        return 2.0 * length, 2.0 * width
    return episodes.robot.foot_length, episodes.robot.foot_width


def record_episode(
    env: gym.Env, policy: Policy, scenario: Scenario, policy_name: str, watch: Watch | None = None
) -> EpisodeRecord:
    """`rollout` with its time histories; the outcome is the same bit for bit."""
    gait_episodes(env)
    recorder = Recorder(watch)
    outcome = rollout(env, policy, scenario, policy_name, recorder)
    return recorder.record(env, scenario, outcome)


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
        profile: of the robot, "exact" or "hardware"; what the scenario says itself stands.

    Returns:
        Columns by name with their units, such as `record["dcm_y"]` [m], and the outcome that `rollout` gives.

    Raises:
        PushRecoveryError: unknown names, a policy that can't act, an environment of another project.
    """
    with acting_in(env, policy, policy_name) as (made, acting, label):
        scenario = get_profile(profile).scaled(size_of(made)).applied(scenario)
        return record_episode(made, acting, scenario, label)


LOG_FORMATS = (".npz", ".csv")


def log_bytes(record: EpisodeRecord, suffix: str) -> bytes:
    """An episode in one of LOG_FORMATS; the same episode gives the same bytes.

    npz: an array for each column, `columns` and `units` with their names in order, and `scenario` and
    `outcome` as JSON. csv: a head of `name [unit]`, and a line for each sample with digits enough to read the
    same numbers back.
    """
    return _npz(record) if suffix == ".npz" else _csv(record)


def write_log(record: EpisodeRecord, path: Path) -> None:
    """Write an episode whole or not at all, in the format of the suffix."""
    write_atomically(path, log_bytes(record, path.suffix.lower()))


def _npz(record: EpisodeRecord) -> bytes:
    buffer = io.BytesIO()
    about = {
        "columns": np.array(list(record.columns)),
        "units": np.array([record.units[name] for name in record.columns]),
        "scenario": np.array(record.scenario.to_json()),
        "outcome": np.array(json.dumps(record.outcome.to_dict(), sort_keys=True)),
    }
    np.savez_compressed(buffer, allow_pickle=False, **about, **record.columns)
    return buffer.getvalue()


def _csv(record: EpisodeRecord) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{name} [{record.units[name]}]" for name in record.columns])
    for row in zip(*(column.tolist() for column in record.columns.values()), strict=True):
        writer.writerow([repr(value) for value in row])
    return text.getvalue().encode()
