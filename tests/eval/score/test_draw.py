"""Pushes of every kind, and shifts of one thing each, from points whose scenarios are written out by hand."""

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from push_recovery.controllers.model.robot import REFERENCE, Similarity
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.distribution import ErrorRanges
from push_recovery.envs.scenario.disturbances import Impactor, Payload, Platform, Slip, SteadyForce, Trip
from push_recovery.envs.scenario.model_errors import EXACT_MODEL, ModelErrors
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.envs.scenario.terrain import Stairs
from push_recovery.eval.rollout.episodes import rollout_batch
from push_recovery.eval.score import draw, kinds
from push_recovery.eval.score.report import floor_of
from push_recovery.eval.score.suites import get_suite

MOST = 1.0 - 1e-9
MIDDLE = draw.Point(*[0.5] * len(draw.Point._fields))


def scenario(**changes: float) -> Scenario:
    return draw.varied_scenario("mine", MIDDLE._replace(**changes), 7)


def test_a_single_push_at_the_pelvis():
    """Half the range of everything; direction 0.625 of a turn from -pi is psi = pi / 4."""
    found = scenario(direction=0.625, sides=0 / 16, pushes=7 / 16, walk=3 / 16)
    (push,) = found.pushes
    duration = 0.1  # sqrt(0.02 x 0.5)
    force = 105.0 / duration  # the middle of 50 and 160 N s
    assert push.force == pytest.approx((force * math.sqrt(0.5), force * math.sqrt(0.5), 0.0), abs=1e-3)
    assert (push.duration, push.body, push.offset, push.frame) == (0.1, "pelvis", (0.0, 0.0, 0.0), "heading")
    assert push.start == GaitEvent(4, "right", 0.5)
    assert (found.id, found.noise_seed, found.stance_side, found.command) == ("mine", 7, "right", Command())
    assert (draw.count_of(found), draw.walk_of(found)) == ("single", "in place")
    assert draw.count_of(Scenario("quiet")) == "none"


def test_the_least_and_the_most():
    ends = ("impulse", "duration", "offset_x", "offset_y", "offset_z")
    least = scenario(**dict.fromkeys(ends, 0.0), pushes=0.0, sides=0.0)
    assert least.pushes[0].impulse_magnitude == pytest.approx(50.0, abs=1e-4)
    assert least.pushes[0].duration == 0.02
    assert least.pushes[0].offset == (-0.08, -0.10, -0.08)
    hard = scenario(**dict.fromkeys(ends, MOST), pushes=0.0, sides=1 / 16)
    assert hard.pushes[0].impulse_magnitude == pytest.approx(110.0, abs=1e-3)
    assert (hard.pushes[0].duration, hard.pushes[0].body) == (0.5, "trunk")
    assert hard.pushes[0].offset == (0.10, 0.16, 0.25)


def test_the_second_of_two_comes_up_to_four_steps_later_from_anywhere():
    """Step 0 stands on the right, so step 4 does; 0.875 x 4 = 3.5 is half-way through step 8."""
    found = scenario(pushes=8 / 16, sides=0.0, direction=0.5, second_direction=0.25, second_time=0.875)
    first, second = found.pushes
    assert (first.start, second.start) == (GaitEvent(4, "right", 0.5), GaitEvent(8, "right", 0.5))
    assert first.impulse == pytest.approx((0.75 * 105.0, 0.0, 0.0), abs=1e-3)
    assert second.impulse == pytest.approx((0.0, -0.75 * 105.0, 0.0), abs=1e-3)
    soon = scenario(pushes=8 / 16, sides=0.0, second_time=0.0).pushes[1]
    assert soon.start == GaitEvent(5, "left", 0.0)


def test_a_repeated_push_comes_four_times_on_the_same_stance():
    """Step 0 stands on the left, the push on the right: the first such step from 4 on is 5."""
    found = scenario(pushes=12 / 16, sides=2 / 16, direction=0.5)
    assert [push.start for push in found.pushes] == [GaitEvent(k, "right", 0.5) for k in (4, 7, 9, 11)]
    assert [push.start.step_index("left") for push in found.pushes] == [5, 7, 9, 11]
    assert {push.impulse for push in found.pushes} == {found.pushes[0].impulse}
    assert found.pushes[0].impulse_magnitude == pytest.approx(0.55 * 105.0, abs=1e-3)
    assert draw.count_of(found) == "repeated"


