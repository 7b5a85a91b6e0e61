"""Noise of the observed motion: its size, its mirror, and that it belongs to the period."""

import numpy as np
from push_recovery.envs.scenario.noise import add_motion_noise, motion_noise

OMEGA = 3.5


def noise(period, steps, seed=1, deviation=0.01):
    out = np.empty(4)
    motion_noise(seed, period, deviation, OMEGA, steps, out)
    return out


def test_com_and_velocity_share_the_deviation_of_the_dcm():
    n = np.array([noise(period, 0) for period in range(20_000)])
    dcm = n[:, :2] + n[:, 2:] / OMEGA
    np.testing.assert_allclose(dcm.std(axis=0), 0.01, rtol=0.03)
    np.testing.assert_allclose(n[:, :2].std(axis=0), 0.01 / np.sqrt(2.0), rtol=0.03)
    assert np.abs(np.corrcoef(n.T) - np.eye(4)).max() < 0.03


def test_a_step_turns_the_canonical_frame_and_not_the_noise():
    for steps in (2, 3, 8):
        side = 1.0 if steps % 2 == 0 else -1.0
        np.testing.assert_array_equal(noise(5, steps), noise(5, 0) * [1.0, side, 1.0, side])


def test_it_goes_to_com_velocity_and_dcm_alone():
    before = np.linspace(0.1, 0.9, 36)
    before[1:3] = before[3:5] + before[5:7] / OMEGA
    after = before.copy()
    add_motion_noise(noise(3, 1), OMEGA, after)
    np.testing.assert_allclose(after[3:7] - before[3:7], noise(3, 1), atol=1e-16)
    np.testing.assert_allclose(after[1:3], after[3:5] + after[5:7] / OMEGA, atol=1e-16)
    assert np.flatnonzero(after != before).tolist() == [1, 2, 3, 4, 5, 6]
