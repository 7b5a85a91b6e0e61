"""Excerpts of the tour: its own punches, on a robot that is told to walk."""

import hashlib
import math
from importlib.util import find_spec
from itertools import combinations

import numpy as np
import pytest
from push_recovery.controllers.errors import UnknownNameError
from push_recovery.controllers.model.capturability import max_recoverable_force
from push_recovery.controllers.model.robot import RobotModel
from push_recovery.envs.robots.biped import biped
from push_recovery.envs.robots.compiled_robot import compiled_robot
from push_recovery.envs.robots.description import robot_description
from push_recovery.envs.robots.model_files import PACKAGES
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, PLAIN_PHYSICS, ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.scenario import HARDWARE
from push_recovery.eval.cli.sharing import MOST
from push_recovery.eval.protocols.tour import tour_scenario
from push_recovery.eval.score.report import groups_of
from push_recovery.eval.score.suites import get_suite
from push_recovery.eval.tuning import pushes
from push_recovery.eval.tuning.pushes import (
    QUICK,
    SEEDS,
    TUNING,
    VARIED,
    excerpt,
    punched_suite,
    tuning_suite,
)

needs_robots = pytest.mark.skipif(
    any(find_spec(name) is None for name in PACKAGES), reason="needs pip install 'push-recovery[robots]'"
)


@pytest.mark.parametrize("run_id", [0, 3000, 5001])
def test_punches_are_three_of_the_last_half_minute_of_the_run(run_id):
    """At 60, 70 and 80 s of the tour, where its ceiling is all of 500 N."""
    found, whole = excerpt("e", run_id, biped()), tour_scenario(run_id, biped())
    taken = [push for push in whole.pushes if push.start in (60.1, 70.1, 80.1)]
    assert [(p.force, p.body, p.offset, p.duration) for p in found.pushes] == [
        (p.force, p.body, p.offset, p.duration) for p in taken
    ]
    assert len(taken) == 3


def test_punches_come_far_apart_and_there_is_time_after_the_last():
    for run_id in range(40):
        scenario = excerpt("e", run_id, biped())
        for push, earliest in zip(scenario.pushes, (1.0, 3.5, 6.0), strict=True):
            assert earliest <= push.start <= earliest + 0.3
        assert scenario.duration == 9.0
        assert scenario.noise_seed == run_id


def test_robots_turn_in_place_walk_straight_on_or_do_it_all():
    kinds = set()
    for run_id in range(60):
        command = excerpt("e", run_id, biped()).command
        assert -0.25 <= command.vx <= 0.5
        assert abs(command.vy) <= 0.2
        assert abs(command.turn) <= 0.6
        kinds.add((command.vx != 0, command.vy != 0, command.turn != 0))
    assert kinds == {(False, False, True), (True, False, False), (True, True, True)}


@needs_robots
def test_robots_that_exist_meet_forces_as_they_are_at_their_own_speed():
    g1, own = compiled_robot(robot_description("g1")), math.sqrt(0.63 / 0.8)
    for run_id in range(3000, 3010):
        theirs, ours = excerpt("e", run_id, g1), excerpt("e", run_id, biped())
        assert theirs.command.vx == pytest.approx(own * ours.command.vx)
        assert theirs.command.vy == pytest.approx(own * ours.command.vy)
        assert theirs.command.turn == ours.command.turn
        for punch, scaled in zip(theirs.pushes, ours.pushes, strict=True):
            assert scaled.force == pytest.approx([60.0 / 35.112 * part for part in punch.force], abs=2e-3)
            assert 250.0 <= math.hypot(*punch.force) <= 500.0


@needs_robots
def test_suites_of_g1_are_those_that_its_preset_was_found_on():
    g1 = compiled_robot(robot_description("g1"))
    for name, scenarios, sha256 in (
        ("tuning-punches", 192, "8f9ac1dddcec792d2d53dbbf84f2a26360dcd93449c891b7d693bddf8f75ad25"),
        ("tuning-punches-held-out", 256, "b4efd6ad88ff45ae1f8ca338e6eff7cf1281fb099ffcb967f98433ad1122d8a0"),
    ):
        suite = punched_suite(name, scenarios, g1)
        assert (suite.name, suite.sha256) == (f"{name}@g1", sha256)