@pytest.mark.parametrize(
    ("level", "sides", "command", "name"),
    [
        (4, 0, Command(0.3), "forward"),
        (7, 8, Command(-0.15), "backward"),
        (8, 8, Command(0.0, 0.125), "sideways"),
        (9, 0, Command(0.0, -0.125), "sideways"),
        (10, 8, Command(0.3, 0.1), "sideways"),
        (11, 0, Command(-0.15, -0.1), "sideways"),
        (12, 8, Command(turn=0.15), "turning"),
        (13, 0, Command(0.3, turn=-0.15), "turning"),
        (15, 8, Command(-0.15, turn=0.15), "turning"),
    ],
)
def test_commands_by_level_and_side(level, sides, command, name):
    found = scenario(walk=level / 16, sides=sides / 16, turn=0.25)
    assert found.command == command
    assert draw.walk_of(found) == name
    assert not any(math.copysign(1.0, value) < 0 and value == 0 for value in vars(found.command).values())


def test_every_kind_is_there_as_often_as_stated():
    scenarios = kinds.DRAWS["varied"].stratified("any", 1, 5)
    assert [s.id for s in scenarios[:2]] == ["any-0000", "any-0001"]
    assert len(scenarios) == 256
    assert Counter(map(draw.count_of, scenarios)) == {"single": 128, "double": 64, "repeated": 64}
    walks = Counter(map(draw.walk_of, scenarios))
    assert walks == {"in place": 64, "forward": 48, "backward": 16, "sideways": 64, "turning": 64}
    sides = Counter((s.pushes[0].body, s.stance_side, s.pushes[0].start.side) for s in scenarios)
    assert set(sides) == set(itertools.product(("pelvis", "trunk"), ("left", "right"), ("left", "right")))
    assert set(sides.values()) == {32}
    pairs = Counter((s.pushes[0].body, draw.count_of(s), draw.walk_of(s)) for s in scenarios)
    assert pairs["trunk", "single", "in place"] == pytest.approx(16, abs=8)
    for body, least, most in (("pelvis", 50, 160), ("trunk", 30, 110)):
        single = [s.pushes[0] for s in scenarios if s.pushes[0].body == body and draw.count_of(s) == "single"]
        impulse = [push.impulse_magnitude for push in single]
        assert least <= min(impulse) < least + 10 < most - 10 < max(impulse) <= most
    logs = np.log([s.pushes[0].duration for s in scenarios])
    assert np.ptp(np.histogram(logs, bins=16, range=(math.log(0.02), math.log(0.5)))[0]) <= 2


def stander(**changes: float) -> Scenario:
    middle = draw.Standing(*[0.5] * len(draw.Standing._fields))
    return draw.standing_scenario("mine", middle._replace(**changes), 7)


def standing_limit(reach: float) -> float:
    """F*_stand of 0.1 s of the paper's robot along an axis, whose hull reaches so far [m]."""
    omega = math.sqrt(9.81 / REFERENCE.com_height)
    time = math.sqrt(REFERENCE.trunk_angle_max * REFERENCE.trunk_inertia / REFERENCE.trunk_torque_max)
    trunk = REFERENCE.trunk_torque_max / (REFERENCE.mass * 9.81) * (1.0 - math.exp(-omega * time)) ** 2
    return REFERENCE.mass * omega**2 * (reach + trunk) / (1.0 - math.exp(-0.1 * omega))


def test_a_push_on_a_stander_is_a_share_of_what_it_can_catch_in_place():
    """Half of the range of shares is 1.2; the sole reaches 0.1 m ahead, and 0.05 + l_p / 2 aside."""
    found = stander(sides=0.0, pushes=0.0)
    (push,) = found.pushes
    assert push.force == pytest.approx((1.2 * standing_limit(0.1), 0.0, 0.0), abs=1e-3)
    assert (push.duration, push.start, push.body, push.offset) == (0.1, 1.0, "pelvis", (0.0, 0.0, 0.0))
    assert (found.command, found.stride, found.stance_side) == (Command(stand=True), 0.0, "right")
    (aside,) = stander(sides=0.0, pushes=0.0, direction=0.75, share=0.0).pushes
    limit = standing_limit(0.05 + 0.5 * REFERENCE.pelvis_width)
    assert aside.force == pytest.approx((0.0, 0.4 * limit, 0.0), abs=1e-3)
    (trunk,) = stander(sides=1 / 16, pushes=0.0).pushes
    assert trunk.force[0] == pytest.approx(0.6 * push.force[0])


