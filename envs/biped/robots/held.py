"""Joints that keep an angle: their motors become servos, which MuJoCo evaluates in its own step.

The torque of a held joint is that of a critically damped spring about its angle,

    tau = I w^2 (q_held - q) - 2 I w qd,    clipped to the motor's forcerange,

with I the inertia that the joint moves in the held posture, the rest of the robot at rest, and w well above
what walking excites. Control takes the joint for rigid: it knows neither its coordinate nor its torque.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ....controllers.errors import InvalidValueError
from ....controllers.model.body_plan import BodyPlan
from .indices import hinge, motor_of

FREQUENCY = 60.0  # w [rad/s]


def hold_joints(model: mujoco.MjModel, plan: BodyPlan) -> None:
    """Turn the motors of a plan's held joints into servos, in place.

    Raises:
        UnknownNameError: a joint that the model does not have.
        InvalidValueError: no hinge, no motor, or an angle out of the joint's range.
    """
    if not plan.held:
        return
    inertia = _inertia(model, plan)
    for name, angle in plan.held:
        joint = hinge(model, name)
        low, high = model.jnt_range[joint]
        if model.jnt_limited[joint] and not low <= angle <= high:
            raise InvalidValueError(
                f"held joint {name!r} must keep an angle in [{low:g}, {high:g}] rad, got {angle:g}"
            )
        motor, moved = motor_of(model, joint), inertia[model.jnt_dofadr[joint]]
        stiffness, damping = moved * FREQUENCY**2, 2.0 * moved * FREQUENCY
        model.actuator_biastype[motor] = mujoco.mjtBias.mjBIAS_AFFINE
        model.actuator_biasprm[motor, :3] = stiffness * angle, -stiffness, -damping


def put_held(model: mujoco.MjModel, plan: BodyPlan, data: mujoco.MjData) -> None:
    """Put the held joints of `data` at their angles."""
    for name, angle in plan.held:
        data.qpos[model.jnt_qposadr[hinge(model, name)]] = angle


def _inertia(model: mujoco.MjModel, plan: BodyPlan) -> np.ndarray:
    """Diagonal of the mass matrix in the held posture, (nv,) [kg m^2]."""
    data = mujoco.MjData(model)
    put_held(model, plan, data)
    mujoco.mj_forward(model, data)
    return data.M[model.M_rowadr + model.M_rownnz - 1].copy()
