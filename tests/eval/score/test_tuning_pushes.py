import hashlib
import math
from itertools import combinations

import numpy as np
import pytest
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, PLAIN_PHYSICS, ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.scenario import HARDWARE
from push_recovery.eval.score.report import groups_of
from push_recovery.eval.score.suites import get_suite
from push_recovery.eval.tuning.pushes import MOST, SEEDS, SHARE, TUNING, VARIED, held_out_of, tuning_suite

HELD_OUT = held_out_of(TUNING)
SCORED = ("standard", "hard", "varied", "varied-sealed")
SUITES = {
    **{name: get_suite(name) for name in SCORED},
    **{name: tuning_suite(name, MOST) for name in SEEDS},
}


@pytest.mark.parametrize(
    ("a", "b"),
    [
        *((tuned, scored) for tuned in SEEDS for scored in SCORED),
        *combinations(SEEDS, 2),
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


def test_half_the_robots_are_of_the_profile_hardware_and_a_quarter_in_finer_physics_with_every_kind_of_push():
    finer = PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0, contact_time=0.004)
    for name in (VARIED, held_out_of(VARIED)):
        scenarios = SUITES[name].scenarios
        exact, fine, real = scenarios[::4], scenarios[2::4], scenarios[1::2]
        assert {s.errors for s in (*exact, *fine)} == {EXACT_MODEL}
        assert {s.physics for s in exact} == {PLAIN_PHYSICS}
        assert {s.physics for s in fine} == {finer}
        assert all(HARDWARE.applied(s) == s for s in real)
        for part in (exact, fine, real):
            sizes = {group: len(ids) for group, ids in groups_of(part).items()}
            for group, share in (("single", 8), ("double", 4), ("repeated", 4), ("trunk", 8), ("turning", 4)):
                bound = 1.1 / len(part) ** 0.5  # 0.05 of half the robots, 0.07 of a quarter: two deviations
                assert sizes[group] / len(part) == pytest.approx(share / 16, abs=bound), (name, group)


def test_pushes_of_every_kind_are_fixed():
    """The profile may change, the pushes may not."""
    found = []
    for name in (VARIED, held_out_of(VARIED)):
        drawn = [repr((s.pushes, s.command, s.noise_seed)) for s in SUITES[name].scenarios]
        found.append(hashlib.sha256("\n".join(drawn).encode()).hexdigest()[:12])
    assert found == ["cb6461f7f840", "8ffecf6c93aa"]
