"""n bipeds at physics rate, and the constants of theirs that a preset may set.

One planning period holds one gait action. Within it every physics step computes touchdown, swing foot,
whole-body torque and push, and then the robot's simulation advances: all in one compiled call
(`period.whole_period`), on as many threads as asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from ...controllers.array_table import parts_table
from ...controllers.errors import InvalidValueError, UnknownNameError, is_finite_number
from ...controllers.estimation.observe import Contacts
from ...controllers.estimation.self_model import empty_self_model, forget
from ...controllers.jit import RangeThreads
from ...controllers.model.capturability import capture_constants
from ...controllers.model.gait_box import DURATION, GAIT_SIZE, STEP, GaitLimits
from ...controllers.model.nominal_gait import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE, ON_BOTH_FEET, WORLD_SIZE, side_sign
from ...controllers.model.robot import RobotModel
from ...controllers.settings import PlannerConfig, load_preset, named_preset
from ...controllers.validation import require_choice
from ...controllers.whole_body.gait_machine import FLOOR, GaitSettings, resting_gait
from ...controllers.whole_body.inverse_dynamics import Gains
from ...controllers.whole_body.kinematics import FOOT_BODY, Array, Physics, sole_position
from ...controllers.whole_body.limits import BoundSettings, make_bounds
from ...controllers.whole_body.swing import COMMAND_SIZE
from ..robots.biped import BIPED, biped
from ..robots.compiled_robot import CompiledRobot
from ..robots.indices import MISSING, inputs, outputs
from ..scenario.arrays import (
    NUMBERS,
    Kicks,
    assign_changes,
    assign_pushes,
    command_row,
    empty_pushes,
    empty_schedule,
)
from ..scenario.model_errors import CONTROL_STEP
from ..scenario.noise import counter_seed
from ..scenario.push import SIDES
from ..scenario.scenario import Scenario
from ..sensing import Senses, Sensing, begin_onboard, exact_sensing, onboard_sensing
from ..simulation import Simulations, compute_nominal
from .floor import FootholdPlanner, KnownFloor, Stance, assign_floor, lay_floor, level_floors, pattern_of
from .laws import assign_laws, own_floor
from .limits_record import LimitsReport, clear_record, empty_record, plan_limits, report_limits
from .model_errors import assign_errors, no_errors
from .period import (
    GAIT,
    Actuation,
    Arena,
    Exchange,
    Tables,
    arena_constants,
    begin_period,
    calls_of,
    finish_period,
    make_steps,
    substeps,
    whole_period,
)
from .posture import posture

OF_ROBOT = (
    "omega",
    "com_height",
    "cmp_gain",
    "mass",
    "feet_apart",
)  # fields of GaitSettings that no file may set
_TUNED = named_preset("biped").robot()
BIPED_LIMITS = replace(GaitLimits.of(BIPED), **_TUNED["limits"])
BIPED_GAINS, BIPED_BOUNDS = Gains(**_TUNED["gains"]), BoundSettings(**_TUNED["bounds"])
BIPED_GAIT = GaitSettings(
    BIPED.omega,
    BIPED.com_height,
    BIPED.cmp_per_trunk_acceleration,
    BIPED.mass,
    BIPED.pelvis_width,
    **_TUNED["gait"],
)
SECTIONS: dict[str, tuple[str, ...]] = {
    "limits": tuple(entry.name for entry in fields(GaitLimits) if isinstance(entry.default, float)),
    "gait": tuple(name for name in GaitSettings._fields if name not in (*OF_ROBOT, "double_support")),
    "gains": Gains._fields,
    "bounds": BoundSettings._fields,
}


@dataclass(frozen=True)
class BipedSettings:
    """The constants, frozen; the defaults are those of `PushRecovery/Biped-v0`."""

    limits: GaitLimits = BIPED_LIMITS
    gait: GaitSettings = BIPED_GAIT
    gains: Gains = BIPED_GAINS
    bounds: BoundSettings = BIPED_BOUNDS

    def changed(self, changes: Mapping[str, Mapping[str, Any]]) -> BipedSettings:
        """These settings with some fields changed: section -> field -> value.

        Raises:
            UnknownNameError: an unknown section or field; lists the valid ones.
            InvalidValueError: a value that is no finite number, a negative one outside the limits, or one
                that GaitLimits refuses.
        """
        for section, values in changes.items():
            if section not in SECTIONS:
                raise UnknownNameError("section of the biped's settings", section, SECTIONS)
            for name, value in values.items():
                if name not in SECTIONS[section]:
                    raise UnknownNameError(f"field of the biped's {section}", name, SECTIONS[section])
                if not (is_finite_number(value) and (section == "limits" or value >= 0)):
                    bound = "" if section == "limits" else " and >= 0"
                    raise InvalidValueError(
                        f"{name} of the biped's {section} must be finite{bound}, got {value!r}"
                    )
        return BipedSettings(
            replace(self.limits, **changes.get("limits", {})),
            self.gait._replace(**changes.get("gait", {})),
            self.gains._replace(**changes.get("gains", {})),
            self.bounds._replace(**changes.get("bounds", {})),
        )

    def of_robot(self, robot: RobotModel) -> BipedSettings:
        """These settings for a robot of another mass, CoM height, trunk or waist."""
        own = robot.omega, robot.com_height, robot.cmp_per_trunk_acceleration, robot.mass, robot.pelvis_width
        limits = replace(self.limits, trunk_pitch=robot.trunk_pitch, trunk_roll=robot.trunk_roll)
        return replace(self, limits=limits, gait=self.gait._replace(**dict(zip(OF_ROBOT, own, strict=True))))

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Section -> field -> value, all that `changed` takes."""
        sections = {"limits": asdict(self.limits), "gait": self.gait._asdict(), "gains": self.gains._asdict(),
                    "bounds": self.bounds._asdict()}  # fmt: skip
        return {name: {key: values[key] for key in SECTIONS[name]} for name, values in sections.items()}


