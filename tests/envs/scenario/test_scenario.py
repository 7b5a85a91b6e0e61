"""Profiles as values, and that drawn scenarios have them while given ones run as they are.

Scenarios for a robot of another size: forces, times, lengths and what follows from them, by hand.
"""

import math
import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.controllers.model.observation import DCM, SWING_POSITION, TRUNK_ANGLE
from push_recovery.controllers.model.robot import SAME, Similarity
from push_recovery.envs.scenario.distribution import ErrorRanges, PushDistribution
from push_recovery.envs.scenario.model_errors import ModelErrors, PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push
from push_recovery.envs.scenario.scenario import (
    EXACT,
    HARDWARE,
    WEIGHED,
    Command,
    CommandChange,
    Scenario,
    StartOffset,
    get_profile,
    get_profiles,
    one_of_each,
)

TURN = Command(0.3, turn=0.2)
CHANGES = (CommandChange(2.0, Command(0.3, 0.1)), CommandChange(3.5, Command()))
PUSH = Push((10.0, 0.0, 0.0), 0.1, 1.0)


def test_json_round_trip_is_exact_and_has_no_key_without_changes():
    scenario = Scenario("a", (PUSH,), Command(0.1), changes=CHANGES)
    text = scenario.to_json()
    assert Scenario.from_json(text) == scenario
    assert Scenario.from_json(text).to_json() == text
    assert "changes" not in Scenario("a", (PUSH,), Command(0.1)).to_dict()
    assert Command.from_dict(TURN.to_dict()) == TURN
    assert set(Command(0.1).to_dict()) == {"vx", "vy"}


def test_mirror_is_an_involution():
    scenario = Scenario("a", changes=CHANGES)
    mirrored = scenario.mirrored()
    assert mirrored.changes == (
        CommandChange(2.0, Command(0.3, -0.1)),
        CommandChange(3.5, Command(0.0, -0.0)),
    )
    assert mirrored.mirrored() == scenario
    assert TURN.mirrored() == Command(0.3, turn=-0.2)


def test_an_episode_waits_for_the_last_change():
    assert Scenario("a", (PUSH,), changes=CHANGES).end_time(1.1) == 7.5
    assert Scenario("a", (PUSH,), changes=CHANGES).end_time(5.0) == 9.0
    assert Scenario("a", changes=CHANGES, duration=3.0).end_time(0.0) == 3.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Command(turn=0.61), r"Command.turn \[rad/s\] must be in \[-0.6, 0.6\], got 0.61"),
        (lambda: CommandChange(0.0, Command()), r"CommandChange.time \[s\] must be in \(0, 1e\+06\], got 0"),
        (lambda: CommandChange(math.inf, Command()), "must be finite, got inf"),
        (lambda: CommandChange(1.0, 0.3), "CommandChange.command must be a Command, got 0.3"),  # type: ignore[arg-type]
        (lambda: Scenario("a", changes=(PUSH,)), "must hold CommandChange objects, got Push"),  # type: ignore[arg-type]
        (lambda: Scenario("a", changes=CHANGES[::-1]), "must rise in time, got 2 s after 3.5 s"),
        (lambda: Scenario.from_dict({"id": "a", "changes": 3}), "scenario changes must be a list, got 3"),
    ],
)
def test_an_impossible_change_is_refused(make, message):
    with pytest.raises(InvalidValueError, match=message):
        make()


