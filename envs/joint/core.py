"""n bipeds whose joints are acted on: what `BipedCore` has, and who turns those actions into torques."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...controllers.joints.contact_gait import nominal_constants
from ...controllers.joints.drives import JOINT, TARGET_REACH, Joints, joint_constants
from ...controllers.joints.observation import JOINT_OBSERVATION_SIZE
from ...controllers.model.nominal_start import NominalStart
from ...controllers.model.observation import OBSERVATION_SIZE
from ...controllers.model.robot import RobotModel
from ...controllers.settings.planner_config import PlannerConfig
from ...controllers.whole_body.bounds import BoundSettings
from ...controllers.whole_body.bounds_met import BOUNDS, JOINT_TORQUE
from ...controllers.whole_body.gait_machine import GaitSettings
from ...controllers.whole_body.inverse_dynamics import Gains
from ...controllers.whole_body.kinematics import NU, Array
from ..biped.bounds_record import BoundsReport
from ..biped.core import DEFAULT_PLANNER, BipedCore
from ..biped.period import PeriodCalls
from ..biped.posture import posture
from ..biped.robots.compiled_robot import CompiledRobot
from ..scenario.scenario import Scenario
from ..snapshot.rows import Arrays, arrays_of
from .residual_calls import RESIDUAL_CALLS
from .target_calls import TARGET_CALLS

TORQUE = BOUNDS[JOINT_TORQUE.bit_length() - 1]  # name of the bound
COMMON = {f"joints.{name}" for name in ("posture", "reach", "stiffness", "damping", "largest", "gait")}


class OnJoints(NamedTuple):
    """What robots have whose joints are acted on, besides the arena of any biped."""

    joints: Joints


class JointCore(BipedCore):
    """n bipeds under joint targets (n, 14), which PD control turns into torques."""

    calls: ClassVar[PeriodCalls] = TARGET_CALLS
    observation_size: ClassVar[int] = JOINT_OBSERVATION_SIZE

    def _more_parts(self) -> Sequence[Any]:
        """What is asked of the joints; made before the first address table, in which it lies last."""
        if not hasattr(self, "joints"):
            self.joints = self._make_joints()
        return (self.joints,)

    def _make_joints(self) -> Joints:
        largest, stiffness, damping = joint_constants(self.body.motors)
        return Joints(
            asked=np.zeros((self.n, NU)), held=np.zeros((self.n, NU)), lifted=np.zeros(self.n, np.int64),
            air=np.zeros((self.n, 2), np.int64), effort=np.zeros(self.n),
            observation=np.zeros((self.n, self.observation_size)),
            posture=standing_posture(self.body, self.robot), reach=self._reach(largest), stiffness=stiffness,
            damping=damping, largest=largest, gait=nominal_constants(self.robot, self._limits, 0.0),
        )  # fmt: skip

    def _reach(self, largest: Array) -> Array:
        """What an action of 1 asks of each joint, (14,): of targets, how far off the standing posture."""
        return np.where(largest > 0.0, TARGET_REACH, 0.0)

    def more_arrays(self) -> Arrays:
        """Arrays of n robots beside the arena whose rows are state, by PART.FIELD."""
        return arrays_of(OnJoints(self.joints), COMMON)

    def more_settings(self) -> bytes:
        """What all robots have in common, beside that of any biped."""
        found = arrays_of(OnJoints(self.joints), ())
        return b"".join(found[name].tobytes() for name in sorted(COMMON))

    def configure(
        self,
        settings: GaitSettings,
        gains: Gains,
        bounds: BoundSettings,
        planner: PlannerConfig = DEFAULT_PLANNER,
    ) -> None:
        """As that of `BipedCore`; the planner's delay of touchdown is the nominal gait's."""
        super().configure(settings, gains, bounds, planner)
        self.joints.gait[:] = nominal_constants(self.robot, self._limits, planner.touchdown_delay)

    def reset(self, k: int, scenario: Scenario, start: NominalStart, gait: Array, action: Array) -> None:
        """As that of `BipedCore`; the joints have been asked for nothing yet."""
        joints = self.joints
        joints.asked[k] = joints.held[k] = joints.effort[k] = 0.0
        joints.lifted[k] = joints.air[k] = 0
        super().reset(k, scenario, start, gait, action)

    def bounds_met(self, k: int) -> BoundsReport:
        """The torque limits that robot k has met since its first push began; there is no plan to meet any."""
        report = super().bounds_met(k)
        return BoundsReport(*({key: v for key, v in part.items() if key == TORQUE} for part in report))


class JointResidualCore(JointCore):
    """n bipeds under gaits, with a residual (n, 14) on the torques that whole-body control finds for them."""

    calls: ClassVar[PeriodCalls] = RESIDUAL_CALLS
    observation_size: ClassVar[int] = OBSERVATION_SIZE + JOINT_OBSERVATION_SIZE

    def _reach(self, largest: Array) -> Array:
        """Torque of a residual of 1 [N m], (14,): none until `scale_residual`."""
        return np.zeros(NU)

    def scale_residual(self, scale: float) -> None:
        """Set what a residual of 1 adds to each torque, as a share of the motor's largest."""
        self.joints.reach[:] = scale * self.joints.largest

    def bounds_met(self, k: int) -> BoundsReport:
        """The limits that robot k has met since its first push began, those of its planner among them."""
        return BipedCore.bounds_met(self, k)


def standing_posture(body: CompiledRobot, robot: RobotModel) -> Array:
    """Joint angles (14,) [rad], in the order of control, of a robot that stands on both feet.

    The CoM is at its height in the gait; the feet are l_p apart and level, pelvis and trunk upright.
    """
    half = 0.5 * robot.pelvis_width
    soles = np.array([[0.0, half, 0.0], [0.0, -half, 0.0]])
    qpos, _ = posture(body, np.array([0.0, 0.0, robot.com_height]), np.zeros(3), soles)
    own = np.array(body.indices.qpos[JOINT:])
    return np.where(own < 0, 0.0, qpos[own])
