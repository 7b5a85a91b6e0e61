"""The canonical frame: origin at the centre of the stance sole, x forwards, y towards the swing side.

In it left and right stance are one problem. With psi the heading and s the sign of its y, -1 on the left foot
(whose swing side is the right one) and 1 on the right foot, a horizontal vector of the world v reads

    v_x' = cos(psi) v_x + sin(psi) v_y,    v_y' = s (cos(psi) v_y - sin(psi) v_x),

and back, with w = s v_y',

    v_x = cos(psi) v_x' - sin(psi) w,      v_y = sin(psi) v_x' + cos(psi) w.

A sign of 1 on either foot gives the frame of the heading, whose y points to the left. Angles and rates about
the vertical axis, and leans towards y, take the sign s alone.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba.extending import register_jitable

from ..compiled.kernels import njit


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