LATE, LARGE = 1e300, 10**5000


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scenario("a", settle_time=LATE),
         "Scenario.settle_time [s] must be in (0, 1e+06], got 1e+300"),
        (lambda: Scenario("a", duration=LATE), "Scenario.duration [s] must be in (0, 1e+06], got 1e+300"),
        (lambda: CommandChange(LATE, TURN), "CommandChange.time [s] must be in (0, 1e+06], got 1e+300"),
        (lambda: Push((1.0, 0.0, 0.0), 0.1, LATE), "Push.start [s] must be in [0, 1e+06], got 1e+300"),
        (lambda: Push(b"abc", 0.1, 0.0), "Push.force [N] must have 3 entries (x, y, z), got b'abc'"),  # type: ignore[arg-type]
        (lambda: Kick((0.1, 0.0, 0.0), LATE), "Kick.start [s] must be in [0, 1e+06], got 1e+300"),
        (lambda: PushDistribution(settle_time=LATE),
         "PushDistribution.settle_time [s] must be in (0, 1e+06], got 1e+300"),
        (lambda: Scenario("a", errors=LARGE),  # type: ignore[arg-type]
         "Scenario.errors must be ModelErrors, got a int of thousands of digits"),
        (lambda: Scenario.from_dict({"id": "a", "pushes": "x" * 999}),
         f"scenario pushes must be a list, got '{'x' * 199}... (1001 characters)"),
        (lambda: get_profiles(5), "unknown profile 5 (valid: exact, collisions, hardware, weighed)"),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_what_is_impossible_is_refused_in_one_line(make, message):
    with pytest.raises(PushRecoveryError, match=f"^{re.escape(message)}$"):
        make()


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("", "''"), (5, "5"), ("\ud800", r"'\ud800'"), ("a\n\x1b[31m", r"'a\n\x1b[31m'"),
        ("a" * 1001, f"'{'a' * 199}... (1003 characters)"), (LARGE, "a int of thousands of digits"),
    ],
    ids=range(6),
)  # fmt: skip
def test_an_id_can_be_printed_and_written(name, told):
    message = f"Scenario.id must be 1 to 1000 printable characters, got {told}"
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        Scenario(name)
    assert Scenario("\u00e4 b/c~" * 100).id == "\u00e4 b/c~" * 100


def test_one_of_each_asks_of_a_robot_what_all_of_them_do():
    """Other numbers ask for nothing new; a delay does, since robots have control steps of their own."""
    weak, strong = Scenario("weak", (PUSH,)), Scenario("strong", (replace(PUSH, force=(99.0, 0.0, 0.0)),))
    new = [
        replace(strong, id="body", pushes=(replace(PUSH, body="trunk"),)),
        replace(strong, id="turn", command=TURN),
        replace(strong, id="kick", kicks=(Kick((0.1, 0.0, 0.0), 1.0),)),
        replace(strong, id="mass", errors=ModelErrors(mass=0.1)),
        replace(strong, id="delay", errors=ModelErrors(delay=0.002)),
        replace(strong, id="late", errors=ModelErrors(delay=0.003)),
        replace(strong, id="cone", physics=PhysicsOptions(cone="elliptic")),
        replace(strong, id="senses", sensing="onboard"),
    ]
    heavier = replace(strong, id="heavier", errors=ModelErrors(mass=0.2))
    assert list(one_of_each([weak, strong, *new, heavier, weak])) == [weak, *new]


def test_an_unknown_key_is_refused():
    with pytest.raises(PushRecoveryError, match="speed"):
        Scenario.from_dict({"id": "a", "changes": [{"time": 1.0, "command": {}, "speed": 2}]})


PUSH_SCENARIO = Push((10.0, -20.0, 0.0), 0.1, GaitEvent(4, "left", 0.2))


def test_json_round_trip_is_exact():
    rng = np.random.default_rng(1)
    for _ in range(50):
        scenario = PushDistribution().sample(rng)
        text = scenario.to_json()
        assert Scenario.from_json(text) == scenario
        assert Scenario.from_json(text).to_json() == text


def test_mirror_is_an_involution_scenario():
    scenario = Scenario("a", (PUSH_SCENARIO,), Command(0.3, 0.1), "right", noise_seed=3)
    mirror = scenario.mirrored()
    assert mirror.stance_side == "left"
    assert mirror.command == Command(0.3, -0.1)
    assert mirror.pushes[0].force == (10.0, 20.0, 0.0)
    assert mirror.id == "a~"
    assert mirror.mirrored() == scenario