def test_feet_astride_change_what_a_stander_can_catch():
    """Forward, either foot ahead is alike; aslant it is not."""
    found = stander(sides=4 / 16, pushes=0.0, stride=MOST)
    assert found.stride == 0.25
    left = stander(sides=6 / 16, pushes=0.0, stride=MOST)
    assert (left.stance_side, left.pushes[0].force) == ("left", pytest.approx(found.pushes[0].force))
    sheer = [stander(sides=side / 16, pushes=0.0, stride=MOST, direction=0.6) for side in (4, 6)]
    assert math.hypot(*sheer[0].pushes[0].force) != pytest.approx(math.hypot(*sheer[1].pushes[0].force))


def test_later_pushes_on_a_stander():
    double = stander(sides=0.0, pushes=8 / 16, second_direction=0.25, pause=0.0).pushes
    assert [push.start for push in double] == [1.0, 1.5]
    assert double[0].force == pytest.approx((0.9 * standing_limit(0.1), 0.0, 0.0), abs=1e-3)
    aside = standing_limit(0.05 + 0.5 * REFERENCE.pelvis_width)
    assert double[1].force == pytest.approx((0.0, -0.9 * aside, 0.0), abs=1e-3)
    repeated = stander(sides=0.0, pushes=12 / 16, pause=0.5).pushes
    assert [push.start for push in repeated] == [1.0, 2.25, 3.5, 4.75]
    assert {push.force for push in repeated} == {repeated[0].force}
    assert repeated[0].force[0] == pytest.approx(0.66 * standing_limit(0.1), abs=1e-3)


PUSH = Push((600.0, -800.0, 0.0), 0.1, GaitEvent(4, "right", 0.25))  # 100 N s
BASE = Scenario("base", (PUSH,), Command(0.2), "left", noise_seed=3)


@pytest.mark.parametrize(
    ("kind", "suite", "expected"),
    [
        ("varied", draw.varied_scenario, (draw.Point, draw.TARGETS)),
        ("quick", draw.varied_scenario, (draw.Point, draw.harder(200.0, 140.0))),
        ("standing", draw.standing_scenario, (draw.Standing,)),
    ],
)
def test_a_scenario_like_a_suite_is_that_of_a_uniform_point(kind, suite, expected):
    """The seed of the noise comes first, then the point, then the errors."""
    point, *targets = expected
    errors = ErrorRanges(friction=(0.5, 0.9))
    found = kinds.SuiteDistribution((kind,), 2.5, errors).sample(np.random.default_rng(5), "mine")
    rng = np.random.default_rng(5)
    assert rng.integers(1) == 0  # of the one kind
    noise_seed = int(rng.integers(2**31))
    whole = suite("mine", point(*rng.random(len(point._fields)).tolist()), noise_seed, *targets)
    assert found == replace(whole, settle_time=2.5, errors=errors.sample(rng))


def test_kinds_are_drawn_equally_often_and_scaled():
    """A quick push has the frame of the heading, a hard one the world's."""
    like = kinds.SuiteDistribution(("quick", "hard", "hard"), 2.5)
    rng, again = np.random.default_rng(3), np.random.default_rng(3)
    scenarios = [like.sample(rng) for _ in range(300)]
    assert 60 <= sum(s.pushes[0].frame == "heading" for s in scenarios) <= 140
    size = Similarity.of(replace(REFERENCE, mass=30.0, com_height=0.4))
    assert [like.scaled(size).sample(again) for _ in range(20)] == [s.scaled(size) for s in scenarios[:20]]


@pytest.mark.parametrize("kind", kinds.SHIFTS)
def test_nothing_else_changes(kind):
    """Command, stance, times and noise are those that the same point has in `hard`'s way of drawing."""
    found = kinds.DRAWS[kind].stratified("s", 1, 9)
    assert [s.id for s in found[:2]] == ["s-0000", "s-0001"]
    assert len({s.pushes + (s.errors,) for s in found}) == len(found) == 256
    assert found == kinds.DRAWS[kind].stratified("s", 1, 9)
    assert found != kinds.DRAWS[kind].stratified("s", 1, 10)
    assert get_suite(kind).scenarios[:1] == kinds.DRAWS[kind].stratified(kind, 1, kinds.SHIFTS[kind].seed)[:1]
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
    ranges = {"shift-magnitude": (210, 250), "shift-body": (48, 200), "shift-repeated": (44, 110)}
    least, most = ranges.get(kind, (80, 200))
    assert least - 0.01 <= min(impulse) < least + 2.0
    assert most - 2.0 < max(impulse) <= most + 0.01


