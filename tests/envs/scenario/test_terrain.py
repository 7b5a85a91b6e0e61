"""Kinds of terrain from outside the package: loaded from JSON, stood on, mirrored and scaled."""

import json
import math
import re
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.robot import Similarity
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEnv, BipedEpisodes
from push_recovery.envs.biped.floor import KnownFloor
from push_recovery.envs.biped.model_errors import altered_model
from push_recovery.envs.pendulum.env import PendulumEpisodes
from push_recovery.envs.robots.biped import PLAN, biped
from push_recovery.envs.scenario.model_errors import ModelErrors
from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import (
    Pattern,
    Slope,
    Stairs,
    Terrain,
    Tiles,
    Wall,
    add_box,
    register_terrain,
)

LARGE = 5.0  # half the size of the floor beside the robot [m]


@register_terrain
@dataclass(frozen=True)
class Stair(Terrain):
    """One step up at x = start."""

    json_name = "stair"

    start: float  # [m]
    rise: float  # [m]

    def shape(self, spec, soles):
        size, place = (LARGE, LARGE, 0.5 * self.rise), (self.start + LARGE, 0.0, 0.5 * self.rise)
        add_box(spec, soles, "stair", size, place)

    def height(self, x, y, pattern):
        return self.rise if x >= self.start else 0.0

    def scaled(self, scale):
        return Stair(scale.length * self.start, scale.length * self.rise)


@register_terrain
@dataclass(frozen=True)
class Kerb(Terrain):
    """The floor is higher from y on, on the left where `rise` is, and rises evenly to that side."""

    json_name = "kerb"

    y: float  # [m]; negative: on the right
    rise: float  # [m]
    slope: float = 0.0  # to the left [rad]

    @property
    def tilt(self):
        return 0.0, self.slope

    def shape(self, spec, soles):
        place = (0.0, self.y + math.copysign(LARGE, self.y), 0.5 * self.rise)
        add_box(spec, soles, "kerb", (LARGE, LARGE, 0.5 * self.rise), place)

    def height(self, x, y, pattern):
        return self.rise if y / self.y >= 1.0 else 0.0

    def mirrored(self):
        return Kerb(-self.y, self.rise, -self.slope)


def on(terrain: Terrain, stance="left", command=0.0, **more) -> Scenario:
    return Scenario(
        "a", (), Command(command), stance, duration=2.0, errors=ModelErrors(terrain=terrain, **more)
    )


def test_a_kind_is_read_from_json_and_written_again():
    text = '{"id":"a","errors":{"terrain":{"kind":"stair","start":0.2,"rise":0.03},"mass":0.1}}'
    scenario = Scenario.from_json(text)
    assert scenario == Scenario("a", errors=ModelErrors(mass=0.1, terrain=Stair(0.2, 0.03)))
    assert hash(scenario.errors) == hash(ModelErrors(mass=0.1, terrain=Stair(0.2, 0.03)))
    assert json.loads(scenario.to_json())["errors"] == json.loads(text)["errors"]
    assert Scenario.from_json(scenario.to_json()) == scenario


def test_the_floor_of_the_fields_is_made_of_terrains_too():
    errors = ModelErrors(slope_forward=0.02, slope_left=-0.03, floor_step=0.01, terrain=Kerb(0.2, 0.01, 0.04))
    assert errors.terrains == (Slope(0.02, -0.03), Tiles(0.01), Kerb(0.2, 0.01, 0.04))
    assert errors.tilt == pytest.approx((0.02, 0.01))
    assert (ModelErrors(mass=0.1).terrains, ModelErrors().tilt) == ((), (0.0, 0.0))


def test_it_is_mirrored_and_scaled_with_its_scenario():
    mirror = on(Kerb(0.2, 0.01, 0.02), slope_left=0.01).mirrored()
    assert mirror.errors == ModelErrors(terrain=Kerb(-0.2, 0.01, -0.02), slope_left=-0.01)
    assert mirror.mirrored() == on(Kerb(0.2, 0.01, 0.02), slope_left=0.01)
    scaled = on(Stair(0.2, 0.03), floor_step=0.01).scaled(Similarity(mass=0.5, length=0.5))
    assert scaled.errors == ModelErrors(terrain=Stair(0.1, 0.015), floor_step=0.005)