def test_end_time():
    assert Scenario("a", (PUSH_SCENARIO,)).end_time(3.0) == 7.0
    assert Scenario("a", (PUSH_SCENARIO,)).end_time(math.inf) == math.inf
    assert Scenario("a", duration=60.0).end_time(0.0) == 60.0
    assert Scenario("a", (PUSH_SCENARIO,)).side_of_step(5) == "right"


@pytest.mark.parametrize(
    "make",
    [
        lambda: Scenario(""),
        lambda: Scenario("a", stance_side="both"),  # type: ignore[arg-type]
        lambda: Scenario("a", duration=0.0),
        lambda: Scenario("a", settle_time=math.nan),
        lambda: Scenario("a", noise_seed=-1),
        lambda: Scenario("a", pushes=(1,)),  # type: ignore[arg-type]
        lambda: Command(vx=math.nan),
        lambda: Scenario.from_json("{"),
        lambda: Scenario.from_json("[]"),
        lambda: Scenario.from_json('{"id": "a", "pushes": 3}'),
        lambda: Scenario.from_json('{"id": "a", "surprise": 3}'),
    ],
)
def test_bad_scenario_is_an_error_of_this_package(make):
    with pytest.raises(PushRecoveryError):
        make()


@pytest.mark.parametrize("name", ["pushes", "changes"])
@pytest.mark.parametrize("value", [3, None])
def test_pushes_and_changes_are_sequences(name, value):
    with pytest.raises(InvalidValueError, match=rf"Scenario\.{name} must be a sequence"):
        Scenario("a", **{name: value})


def test_a_noise_seed_stays_one_that_json_can_hold():
    assert Scenario.from_json(Scenario("a", noise_seed=2**128 - 1).to_json()).noise_seed == 2**128 - 1
    with pytest.raises(InvalidValueError, match=r"Scenario\.noise_seed must be an integer in"):
        Scenario("a", noise_seed=2**128)


def test_a_sensing_is_said_only_where_it_is_not_exact():
    onboard = Scenario("a", sensing="onboard")
    assert "sensing" not in Scenario("a").to_dict()
    assert onboard.to_dict()["sensing"] == "onboard"
    assert Scenario.from_json(onboard.to_json()) == onboard
    assert onboard.mirrored().sensing == "onboard"
    with pytest.raises(UnknownNameError, match=r"sensing 'onbord'.*exact, onboard"):
        Scenario("a", sensing="onbord")


PUSHED = Scenario("a", (Push((60.0, 0.0, 0.0), 0.1, 1.0),), noise_seed=7)


def test_exact_changes_nothing():
    off = replace(PUSHED, errors=ModelErrors(mass=0.1), physics=PhysicsOptions(time_step=0.001))
    assert EXACT.applied(PUSHED) == PUSHED
    assert EXACT.applied(off) == off


def test_hardware_is_what_the_pages_say():
    applied = HARDWARE.applied(PUSHED)
    assert applied.to_dict()["errors"] == {
        "friction": 0.7, "delay": 0.004, "joint_friction": 1.0, "armature": 0.03, "collisions": True,
        "motor_power": 2000.0, "bus_power": 3000.0, "continuous_torque": 0.4,
    }  # fmt: skip
    assert applied.to_dict()["sensing"] == "onboard"
    assert applied.to_dict()["physics"] == {"time_step": 0.001, "cone": "elliptic", "impratio": 10.0}
    assert replace(applied, errors=PUSHED.errors, physics=PUSHED.physics, sensing="exact") == PUSHED


def test_what_a_scenario_says_itself_stands():
    own = replace(PUSHED, errors=ModelErrors(mass=0.1, friction=0.5), physics=PhysicsOptions(impratio=3.0))
    applied = HARDWARE.applied(own)
    assert (applied.errors.mass, applied.errors.friction, applied.errors.delay) == (0.1, 0.5, 0.004)
    assert (applied.physics.impratio, applied.physics.time_step) == (3.0, 0.001)
    assert HARDWARE.applied(own.mirrored()) == HARDWARE.applied(own).mirrored()