@pytest.mark.parametrize(("u", "duration"), [(0.0, 0.02), (0.5, 0.1), (MOST, 0.5)])
def test_another_duration_has_the_same_impulse(u, duration):
    found = kinds.longer_or_shorter(BASE, [u])
    (push,) = found.pushes
    assert push.duration == pytest.approx(duration, abs=1e-4)
    assert push.impulse == pytest.approx((60.0, -80.0, 0.0), abs=1e-3)
    assert replace(found, pushes=BASE.pushes) == BASE


def test_another_place_on_either_body():
    (trunk,) = kinds.elsewhere(BASE, [0.49, 0.0, 0.5, MOST]).pushes
    assert (trunk.body, trunk.offset) == ("trunk", (-0.10, 0.0, 0.25))
    assert trunk.force == pytest.approx((360.0, -480.0, 0.0))
    (pelvis,) = kinds.elsewhere(BASE, [0.5, MOST, 0.0, 0.5]).pushes
    assert (pelvis.body, pelvis.offset, pelvis.force) == ("pelvis", (0.08, -0.10, 0.0), PUSH.force)


def test_another_robot():
    least = kinds.another_robot(BASE, [0.0] * 9).errors
    assert least == ModelErrors(mass=-0.15, trunk_com=(-0.03, -0.03, -0.03))
    most = kinds.another_robot(BASE, [MOST] * 9).errors
    assert most == ModelErrors(
        mass=0.15, payload=8.0, trunk_com=(0.03, 0.03, 0.03), joint_friction=1.5, armature=0.04, delay=0.008,
        dcm_noise=0.004,
    )  # fmt: skip
    half = kinds.another_robot(BASE, [0.5] * 9).errors
    assert half == ModelErrors(payload=4.0, joint_friction=0.75, armature=0.02, delay=0.004, dcm_noise=0.002)
    assert kinds.another_robot(BASE, [0.5] * 9).pushes == BASE.pushes


def test_another_floor():
    for point, errors in (
        ([0.0, 0.5, 0.0], ModelErrors(friction=0.45)),
        ([0.5, MOST, 0.25], ModelErrors(slope_left=0.07)),  # a quarter turn: to the left
        ([0.5, 0.0, 0.5], ModelErrors(slope_forward=-0.02)),
        ([0.9, 0.0, 0.0], ModelErrors(floor_step=0.005)),
    ):
        assert kinds.another_floor(BASE, point).errors == errors
    names = [set(s.errors.names) for s in kinds.DRAWS["shift-floor"].stratified("s", 1, 2)]
    counts = [sum(bool(found & wanted) for found in names)
              for wanted in ({"friction"}, {"slope_forward", "slope_left"}, {"floor_step"})]  # fmt: skip
    assert sum(counts) == 256
    assert all(abs(count - 256 / 3) <= 2 for count in counts)


def test_repeated_pushes_turn_and_alternate():
    """Step 0 stands on the left, so the first step from 4 on that stands on the right is 5."""
    found = kinds.repeated(BASE, [0.5, 0.0, 0.25]).pushes  # 2 + int(0.5 x 4) = 4, each a quarter turn further
    assert [push.start for push in found] == [
        GaitEvent(5, "right", 0.25), GaitEvent(6, "left", 0.25), GaitEvent(7, "right", 0.25),
        GaitEvent(8, "left", 0.25),
    ]  # fmt: skip
    quarter = [(330.0, -440.0), (440.0, 330.0), (-330.0, 440.0), (-440.0, -330.0)]
    assert np.array([push.force[:2] for push in found]) == pytest.approx(np.array(quarter), abs=2e-3)
    wide = kinds.repeated(BASE, [MOST, MOST, 0.0]).pushes
    assert [push.start.step_index("left") for push in wide] == [5, 8, 11, 14, 17]
    assert [push.direction for push in wide] == pytest.approx([math.atan2(-0.8, 0.6)] * 5, abs=1e-5)
    assert len(kinds.repeated(BASE, [0.0, 0.0, 0.0]).pushes) == 2