def test_the_model_has_its_geoms_and_soles_touch_them_as_the_plane():
    model = altered_model(biped(), ModelErrors(terrain=Stair(0.2, 0.03), friction=0.5))
    assert model is not None
    touched = model.pair_geom1 == model.geom("stair").id
    assert {model.geom(foot).name for foot in model.pair_geom2[touched]} == set(PLAN.sole_boxes)
    np.testing.assert_array_equal(model.pair_friction[touched, :2], 0.5)
    np.testing.assert_array_equal(model.opt.gravity, [0.0, 0.0, -9.81])
    again = altered_model(biped(), ModelErrors(terrain=Stair(0.2, 0.04)))
    assert again is not None
    assert again is not model
    assert again.geom("stair").size[2] == 0.02


@pytest.mark.parametrize("stance", ["left", "right"])
def test_soles_begin_on_it(stance):
    """A kerb on the swing side lifts the swing sole alone; a stair behind the robot lifts both."""
    side = 1.0 if stance == "right" else -1.0
    episodes = BipedEpisodes(3)
    episodes.begin(0, on(Kerb(side * 0.06, 0.02), stance))
    episodes.begin(1, on(Stair(-1.0, 0.02), stance))
    episodes.begin(2, on(Stair(0.05, 0.02), stance))  # under the toes of the stance sole
    for k, expected in enumerate([(0.0, 0.02), (0.02, 0.02), (0.02, 0.02)]):
        model, data = episodes.core.simulations.models[k], episodes.core.simulations.data[k]
        soles = [data.geom_xpos[model.geom(foot).id][2] - 0.015 for foot in PLAN.sole_boxes]
        np.testing.assert_allclose(soles if stance == "left" else soles[::-1], expected, atol=1e-9)


def test_a_robot_walks_up_a_stair():
    env = BipedEnv()
    observation, _ = env.reset(options={"scenario": on(Stair(0.4, 0.01), command=0.3)})
    policy = make_policy("two-stage", env.robot, env.limits, "biped")
    over, touched = False, False
    while not over:
        observation, _, failed, truncated, _ = env.step(policy.predict(observation)[0])
        model, data = env.core.simulations.models[0], env.core.simulations.data[0]
        touched |= model.geom("stair").id in data.contact.geom[:, 0]
        over = failed or truncated
    assert touched
    assert not failed
    assert env.core.com[0, 0] > 0.4


def test_a_slope_of_its_own_is_that_of_the_fields():
    """Its gravity, what control believes, and what recovery is judged by, bit for bit."""
    kinds = Kerb(3.0, 0.01, 0.03), None
    episodes = BipedEpisodes(2)
    for k, (terrain, own) in enumerate(zip(kinds, (0.0, 0.03), strict=True)):
        errors = ModelErrors(terrain=terrain, slope_left=own)
        episodes.begin(k, Scenario("a", (Push((40.0, 50.0, 0.0), 0.1, 0.1),), errors=errors))
    for _ in range(20):
        episodes.step(np.zeros((2, 7), np.float32))
        for values in (episodes.core.truth, episodes.core.observation, episodes._episodes.uphill):
            np.testing.assert_allclose(values[0], values[1], atol=1e-9)
    gravity = [model.opt.gravity for model in episodes.core.simulations.models]
    np.testing.assert_array_equal(*gravity)
    assert gravity[0][1] == pytest.approx(-9.81 * math.sin(0.03))


def test_what_is_no_terrain_is_refused():
    with pytest.raises(UnknownNameError, match=r"kind of terrain 'steps'.*stair"):
        ModelErrors.from_dict({"terrain": {"kind": "steps"}})
    with pytest.raises(InvalidValueError, match="terrain lacks kind"):
        ModelErrors.from_dict({"terrain": {"start": 0.2}})
    for bad in (3, Tiles(0.01)):
        with pytest.raises(InvalidValueError, match="terrain must be a Terrain of a registered kind"):
            ModelErrors(terrain=bad)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="kind 'stair' is registered already"):
        register_terrain(type("Other", (Stair,), {"json_name": "stair"}))
    with pytest.raises(PushRecoveryError, match="pendulum has no model error 'terrain'"):
        PendulumEpisodes(1).begin(0, on(Stair(0.2, 0.03)))
    assert mujoco.mj_name2id(biped().model, mujoco.mjtObj.mjOBJ_GEOM, "stair") < 0