def biped_settings(preset: str, variant: str = "") -> BipedSettings:
    """The settings of a preset, by name or file, for a variant; the rest is the biped's own preset's."""
    return BipedSettings().changed(load_preset(preset).robot(variant))


DEFAULT_PLANNER = PlannerConfig()


class BipedCore:
    """n bipeds that share one compiled model; one with model errors of its body or floor has its own.

    Arrays are indexed by robot and hold what was true at the end of the last physics step; `put` sets a
    state.
    The state of a robot does not depend on the others or on the thread count. A robot that has fallen rests
    until its reset.
    """

    actuation: ClassVar[Actuation] = GAIT  # whole-body control turns a gait into torques

    def __init__(
        self,
        n: int,
        robot: RobotModel,
        limits: GaitLimits,
        control_hz: float = 100.0,
        threads: int = 1,
        body: CompiledRobot | None = None,
        sensing: str | None = None,
    ):
        """Build the robots, none of them in a state yet: `reset` each before the first step.

        Args:
            n: number of robots.
            robot: physical constants.
            limits: of the capture margin.
            control_hz: planning rate [Hz]; divides the physics rate of 500 Hz.
            threads: that a planning period is computed on.
            body: the robot's model; None: the biped's.
            sensing: of every robot, whatever its scenario says of it; None: what the scenario says.

        Raises:
            InvalidValueError: for an impossible rate or number.
            UnknownNameError: for another sensing.
        """
        self.n, self.robot, self.substeps = n, robot, substeps(control_hz)
        self.after_physics_step: Callable[[], None] | None = None  # for a closer look, slow
        self._threads = RangeThreads(threads)
        self.body = body or biped()
        self._stateless = set(range(n))  # robots that were never put anywhere
        given, found = inputs(self.body.indices), outputs(self.body.model, self.body.indices)
        self.simulations = Simulations(self.body.model, n, given, found, self._threads.threads)
        arrays = self.simulations.arrays
        self.physics = Physics._make(
            [*(arrays[field.name] for field in (*found[:-1], *given)), *self.body.constants()]
        )
        self.gait = resting_gait(n)
        self.contacts = Contacts(
            arrays["qfrc_constraint"], impulse=np.zeros((n, 3)), time=np.zeros(n), velocity=np.zeros((n, 3))
        )
        self.pushes = empty_pushes(n, 1)
        self.errors = no_errors(n)
        self.schedule = empty_schedule(n)
        self.kicks = Kicks(n)
        self._of_laws: list[Any] = [()] * n  # arrays that `pushes.places` has the addresses of
        self.known = empty_self_model(n)
        self.floors = level_floors(n)
        self._known_floors: dict[int, KnownFloor] = {}  # by robot that knows its own
        self.command = np.zeros((n, COMMAND_SIZE))  # in force
        self.previous_action = np.zeros((n, GAIT_SIZE))
        self.observation = np.zeros((n, OBSERVATION_SIZE))
        self.truth = np.zeros((n, OBSERVATION_SIZE))  # observation without its noise, to judge by
        self.margin = np.zeros(n)  # capture margin [m]
        self.world = np.zeros((n, WORLD_SIZE))  # DCM, CoP and CMP in the world [m]
        self.com = np.zeros((n, 2))  # true, in the world [m]
        exact = exact_sensing(self.physics, self.contacts, self.simulations.handles)
        self.senses = Senses(n, exact, self._own_sensors, sensing)
        self._limits = limits
        self.limits_record = empty_record(n, plan_limits(robot, limits, PlannerConfig(), 0.0))
        self.own = self._own_parts()
        self.configure(BipedSettings())

    def _own_parts(self) -> Any:
        """NamedTuple of the parts that the actuation has beside the arena."""
        return ()

    def _own_sensors(self) -> Sensing:
        """The arrays of robots that act on their own sensors."""
        present = (np.array(self.body.indices.motors) != MISSING).astype(np.float64)
        return onboard_sensing(self.simulations, self.physics, self.contacts, present)

    @property
    def judged(self) -> Physics:
        """The true state of robots that act on their own sensors; that of the others is `physics`."""
        return self.senses.last.judged

    @property
    def estimate(self) -> Any:
        """Estimate of the bases of robots that act on their own sensors, of the estimator that came last."""
        return self.senses.kinds[-1].estimate

    def true_state(self, k: int) -> Physics:
        """The arrays that hold where robot k truly is."""
        return self.senses.kinds[self.senses.of(k)].sensing.judged

    def true_values(self, name: str) -> Array:
        """A field of `Physics` as it truly is of every robot, (n, ...)."""
        exact, judged = getattr(self.physics, name), getattr(self.judged, name)
        if judged is exact:
            return exact
        return np.where(self.senses.onboard.reshape(-1, *(1,) * (exact.ndim - 1)), judged, exact)

    def arena_of(self, k: int) -> Arena:
        """All arrays of the core, as they hold robot k."""
        return self._arenas[self.senses.of(k)][0]

    def __getstate__(self) -> object:
        """Refuse copies and pickles: compiled code knows the arrays by their addresses."""
        raise InvalidValueError(
            "a biped cannot be copied or pickled; make a new environment and reset it with the same scenario"
        )

    def configure(self, settings: BipedSettings, planner: PlannerConfig = DEFAULT_PLANNER) -> None:
        """Set the constants of gait machine and whole-body control, and whose plans' limits are recorded."""
        self.gait_settings = settings.gait._replace(double_support=planner.double_support)
        self._capture = capture_constants(self.robot, self._limits)
        self._footholds = FootholdPlanner(self.robot.omega, self._limits, planner)
        self.limits_record.edges[:] = plan_limits(self.robot, self._limits, planner, settings.gait.commit)
        threads, motors = range(self._threads.threads), self.body.motors
        whole = settings.bounds._replace(cop_x_max=self._limits.cop_x_max, cop_y_max=self._limits.cop_y_max)
        self._bounds = [make_bounds(settings.bounds, motors) for _ in threads]
        self._both = [make_bounds(whole, motors, two_feet=True) for _ in threads]
        self.constants = arena_constants(self.gait_settings, settings.gains, settings.bounds, whole)
        self._bind()

    def _bind(self) -> None:
        """Write the address tables anew, for each sensing one a thread: whenever an array is replaced."""
        exchange = Exchange(
            self.command, self.previous_action, self._capture, self.observation, self.margin, self.world,
            self.truth, self.com,
        )  # fmt: skip
        state = self.physics, self.gait, self.pushes
        rest = self.errors, self.limits_record, self.schedule, self.known, self.floors
        workers = [
            (self._bounds[w][0], self._both[w][0], self.simulations.handles_of(w))
            for w in range(self._threads.threads)
        ]
        self._arenas = [
            [Arena(*state, bounds, both, exchange, self.contacts, handles, *rest, *sense.sensing,
                   calls_of(self.actuation, sense.estimator))
             for bounds, both, handles in workers]
            for sense in self.senses.kinds
        ]  # fmt: skip
        own, estimates = (
            parts_table(self.own),
            [[s.estimate] if s.estimator else [] for s in self.senses.kinds],
        )
        self._tables = [
            [Tables(parts_table(arena), own, parts_table(estimate)) for arena in arenas]
            for arenas, estimate in zip(self._arenas, estimates, strict=True)
        ]

    def assign(self, k: int, scenario: Scenario) -> None:
        """Give robot k what a scenario says: model, floor, errors, sensing, pushes, new commands, kicks.

        It has to be put somewhere next, as `reset` does, or by `put_back`.

        Raises:
            InvalidValueError: the robot can't have it; nothing has changed then.
        """
        if scenario.floor_shifts > 1:
            raise InvalidValueError(f"a floor has one shift at most, got several in scenario {scenario.id!r}")
        for push in scenario.forces:
            require_choice("push body", push.body, tuple(self.body.pushed))
        model = assign_errors(self.errors, k, scenario, self.body)
        self.simulations.use_model(k, own_floor(scenario, model, self.simulations.model))
        model, data = self.simulations.models[k], self.simulations.data[k]
        assign_floor(self.floors, k, scenario, self.body.plan.sole_boxes, model, data)
        self._known_floors.pop(k, None)
        if scenario.errors.floor_known and scenario.errors.terrains:
            self._known_floors[k] = self._floor_of(k, scenario)
        pushes = assign_pushes(self.pushes, k, scenario, self.body.pushed)
        schedule = assign_changes(self.schedule, k, scenario)
        comes = self.senses.assign(k, scenario.sensing)
        if comes or pushes is not self.pushes or schedule is not self.schedule:
            self.pushes, self.schedule = pushes, schedule
            self._bind()
        if self.body.indices.trunk == self.body.indices.pelvis:
            self.pushes.body[k, self.pushes.body[k] == NUMBERS["trunk"]] = NUMBERS["pelvis"]
        sensors = self.senses.last.sensors if self.senses.of(k) else None
        self._of_laws[k] = assign_laws(self.pushes, k, scenario, self.body, model, data, sensors)
        if scenario.floor_goes:
            self.errors.physical[k] = self.errors.mismatched[k] = 1
        self.kicks.assign(k, scenario.jumps)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put robot k at the start of a nominal step, feet level and at rest, pelvis and trunk upright.

        Where the scenario has a start of its own, CoM and trunk are beside the nominal ones by that.
        `gait` (7,) and `action` (7,) are the nominal step's, which count as the previous ones. The posture is
        that of the nominal robot, each sole flat on the floor; model errors act from here on.
        """
        self.assign(k, scenario)
        stance = SIDES.index(scenario.stance_side)
        sign = side_sign(stance)
        soles = np.zeros((2, 3))  # the stance sole at the origin, each on the highest point under it
        soles[1 - stance, :2] = start.swing[0], sign * start.swing[1]
        for sole in soles:
            sole[2] = self._floor_height(k, scenario, sole[0], sole[1])
        x, y = scenario.start.com
        height = soles[stance, 2] + self.robot.com_height
        com = np.array([start.com[0] + x, sign * start.com[1] + y, height])
        velocity = np.array([start.com_velocity[0], sign * start.com_velocity[1], 0.0])
        qpos, qvel = self._posture(com, velocity, soles, scenario.start.lean)
        if self.senses.of(k):
            sensors = self.senses.last.sensors
            sensors.seed[k], sensors.side[k] = counter_seed(scenario.noise_seed), stance
        self.put(k, qpos, qvel)
        for field in self.gait:
            field[k] = 0
        self.gait.stance[k] = stance
        self.gait.swing[k, :3] = soles[1 - stance]
        self.gait.height[k, 0], self.gait.height[k, FLOOR] = self.robot.com_height, soles[stance, 2]
        self.command[k] = command_row(scenario.command)
        self.gait.stand[k] = scenario.command.stand
        if scenario.command.stand:
            self.gait.elapsed[k] = ON_BOTH_FEET
        self.gait.plan[k] = gait
        self.previous_action[k] = action
        self.contacts.time[k] = 0.0
        forget(self.known, k, self.gait_settings, self._bounds[0][0].settings.friction)
        clear_record(self.limits_record, k)
        self.truth[k] = 0.0
        kind = self.senses.of(k)
        finish_period(self._tables[kind][0], self.constants, k, k + 1)

    def _posture(
        self, com: Array, velocity: Array, soles: Array, lean: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Where a robot begins: CoM, its velocity (3,) [m/s], soles (2, 3) [m] and lean to qpos and qvel."""
        return posture(self.body, com, velocity, soles, lean)

    def _floor_height(self, k: int, scenario: Scenario, x: float, y: float) -> float:
        """Height of a sole of robot k that lies at (x, y): the highest of the floor at its corners [m]."""
        return self._floor_of(k, scenario).under(x, y)[1] if scenario.errors.terrains else 0.0

    def _floor_of(self, k: int, scenario: Scenario) -> KnownFloor:
        length, width = self.body.half_sole
        return KnownFloor(scenario.errors.terrains, pattern_of(self.floors, k), (length, width))

    def put(self, k: int, qpos: Array, qvel: Array) -> None:
        """Put robot k into a state (nq,), (nv,), nothing acting on it; the gait machine stays as it is."""
        lay_floor(self.floors, k, self.simulations.models[k], self.simulations.data[k], qpos)
        self.simulations.put(k, qpos, qvel)
        self._stateless.discard(k)
        if self.senses.of(k):
            gravity = self.simulations.models[k].opt.gravity
            begin_onboard(self.senses.kinds[self.senses.of(k)], k, self.physics, self.contacts, gravity)
            self.errors.physical[k] = self.errors.mismatched[k] = 1
        if self.errors.mismatched[k]:
            compute_nominal(self.simulations.handles, k)

    def put_back(self, k: int, state: Array) -> None:
        """Put the simulation of robot k into a `state` of `simulations`; the arrays stay as they are."""
        self.simulations.restore(k, state)
        self._stateless.discard(k)

    def limits_met(self, k: int) -> LimitsReport:
        """The limits that robot k has met since its first push began."""
        return report_limits(self.limits_record, k, self.pushes.start[k].min().item(), self.gait.time.item(k))

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one planning period; the observation repeats `actions` (n, 7).

        Raises:
            InvalidValueError: a robot has no state yet.
        """
        if self._stateless:
            raise InvalidValueError(
                f"robots {sorted(self._stateless)} have no state yet: reset each of the {self.n} before the "
                "first step"
            )
        if self.kicks.waiting:
            self._kick()
        if self._known_floors and gaits.shape[1] == GAIT_SIZE:
            gaits = self._on_footholds(gaits)
        if self.after_physics_step is not None:
            self._step_slowly(gaits, actions, self.after_physics_step)
            return
        constants, steps, share = self.constants, self.substeps, 1.0 / max(self.substeps, 1)

        def job(worker: int, first: int, end: int) -> None:
            for kind, start, stop in self.senses.runs(first, end):
                table = self._tables[kind][worker]
                whole_period(table, constants, gaits, actions, steps, share, CONTROL_STEP, start, stop)

        self._threads.run(job, self.n)

    def _on_footholds(self, gaits: Array) -> Array:
        """The gaits (n, 7) with the steps of robots that know their floor moved to level footholds.

        Writes by how much the floor rises to them. What is known is the floor beside the true stance sole, as
        a camera sees it; a step that is committed stays where it is.
        """
        gaits, gait = gaits.copy(), self.gait
        for k, floor in self._known_floors.items():
            if gait.failure[k] != 0 or gait.elapsed[k] < 0.0:
                continue
            stance, asked, true = gait.stance[k], gaits[k], self.true_state(k)
            landing = max(gait.plan[k, DURATION], asked[DURATION]) - gait.elapsed[k]
            committed = landing < self.gait_settings.commit
            (x, y, _), forward = sole_position(true, k, stance), true.xmat[k, FOOT_BODY[stance]]
            yaw, sign = math.atan2(forward[3], forward[0]), side_sign(stance)
            way, speed = self.floors.way[k], self.command.item(k, 0)
            if committed:
                self._footholds.hold_step(way, speed, self.observation[k], gait.plan[k], asked)
            else:
                own = Stance(stance, gait.time.item(k), x, y, yaw, sign * asked[STEP + 1], speed)
                self._footholds.begin_step(floor, way, own)
                self._footholds.move_step(way, speed, self.observation[k], asked)
            length, width = (gait.plan[k] if committed else asked)[STEP : STEP + 2]
            cos, sin, aside = math.cos(yaw), math.sin(yaw), sign * width
            x_to, y_to = x + cos * length - sin * aside, y + sin * length + cos * aside
            gait.rise[k] = floor.under(x_to, y_to, yaw)[1] - floor.under(x, y, yaw)[1]
        return gaits

    def _kick(self) -> None:
        """Let the kicks come that are due when the period begins; robots that have fallen rest."""
        for k in sorted(self.kicks.waiting):
            for kick in self.kicks.due(k, self.gait.time.item(k)):
                if self.gait.failure[k] == 0:
                    self.jump(k, np.array(kick.velocity))

    def jump(self, k: int, velocity: Array) -> None:
        """Change the velocity of all bodies of robot k by the same, (3,) in world axes [m/s].

        A robot with its own sensors feels it as they do, by an accelerometer that has a range.
        """
        self.simulations.jump(k, self.body.indices.dof[:3], velocity)
        if not self.errors.mismatched[k]:
            self.simulations.show(k)
            return
        self.true_state(k).qvel[k, :3] += velocity
        if not self.senses.of(k):
            compute_nominal(self.simulations.handles, k)

    def _step_slowly(self, gaits: Array, actions: Array, look: Callable[[], None]) -> None:
        """Step on one thread, physics step by physics step, and look after each."""
        constants, share = self.constants, 1.0 / max(self.substeps, 1)
        runs = [(self._tables[kind][0], first, end) for kind, first, end in self.senses.runs(0, self.n)]
        for table, first, end in runs:
            begin_period(table, constants, gaits, actions, first, end)
        for _ in range(self.substeps):
            for table, first, end in runs:
                make_steps(table, constants, 1, share, CONTROL_STEP, first, end)
            look()
        for table, first, end in runs:
            finish_period(table, constants, first, end)
