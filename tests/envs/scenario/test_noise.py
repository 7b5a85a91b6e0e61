"""Counter-based noise: moments, independence, and that a number depends on its counters alone.

Noise of the observed motion: its size, its mirror, and that it belongs to the period.
"""

import numpy as np
import pytest
from numba import njit
from push_recovery.envs.scenario.noise import (
    add_motion_noise,
    counter_seed,
    motion_noise,
    normal_pair,
    scrambled,
)
from scipy import stats

COUNT = 40_000


@njit
def along(seed, index, channel, count, axis):
    """Pairs (count, 2) along one of the three counters."""
    out = np.empty((count, 2))
    for i in range(count):
        step = [0, 0, 0]
        step[axis] = i
        out[i] = normal_pair(seed + step[0], index + step[1], channel + step[2])
    return out


@pytest.mark.parametrize("axis", [0, 1, 2], ids=["seeds", "moments", "channels"])
def test_numbers_are_standard_normal_and_independent(axis):
    z = along(3, 5, 1, COUNT, axis)
    for column in z.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
        for lag in (1, 2, 7):
            assert abs(np.mean(column[lag:] * column[:-lag])) < 4.0 / np.sqrt(COUNT)
            assert abs(np.mean(column[lag:] ** 2 * column[:-lag] ** 2) - 1.0) < 4.0 * 8.0**0.5 / COUNT**0.5
    assert abs(np.mean(z[:, 0] * z[:, 1])) < 4.0 / np.sqrt(COUNT)


@pytest.mark.parametrize("other", [(3, 6, 1), (3, 5, 2), (4, 5, 1)], ids=["moment", "channel", "seed"])
def test_streams_of_other_counters_are_unrelated(other):
    a, b = along(3, 5, 1, COUNT, 1), along(*other, COUNT, 1)
    if other[1] == 6:  # the same stream one later
        a = a[1:]
        assert a.tobytes() == b[:-1].tobytes()
        return
    assert np.abs(np.mean(a * b, axis=0)).max() < 4.0 / np.sqrt(COUNT)


def test_a_number_depends_on_its_counters_alone():
    backwards = [normal_pair(9, i, 4) for i in reversed(range(20))][::-1]
    assert [tuple(row) for row in along(9, 0, 4, 20, 1)] == backwards


def test_the_bits_are_those_of_splitmix64():
    """First outputs of the published generator from seed 1234567."""
    state, golden = 1234567, 0x9E3779B97F4A7C15
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    for value in expected:
        state = (state + golden) % 2**64
        assert int(scrambled(np.uint64(state))) == value


@pytest.mark.parametrize("seed", [0, 7, 2**63 - 1, 2**63, 2**64 + 7, 10**30])
def test_seeds_of_any_size(seed):
    wrapped = counter_seed(seed)
    assert -(2**63) <= wrapped < 2**63
    assert (wrapped - seed) % 2**64 == 0
    assert np.isfinite(normal_pair(wrapped, 0, 0)).all()


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