def test_weighed_robots_are_those_of_hardware_with_a_mass_and_a_trunk_of_their_own():
    """Uniform within 2 % and 1 cm: mean 0, standard deviations bound / sqrt(3), within 3 standard errors."""
    seeds = range(400)
    drawn = [WEIGHED.applied(replace(PUSHED, noise_seed=seed)) for seed in seeds]
    again = WEIGHED.applied(replace(PUSHED, noise_seed=7, id="other"))
    assert again.errors == drawn[7].errors
    bare = {"mass": 0.0, "trunk_com": (0.0, 0.0, 0.0)}
    for seed, one in zip(seeds, drawn, strict=True):
        same = replace(one, errors=replace(one.errors, **bare))
        assert same == HARDWARE.applied(replace(PUSHED, noise_seed=seed))
    values = np.array([(one.errors.mass, *one.errors.trunk_com) for one in drawn])
    bounds = np.array([0.02, 0.01, 0.01, 0.01])
    assert (abs(values) <= bounds).all()
    assert (abs(values.mean(0)) < 3.0 * bounds / math.sqrt(3.0 * 400)).all()
    assert values.std(0) == pytest.approx(bounds / math.sqrt(3.0), rel=0.12)
    assert abs(np.corrcoef(values.T) - np.eye(4)).max() < 0.16
    assert sorted(set(values[:, 0].tolist())) == pytest.approx(np.arange(-4, 5) * 0.005)  # nine models
    own = replace(PUSHED, errors=ModelErrors(mass=0.1))
    assert WEIGHED.applied(own).errors.mass == 0.1


def test_a_trunk_is_weighed_in_the_size_of_the_robot():
    small = WEIGHED.scaled(Similarity(mass=0.5, length=0.5))
    assert (small.mass_within, small.trunk_com_within) == (0.02, 0.005)
    of_small, of_large = (one.applied(PUSHED).errors for one in (small, WEIGHED))
    assert of_small.mass == of_large.mass
    assert of_small.trunk_com == pytest.approx([0.5 * part for part in of_large.trunk_com], abs=1e-4)


def test_an_unknown_profile_is_named_with_the_valid_ones():
    assert get_profile("hardware") is HARDWARE
    with pytest.raises(UnknownNameError, match="did you mean 'hardware'"):
        get_profile("hardwar")
    with pytest.raises(UnknownNameError, match="profile"):
        gym.make("push_recovery:PushRecovery/Biped-v0", profile="real")


def test_of_several_profiles_each_scenario_draws_one():
    both, scenarios = get_profiles(["exact", "hardware"]), [replace(PUSHED, noise_seed=i) for i in range(400)]
    assert get_profiles("hardware") is HARDWARE
    assert get_profiles(["exact"]) is EXACT
    drawn = [both.applied(one) for one in scenarios]
    assert drawn == [both.applied(one) for one in scenarios]
    of = [
        (EXACT, HARDWARE)[one.sensing == "onboard"].applied(s)
        for one, s in zip(drawn, scenarios, strict=True)
    ]
    assert drawn == of
    assert 160 < sum(one.sensing == "onboard" for one in drawn) < 240  # 4 standard deviations
    half = Similarity(mass=0.5)
    robots = [one.errors.bus_power for one in map(both.scaled(half).applied, scenarios[:20])]
    assert set(robots) == {None, HARDWARE.scaled(half).errors.bus_power}
    with pytest.raises(InvalidValueError, match="profile must be at least one name"):
        get_profiles([])
    with pytest.raises(UnknownNameError, match="did you mean 'hardware'"):
        get_profiles(["exact", "hardwar"])


