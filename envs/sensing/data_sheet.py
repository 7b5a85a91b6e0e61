"""Figures of the sensors that a robot carries; docs/hardware.md says where they come from."""

from __future__ import annotations

import math
from typing import NamedTuple

_DEGREE, _G = math.pi / 180.0, 9.81
BANDWIDTH = 250.0  # of white noise in samples 2 ms apart [Hz]


class SensorSettings(NamedTuple):
    """Standard deviations unless said otherwise; noise is white, of one sample every 2 ms."""

    rate_noise: float = 0.007 * _DEGREE * math.sqrt(BANDWIDTH)  # of the gyro [rad/s]
    rate_bias: float = 0.05 * _DEGREE  # left after calibration at rest [rad/s]
    rate_walk: float = 2e-5  # of that bias [rad/s / sqrt(s)]
    rate_scale: float = 0.001  # error over the rate
    rate_range: float = 2000.0 * _DEGREE  # largest rate told [rad/s]
    force_noise: float = 120e-6 * _G * math.sqrt(BANDWIDTH)  # of the accelerometer [m/s^2]
    force_bias: float = 3e-3 * _G  # left after calibration [m/s^2]
    force_walk: float = 1e-4  # of that bias [m/s^2 / sqrt(s)]
    force_scale: float = 0.005  # error over the specific force
    force_range: float = 16.0 * _G  # largest specific force told [m/s^2]
    angle_resolution: float = 2.0 * math.pi / 2**17  # step of an encoder at the joint [rad]
    angle_noise: float = 2e-5  # [rad]
    angle_offset: float = 5e-4  # of its zero [rad]
    load_noise: float = 2.0  # of a force sensor in a foot, each axis [N]
    load_lag: float = 0.001  # time constant of its filter [s]
    load_least: float = 8.0  # a smaller load is told as none [N]


SETTINGS = len(SensorSettings._fields)