def in_laboratory(kind: int, **changes: float) -> Scenario:
    middle = kinds.Laboratory(*[0.5] * len(kinds.Laboratory._fields))
    return kinds.laboratory_scenario("mine", middle._replace(kind=(kind + 0.5) / 8, **changes), 7)


def test_kinds_of_laboratories_from_points():
    """Half the range of everything, to the left: three quarters of a turn from - pi are pi / 2."""
    event = GaitEvent(4, "left", 0.5)
    middle = {i: in_laboratory(i, direction=0.75, sides=6 / 16) for i in range(8)}
    quarter = round(math.pi / 2, 4)
    mass = round(12.0 * math.sqrt(5.0), 4)
    assert middle[0].disturbances == (Impactor(mass, round(160.0 / mass, 4), event, quarter),)
    assert middle[3].disturbances == (SteadyForce(210.0, event, 2.5, quarter),)
    (slips,) = middle[4].disturbances
    assert (type(slips), slips.side, slips.start, slips.duration) == (Slip, "left", event, 1.2)
    assert slips.friction == pytest.approx(math.sqrt(0.2 * 0.02), abs=1e-4)  # the middle of the logarithm
    (trips,) = middle[5].disturbances
    assert (type(trips), trips.start, trips.force) == (Trip, GaitEvent(4, "left", 0.25), 425.0)
    (drops,) = middle[6].disturbances
    assert (type(drops), drops.offset) == (Payload, (0.0, 0.1, 0.1))
    (moves,) = middle[7].disturbances
    assert (type(moves), moves.direction) == (Platform, quarter)
    assert {middle[i].command for i in range(8) if i != 5} == {Command(vx=0.25)}
    assert middle[5].command == Command(vx=0.4)
    assert in_laboratory(0, sides=2 / 16).command == Command()  # in place
    assert in_laboratory(5, sides=2 / 16).command == Command(vx=0.4)  # who trips walks
    assert [in_laboratory(0, sides=i / 16).stance_side for i in (0, 1)] == ["right", "left"]


def test_the_suite_of_disturbances_has_each_kind_as_often_at_all_strengths_and_directions():
    scenarios = get_suite("disturbances").scenarios
    parts = [scenario.disturbances[0] for scenario in scenarios]
    counts = Counter(part.json_name for part in parts)
    assert counts == dict.fromkeys(
        ("impactor", "weight pull", "waist pull", "steady force", "slip", "trip", "payload", "platform"), 32
    )
    assert all(len(scenario.disturbances) == 1 and not scenario.pushes for scenario in scenarios)
    for kind in ("impactor", "waist pull", "platform"):
        turned = [part.direction for part in parts if part.json_name == kind]
        quarters = Counter(int((psi + math.pi) / (0.5 * math.pi) - 1e-9) for psi in turned)
        assert set(quarters.values()) == {8}
    assert {scenario.stance_side for scenario in scenarios} == {"left", "right"}


GROUND = kinds.Ground(*[0.5] * len(kinds.Ground._fields))


def on_floor(kind: int, known: bool = True, **changes: float) -> Scenario:
    return kinds.terrain_scenario("mine", GROUND._replace(floor=(kind + 0.5) / 8, **changes), 7, known)


def test_floors_from_points():
    """Half the range of everything; a slope that rises to the left, and a flight of 2 + 8 // 4 steps."""
    assert [on_floor(i, uphill=0.25, sides=8 / 16).errors for i in range(8)] == [
        ModelErrors(floor_known=True, **floor)
        for floor in (
            {},
            {"slope_left": 0.0536},
            {"floor_step": 0.0175},
            {"slope_left": 0.0536, "floor_step": 0.0175},
            {"terrain": Stairs(0.06, 1, 0.675, 0.4, 5.0)},
            {"terrain": Stairs(-0.06, 1, 0.675, 0.4, 5.0)},
            {"terrain": Stairs(0.06, 4, 0.675, 0.4, 5.0)},
            {"terrain": Stairs(-0.06, 4, 0.675, 0.4, 5.0)},
        )
    ]
    assert on_floor(1, height=MOST, uphill=0.0).errors.slope_forward <= math.radians(5.0)