class Plain(Terrain):
    json_name = "plain"


@dataclass
class Loose(Terrain):
    json_name = "loose"


@dataclass(frozen=True)
class Sorted(Terrain):
    json_name = "sorted"
    kind: str = "a"


NAMELESS, NUMBERED = (type("Named", (Stair,), {"json_name": name}) for name in ("", 5))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (None, "be a subclass of Terrain, got None"),
        ("stairs", "be a subclass of Terrain, got 'stairs'"),
        (Stair(0.2, 0.03), "be a subclass of Terrain, got Stair(start=0.2, rise=0.03)"),
        (Pattern, f"be a subclass of Terrain, got {Pattern}"),
        (Plain, f"be a frozen dataclass, made one before it is registered, got {Plain}"),
        (Loose, f"be a frozen dataclass, made one before it is registered, got {Loose}"),
        (NAMELESS, f"have a json_name of printable characters, got {NAMELESS}"),
        (NUMBERED, f"have a json_name of printable characters, got {NUMBERED}"),
        (Sorted, f"have no field 'kind', got {Sorted}"),
    ],
)
def test_a_class_that_no_scenario_can_have_is_not_registered(kind, words):
    with pytest.raises(InvalidValueError, match=f"^{re.escape(f'a class of a terrain must {words}')}$"):
        register_terrain(kind)


@register_terrain
@dataclass(frozen=True)
class Faulty(Terrain):
    """What goes wrong with it is what it is made with."""

    json_name = "faulty"

    geom: str = ""
    high: Any = 0.0

    def shape(self, spec, soles):
        spec.worldbody.add_geom(name=self.geom, size=[1.0, 1.0, 1.0])

    def height(self, x, y, pattern):
        return self.high


@pytest.mark.parametrize(
    ("terrain", "message"),
    [
        (Faulty(high=math.nan), "Faulty.height [m] at the start must be finite, got nan"),
        (Faulty(high=None), "Faulty.height [m] at the start must be a number, got None"),
        (Faulty(high="x"), "Faulty.height [m] at the start must be a number, got 'x'"),
        (Faulty(geom=5), "terrain Faulty can't be added to the model: "),  # type: ignore[arg-type]
        (Faulty(geom="floor"), "terrain Faulty can't be added to the model: "
         "ValueError(\"Error: repeated name 'floor' in geom\")"),
    ],
)  # fmt: skip
def test_a_terrain_that_fails_at_the_run_is_named(terrain, message):
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}") as caught:
        altered_model(biped(), ModelErrors(terrain=terrain))
    assert "\n" not in str(caught.value)


def test_stairs_go_up_and_down_again_tread_by_tread():
    """Two steps of 10 cm from 0.5 m on, treads of 0.3 m, a landing of 0.8 m; level from 1.9 m on."""
    stairs = Stairs(rise=0.1, steps=2, start=0.5, tread=0.3, landing=0.8)
    middles = {0.4: 0.0, 0.65: 0.1, 1.2: 0.2, 1.75: 0.1, 1.95: 0.0, -3.0: 0.0}
    assert {x: stairs.height(x, 7.0, Pattern()) for x in middles} == middles
    assert stairs.end == pytest.approx(1.9)
    assert stairs.height(1.8999, 0.0, Pattern()) == 0.1
    assert stairs.mirrored() == stairs
    scaled = stairs.scaled(Similarity(mass=0.5, length=0.9))
    assert (scaled.steps, scaled.end) == (2, pytest.approx(0.9 * 1.9))
    assert scaled.rise == pytest.approx(0.09)


