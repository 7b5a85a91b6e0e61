"""What a correction of 1 means, from the box written out by hand."""

import numpy as np
import pytest
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.policies.residual import default_residual_scale


def test_a_correction_of_one_is_so_many_metres_seconds_and_radians():
    """0.12 m, 0.10 m, 0.15 s, CoP 0.06 and 0.03 m, 12 rad/s^2; an action of 2 spans the box."""
    spans = np.array([1.0, 0.3, 0.7, 0.2, 0.1, 37.5, 37.5])  # high - low of the paper's box
    physical = np.array([0.12, 0.10, 0.15, 0.06, 0.03, 12.0, 12.0])
    assert default_residual_scale(GaitLimits()) == pytest.approx(2.0 * physical / spans, rel=1e-6)
    assert default_residual_scale(GaitLimits(), 0.5) == pytest.approx(physical / spans, rel=1e-6)


def test_an_entry_without_a_range_is_not_corrected():
    scale = default_residual_scale(GaitLimits(trunk_roll=False))
    assert scale[6] == 0.0
    assert scale[5] == pytest.approx(24.0 / 37.5)
