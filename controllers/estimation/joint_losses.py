"""What the joints of the legs lose, found while a leg swings: friction, and a rotor heavier than the model's.

A leg in the air is moved by its motors alone. What their torques tau, which the drives report, leave over is

    r = tau - (M qdd + h) = c sign(qd) + I qdd,

in each joint: c its friction [N m], I the inertia [kg m^2] that its rotor has beyond the model's. qdd is a
difference quotient, so r, sign(qd) and qdd pass through the same filter, which leaves the relation between
them as it is. c and I are the least squares over what the leg's swings have told, the last `MEMORY` seconds
the most. Each touchdown takes them into mass matrix and bias; the inverse dynamics do the rest.

The waist is left out. The trunk hardly moves while the robot walks, so that a tilt of the estimate passes for
friction, and a trunk whose friction is taken for more than it is leans further and further.

An, Atkeson and Hollerbach (1985), "Estimation of inertial parameters of rigid body links of manipulators".
"""

# stack_floats is an intrinsic: its arguments are those of its signature, less the typing context.
# pyright: reportCallIssue=false

from __future__ import annotations

import math

from numba.np.numpy_support import carray

from ..compiled.array_table import Floats2, Floats3
from ..compiled.kernels import njit
from ..compiled.stack_array import stack_floats
from ..whole_body.gait_machine import Gait
from ..whole_body.kinematics import LEG_DOF, NV, Array, Physics
from ..whole_body.mass_matrix import BASE, DIAGONAL, ROW

MEMORY = 2.0  # of swinging [s]
FILTER = 100.0  # rate [1/s]
LEAST_SPEED = 0.1  # slower than this, sign(qd) grows linearly [rad/s]
FRICTION_AT_FIRST = 0.02  # weight of c = 0: that of moving for so long [s]
ROTOR_AT_FIRST = 2.0  # weight of I = 0, an integral of qdd^2 [rad^2/s^3]
REST = 0.02  # slower than this, a joint tells nothing [rad/s]
BLOW = 10.0  # no joint loses so much: it is at its stop, or something has hit the foot [N m]
FRICTION_KNOWN, FRICTION_MOST = 0.2, 5.0  # less counts as none, more as this [N m]
ROTOR_KNOWN, ROTOR_MOST = 0.005, 0.2  # likewise [kg m^2]

# Columns of a joint's row
LOST, SIGN, ACCELERATION = 0, 1, 2  # filtered since the swing began [N m], [], [rad/s^2]
SIGN_SIGN, SIGN_ACCELERATION, ACCELERATION_SQUARED = 3, 4, 5  # integrals of their products over time
SIGN_LOST, ACCELERATION_LOST = 6, 7
FRICTION, ROTOR = 8, 9  # c [N m] and I [kg m^2]
SIZE = 10
# Columns of what is kept of the step's beginning: rows of M of the swing leg's joints, theirs of h, all rates
BIAS = 57
RATES = BIAS + 6
BEFORE = RATES + NV


@njit(cache=True, forceinline=True)
def direction(speed: float) -> float:
    """Sign of a joint's rate [rad/s], continuous."""
    return min(max(speed / LEAST_SPEED, -1.0), 1.0)


@njit(cache=True, forceinline=True)
def known_size(value: float, known: float, most: float) -> float:
    """A loss, where it is large enough to be told from none, and no larger than is believed."""
    return min(value, most) if value >= known else 0.0


@njit(cache=True)
def conclude(joint: Array) -> None:
    """Solve the least squares of a joint's row (SIZE,), and begin the filters of its next swing."""
    a, b, c = joint[SIGN_SIGN] + FRICTION_AT_FIRST, joint[SIGN_ACCELERATION], joint[ACCELERATION_SQUARED]
    c += ROTOR_AT_FIRST
    determinant = a * c - b * b
    friction = (c * joint[SIGN_LOST] - b * joint[ACCELERATION_LOST]) / determinant
    rotor = (a * joint[ACCELERATION_LOST] - b * joint[SIGN_LOST]) / determinant
    joint[FRICTION] = known_size(friction, FRICTION_KNOWN, FRICTION_MOST)
    joint[ROTOR] = known_size(rotor, ROTOR_KNOWN, ROTOR_MOST)
    joint[LOST] = joint[SIGN] = joint[ACCELERATION] = 0.0


