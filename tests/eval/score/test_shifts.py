"""Each shift changes one thing of a push like those of `hard`, by values worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.score.draw import (
    SHIFTS,
    another_floor,
    another_robot,
    elsewhere,
    longer_or_shorter,
    repeated,
    shifted_scenarios,
)
from push_recovery.eval.score.suites import get_suite

PUSH = Push((600.0, -800.0, 0.0), 0.1, GaitEvent(4, "right", 0.25))  # 100 N s
BASE = Scenario("base", (PUSH,), Command(0.2), "left", noise_seed=3)
MOST = 1.0 - 1e-9


def one(scenario: Scenario) -> Push:
    (push,) = scenario.pushes
    return push


@pytest.mark.parametrize("kind", SHIFTS)
def test_nothing_else_changes(kind):
    """Command, stance, times and noise are those that the same point has in `hard`'s way of drawing."""
    found = shifted_scenarios(kind, "s", 1, 9)
    assert [s.id for s in found[:2]] == ["s-0000", "s-0001"]
    assert len({s.pushes + (s.errors,) for s in found}) == len(found) == 256
    assert found == shifted_scenarios(kind, "s", 1, 9)
    assert found != shifted_scenarios(kind, "s", 1, 10)
    assert get_suite(kind).scenarios[:1] == shifted_scenarios(kind, kind, 1, SHIFTS[kind].seed)[:1]
    for scenario in found:
        assert scenario.pushes[0].start.step == 4 or kind == "shift-repeated"
        assert scenario.settle_time == 4.0
        assert (kind in {"shift-model", "shift-floor"}) == (scenario.errors != EXACT_MODEL)
        if kind != "shift-duration":
            assert {push.duration for push in scenario.pushes} == {0.1}
        if kind != "shift-body":
            assert {(push.body, push.offset) for push in scenario.pushes} == {("pelvis", (0.0, 0.0, 0.0))}
        if kind != "shift-repeated":
            assert len(scenario.pushes) == 1
    impulse = [s.pushes[0].impulse_magnitude for s in found]
    least, most = {"shift-magnitude": (210, 250), "shift-body": (48, 200), "shift-repeated": (44, 110)}.get(
        kind, (80, 200)
    )
    assert least - 0.01 <= min(impulse) < least + 2.0
    assert most - 2.0 < max(impulse) <= most + 0.01


@pytest.mark.parametrize(("u", "duration"), [(0.0, 0.02), (0.5, 0.1), (MOST, 0.5)])
def test_another_duration_has_the_same_impulse(u, duration):
    found = longer_or_shorter(BASE, [u])
    assert one(found).duration == pytest.approx(duration, abs=1e-4)
    assert one(found).impulse == pytest.approx((60.0, -80.0, 0.0), abs=1e-3)
    assert replace(found, pushes=BASE.pushes) == BASE


def test_another_place_on_either_body():
    trunk = one(elsewhere(BASE, [0.49, 0.0, 0.5, MOST]))
    assert (trunk.body, trunk.offset) == ("trunk", (-0.10, 0.0, 0.25))
    assert trunk.force == pytest.approx((360.0, -480.0, 0.0))
    pelvis = one(elsewhere(BASE, [0.5, MOST, 0.0, 0.5]))
    assert (pelvis.body, pelvis.offset, pelvis.force) == ("pelvis", (0.08, -0.10, 0.0), PUSH.force)


def test_another_robot():
    assert another_robot(BASE, [0.0] * 9).errors == ModelErrors(mass=-0.15, trunk_com=(-0.03, -0.03, -0.03))
    most = another_robot(BASE, [MOST] * 9).errors
    assert most == ModelErrors(
        mass=0.15, payload=8.0, trunk_com=(0.03, 0.03, 0.03), joint_friction=1.5, armature=0.04, delay=0.008,
        dcm_noise=0.004,
    )  # fmt: skip
    half = another_robot(BASE, [0.5] * 9).errors
    assert half == ModelErrors(payload=4.0, joint_friction=0.75, armature=0.02, delay=0.004, dcm_noise=0.002)
    assert another_robot(BASE, [0.5] * 9).pushes == BASE.pushes


def test_another_floor():
    assert another_floor(BASE, [0.0, 0.5, 0.0]).errors == ModelErrors(friction=0.45)
    uphill = another_floor(BASE, [0.5, MOST, 0.25]).errors  # a quarter turn: to the left
    assert uphill == ModelErrors(slope_left=0.07)
    back = another_floor(BASE, [0.5, 0.0, 0.5]).errors
    assert back == ModelErrors(slope_forward=-0.02)
    assert another_floor(BASE, [0.9, 0.0, 0.0]).errors == ModelErrors(floor_step=0.005)
    kinds = [set(s.errors.names) for s in shifted_scenarios("shift-floor", "s", 1, 2)]
    counts = [sum(bool(names & wanted) for names in kinds)
              for wanted in ({"friction"}, {"slope_forward", "slope_left"}, {"floor_step"})]  # fmt: skip
    assert sum(counts) == 256
    assert all(abs(count - 256 / 3) <= 2 for count in counts)


def test_repeated_pushes_turn_and_alternate():
    """Step 0 stands on the left, so the first step from 4 on that stands on the right is 5."""
    found = repeated(BASE, [0.5, 0.0, 0.25]).pushes  # 2 + int(0.5 x 4) = 4, each a quarter turn further
    assert [push.start for push in found] == [
        GaitEvent(5, "right", 0.25), GaitEvent(6, "left", 0.25), GaitEvent(7, "right", 0.25),
        GaitEvent(8, "left", 0.25),
    ]  # fmt: skip
    quarter = [(330.0, -440.0), (440.0, 330.0), (-330.0, 440.0), (-440.0, -330.0)]
    assert np.array([push.force[:2] for push in found]) == pytest.approx(np.array(quarter), abs=2e-3)
    wide = repeated(BASE, [MOST, MOST, 0.0]).pushes
    assert [push.start.step_index("left") for push in wide] == [5, 8, 11, 14, 17]
    assert [push.direction for push in wide] == pytest.approx([math.atan2(-0.8, 0.6)] * 5, abs=1e-5)
    assert len(repeated(BASE, [0.0, 0.0, 0.0]).pushes) == 2
