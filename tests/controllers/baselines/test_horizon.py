"""The prediction against the motion itself: cubics pieced together, feet added up."""

import numpy as np
import pytest
from push_recovery.controllers.policies.linear_mpc import (
    ACCELERATION,
    COLUMNS,
    FOOT,
    JERK,
    NODES,
    POSITION,
    RATE,
    SAMPLES,
    STEPS,
    predict,
)

OMEGA, REMAINING, PERIOD = 3.5, 0.13, 0.4


def motion(values):
    """CoP less foot, CoM velocity and time of every node, from x, x', x'' and x''' in metres and seconds."""
    x, speed, time, foot = values[POSITION], OMEGA * values[RATE], 0.0, 0.0
    nodes = []
    for step in range(STEPS):
        acceleration = OMEGA**2 * values[ACCELERATION + step]
        foot += values[FOOT + step - 1] if step else 0.0
        nodes.append((x - acceleration / OMEGA**2 - foot, speed, time))
        for interval in range(SAMPLES):
            d = (REMAINING, PERIOD, PERIOD)[step] / SAMPLES
            jerk = OMEGA**3 * values[JERK + step * SAMPLES + interval]
            path = np.poly1d([jerk / 6.0, acceleration / 2.0, speed, x])
            x, speed, acceleration = (np.polyval(np.polyder(path, m), d) for m in range(3))
            time += d
            nodes.append((x - acceleration / OMEGA**2 - foot, speed, time))
    return np.array(nodes)


@pytest.fixture
def predicted():
    cop, rate, spans = np.empty((NODES, COLUMNS)), np.empty((NODES, COLUMNS)), np.empty(NODES)
    predict(REMAINING, PERIOD, OMEGA, cop, rate, spans)
    return cop, rate, spans


def test_nodes_are_those_of_the_motion(predicted):
    cop, rate, _ = predicted
    rng = np.random.default_rng(4)
    for _ in range(5):
        values = rng.normal(size=COLUMNS)
        nodes = motion(values)
        np.testing.assert_allclose(cop @ values, nodes[:, 0], atol=1e-10)
        np.testing.assert_allclose(OMEGA * (rate @ values), nodes[:, 1], atol=1e-10)


def test_spans_integrate_by_the_trapezoid_rule(predicted):
    *_, spans = predicted
    time = motion(np.zeros(COLUMNS))[:, 2]
    assert spans.sum() == pytest.approx(REMAINING + 2.0 * PERIOD, abs=1e-12)
    for values in (time, time**2):
        assert spans @ values == pytest.approx(np.trapezoid(values, time), abs=1e-12)
