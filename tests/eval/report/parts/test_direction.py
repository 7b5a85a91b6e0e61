"""Where a push stands on the map."""

import math

import pytest
from push_recovery.envs.scenario.push import GaitEvent, Push, polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.record.words import sector_of
from push_recovery.eval.report.pushes import MappedPush, direction_figure, mapped_pushes, stance_direction
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.score.frontier import limit_share


def event(side):
    return GaitEvent(4, side)


def test_pushes_on_a_right_stance_are_mirrored():
    assert stance_direction(polar_push(100.0, 0.7, 0.1, event("left"))) == pytest.approx(0.7)
    assert stance_direction(polar_push(100.0, 0.7, 0.1, event("right"))) == pytest.approx(-0.7)


def test_a_sector_is_the_nearest_of_eight_directions():
    degrees = {0.0: 0, 22.0: 0, 23.0: 1, 90.0: 2, 179.0: 4, -179.0: 4, -90.0: 6, -23.0: 7, -22.0: 0}
    assert {psi: sector_of(psi) for psi in degrees} == degrees


def test_only_single_pushes_with_a_limit_are_mapped():
    push, late = polar_push(80.0, 1.0, 0.1, event("right")), Push((50.0, 0.0, 0.0), 0.1, 2.0)
    scenarios = [Scenario("one", (push,)), Scenario("two", (push, push)), Scenario("none", ()),
                 Scenario("timed", (late,))]  # fmt: skip
    env = make_env("PushRecovery/Pendulum-v0")
    (found,) = mapped_pushes(env, scenarios)
    share = limit_share(env, push, scenarios[0].command)
    env.close()
    assert found == MappedPush("one", pytest.approx(-1.0), share)


def test_the_rim_counts_what_each_sector_recovers():
    pushes = [MappedPush("a", 0.1, 0.4), MappedPush("b", -0.2, 0.9), MappedPush("c", math.pi / 2, 1.4)]
    rows = {name: {"recovered": ok, "survived": ok} for name, ok in (("a", True), ("b", False), ("c", True))}
    drawn = direction_figure("p", pushes, rows)
    for text in ("1/2", "forward", "1/1", "stance", "swing", "0/0", "F*"):
        assert f">{text}</text>" in drawn
