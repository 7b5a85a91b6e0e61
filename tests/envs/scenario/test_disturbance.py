"""Kinds of disturbances from outside the package: loaded from JSON, and felt as what they are made of."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.controllers.model.robot import Similarity
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.scenario.push import (
    Disturbance,
    GaitEvent,
    Kick,
    Push,
    read_disturbance,
    register_disturbance,
)
from push_recovery.envs.scenario.scenario import Scenario


@register_disturbance
@dataclass(frozen=True)
class DoubleTap(Disturbance):
    """The same push twice, the second one a pause after the first has ended."""

    json_name = "double tap"

    force: tuple[float, float, float]  # [N]
    duration: float  # of each [s]
    start: float  # [s]
    pause: float = 0.1  # [s]

    @property
    def forces(self):
        again = self.start + self.duration + self.pause
        return tuple(Push(self.force, self.duration, start) for start in (self.start, again))

    def mirrored(self):
        return replace(self, force=self.forces[0].mirrored().force)

    def scaled(self, scale):
        first = self.forces[0].scaled(scale)
        return DoubleTap(first.force, first.duration, first.start, self.pause * scale.time)


@register_disturbance
@dataclass(frozen=True)
class Collision(Disturbance):
    """A jump of the velocity, and a push that stays."""

    json_name = "collision"

    velocity: tuple[float, float, float]  # [m/s]
    force: tuple[float, float, float]  # [N]
    start: float  # [s]

    @property
    def forces(self):
        return (Push(self.force, 0.2, self.start, "trunk"),)

    @property
    def jumps(self):
        return (Kick(self.velocity, self.start),)

    def mirrored(self):
        return replace(
            self, velocity=self.jumps[0].mirrored().velocity, force=self.forces[0].mirrored().force
        )

    def scaled(self, scale):
        force, jump = self.forces[0].scaled(scale), self.jumps[0].scaled(scale)
        return Collision(jump.velocity, force.force, jump.start)


TAP = DoubleTap((120.0, 200.0, 0.0), 0.05, 0.23)
HIT = Collision((0.1, -0.2, 0.0), (60.0, -50.0, 10.0), 0.31)
TEXT = (
    '{"id":"a","disturbances":[{"kind":"double tap","force":[120,200,0],"duration":0.05,"start":0.23},'
    '{"kind":"collision","velocity":[0.1,-0.2,0],"force":[60,-50,10],"start":0.31}]}'
)


def test_kinds_are_read_from_json_and_written_again():
    scenario = Scenario.from_json(TEXT)
    assert scenario == Scenario("a", disturbances=(TAP, HIT))
    assert hash(scenario) == hash(Scenario("a", disturbances=(TAP, HIT)))
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert json.loads(scenario.to_json())["disturbances"][0] == {
        "kind": "double tap", "force": [120.0, 200.0, 0.0], "duration": 0.05, "start": 0.23, "pause": 0.1
    }  # fmt: skip
    assert "disturbances" not in json.loads(Scenario("a").to_json())  # hashes of suites without stay
    assert read_disturbance({"kind": "kick", "velocity": [1, 0, 0], "start": 2}) == Kick((1.0, 0.0, 0.0), 2.0)


def test_they_are_mirrored_and_scaled_with_their_scenario():
    scenario = Scenario("a", disturbances=(TAP, HIT))
    mirror = scenario.mirrored()
    assert mirror.forces[1].force == (120.0, -200.0, 0.0)
    assert mirror.jumps == (Kick((0.1, 0.2, 0.0), 0.31),)
    assert mirror.mirrored() == scenario
    scaled = scenario.scaled(Similarity(mass=0.5, length=4.0))
    assert scaled.forces[1] == Push((60.0, 100.0, 0.0), 0.1, 0.23 * 2.0 + 0.1 + 0.2)
    assert scaled.jumps == (Kick((0.2, -0.4, 0.0), 0.62),)


def test_impulse_and_end_follow_from_the_parts():
    assert TAP.impulse == pytest.approx((12.0, 20.0, 0.0))
    assert HIT.impulse == pytest.approx((12.0, -10.0, 2.0))
    assert Kick((1.0, 0.0, 0.0), 0.0).impulse == (0.0, 0.0, 0.0)
    assert Scenario("a", disturbances=(HIT,), settle_time=1.0).end_time(0.0) == 1.31  # the jump's, at least
    push = Push((3.0, 4.0, 0.0), 0.1, GaitEvent(2, "left"))
    assert (push.forces, push.jumps) == ((push,), ())


@pytest.mark.parametrize("robots", [BipedEpisodes, PendulumEpisodes])
def test_a_robot_feels_the_forces_as_pushes_of_their_own(robots):
    """Bit for bit, beside a robot of another scenario, and both have begun twice."""
    first = Push((40.0, 0.0, 0.0), 0.1, GaitEvent(0, "left", 0.2))
    kinds = Scenario("a", (first,), disturbances=(TAP,), settle_time=0.3)
    pushes = Scenario("a", (first, *TAP.forces), settle_time=0.3)
    episodes, action = robots(3), np.zeros((3, 7), np.float32)
    for _ in range(2):
        for k, scenario in enumerate((kinds, Scenario("b"), pushes)):
            episodes.begin(k, scenario)
        seen, ends = [], []
        for _ in range(75):
            ends.append(episodes.step(action).truncated.copy())
            seen.append(episodes.core.truth.copy())
        trace = np.array(seen)
        assert trace[:, 0].tobytes() == trace[:, 2].tobytes()
        assert np.abs(trace[:, 0] - trace[:, 1]).max() > 0.01
        due = TAP.forces[1].start + TAP.duration + 0.3
        assert [int(np.argmax(end)) + 1 for end in np.array(ends).T[[0, 2]]] == 2 * [round(due * 100.0)]
        delivered = episodes.core.pushes.delivered[0, 1:3].sum(axis=0)
        np.testing.assert_allclose(delivered, TAP.impulse, atol=1e-9)


def test_a_robot_feels_the_jumps_as_kicks_and_goes_on_from_a_snapshot():
    kinds = Scenario("a", disturbances=(HIT,), duration=1.0)
    plain = Scenario("a", HIT.forces, kicks=HIT.jumps, duration=1.0)
    traces, action = [], np.zeros(7, np.float32)
    for scenario in (kinds, plain):
        env = BipedEnv()
        env.reset(options={"scenario": scenario})
        seen = [env.step(action)[0] for _ in range(25)]
        snapshot = env.state_snapshot()
        seen += [env.step(action)[0] for _ in range(25)]
        info = env.step(action)[4]
        assert info["push"]["body"] == "trunk"
        env.restore(snapshot)
        again = [env.step(action)[0] for _ in range(25)]
        assert np.array(again).tobytes() == np.array(seen[25:]).tobytes()
        traces.append(np.array(seen))
    assert traces[0].tobytes() == traces[1].tobytes()
    with pytest.raises(InvalidValueError, match="must have its jumps"):
        env.restore(snapshot, replace(plain, kicks=()))


@dataclass(frozen=True)
class Unfinished(Disturbance):
    json_name = "unfinished"


def test_a_robot_without_jumps_refuses_them():
    with pytest.raises(InvalidValueError, match="takes no kicks"):
        PendulumEpisodes(1).begin(0, Scenario("a", disturbances=(HIT,)))


def test_what_is_no_disturbance_is_refused():
    with pytest.raises(UnknownNameError, match=r"kind of disturbance 'tap'.*double tap"):
        Scenario.from_json('{"id": "a", "disturbances": [{"kind": "tap"}]}')
    with pytest.raises(InvalidValueError, match="disturbance lacks kind"):
        Scenario.from_json('{"id": "a", "disturbances": [{}]}')
    with pytest.raises(InvalidValueError, match="disturbance must be an object, got int"):
        read_disturbance(3)
    with pytest.raises(UnknownNameError, match="double tap key 'strength'"):
        read_disturbance({"kind": "double tap", "force": [1, 0, 0], "duration": 1, "start": 0, "strength": 3})
    with pytest.raises(InvalidValueError, match="must hold Disturbance objects, got 1"):
        Scenario("a", disturbances=(1,))  # type: ignore[arg-type]
    for forces, words in ((None, "be a sequence of Push, got None"), ((1,), "hold Push objects, got 1")):
        other = type("Other", (DoubleTap,), {"forces": forces})(**vars(TAP))
        with pytest.raises(InvalidValueError, match=rf"^Other\.forces must {words}$"):
            Scenario("a", disturbances=(other,))
    with pytest.raises(InvalidValueError, match="a class of a disturbance must define mirrored, scaled, got"):
        register_disturbance(Unfinished)
    with pytest.raises(InvalidValueError, match="kind 'push' is registered already"):
        register_disturbance(type("Other", (DoubleTap,), {"json_name": "push"}))