@njit(cache=True)
def take_in(joint: Array, lost: float, speed: float, acceleration: float, dt: float) -> None:
    """Take torque lost [N m], rate and acceleration of a joint over dt [s] into its row (SIZE,)."""
    share, keep = 1.0 - math.exp(-FILTER * dt), math.exp(-dt / MEMORY)
    joint[LOST] += share * (lost - joint[LOST])
    joint[SIGN] += share * (direction(speed) - joint[SIGN])
    joint[ACCELERATION] += share * (acceleration - joint[ACCELERATION])
    r, s, a = joint[LOST], joint[SIGN], joint[ACCELERATION]
    if abs(r) > BLOW:
        joint[LOST] = joint[SIGN] = joint[ACCELERATION] = 0.0
        return
    if abs(speed) < REST:  # it may rest against its stop
        return
    joint[SIGN_SIGN] = keep * joint[SIGN_SIGN] + s * s * dt
    joint[SIGN_ACCELERATION] = keep * joint[SIGN_ACCELERATION] + s * a * dt
    joint[ACCELERATION_SQUARED] = keep * joint[ACCELERATION_SQUARED] + a * a * dt
    joint[SIGN_LOST] = keep * joint[SIGN_LOST] + s * r * dt
    joint[ACCELERATION_LOST] = keep * joint[ACCELERATION_LOST] + a * r * dt


@njit(cache=True)
def leg_row(before: Array, i: int, qdd: Array, first: int) -> float:
    """Row i of M qdd of a leg, from the rows of its joints, qdd (20,) and its first degree of freedom."""
    row, total = i * (2 * BASE + 1 + i) // 2, 0.0
    for c in range(BASE):
        total += before[row + c] * qdd[c]
    for c in range(i + 1):
        total += before[row + BASE + c] * qdd[first + c]
    for c in range(i + 1, 6):
        total += before[c * (2 * BASE + 1 + c) // 2 + BASE + i] * qdd[first + c]
    return total


@njit(cache=True)
def feel_swing(joints: Floats3, before: Floats2, phys: Physics, k: int, leg: int, dt: float) -> None:
    """Take in what the joints of a leg in the air have lost in the physics step that has just ended."""
    qdd, first = carray(stack_floats(20), (NV,)), LEG_DOF[leg]
    for i in range(NV):
        qdd[i] = (phys.qvel[k, i] - before[k, RATES + i]) / dt
    for i in range(6):
        j = first + i
        lost = phys.ctrl[k, j - BASE] - leg_row(before[k], i, qdd, first) - before[k, BIAS + i]
        take_in(joints[k, j - BASE], lost, 0.5 * (phys.qvel[k, j] + before[k, RATES + j]), qdd[j], dt)


@njit(cache=True)
def keep_leg(before: Floats2, phys: Physics, k: int, leg: int) -> None:
    """Keep the rows of a leg's joints, and all rates, for the physics step to come."""
    for i in range(BIAS):
        before[k, i] = phys.mass_matrix[k, ROW[LEG_DOF[leg]] + i]
    for i in range(6):
        before[k, BIAS + i] = phys.bias[k, LEG_DOF[leg] + i]
    for i in range(NV):
        before[k, RATES + i] = phys.qvel[k, i]


@njit(cache=True, forceinline=True)
def feel_joints(joints: Floats3, before: Floats2, phys: Physics, gait: Gait, k: int, dt: float) -> None:
    """Take in the physics step of robot k that has just ended; a leg that has just landed concludes.

    Args:
        joints: (n, 14, SIZE), written.
        before: (n, BEFORE) the swing leg's rows and all rates at the beginning of the step, written.
        phys: of all robots after the step, M and h of the model, torques as the drives gave them.
        gait: of all robots.
        k: the robot.
        dt: of the step [s].
    """
    stance = gait.stance[k]
    if gait.elapsed[k] <= 1.5 * dt:  # has just touched down
        for j in range(LEG_DOF[stance], LEG_DOF[stance] + 6):
            conclude(joints[k, j - BASE])
    elif phys.load[k, 1 - stance] <= 0.0:
        feel_swing(joints, before, phys, k, 1 - stance, dt)
    keep_leg(before, phys, k, 1 - stance)


@njit(cache=True, forceinline=True)
def add_losses(joints: Floats3, phys: Physics, k: int) -> None:
    """Add what the joints of robot k lose to its mass matrix and bias, just computed from its model."""
    for j in range(LEG_DOF[0], NV):
        joint = joints[k, j - BASE]
        phys.mass_matrix[k, DIAGONAL[j]] += joint[ROTOR]
        phys.bias[k, j] += joint[FRICTION] * direction(phys.qvel[k, j])