@pytest.mark.parametrize("env_id", ["Biped", "BipedResidual"])
def test_an_environment_draws_robots_of_its_profile(env_id):
    name = f"push_recovery:PushRecovery/{env_id}-v0"
    drawn = []
    for profile in ("exact", "hardware"):
        env = gym.make(name, profile=profile)
        env.reset(seed=3)
        drawn.append(env.unwrapped.scenario)
        env.reset(options={"scenario": PUSHED})
        assert env.unwrapped.scenario == PUSHED
        env.close()
    assert drawn[1] == HARDWARE.applied(drawn[0])
    assert drawn[1] != drawn[0]


@pytest.mark.parametrize("env_id", ["Biped", "BipedResidual"])
def test_a_vector_of_robots_has_the_profile_too(env_id):
    seen = []
    for profile in ("exact", "hardware"):
        envs = gym.make_vec(
            f"push_recovery:PushRecovery/{env_id}-v0", 2, "vector_entry_point", profile=profile
        )
        envs.reset(seed=3)
        core = envs.unwrapped.core
        seen.append((core.errors.delay.tolist(), core.simulations.models[1].opt.timestep, core.senses.of(1)))
        alike = envs.unwrapped.episodes.clone(1)
        assert alike.drawn(envs.unwrapped.push_distribution, np.random.default_rng(0)).errors.collisions == (
            profile == "hardware"
        )
        envs.close()
    assert seen == [([0, 0], 0.002, 0), ([2, 2], 0.001, 1)]


@pytest.mark.parametrize(("sensing", "kind"), [(None, 1), ("exact", 0), ("onboard", 1)])
def test_a_sensing_of_the_environment_stands_above_the_profile(sensing, kind):
    env = gym.make("push_recovery:PushRecovery/Biped-v0", profile="hardware", sensing=sensing)
    env.reset(seed=3)
    assert env.unwrapped.episodes.core.senses.of(0) == kind
    env.close()


LARGER = Similarity(2.0, 2.25)  # twice as heavy, 1.5 times as slow
EVENT = GaitEvent(4, "left", 0.25)


def test_a_push_by_hand():
    push = Push((10.0, -20.0, 30.0), 0.1, 2.0, "left_shank", (0.01, 0.02, -0.04), "heading")
    assert push.scaled(LARGER) == Push(
        (20.0, -40.0, 60.0), 0.1 * 1.5, 3.0, "left_shank", (0.0225, 0.045, -0.09), "heading"
    )
    assert push.scaled(LARGER).impulse_magnitude == pytest.approx(3.0 * push.impulse_magnitude)
    assert Push((1.0, 0.0, 0.0), 0.1, EVENT).scaled(LARGER).start == EVENT


def test_a_scenario_by_hand():
    scenario = Scenario(
        "one", (Push((1.0, 0.0, 0.0), 0.2, EVENT),), Command(0.2, -0.1, 0.3), "right", 2.0, 8.0, 7,
        ModelErrors(friction=0.5, payload=3.0), (CommandChange(4.0, Command(0.1)),),
        kicks=(Kick((0.1, 0.2, 0.0), 1.0),),
    )  # fmt: skip
    scaled = scenario.scaled(LARGER)
    assert (scaled.id, scaled.stance_side, scaled.noise_seed) == ("one", "right", 7)
    assert (scaled.settle_time, scaled.duration) == (3.0, 12.0)
    assert scaled.command == Command(0.2 * 1.5, -0.1 * 1.5, 0.3 / 1.5)
    assert scaled.changes == (CommandChange(6.0, Command(0.1 * 1.5)),)
    assert scaled.kicks == (Kick((0.1 * 1.5, 0.2 * 1.5, 0.0), 1.5),)
    assert scaled.errors == ModelErrors(friction=0.5, payload=6.0)
    assert Scenario("open").scaled(LARGER).duration is None
    assert scenario.scaled(SAME) == scenario


