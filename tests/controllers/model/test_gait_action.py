"""Gait variables as actions, by hand: the way back of `gaits_of_actions`."""

import numpy as np
import pytest
from push_recovery.controllers.model.double_support import gaits_of_actions, scale_actions
from push_recovery.controllers.model.gait_box import GaitLimits
from push_recovery.controllers.model.observation import ELAPSED, SWING_POSITION

LIMITS = GaitLimits()
D = 0.1  # double support [s]


def actions_of(gaits, elapsed=0.3, double_support=0.0):
    """Actions (n, 7) of gaits (n, 7) `elapsed` into a step whose swing foot stood at (-0.3, 0.25)."""
    gaits = np.array(gaits, dtype=np.float64)
    observations = np.zeros((len(gaits), 36))
    observations[:, ELAPSED], observations[:, SWING_POSITION] = elapsed, (-0.3, 0.25, 0.0)
    actions = np.full((len(gaits), 7), np.nan, np.float32)
    scale_actions(gaits, observations, LIMITS.box, double_support, actions)
    return actions, observations


def test_the_box_is_spanned_and_what_lies_beyond_is_clipped():
    middle, span = 0.5 * (LIMITS.low + LIMITS.high), LIMITS.high - LIMITS.low
    shares = [0.0, 0.5, -0.25, 1.0, -1.0, 1.5, -1.5]
    found, _ = actions_of([middle + 0.5 * share * span for share in shares])
    np.testing.assert_allclose(found, np.repeat(np.clip(shares, -1.0, 1.0)[:, None], 7, axis=1), atol=1e-6)


@pytest.mark.parametrize(("elapsed", "both"), [(0.05, True), (0.11, False)])
def test_while_both_feet_stand_the_cop_spans_the_box_about_both_soles(elapsed, both):
    """Soles of 0.2 x 0.1 m at the origin and at (-0.3, 0.25)."""
    low, high = LIMITS.low.copy(), LIMITS.high.copy()
    if both:
        low[3:5], high[3:5] = (-0.4, -0.05), (0.1, 0.3)
    found, observations = actions_of([low, high, 0.5 * (low + high)], elapsed, D)
    np.testing.assert_allclose(found, np.repeat([[-1.0], [1.0], [0.0]], 7, axis=1), atol=1e-6)
    again = gaits_of_actions(LIMITS, observations[2:], found[2:], D)
    np.testing.assert_allclose(np.delete(again[0], [3, 4]), np.delete(0.5 * (low + high), [3, 4]), atol=1e-6)
