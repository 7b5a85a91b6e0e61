import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.controllers.whole_body.swing import swing_update, swing_update_batch

DT, APEX, DESCENT = 0.002, 0.06, 0.3


def fly(duration=lambda t: 0.5, target=lambda t: (0.3, 0.2), end=0.5, dt=DT):
    state = np.zeros(9)
    state[0:2] = -0.1, -0.2
    trace = [state.copy()]
    for k in range(round(end / dt)):
        t = k * dt
        swing_update(state, *target(t), t, duration(t), dt, APEX, DESCENT)
        trace.append(state.copy())
    return np.array(trace)


def test_arrives_at_the_target_at_rest_and_at_the_floor_on_time():
    end = fly()[-1]
    assert end[0:2] == pytest.approx([0.3, 0.2], abs=1e-3)
    assert end[3:5] == pytest.approx([0.0, 0.0], abs=0.01)
    assert end[2] == pytest.approx(0.0, abs=1e-3)
    assert end[5] == pytest.approx(-0.1, abs=0.02)


def test_rises_to_the_apex_in_mid_step():
    trace = fly()
    assert trace[:, 2].max() == pytest.approx(APEX, abs=2e-3)
    assert 0.15 < trace[:, 2].argmax() * DT < 0.3
    assert trace[:, 2].min() > -1e-3


def test_regenerating_with_the_same_target_follows_one_curve():
    fine, coarse = fly(dt=0.001)[::10], fly(dt=0.01)
    horizontal = [0, 1, 3, 4, 6, 7]
    assert fine[:44, horizontal] == pytest.approx(coarse[:44, horizontal], abs=1e-6)
    assert fine[:19] == pytest.approx(coarse[:19], abs=1e-6)  # upwards, until close to the apex


def moving(t):
    return (0.3, 0.2) if t < 0.2 else (0.45, 0.1)


@pytest.mark.parametrize("duration", [lambda t: 0.5, lambda t: 0.5 if t < 0.25 else 0.42])
def test_position_velocity_and_acceleration_stay_continuous(duration):
    """Steps of each derivative shrink with dt: what remains is bounded by the next derivative times dt."""
    trace = fly(duration, moving, 0.55)
    for level in range(2):
        values, rates = trace[:, 3 * level : 3 * level + 3], trace[:, 3 * level + 3 : 3 * level + 6]
        mean_rate = 0.5 * (rates[1:] + rates[:-1])
        scale = np.abs(rates).max()
        assert np.abs(np.diff(values, axis=0) - mean_rate * DT).max() < 0.05 * scale * DT + 1e-6
    steps = [np.abs(np.diff(fly(duration, moving, 0.55, dt)[:, 6:], axis=0)).max() for dt in (0.002, 0.0005)]
    assert steps[1] < 0.5 * steps[0]


def test_late_foot_descends_at_constant_speed():
    trace = fly(lambda t: 0.5, end=0.7)
    assert trace[-1, 5] == pytest.approx(-DESCENT, rel=1e-3)
    assert trace[-1, 8] == pytest.approx(0.0, abs=0.05)


def test_batch_gives_the_bits_of_single_feet():
    rng = np.random.default_rng(0)
    states, targets = rng.normal(0, 0.1, (5, 9)), rng.normal(0, 0.2, (5, 2))
    elapsed, duration = rng.uniform(0, 0.4, 5), rng.uniform(0.3, 0.6, 5)
    single = states.copy()
    swing_update_batch(states, targets, elapsed, duration, DT, APEX, DESCENT)
    for i in range(5):
        swing_update(single[i], *targets[i], elapsed[i], duration[i], DT, APEX, DESCENT)
    assert np.array_equal(single, states)


def test_batch_refuses_wrong_shapes():
    with pytest.raises(InvalidValueError, match="states"):
        swing_update_batch(np.zeros((2, 9)), np.zeros((3, 2)), np.zeros(2), np.ones(2), DT)


def test_a_foot_with_too_little_time_comes_down_at_two_metres_a_second_and_is_late():
    """From 8 cm, 20 ms before T: a quintic would peak at 1.875 x 0.08 / 0.02 = 7.5 m/s."""
    state, dt = np.zeros(9), 0.001
    state[2], heights, speeds = 0.08, [0.08], [0.0]
    for i in range(200):
        swing_update(state, 0.0, 0.0, 0.38 + i * dt, 0.4, dt, 0.06, 0.3)
        heights.append(state[2])
        speeds.append(state[5])
    assert -2.0 < min(speeds) < -0.5
    assert heights[20] > 0.04  # it is late
    # the height is the integral of the speed all the way, also where the foot is late
    np.testing.assert_allclose(np.diff(heights), 0.5 * dt * (np.array(speeds[1:]) + speeds[:-1]), atol=2e-6)
    assert speeds[-1] == pytest.approx(-0.3, abs=1e-6)


@pytest.mark.parametrize("duration", [0.4, 0.6])
def test_the_foot_is_highest_at_45_percent_of_the_step(duration):
    heights = fly(duration=lambda t: duration, end=duration)[:, 2]
    assert heights.argmax() * DT == pytest.approx(0.45 * duration, abs=1.5 * DT)
    assert heights.max() == pytest.approx(APEX, rel=0.01)
