"""One recorded episode of the pendulum: what the figures of scenario 1 are drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Record:
    """Time histories, world frame (x forward, y left); one sample per planning period, n of them, m steps."""

    arm: str  # name of the policy
    time: Array  # (n,) since reset [s]
    com: Array  # (n, 2) [m]
    dcm: Array  # (n, 2) [m]
    cop: Array  # (n, 2) held since the sample before [m]
    cmp: Array  # (n, 2) [m]
    trunk_angle: Array  # (n, 2) lean towards +x, +y [rad]
    trunk_torque: Array  # (n, 2) held since the sample before [N m]
    stance: Array  # (n, 2) centre of the stance sole [m]
    swing: Array  # (n, 3) centre of the swing sole [m]
    step: Ints  # (n,) number of touchdowns so far
    foothold: Array  # (m, 2) centre of every sole that was stood on, in order [m]
    foothold_side: Ints  # (m,) 0 left, 1 right
    touchdown: Array  # (m,) when it was set down, 0 for the first [s]
    push_force: Array  # (2,) [N]
    push_start: float  # [s]
    push_duration: float  # [s]
    survived: bool
    foot_size: tuple[float, float]  # length, width [m]
    com_height: float  # [m]
    trunk_torque_max: float  # [N m]
    trunk_angle_max: float  # [rad]
