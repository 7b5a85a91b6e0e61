"""n bipeds at physics rate: one planning period holds one gait action.

Within the period every physics step computes, for each robot, touchdown, swing foot, whole-body torque and
push, and then the batch of simulations advances together.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from ..controllers.capturability import capture_constants
from ..controllers.errors import InvalidValueError
from ..controllers.limits import GAIT_SIZE, GaitLimits
from ..controllers.observation import OBSERVATION_SIZE
from ..controllers.robot import RobotModel
from .biped_arena import (
    Arena,
    View,
    arena_constants,
    arena_table,
    begin_period,
    control_step,
    finish_period,
    measure_step,
)
from .biped_gait import Gait, GaitSettings, side_sign
from .biped_kinematics import Array, Physics
from .biped_model import PHYSICS_DT, biped_model, mass_matrix_index, posture
from .biped_observation import Contacts
from .nominal_start import NominalStart
from .push import SIDES
from .push_batch import assign_pushes, empty_pushes
from .scenario import Scenario
from .whole_body import Gains
from .wrench_bounds import BoundSettings, make_bounds

AT_VELOCITY = mujoco.mjtStage.mjSTAGE_VEL.value  # stages that are current after a physics step


class BipedCore:
    """n bipeds that share one compiled model; `mujoco.batch` steps them on a thread pool.

    Arrays are indexed by robot. The state of a robot does not depend on the others or on the thread count.
    """

    def __init__(
        self, n: int, robot: RobotModel, limits: GaitLimits, control_hz: float = 100.0, threads: int = 1
    ):
        self.n = n
        self.robot = robot
        self.substeps = physics_steps(control_hz)
        self.batch = Batch(biped_model(), n, threads, persistent=True)
        bind = self.batch.bind
        self.physics = Physics(
            bind("qpos"), bind("qvel"), bind("xpos"), bind("xmat"), bind("xanchor"), bind("xaxis"),
            bind("subtree_com"), bind("M"), bind("qfrc_bias"), bind("sensordata"), bind("ctrl"),
            bind("xfrc_applied"),
        )  # fmt: skip
        self.gait = Gait(
            stance=np.zeros(n, np.int64), steps=np.zeros(n, np.int64), elapsed=np.zeros(n), time=np.zeros(n),
            heading=np.zeros(n), swing=np.zeros((n, 9)), height=np.zeros(n), plan=np.zeros((n, GAIT_SIZE)),
            failure=np.zeros(n, np.int64), wrench=np.zeros((n, 6)),
        )  # fmt: skip
        self.contacts = Contacts(
            bind("qfrc_constraint"), impulse=np.zeros((n, 2)), time=np.zeros(n), velocity=np.zeros((n, 3))
        )
        self.pushes = empty_pushes(n, 1)
        self.command = np.zeros((n, 2))
        self.previous_action = np.zeros((n, GAIT_SIZE))
        self.observation = np.zeros((n, OBSERVATION_SIZE))
        self.margin = np.zeros(n)  # capture margin [m]
        self.world = np.zeros((n, 6))  # DCM, CoP and CMP in the world [m]
        self._capture = capture_constants(robot, limits)
        settings = GaitSettings(robot.omega, robot.com_height, robot.cmp_per_trunk_acceleration, robot.mass)
        self.configure(settings, Gains(), BoundSettings())

    def configure(self, settings: GaitSettings, gains: Gains, bounds: BoundSettings) -> None:
        """Set the constants of gait machine and whole-body control."""
        self.settings = settings
        self.bounds, self._bounds_memory = make_bounds(bounds, biped_model().actuator_forcerange[:, 1].copy())
        self._constants = arena_constants(settings, gains, bounds)
        self._bind()

    def _bind(self) -> None:
        """Write the address table anew; to be called whenever an array is replaced."""
        view = View(
            self.command, self.previous_action, self._capture, self.observation, self.margin, self.world
        )
        state = (self.physics, self.gait, self.pushes, self.bounds)
        self._arena = Arena(*state, mass_matrix_index(), view, self.contacts)
        self._table = arena_table(self._arena)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """Put robot k at the start of a nominal step, feet level and at rest, pelvis and trunk upright.

        `gait` (7,) and `action` (7,) are the nominal step's, which count as the previous ones.
        """
        stance = SIDES.index(scenario.stance_side)
        sign = side_sign(stance)
        soles = np.zeros((2, 3))
        soles[1 - stance, :2] = start.swing[0], sign * start.swing[1]
        com = np.array([start.com[0], sign * start.com[1], self.robot.com_height])
        velocity = np.array([start.com_velocity[0], sign * start.com_velocity[1], 0.0])
        qpos, qvel = posture(com, velocity, soles)
        self.batch.reset([k], stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.physics.qpos[k], self.physics.qvel[k] = qpos, qvel
        self.batch.forward([k], stage=AT_VELOCITY)
        for field in self.gait:
            field[k] = 0
        self.gait.stance[k] = stance
        self.gait.swing[k, :3] = soles[1 - stance]
        self.gait.height[k] = self.robot.com_height
        self.command[k] = scenario.command.vx, scenario.command.vy
        self.gait.plan[k] = gait
        self.previous_action[k] = action
        pushes = assign_pushes(self.pushes, k, scenario)
        if pushes is not self.pushes:
            self.pushes = pushes
            self._bind()
        self.contacts.time[k] = 0.0
        self.observation[k] = 0.0
        finish_period(self._table, self._constants)

    def step(self, gaits: Array, actions: Array) -> None:
        """Hold gait variables (n, 7) for one planning period; the observation repeats `actions` (n, 7)."""
        begin_period(self._table, self._constants, gaits, actions)
        for _ in range(self.substeps):
            control_step(self._table, self._constants, PHYSICS_DT)
            self.batch.step(stage=AT_VELOCITY)
            measure_step(self._table, PHYSICS_DT)
        finish_period(self._table, self._constants)


def physics_steps(control_hz: float) -> int:
    """Physics steps per planning period; the rate must divide the physics rate."""
    steps = round(1.0 / (control_hz * PHYSICS_DT)) if control_hz > 0 else 0
    if steps < 1 or abs(steps * PHYSICS_DT * control_hz - 1.0) > 1e-9:
        valid = ", ".join(f"{500 / s:g}" for s in (1, 2, 4, 5, 10))
        raise InvalidValueError(
            f"control_hz must divide the physics rate of 500 Hz (such as {valid}), got {control_hz}"
        )
    return steps
