"""Disturbances that laboratories use: to JSON and back, mirrored, scaled, and what is refused in one line."""

import json
import math
from dataclasses import replace

import pytest
from push_recovery.controllers.errors import PushRecoveryError
from push_recovery.controllers.model.robot import Similarity
from push_recovery.envs.scenario.disturbances import (
    Impactor,
    Payload,
    Platform,
    Slip,
    SteadyForce,
    TiltingPlatform,
    Trip,
    WaistPull,
    WeightPull,
)
from push_recovery.envs.scenario.push import (
    Coupling,
    FloorShift,
    FloorTilt,
    GaitEvent,
    Grip,
    Push,
    Ramp,
    read_disturbance,
)
from push_recovery.envs.scenario.scenario import Scenario

EVENT = GaitEvent(4, "left", 0.3)
KINDS = (
    Impactor(10.0, 3.0, 1.0, 0.5, offset=(0.0, 0.1, 0.2)),
    WeightPull(8.0, EVENT, 0.5, -1.0, drop=0.1),
    WaistPull(0.15, 0.3, 1.0, 1.0),
    SteadyForce(60.0, 1.0, 2.0, 2.0),
    Slip("left", 0.05, EVENT, 0.4),
    Trip(EVENT),
    Payload(5.0, 0.5, 1.0, offset=(0.2, 0.1, 0.0)),
    Platform(0.1, 0.3, 1.0, -0.5),
    TiltingPlatform(0.1, 0.3, 1.0, -0.5, hold=0.4),
)
ALL = Scenario("all", disturbances=KINDS)
MOTORS = {"waist pull", "platform", "tilting platform"}  # kinds that go no faster than they are told


def test_they_are_read_from_json_and_written_again():
    assert Scenario.from_json(ALL.to_json()) == ALL
    kinds = [part["kind"] for part in json.loads(ALL.to_json())["disturbances"]]
    assert kinds == [
        "impactor",
        "weight pull",
        "waist pull",
        "steady force",
        "slip",
        "trip",
        "payload",
        "platform",
        "tilting platform",
    ]
    short = {
        "kind": "impactor",
        "mass": 10,
        "speed": 3,
        "start": {"step": 4, "side": "left", "fraction": 0.3},
    }
    assert read_disturbance(short) == Impactor(10.0, 3.0, EVENT)


def test_pushes_that_follow_laws_are_read_and_written_too():
    """As a robot of all joints has them, whose gait events are times."""
    pushes = Scenario("all", ALL.forces)
    assert Scenario.from_json(pushes.to_json()) == pushes
    assert "law" not in Push((1.0, 0.0, 0.0), 0.1, 0.0).to_dict()  # hashes of suites without stay
    assert Push((1.0, 0.0, 0.0), 0.1, 0.0, law=Ramp(0.05)).to_dict()["law"] == {"kind": "ramp", "rise": 0.05}


@pytest.mark.parametrize("part", KINDS, ids=lambda part: part.json_name)
def test_its_pushes_are_mirrored_and_scaled_as_it_is(part):
    assert part.mirrored().mirrored() == part
    mirrored = tuple(push.mirrored() for push in part.forces)
    assert [push.body for push in part.mirrored().forces] == [push.body for push in mirrored]
    for one, other in zip(part.mirrored().forces, mirrored, strict=True):
        assert one.force == pytest.approx(other.force, abs=1e-12)
        assert replace(one, force=other.force) == other
    scale = Similarity(mass=0.5, length=0.64)
    for one, other in zip(part.scaled(scale).forces, part.forces, strict=True):
        sized = other.scaled(scale)
        assert one.force == pytest.approx(sized.force)
        assert (one.duration, *one.offset) == pytest.approx((sized.duration, *sized.offset))
        assert one.start == (EVENT if other.start == EVENT else pytest.approx(sized.start))
        assert set(one.law.to_dict()) == set(sized.law.to_dict())
        for name, value in one.law.to_dict().items():
            if name != "fastest" or part.json_name in {
                "waist pull",
                "platform",
                "tilting platform",
            }:  # of no motor it is none's
                expected = sized.law.to_dict().get(name)
                assert value == (pytest.approx(expected) if isinstance(value, float) else expected), name


def test_a_robot_of_another_size_meets_the_same_ratios():
    """Half the mass, 0.64 of the height: velocities and times times 0.8, forces times 0.5."""
    scale = Similarity(mass=0.5, length=0.64)
    hit = KINDS[0].scaled(scale)
    assert (hit.mass, hit.speed, hit.start) == pytest.approx((5.0, 2.4, 0.8))
    assert hit.offset == pytest.approx((0.0, 0.064, 0.128))
    assert hit.contact_time == pytest.approx(0.8 * KINDS[0].contact_time)
    assert hit.momentum == pytest.approx(scale.impulse * KINDS[0].momentum)
    assert KINDS[5].scaled(scale).start == EVENT
    assert KINDS[4].scaled(scale).friction == 0.05
    tilts = KINDS[8].scaled(scale)
    assert (tilts.angle, tilts.fastest, tilts.acceleration) == pytest.approx((0.1, 0.3 / 0.8, 10.0 / 0.64))
    assert tilts.forces[0].duration == pytest.approx(0.8 * (2.0 * (0.1 / 0.3 + 0.3 / 10.0) + 0.4))