def test_suites_share_no_run_with_each_other_and_with_the_protocol():
    runs = [
        {scenario.noise_seed for scenario in punched_suite(name, 1024, biped()).scenarios}
        for name in ("tuning-punches", "tuning-punches-held-out")
    ]
    assert not runs[0] & runs[1]
    assert min(runs[0] | runs[1]) >= MOST["tour"]


def test_an_unknown_suite_is_refused():
    message = r"^unknown tuning suite 'tuning'.* \(valid: tuning-punches, tuning-punches-held-out\)$"
    with pytest.raises(UnknownNameError, match=message):
        punched_suite("tuning", 8, biped())


HELD_OUT = pushes.held_out_of(TUNING)
OF_EVERY_KIND = VARIED, pushes.held_out_of(VARIED), QUICK, pushes.held_out_of(QUICK)
SCORED = ("quick", "standard", "hard", "varied", "varied-sealed")
SUITES = {
    **{name: get_suite(name) for name in SCORED},
    **{name: tuning_suite(name, pushes.SUITE_SIZE) for name in SEEDS},
}


@pytest.mark.parametrize(
    ("a", "b"), [*((tuned, scored) for tuned in SEEDS for scored in SCORED), *combinations(SEEDS, 2)]
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
        for values, (low, high) in ((shares, pushes.SHARE), (directions, (-math.pi, math.pi))):
            cells = np.floor((np.array(values) - low) / (high - low) * 16 + 1e-9)
            assert np.bincount(cells.astype(int), minlength=16).tolist() == [16] * 16


def test_content_is_fixed_and_fewer_scenarios_are_the_first_ones():
    assert [SUITES[name].sha256[:12] for name in (TUNING, HELD_OUT)] == ["1bde50da0ed5", "5e4511fe9a59"]
    assert tuning_suite(TUNING, 32).scenarios == SUITES[TUNING].scenarios[:32]


def test_errors_spoil_every_second_robot_and_half_of_them_with_less_mass():
    errors, body = ModelErrors(mass=0.1, delay=0.01), biped()
    for plain, spoilt in (
        (tuning_suite(TUNING, 8), tuning_suite(TUNING, 8, errors)),
        (punched_suite("tuning-punches", 8, body), punched_suite("tuning-punches", 8, body, errors)),
    ):
        assert spoilt.name == f"{plain.name}-half-mass-delay"
        assert [s.errors.mass for s in spoilt.scenarios] == [0.0, 0.1, 0.0, -0.1] * 2
        assert [s.errors.delay for s in spoilt.scenarios] == [0.0, 0.01] * 4
        assert [s.pushes for s in spoilt.scenarios] == [s.pushes for s in plain.scenarios]


def test_half_the_robots_are_of_the_profile_hardware_and_a_quarter_in_finer_physics_with_every_kind_of_push():
    finer = PhysicsOptions(time_step=0.001, cone="elliptic", impratio=10.0, contact_time=0.004)
    for name in OF_EVERY_KIND:
        scenarios = SUITES[name].scenarios
        exact, fine, real = scenarios[::4], scenarios[2::4], scenarios[1::2]
        assert {s.errors for s in (*exact, *fine)} == {EXACT_MODEL}
        assert {s.physics for s in exact} == {PLAIN_PHYSICS}
        assert {s.physics for s in fine} == {finer}
        assert all(HARDWARE.applied(s) == s for s in real)
        for part in (exact, fine, real) if VARIED in name else (scenarios,):
            sizes = {group: len(ids) for group, ids in groups_of(part).items()}
            for group, share in (("single", 8), ("double", 4), ("repeated", 4), ("trunk", 8), ("turning", 4)):
                bound = 1.1 / len(part) ** 0.5  # 0.05 of half the robots, 0.07 of a quarter: two deviations
                assert sizes[group] / len(part) == pytest.approx(share / 16, abs=bound), (name, group)


def test_pushes_of_every_kind_are_fixed():
    """The profile may change, the pushes may not."""
    found = []
    for name in OF_EVERY_KIND:
        drawn = [repr((s.pushes, s.command, s.noise_seed)) for s in SUITES[name].scenarios]
        for new in (", stand=False", ", law=None"):  # which commands and pushes did not have then
            drawn = [text.replace(new, "") for text in drawn]
        found.append(hashlib.sha256("\n".join(drawn).encode()).hexdigest()[:12])
    assert found == ["cb6461f7f840", "8ffecf6c93aa", "c05899a3c84e", "d1e2d9449f63"]