def test_what_mirrors_scales():
    scenario = Scenario(
        "one", (Push((1.0, 2.0, 3.0), 0.2, EVENT, "left_foot", (0.1, 0.2, 0.3)),), Command(0.2, -0.1, 0.3)
    )
    assert scenario.mirrored().scaled(LARGER) == scenario.scaled(LARGER).mirrored()


@pytest.mark.parametrize(("turn", "found"), [(0.6, 0.6), (-0.6, -0.6), (0.3, 0.6), (0.2, 0.4), (-0.2, -0.4)])
def test_a_small_robot_turns_faster_up_to_the_bound(turn, found):
    assert Command(turn=turn).scaled(Similarity(1.0, 0.25)).turn == found


def test_errors_by_hand():
    errors = ModelErrors(
        mass=0.1, payload=1.0, trunk_com=(0.01, -0.02, 0.0), friction=0.7, slope_left=0.02, delay=0.004,
        dcm_noise=0.002, joint_noise=0.001, floor_step=0.004, joint_friction=1.0, joint_damping=1.0,
        armature=0.02, collisions=True, motor_power=1000.0, bus_power=2000.0, continuous_torque=0.5,
    )  # fmt: skip
    assert errors.scaled(LARGER) == ModelErrors(
        mass=0.1, payload=2.0, trunk_com=(0.0225, -0.045, 0.0), friction=0.7, slope_left=0.02, delay=0.004,
        dcm_noise=0.002 * 2.25, joint_noise=0.001, floor_step=0.004 * 2.25, joint_friction=4.5,
        joint_damping=6.75, armature=0.02 * 10.125, collisions=True, motor_power=3000.0, bus_power=6000.0,
        continuous_torque=0.5,
    )  # fmt: skip
    assert ModelErrors().scaled(LARGER) == ModelErrors()
    ranges = ErrorRanges(payload=(0.0, 2.0), friction=(0.4, 1.0), trunk_com=(-0.01, 0.02))
    assert ranges.scaled(LARGER) == ErrorRanges(
        payload=(0.0, 4.0), friction=(0.4, 1.0), trunk_com=(-0.0225, 0.045)
    )


def test_a_profile_keeps_its_name_and_senses():
    scaled = HARDWARE.scaled(LARGER)
    assert (scaled.name, scaled.physics, scaled.sensing) == ("hardware", HARDWARE.physics, HARDWARE.sensing)
    assert scaled.errors == HARDWARE.errors.scaled(LARGER)
    assert EXACT.scaled(LARGER) == EXACT


def test_drawing_and_scaling_change_places():
    """To rounding; gait events and seeds are the same ones."""
    ranges = PushDistribution(
        turn=0.3,
        errors=ErrorRanges(payload=(0.0, 5.0)),
        settle_time=2.0,
        push_duration_ratio=4.0,
        pushes_max=3,
    )
    for seed in range(50):
        drawn, later = (
            ranges.scaled(LARGER).sample(np.random.default_rng(seed)),
            ranges.sample(np.random.default_rng(seed)).scaled(LARGER),
        )
        assert (drawn.id, drawn.noise_seed) == (later.id, later.noise_seed)
        assert drawn.stance_side == later.stance_side
        for a, b in zip(drawn.pushes, later.pushes, strict=True):
            assert a.start == b.start
            assert (*a.force, a.duration) == pytest.approx((*b.force, b.duration))
        parts = [(s.command.vx, s.command.vy, s.command.turn, s.settle_time) for s in (drawn, later)]
        assert parts[0] == pytest.approx(parts[1])
        assert drawn.errors.payload == pytest.approx(later.errors.payload)