def test_a_push_on_terrain_comes_where_the_floor_is():
    """At 0.3 m/s and 0.096 m a step: x = 0.675 + 0.1 + 0.5 x 0.4 x steps."""
    (push,) = on_floor(6, sides=9 / 16, direction=0.75).pushes  # trunk, first stance right, 4 steps
    assert (push.body, push.frame, push.offset) == ("trunk", "heading", (0.0, 0.0, 0.0))
    assert (push.start.step, push.start.side) == (16, "right")
    assert push.start.fraction == pytest.approx((0.775 + 0.8) / 0.096 - 16.0, abs=1e-4)
    assert push.force == pytest.approx((0.0, 700.0, 0.0), abs=1e-3)  # the middle of 30 and 110 N s
    soon = on_floor(4, sides=9 / 16).pushes[0].start
    assert (soon.step, soon.fraction) == (10, pytest.approx((0.775 + 0.2) / 0.096 - 10.0, abs=1e-4))
    assert on_floor(0, sides=2 / 16).stance_side == "left"


@pytest.fixture(scope="module")
def terrain():
    return get_suite("terrain").scenarios


def test_every_floor_comes_as_often_with_every_body_and_either_first_foot(terrain):
    counts = Counter(floor_of(scenario) for scenario in terrain)
    names = "level", "slope", "tiles", "slope and tiles", "step up", "step down", "stairs up", "stairs down"
    assert counts == dict.fromkeys(names, 32)
    sides = Counter((floor_of(s), s.pushes[0].body, s.stance_side) for s in terrain)
    assert set(sides.values()) == {8}
    assert {s.errors.terrain.steps for s in terrain if floor_of(s).startswith("stairs")} == {2, 3, 4, 5}


def test_robots_walk_forward_and_are_pushed_on_the_terrain(terrain):
    for scenario in terrain:
        speed, (push,) = scenario.command.vx, scenario.pushes
        assert scenario.command == Command(speed)
        assert 0.2 <= speed <= 0.4
        index = push.start.step_index(scenario.stance_side)
        assert index == push.start.step >= draw.FIRST_STEP
        place, floor = speed * kinds.STEP_TIME * (index + push.start.fraction), scenario.errors.terrain
        low, high = kinds.TARGETS[push.body].impulse
        assert low <= push.impulse_magnitude <= high
        if floor is not None:
            assert floor.start + 0.1 - 1e-4 <= place <= floor.start + 0.1 + floor.steps * floor.tread
    quarters = Counter(int(2.0 * s.pushes[0].direction / math.pi + 2.0) for s in terrain)
    assert set(quarters.values()) == {64}


@pytest.mark.parametrize("end", ["", "-sealed"])
def test_both_suites_of_terrain_differ_in_what_control_knows_alone(end):
    known, unknown = get_suite(f"terrain{end}").scenarios, get_suite(f"terrain-blind{end}").scenarios
    assert len(known) == (1024 if end else 256)
    assert all(scenario.errors.floor_known for scenario in known)
    assert unknown == tuple(replace(s, errors=replace(s.errors, floor_known=False)) for s in known)
    assert [s.id for s in unknown] == [s.id for s in known]


def test_a_mirrored_scenario_of_terrain_is_one_of_its_floor(terrain):
    for scenario in terrain:
        mirror = scenario.mirrored()
        assert mirror.mirrored() == scenario
        assert floor_of(mirror) == floor_of(scenario)
        assert mirror.pushes[0].start.step_index(mirror.stance_side) == scenario.pushes[0].start.step


def test_terrain_has_no_push_of_another_suite(terrain):
    pushes = {scenario.pushes for scenario in terrain}
    assert len(pushes) == 256
    for name in ("quick", "standard", "hard", "varied", "shift-floor", "terrain-sealed"):
        assert not pushes & {scenario.pushes for scenario in get_suite(name).scenarios}


def test_a_slope_has_no_height_to_know_and_a_step_has():
    """Its height over the plane on which the robot stands is zero: gravity is tilted instead."""
    episodes = BipedEpisodes(2)
    policy = make_policy("two-stage", episodes.robot, episodes.limits, "biped")

    def moved(kind: int) -> bool:
        both = [replace(on_floor(kind, known), duration=4.0, pushes=()) for known in (True, False)]
        first, second = (
            outcome.to_dict()
            for outcome in rollout_batch(
                episodes, policy, [replace(s, id=f"{i}") for i, s in enumerate(both)], "two-stage"
            )
        )
        return first["total_reward"] != second["total_reward"]

    assert [moved(kind) for kind in (0, 1, 4)] == [False, False, True]
