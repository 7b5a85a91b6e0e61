"""From a drag on the screen to a push.

The pointer's way is measured in metres on the plane that holds the point grabbed and faces the camera: r to
the right and u upwards. To the right stays to the right, upwards is away from the camera, along the floor:

    J = K (r a + u b),     a: the camera's right,  b: its view without its vertical part;  |J| <= LARGEST.

At depth D from the camera a pixel is 2 D tan(fov / 2) / H metres, where H is the picture's height in pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...controllers.validation import require_number
from ...envs.scenario.push import Push

Array = NDArray[np.float64]

IMPULSE_PER_METRE = 100.0  # K [N s/m]
LARGEST = 400.0  # [N s]
DURATION = 0.1  # of a push by hand [s]
STEEP = 1e-6  # a view with less of a horizontal part looks straight down


def metres_per_pixel(depth: float, fov: float, height: float) -> float:
    """How far a pixel is at a depth [m] from the camera, in a picture `height` pixels high; fov [rad]."""
    return 2.0 * depth * math.tan(fov / 2.0) / height


def dragged_impulse(way: ArrayLike, camera: ArrayLike) -> Array:
    """Horizontal impulse (2,) [N s], in the world, of a drag.

    Args:
        way: from the point grabbed to the pointer, (3,) in the world [m].
        camera: its axes in the world, (3, 3), columns right, down, view.
    """
    right, down, view = np.asarray(camera, np.float64).T
    away = view if np.hypot(*view[:2]) > STEEP else -down
    away = away[:2] / np.hypot(*away[:2])
    aside = np.array([away[1], -away[0]])
    way = np.asarray(way, np.float64)
    return limited(IMPULSE_PER_METRE * ((way @ right) * aside - (way @ down) * away))


def limited(impulse: ArrayLike) -> Array:
    """An impulse (2,) no larger than LARGEST, in the same direction."""
    impulse = np.asarray(impulse, np.float64)
    return impulse * min(1.0, LARGEST / max(float(np.hypot(*impulse)), 1e-12))


def polar_impulse(size: float, psi_deg: float) -> Array:
    """Impulse (2,) of a size [N s] towards psi, counter-clockwise from x [deg].

    Raises:
        InvalidValueError: a size beyond LARGEST or an angle that is not finite.
    """
    size = require_number("impulse [N s]", size, 0.0, LARGEST)
    psi = math.radians(require_number("direction [deg]", psi_deg))
    return np.array([size * math.cos(psi), size * math.sin(psi)])


def push_now(impulse: ArrayLike, time: float, body: str = "pelvis", duration: float = DURATION) -> Push:
    """The push of an impulse (2,) [N s] from a time on [s]: the force J / duration."""
    x, y = (float(part) / duration for part in np.asarray(impulse, np.float64))
    return Push((x, y, 0.0), duration, time, body)
