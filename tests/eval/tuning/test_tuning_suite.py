import math

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.eval.score.suites import hard_suite, standard_suite
from push_recovery.eval.tuning.suite import HELD_OUT, MOST, SHARE, TUNING, tuning_suite

SUITES = {
    "standard": standard_suite(),
    "hard": hard_suite(),
    **{name: tuning_suite(name, MOST) for name in (TUNING, HELD_OUT)},
}


@pytest.mark.parametrize(
    ("a", "b"),
    [
        *((tuned, scored) for tuned in (TUNING, HELD_OUT) for scored in ("standard", "hard")),
        (TUNING, HELD_OUT),
    ],
)
def test_suites_are_disjoint(a, b):
    """No scenario of one is in the other, whatever its name: ids, pushes and noise differ."""
    for part in (lambda s: s.id, lambda s: s.pushes, lambda s: s.noise_seed):
        first, second = ({part(s) for s in SUITES[name].scenarios} for name in (a, b))
        assert len(first) == len(SUITES[a].scenarios)
        assert not first & second


def test_forces_are_shares_of_the_limit_spread_evenly():
    for name in (TUNING, HELD_OUT):
        shares, directions = [], []
        for scenario in SUITES[name].scenarios[:256]:
            (push,) = scenario.pushes
            psi = push.direction if push.start.side == "left" else -push.direction
            shares.append(math.hypot(*push.force) / max_recoverable_force(RobotModel(), psi))
            directions.append(push.direction)
        for values, (low, high) in ((shares, SHARE), (directions, (-math.pi, math.pi))):
            cells = np.floor((np.array(values) - low) / (high - low) * 16 + 1e-9)
            assert np.bincount(cells.astype(int), minlength=16).tolist() == [16] * 16


def test_fewer_scenarios_are_the_first_ones():
    assert tuning_suite(TUNING, 32).scenarios == SUITES[TUNING].scenarios[:32]


def test_content_is_fixed():
    hashes = [SUITES[name].sha256[:12] for name in (TUNING, HELD_OUT)]
    assert hashes == ["1bde50da0ed5", "5e4511fe9a59"]


def test_errors_spoil_every_second_robot_and_half_of_them_with_less_mass():
    errors = ModelErrors(mass=0.1, delay=0.01)
    plain, spoilt = tuning_suite(TUNING, 16), tuning_suite(TUNING, 16, errors)
    assert spoilt.name == "tuning-half-mass-delay"
    assert [s.errors.mass for s in spoilt.scenarios[:4]] == [0.0, 0.1, 0.0, -0.1]
    assert [s.errors.delay for s in spoilt.scenarios[:4]] == [0.0, 0.01, 0.0, 0.01]
    assert [s.pushes for s in spoilt.scenarios] == [s.pushes for s in plain.scenarios]