@pytest.mark.parametrize("rise", [0.06, -0.06])
def test_a_sole_stands_on_the_treads_where_they_are_said_to_be(rise):
    """A ray from above meets the floor at the stated height: stairs up, and stairs down into the ground."""
    stairs = Stairs(rise, steps=2, start=0.5, tread=0.3, landing=0.8)
    model = altered_model(biped(), ModelErrors(terrain=stairs))
    assert model is not None
    data, found = mujoco.MjData(model), np.zeros(1, np.int32)
    mujoco.mj_kinematics(model, data)
    for x in (-1.0, 0.4, 0.55, 0.85, 1.55, 1.65, 1.85, 2.5):
        down = np.array([0.0, 0.0, -1.0])
        far = mujoco.mj_ray(model, data, np.array([x, 1.0, 1.0]), down, None, 1, -1, found)
        assert 1.0 - far == pytest.approx(stairs.height(x, 1.0, Pattern()), abs=1e-9)
        pairs = {(int(a), int(b)) for a, b in zip(model.pair_geom1, model.pair_geom2, strict=True)}
        soles = {model.geom(name).id for name in PLAN.sole_boxes}
        assert all((int(found[0]), sole) in pairs for sole in soles)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rise": 0.31}, r"Stairs.rise \[m\] must be .*0.3.*, got 0.31"),
        ({"rise": 0.1, "steps": 0}, r"Stairs.steps must be an integer in \[1, 30\], got 0"),
        ({"rise": 0.1, "start": 0.1}, r"Stairs.start \[m\] must be .*0.2"),
        ({"rise": 0.1, "tread": 0.0}, r"Stairs.tread \[m\] must be .*0.2"),
        ({"rise": 0.1, "landing": math.nan}, r"Stairs.landing \[m\] must be"),
    ],
)
def test_impossible_stairs_are_refused(values, message):
    with pytest.raises(InvalidValueError, match=message):
        Stairs(**values)


def test_whether_the_floor_is_known_is_said_by_the_scenario():
    errors = ModelErrors(terrain=Stairs(0.1), floor_known=True)
    assert ModelErrors.from_dict(json.loads(json.dumps(errors.to_dict()))) == errors
    assert "floor_known" not in ModelErrors(terrain=Stairs(0.1)).to_dict()
    with pytest.raises(InvalidValueError, match=r"ModelErrors.floor_known must be true or false, got 1"):
        ModelErrors(floor_known=1)  # type: ignore[arg-type]


HALF_SOLE = (0.1, 0.05)


def test_clear_places_for_a_sole_lie_in_intervals():
    """A step of 10 cm at 1 m: with a sole of 0.2 m, 5 cm clear of it, up to 0.85 and from 1.15 m on."""
    floor = KnownFloor((Stair(1.0, 0.1),), Pattern(), HALF_SOLE)
    for x, yaw in ((0.805, 0.0), (1.195, math.pi)):  # from both sides
        (first, last), (beyond, farthest) = floor.intervals(x, 0.0, yaw, -0.3, 0.4)
        assert (first, last) == (pytest.approx(-0.3), pytest.approx(0.04))
        assert (beyond, farthest) == (pytest.approx(0.35), pytest.approx(0.4))
    assert floor.intervals(0.3, 0.0, 0.0, -0.3, 0.4) == []  # all is clear
    assert floor.under(0.95, 0.0) == (0.0, 0.1)
    steep = KnownFloor((Stairs(0.1, 30, 0.2, 0.2),), Pattern(), HALF_SOLE)
    assert steep.intervals(2.0, 0.0, 0.0, -0.3, 0.4) == []  # its treads are too short


def test_low_edges_are_stepped_on_and_high_ones_cleared_by_more():
    low, middle = (KnownFloor((Stair(1.0, rise),), Pattern(), HALF_SOLE) for rise in (0.03, 0.06))
    assert low.intervals(0.8, 0.0, 0.0, -0.3, 0.4) == []
    (_, last), (beyond, _) = middle.intervals(0.8, 0.0, 0.0, -0.3, 0.4)
    assert (last, beyond) == (pytest.approx(0.06), pytest.approx(0.34))  # 15 mm + 0.35 x 60 mm beside it


