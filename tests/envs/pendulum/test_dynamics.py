"""The trunk's arrival at its stop, against the parabola of its angle."""

import math

import numpy as np
import pytest
from push_recovery.envs.pendulum.dynamics import time_to_stop


def test_time_to_stop_is_the_first_root():
    rng = np.random.default_rng(0)
    for _ in range(200):
        angle, rate, a = rng.uniform(-1, 1), rng.normal(0, 3), rng.normal(0, 15)
        s = time_to_stop(angle, rate, a, 1.0472)
        times = np.linspace(0, min(s, 3.0), 2000)[:-1]
        assert np.abs(angle + rate * times + a * times**2 / 2).max() <= 1.0472 + 1e-9
        if math.isfinite(s):
            assert abs(angle + rate * s + a * s * s / 2) == pytest.approx(1.0472, abs=1e-9)