def test_impulses_by_which_they_are_reported():
    assert math.hypot(*KINDS[0].impulse) == pytest.approx(30.0)  # m v
    assert math.hypot(*KINDS[1].impulse) == pytest.approx(8.0 * 9.81 * 0.5)
    assert math.hypot(*KINDS[3].impulse) == pytest.approx(60.0 * 1.8)
    assert KINDS[4].impulse == KINDS[7].impulse == KINDS[8].impulse == (0.0, 0.0, 0.0)
    assert KINDS[6].impulse == pytest.approx((0.0, 0.0, -5.0 * math.sqrt(2.0 * 9.81 * 0.5)))


BAD = [
    (lambda: Payload(0.5, 0.5, 1.0, stiffness=4e4),
     r"Payload.stiffness \[N/m\] must be at most 31250 with 0.5 kg"),
    (lambda: Impactor(0.0, 3.0, 1.0), r"Impactor.mass \[kg\] must be in \[0.1, 1000\], got 0"),
    (lambda: Impactor(math.nan, 3.0, 1.0), r"Impactor.mass \[kg\] must be finite, got nan"),
    (lambda: Impactor("heavy", 3.0, 1.0), r"Impactor.mass \[kg\] must be a number, got 'heavy'"),
    (lambda: Impactor(10.0, -1.0, 1.0), r"Impactor.speed \[m/s\] must be in \[0.01, 20\], got -1"),
    (lambda: Impactor(10.0, None, 1.0), r"Impactor.speed \[m/s\] must be a number, got None"),
    (lambda: Impactor(10.0, 3.0, -1.0), r"Impactor.start \[s\] must be in \[0, 1e\+06\], got -1"),
    (lambda: Impactor(10.0, 3.0, 1.0, math.inf), r"Impactor.direction \[rad\] must be finite"),
    (lambda: Impactor(10.0, 3.0, 1.0, body="head"), r"push body 'head'.*pelvis, trunk"),
    (lambda: Impactor(10.0, 3.0, 1.0, offset=(1.0, 2.0)), r"Impactor.offset \[m\] must have 3 entries"),
    (lambda: Impactor(10.0, 3.0, 1.0, restitution=1.0),
     r"Impactor.restitution must be in \[0.3, 0.9\], got 1"),
    (lambda: Impactor(0.5, 3.0, 1.0, stiffness=2e4),
     r"Impactor.stiffness \[N/m\] must be at most 7812.5 with 0.5 kg"),
    (lambda: Impactor.pendulum(4.0, 1.0, 1.2, 1.0),
     r"pendulum's distance \[m\] must be in \(0, 1\], got 1.2"),
    (lambda: Impactor.pendulum(4.0, 0.0, 0.2, 1.0),
     r"pendulum's length \[m\] must be in \[0.01, 100\], got 0"),
    (lambda: WeightPull(8.0, 1.0, 0.0), r"WeightPull.duration \[s\] must be in \[0.002, 3600\], got 0"),
    (lambda: WeightPull(8.0, 1.0, 1.0, drop=-0.1), r"WeightPull.drop \[m\] must be in \[0, 2\], got -0.1"),
    (lambda: WeightPull(8.0, 1.0, 1.0, reach=0.1),
     r"WeightPull.reach \[m\] must be in \[0.5, 100\], got 0.1"),
    (lambda: WeightPull(0.1, 1.0, 1.0, stiffness=1e5), r"WeightPull.stiffness \[N/m\] must be at most 6250"),
    (lambda: Impactor.pendulum(4.0, 1.0, 0.2, 1.0, speed=3.0),
     r"^unknown Impactor.pendulum key 'speed' \(valid: body, direction, offset, restitution, stiffness\)$"),
    (lambda: WaistPull(2.0, 0.001, 0.5, hold=3600.0),
     r"^WaistPull.hold \[s\] must be at most 1600 with 2000 s of motion, since disturbances end after "
     r"3600 s, got 3600$"),
    (lambda: TiltingPlatform(0.5, 0.001, 0.5, hold=3600.0),
     r"^TiltingPlatform.hold \[s\] must be at most 2600 with 1000 s of motion, since disturbances end after "
     r"3600 s, got 3600$"),
    (lambda: Impactor(10.0, 3.0, 1e300), r"^Impactor.start \[s\] must be in \[0, 1e\+06\], got 1e\+300$"),
    (lambda: WaistPull(0.0, 0.3, 1.0), r"WaistPull.travel \[m\] must be in \[0.001, 2\], got 0"),
    (lambda: WaistPull(0.1, 0.0, 1.0), r"WaistPull.fastest \[m/s\] must be in \[0.001, 10\], got 0"),
    (lambda: WaistPull(0.1, 0.3, 1.0, hold=-1.0), r"WaistPull.hold \[s\] must be in \[0, 3600\], got -1"),
    (lambda: SteadyForce(-5.0, 1.0, 2.0), r"SteadyForce.force \[N\] must be in \[0, 1e\+07\], got -5"),
    (lambda: SteadyForce(5.0, 1.0, 0.3),
     r"SteadyForce.duration \[s\] must be at least twice its rise of 0.2, got 0.3"),
    (lambda: Slip("middle", 0.1, 1.0, 0.3), r"side 'middle'.*left, right"),
    (lambda: Slip("left", 0.0, 1.0, 0.3), r"Slip.friction must be in \[0.01, 2\], got 0"),
    (lambda: Trip(1.0), r"Trip.start must be a GaitEvent, got 1.0"),
    (lambda: Trip(EVENT, height=0.0), r"Trip.height \[m\] must be in \[0.001, 1\], got 0"),
    (lambda: Trip(EVENT, force=0.0), r"Trip.force \[N\] must be in \[1, 10000\], got 0"),
    (lambda: Payload(-2.0, 0.5, 1.0), r"Payload.mass \[kg\] must be in \[0.1, 100\], got -2"),
    (lambda: Payload(2.0, 9.0, 1.0), r"Payload.height \[m\] must be in \[0, 5\], got 9"),
    (lambda: Platform(0.1, 0.3, 1.0, acceleration=0.0),
     r"Platform.acceleration \[m/s\^2\] must be in \[0.01, 100\]"),
    (lambda: Platform(3.0, 0.3, 1.0), r"Platform.travel \[m\] must be in \[0.001, 2\], got 3"),
    (lambda: TiltingPlatform(0.6, 0.3, 1.0),
     r"TiltingPlatform.angle \[rad\] must be in \[0.001, 0.5\], got 0.6"),
    (lambda: TiltingPlatform(0.1, 0.0, 1.0),
     r"TiltingPlatform.fastest \[rad/s\] must be in \[0.001, 10\], got 0"),
    (lambda: TiltingPlatform(0.1, 0.3, 1.0, hold=-1.0),
     r"TiltingPlatform.hold \[s\] must be in \[0, 3600\], got -1"),
    (lambda: FloorTilt(0.0, 2.0, 1.0, 1.0, 1.0), r"FloorTilt.angle \[rad\] must be in \[0, 1\], got 2"),
    (lambda: read_disturbance({"kind": "impact"}), r"kind of disturbance 'impact'.*impactor.*platform"),
    (lambda: read_disturbance({"kind": "slip", "side": "left"}), r"slip lacks duration, friction, start"),
    (lambda: read_disturbance({"kind": "payload", "mass": 1, "height": 1, "start": 1, "color": 1}),
     r"payload key 'color'"),
    (lambda: read_disturbance({"kind": "trip", "start": {"step": -1, "side": "left"}}),
     r"GaitEvent.step must be"),
    (lambda: Push((0.0, 0.0, 0.0), 0.1, 0.0, law=Coupling(1e3)), r"Push.force \[N\] must not be zero"),
    (lambda: Push((1.0, 0.0, 0.0), 0.1, 0.0, law=Coupling(1e3, at_toe=True)),
     r"body with a toe 'pelvis'.*left_foot"),
    (lambda: Push((1.0, 0.0, 0.0), 0.1, 0.0, law=Coupling(1e3, bound=1)),
     r"Coupling.bound must be a bool, got 1"),
    (lambda: Push((0.0, 0.0, 0.0), 0.1, 0.0, law=Grip(0.1)), r"body with a sole 'pelvis'.*right_foot"),
    (lambda: Push((1.0, 0.0, 0.0), 0.1, 0.0, law=Ramp(0.06)),
     r"Push.duration \[s\] must be at least twice the rise"),
    (lambda: Push((1.0, 0.0, 0.0), 0.1, 0.0, law=0.3), r"Push.law must be a Law, got 0.3"),
    (lambda: FloorShift(0.0, -0.1, 1.0, 1.0), r"FloorShift.travel \[m\] must be in \[0, 10\], got -0.1"),
    (lambda: Push.from_json('{"force": [1,0,0], "duration": 1, "start": 0, "law": {}}'),
     r"law of a push lacks kind"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), BAD, ids=range(len(BAD)))
def test_what_is_impossible_is_refused_in_one_line(make, words):
    with pytest.raises(PushRecoveryError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_force_without_a_plateau_is_a_triangle():
    """60 N after 0.2 s, none after 0.4 s."""
    assert SteadyForce(60.0, 0.0, 0.4, rise=0.2).impulse == pytest.approx((12.0, 0.0, 0.0))
