"""The canonical frame, and the layout of the gait observation in it: all that the planner needs.

The canonical frame has its origin at the centre of the stance sole, x forwards and y towards the swing side,
so that left and right stance are one problem. With psi the heading and s the sign of its y, -1 on the left
foot (whose swing side is the right one) and 1 on the right foot, a horizontal vector of the world v reads

    v_x' = cos(psi) v_x + sin(psi) v_y,    v_y' = s (cos(psi) v_y - sin(psi) v_x),

and back, with w = s v_y',

    v_x = cos(psi) v_x' - sin(psi) w,      v_y = sin(psi) v_x' + cos(psi) w.

A sign of 1 on either foot gives the frame of the heading, whose y points to the left. Angles and rates about
the vertical axis, and leans towards y, take the sign s alone.

The observation is one flat vector for the planner and the networks, for the pendulum and for the biped.
Positions [m] are relative to the centre of the stance sole; velocities [m/s] are of the world, in the same
axes. Lean angles [rad] are positive towards +x (pitch) and +y (roll).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidValueError
from ..jit import njit


class Frame(NamedTuple):
    """Axes of a frame on the floor."""

    cos: float  # of the heading psi
    sin: float
    sign: float  # s: of the frame's y in a frame turned to the heading


@register_jitable
def side_sign(stance: Any) -> Any:
    """Sign s of the canonical y in the frame of the heading: -1.0 on the left foot (0), 1.0 on the right (1).

    Takes one stance or an array of them.
    """
    return 2.0 * stance - 1.0


@njit(cache=True, forceinline=True)
def canonical_frame(heading: float, stance: int) -> Frame:
    """The canonical frame of a heading [rad] and a stance foot, 0 left, 1 right."""
    return Frame(math.cos(heading), math.sin(heading), side_sign(stance))


@njit(cache=True, forceinline=True)
def heading_frame(heading: float) -> Frame:
    """The frame of a heading [rad]: x along it, y to the left."""
    return Frame(math.cos(heading), math.sin(heading), 1.0)


@njit(cache=True, forceinline=True)
def canonical(frame: Frame, x: float, y: float) -> tuple[float, float]:
    """A horizontal vector of the world, in the frame."""
    return frame.cos * x + frame.sin * y, frame.sign * (frame.cos * y - frame.sin * x)


@njit(cache=True, forceinline=True)
def in_world(frame: Frame, x: float, y: float) -> tuple[float, float]:
    """A horizontal vector of the frame, in the world."""
    y *= frame.sign
    return frame.cos * x - frame.sin * y, frame.sin * x + frame.cos * y


@njit(cache=True, forceinline=True)
def point_in_world(frame: Frame, sole_x: float, sole_y: float, x: float, y: float) -> tuple[float, float]:
    """A point of the frame, whose origin lies at a sole's centre (sole_x, sole_y), in the world [m]."""
    y *= frame.sign
    return sole_x + frame.cos * x - frame.sin * y, sole_y + frame.sin * x + frame.cos * y


ELAPSED = 0  # time since the step began [s]; ON_BOTH_FEET where the robot stands and none has begun
DCM = slice(1, 3)  # xi = com + com_velocity / omega
COM = slice(3, 5)  # horizontal
COM_VELOCITY = slice(5, 7)
COM_HEIGHT_ERROR = 7  # above the pendulum's height h
COM_VERTICAL_VELOCITY = 8
SWING_POSITION = slice(9, 12)  # centre of the swing sole, z above the floor
SWING_VELOCITY = slice(12, 15)
TRUNK_ANGLE = slice(15, 17)  # lean of the trunk: pitch, roll
TRUNK_RATE = slice(17, 19)  # [rad/s]
PELVIS_ANGLE = slice(19, 21)  # lean of the pelvis: pitch, roll (zero on the pendulum)
HEADING_ERROR = 21  # pelvis yaw over the heading, positive towards +y [rad]
YAW_RATE = 22  # [rad/s], positive towards +y
STANCE_CONTACT = 23  # 1 if the stance foot carries load
SWING_CONTACT = 24
COMMAND = slice(25, 27)  # commanded velocity x, y [m/s]
PREVIOUS_ACTION = slice(27, 34)  # action of the last period, in [-1, 1]
# External force over m omega^2 during the last period, from the DCM and the CMP that acted in it:
# delta = (xi - (exp(omega dt) xi_before - (exp(omega dt) - 1) cmp)) / (exp(omega dt) - 1)  [m]
PUSH_ESTIMATE = slice(34, 36)

ON_BOTH_FEET = -1.0  # "elapsed" of a robot that stands on both feet until a step begins

# Columns of DCM, CoP and CMP in the world [m], for `info`; of a pair (x, y) the first one
WORLD_DCM, WORLD_COP, WORLD_CMP = 0, 2, 4
WORLD_SIZE = 6

OBSERVATION_SIZE = 36
OBSERVATION_NAMES = (
    "elapsed", "dcm_x", "dcm_y", "com_x", "com_y", "com_velocity_x", "com_velocity_y", "com_height_error",
    "com_vertical_velocity", "swing_x", "swing_y", "swing_z", "swing_velocity_x", "swing_velocity_y",
    "swing_velocity_z", "trunk_pitch", "trunk_roll", "trunk_pitch_rate", "trunk_roll_rate", "pelvis_pitch",
    "pelvis_roll", "heading_error", "yaw_rate", "stance_contact", "swing_contact", "command_x", "command_y",
    "previous_step_length", "previous_step_width", "previous_step_duration", "previous_cop_x",
    "previous_cop_y", "previous_trunk_pitch_acceleration", "previous_trunk_roll_acceleration",
    "push_estimate_x", "push_estimate_y",
)  # fmt: skip


_DOUBLE = np.dtype(np.float64)


def as_doubles(observation: ArrayLike) -> NDArray[np.float64]:
    """Observations of any shape as contiguous float64.

    Raises:
        InvalidValueError: for something that is no array of real numbers that a float can hold.
    """
    try:
        values = np.ascontiguousarray(observation)
    except (TypeError, ValueError) as error:  # ragged
        raise InvalidValueError(f"observation is not an array of numbers: {error}") from None
    return values if values.dtype is _DOUBLE else _converted(values)


def _converted(values: NDArray[Any]) -> NDArray[np.float64]:
    """Numbers of another type as float64."""
    if values.dtype.kind not in "biufO":
        raise InvalidValueError(f"observation is not an array of real numbers: it holds {values.dtype}")
    try:
        with np.errstate(over="ignore"):  # infinity is refused where it matters, with NaN
            return values.astype(np.float64)
    except OverflowError:
        raise InvalidValueError("observation holds an integer that is larger than any float") from None
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"observation is not an array of real numbers: {error}") from None


def as_batch(observation: ArrayLike, size: int = OBSERVATION_SIZE) -> tuple[NDArray[np.float64], bool]:
    """Observations as (n, size) float64, and whether it was a single one.

    Raises:
        InvalidValueError: for another shape or something that is no real number.
    """
    batch = as_doubles(observation)
    single = batch.ndim == 1
    batch = batch[None] if single else batch
    if not batch.flags.writeable:  # compiled code would be compiled once more for it
        batch = batch.copy()
    if batch.ndim != 2 or batch.shape[1] != size:
        raise InvalidValueError(
            f"observation must have shape ({size},) or (n, {size}), got {np.shape(observation)}"
        )
    return batch, single