def test_a_stander_may_begin_astride():
    """Kept in JSON where it is not 0, scaled like a length, the same mirrored; of no robot that walks."""
    astride = Scenario("astride", command=Command(stand=True), stride=-0.2)
    assert Scenario.from_json(astride.to_json()) == astride
    assert "stride" not in replace(astride, stride=0.0).to_dict()
    assert astride.scaled(Similarity(mass=2.0, length=0.5)).stride == -0.1
    assert astride.mirrored().stride == -0.2
    with pytest.raises(InvalidValueError, match=r"must be 0 m without Command\(stand=True\), got 0.1"):
        Scenario("walks", stride=0.1)
    with pytest.raises(InvalidValueError, match=r"Scenario.stride \[m\] must be"):
        replace(astride, stride=0.6)


@pytest.mark.parametrize(("name", "side"), [("Pendulum-v0", "left"), ("Biped-v0", "right")])
def test_feet_stand_astride_at_the_start(name, side):
    scenario = Scenario("astride", (), Command(stand=True), side, duration=1.0, stride=0.15)
    with gym.make(f"PushRecovery/{name}") as env:
        seen, _ = env.reset(options={"scenario": scenario})
        width = env.unwrapped.episodes.robot.pelvis_width
    assert seen[SWING_POSITION][:2] == pytest.approx([0.15, width], abs=1e-6)
    assert seen[DCM] == pytest.approx([0.075, 0.5 * width], abs=1e-3)


START = StartOffset((0.002, -0.001), (0.02, 0.03))


def test_a_start_stands_in_json_only_where_it_is_not_the_nominal_one():
    assert "start" not in Scenario("a").to_dict()
    scenario = Scenario("a", start=START)
    assert scenario.to_dict()["start"] == {"com": [0.002, -0.001], "lean": [0.02, 0.03]}
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert scenario.mirrored().start == StartOffset((0.002, 0.001), (0.02, -0.03))
    assert scenario.scaled(Similarity(0.5, 0.25)).start == StartOffset((0.0005, -0.00025), (0.02, 0.03))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StartOffset((0.06, 0.0)), r"StartOffset.com \[m\]\[0\] must be .*0.05.*got 0.06"),
        (lambda: StartOffset(lean=(0.0, -0.2)), r"StartOffset.lean \[rad\]\[1\] must be .*0.1.*got -0.2"),
        (lambda: StartOffset((0.0, 0.0, 0.0)), r"StartOffset.com \[m\] must have 2 entries"),
        (lambda: StartOffset(lean="ab"), r"StartOffset.lean \[rad\] must have 2 entries"),
        (lambda: Scenario("a", start=(0.0, 0.0)), "Scenario.start must be a StartOffset"),
    ],
)
def test_an_impossible_start_is_refused(make, message):
    with pytest.raises(InvalidValueError, match=message):
        make()


@pytest.mark.parametrize("name", ["Pendulum", "Biped"])
@pytest.mark.parametrize("command", [Command(), Command(stand=True)])
def test_a_robot_begins_beside_its_nominal_start(name, command):
    """On the right foot the swing side is the left one, so that what goes to the left keeps its sign."""
    env = gym.make(f"push_recovery:PushRecovery/{name}-v0")
    episodes = env.unwrapped.episodes
    scenario = Scenario("a", command=command, stance_side="right")
    found = []
    for one in (scenario, replace(scenario, start=START), replace(scenario, start=START).mirrored()):
        env.reset(options={"scenario": one})
        found.append((episodes.motion().com[0].copy(), episodes.core.truth[0].copy()))
    (com, seen), (beside, leaning), (_, mirrored) = found
    assert beside - com == pytest.approx(START.com, abs=1e-9)
    assert leaning[TRUNK_ANGLE] == pytest.approx(START.lean, abs=1e-4)
    assert leaning[SWING_POSITION] == pytest.approx(seen[SWING_POSITION], abs=1e-9)  # the feet as they were
    assert leaning[DCM] - seen[DCM] == pytest.approx(START.com, abs=1e-9)
    assert mirrored == pytest.approx(leaning, abs=1e-9)
    env.close()


def test_a_robot_on_its_own_sensors_stays_so_under_any_profile():
    assert EXACT.applied(replace(PUSHED, sensing="onboard")).sensing == "onboard"