def test_the_highest_of_all_parts_is_the_floor():
    floor = KnownFloor((Stair(0.0, 0.03), Stair(0.5, 0.08)), Pattern(), HALF_SOLE)
    assert [floor.under(x, 0.0) for x in (-0.5, 0.3, 0.55, 0.9)] == [
        (0.0, 0.0), (0.03, 0.03), (0.03, 0.08), (0.08, 0.08)
    ]  # fmt: skip


def test_a_wall_holds_up_a_robot_that_is_pushed_against_it():
    """It meets trunk or arms, by a force that points away from it; the robot without one goes on."""
    push = Push((0.0, 1500.0, 0.0), 0.1, 0.2)
    walls = (Wall(0.4), None)
    episodes, most = BipedEpisodes(2), []
    policy = make_policy("two-stage", episodes.robot, episodes.limits, episodes.preset)
    for k, wall in enumerate(walls):
        errors = ModelErrors(collisions=True, terrain=wall)
        episodes.begin(k, Scenario(str(k), (push,), errors=errors, stance_side="right", duration=9.0))
    core, forces, force = episodes.core, [], np.zeros(6)
    model, data = core.simulations.models[0], core.simulations.data[0]
    plane = model.geom("wall").id
    for _ in range(80):
        episodes.step(policy.predict(core.observation)[0])
        most.append(core.judged.qpos[:, 1].copy())
        for i, contact in enumerate(data.contact):
            if plane in contact.geom:
                mujoco.mj_contactForce(model, data, i, force)
                sign = 1.0 if contact.geom[0] == plane else -1.0
                forces.append(sign * contact.frame.reshape(3, 3).T @ force[:3])
    assert len(forces) > 0
    total = np.sum(forces, axis=0)
    assert total[1] < -100.0  # to the right, where the robot is
    reached = np.max(most, axis=0)
    assert reached[0] < 0.4 < reached[1]


def test_a_wall_is_mirrored_and_scaled_and_needs_collisions():
    wall = Wall(0.5, 1.0)
    assert wall.mirrored() == Wall(0.5, -1.0)
    assert wall.scaled(Similarity(mass=0.5, length=0.6)) == Wall(0.3, 1.0)
    scenario = Scenario("a", errors=ModelErrors(terrain=wall, collisions=True))
    assert Scenario.from_json(scenario.to_json()) == scenario
    model = altered_model(biped(), scenario.errors)
    assert model is not None
    plane = model.geom("wall")
    assert plane.pos == pytest.approx([0.5 * math.cos(1.0), 0.5 * math.sin(1.0), 0.0])
    normal = np.zeros(9)
    mujoco.mju_quat2Mat(normal, plane.quat)
    assert normal[2::3] == pytest.approx([-math.cos(1.0), -math.sin(1.0), 0.0], abs=1e-9)
    with pytest.raises(InvalidValueError, match=r"collisions must be true with .* wall, got False"):
        ModelErrors(terrain=wall)
    with pytest.raises(InvalidValueError, match=r"Wall.distance \[m\] must be in \[0.05, 1000\], got 0"):
        Wall(0.0)
    with pytest.raises(InvalidValueError, match=r"Wall.direction \[rad\] must be finite"):
        Wall(1.0, math.nan)


@pytest.mark.parametrize("height", [0.244, 0.439, 0.85])
def test_stairs_of_suites_can_be_had_by_any_robot(height):
    """In proportion, within the bounds of depth: 0.2 to 5 m."""
    ratio = height / 0.8
    stairs = Stairs(0.1, 5, 0.55, 0.35, 5.0).scaled(Similarity(1.0, ratio))
    assert stairs.rise == pytest.approx(0.1 * ratio)
    wanted = [min(max(depth * ratio, 0.2), 5.0) for depth in (0.55, 0.35, 5.0)]
    assert [stairs.start, stairs.tread, stairs.landing] == pytest.approx(wanted)


def test_a_slope_fills_no_stairs_that_lead_down():
    floor = KnownFloor((Slope(0.02), Stairs(-0.1, 1, 0.3, landing=3.0)), Pattern(), HALF_SOLE)
    assert floor.under(1.0, 0.0) == (-0.1, -0.1)
    assert KnownFloor((Slope(0.02),), Pattern(), HALF_SOLE).under(1.0, 0.0) == (0.0, 0.0)
