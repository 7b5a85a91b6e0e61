import json
import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, PushRecoveryError, UnknownNameError
from push_recovery.envs.scenario.arrays import MARK, assign_pushes, empty_pushes
from push_recovery.envs.scenario.push import GaitEvent, Kick, Push, mirrored_body, polar_push
from push_recovery.envs.scenario.scenario import Scenario


@pytest.mark.parametrize(
    ("step", "side", "first", "index"),
    [(4, "left", "left", 4), (4, "right", "left", 5), (4, "left", "right", 5)],
)
def test_event_falls_in_the_first_step_on_its_side(step, side, first, index):
    assert GaitEvent(step, side).step_index(first) == index


def test_a_mirrored_push_attacks_the_mirrored_point():
    mirror = Push((1.0, 2.0, 3.0), 0.1, 0.0, "trunk", (0.1, 0.2, 0.3)).mirrored()
    assert (mirror.force, mirror.offset, mirror.body) == ((1.0, -2.0, 3.0), (0.1, -0.2, 0.3), "trunk")
    np.testing.assert_allclose(
        np.cross(mirror.offset, mirror.force), np.cross((0.1, 0.2, 0.3), (1.0, 2.0, 3.0)) * [-1.0, 1.0, -1.0]
    )  # a moment is a pseudovector


@pytest.mark.parametrize("frame", ["world", "heading"])
def test_polar_push_and_mirror(frame):
    push = polar_push(100.0, math.radians(30), 0.2, GaitEvent(4, "left", 0.25), body="trunk", frame=frame)
    assert push.impulse_magnitude == pytest.approx(20.0, abs=1e-12)
    assert push.direction == pytest.approx(math.radians(30))
    mirror = push.mirrored()
    assert mirror.direction == pytest.approx(math.radians(-30))
    assert mirror.start == GaitEvent(4, "right", 0.25)
    assert mirror.frame == frame
    assert mirror.mirrored() == push
    assert math.copysign(1.0, Push((1.0, 0.0, 0.0), 0.1, 0.0).mirrored().force[1]) == 1.0


@pytest.mark.parametrize(
    ("body", "other"),
    [
        ("pelvis", "pelvis"),
        ("trunk", "trunk"),
        ("left_thigh", "right_thigh"),
        ("right_foot", "left_foot"),
        ("link:left_elbow", "link:right_elbow"),
        ("link:waist_yaw", "link:waist_yaw"),
    ],
)
def test_a_leg_is_mirrored_into_the_other_one(body, other):
    push = Push((1.0, 2.0, 3.0), 0.1, 2.0, body, (0.1, -0.2, 0.3))
    assert push.mirrored() == Push((1.0, -2.0, 3.0), 0.1, 2.0, other, (0.1, 0.2, 0.3))


@pytest.mark.parametrize("frame", ["world", "heading"])
@pytest.mark.parametrize("start", [2.6, GaitEvent(4, "right", 0.5)])
def test_dict_round_trip(start, frame):
    push = Push((1.0, 2.0, 3.0), 0.1, start, "trunk", (0.1, 0.0, 0.2), frame)
    assert Push.from_dict(push.to_dict()) == push
    assert ("frame" in push.to_dict()) == (frame == "heading")


def test_accepts_arrays_and_stores_tuples():
    push = Push(np.array([1, 2, 3]), 1, 0)  # type: ignore[arg-type]
    assert push.force == (1.0, 2.0, 3.0)
    assert hash(push) == hash(Push((1.0, 2.0, 3.0), 1.0, 0.0))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"force": (1.0, math.nan, 0.0)}, ["force", "finite"]),
        ({"force": (1.0, 2.0)}, ["force", "3"]),
        ({"duration": 0.0}, ["duration", "0"]),
        ({"duration": -0.1}, ["duration", "-0.1"]),
        ({"start": -1.0}, ["start", "-1"]),
        ({"start": "soon"}, ["start", "soon"]),
        ({"body": "head"}, ["head", "pelvis", "trunk"]),
        ({"offset": (0.0, 0.0, math.inf)}, ["offset"]),
        ({"frame": "body"}, ["push frame", "body", "world, heading"]),
    ],
)
def test_bad_push_names_the_value(values, words):
    good = {"force": (1.0, 0.0, 0.0), "duration": 0.1, "start": 0.0}
    with pytest.raises(PushRecoveryError) as caught:
        Push(**{**good, **values})
    assert all(word in str(caught.value) for word in words)


def test_bad_event_names_the_value():
    with pytest.raises(UnknownNameError, match="left, right"):
        GaitEvent(4, "middle")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=r"fraction.*1\.5"):
        GaitEvent(4, "left", 1.5)
    with pytest.raises(InvalidValueError, match="step"):
        GaitEvent(-1, "left")
    with pytest.raises(UnknownNameError, match="when"):
        Push.from_dict({"force": [1, 0, 0], "duration": 0.1, "start": 0, "when": 1})
    with pytest.raises(InvalidValueError, match="duration"):
        Push.from_dict({"force": [1, 0, 0], "start": 0})


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_and_offset_have_bounds(axis, sign):
    def along(value):
        return tuple(sign * value if i == axis else 0.0 for i in range(3))

    Push(along(1e7), 3600.0, 0.0, offset=along(10.0))
    with pytest.raises(
        InvalidValueError, match=rf"Push\.force \[N\]\[{axis}\] must be in \[-1e\+07, 1e\+07\]"
    ):
        Push(along(1.001e7), 0.1, 0.0)
    with pytest.raises(InvalidValueError, match=rf"Push\.offset \[m\]\[{axis}\] must be in \[-10, 10\]"):
        Push(along(1.0), 0.1, 0.0, offset=along(10.1))


def test_duration_and_step_have_bounds():
    with pytest.raises(InvalidValueError, match=r"duration \[s\] must be in \(0, 3600\], got 3600\.5"):
        Push((1.0, 0.0, 0.0), 3600.5, 0.0)
    with pytest.raises(InvalidValueError, match=r"GaitEvent\.step must be an integer in \[0, 100000\]"):
        GaitEvent(10**30, "left")


@pytest.mark.parametrize(
    ("magnitude", "direction"),
    [(math.inf, 0.0), (1.1e7, 0.0), (1.0, math.inf), (1.0, math.nan), (1.0, "left")],
)
def test_a_polar_push_refuses_what_has_no_direction_or_size(magnitude, direction):
    with pytest.raises(InvalidValueError, match=r"push (magnitude|direction) \["):
        polar_push(magnitude, direction, 0.1, 1.0)


KICK = Kick((0.3, -0.4, 0.1), 2.5)


def test_json_round_trip():
    scenario = Scenario("a", (Push((1.0, 0.0, 0.0), 0.1, 1.0),), kicks=(KICK, Kick((0, 1, 0), 3)))
    text = scenario.to_json()
    assert Scenario.from_json(text) == scenario
    assert json.loads(text)["kicks"][0] == {"velocity": [0.3, -0.4, 0.1], "start": 2.5}
    assert "kicks" not in json.loads(Scenario("a").to_json())  # hashes of suites without stay


def test_mirror_is_an_involution():
    mirror = Scenario("a", kicks=(KICK,)).mirrored()
    assert mirror.kicks == (Kick((0.3, 0.4, 0.1), 2.5),)
    assert mirror.mirrored() == Scenario("a", kicks=(KICK,))


def test_an_episode_ends_after_the_last_kick():
    scenario = Scenario("a", kicks=(Kick((0.1, 0, 0), 3.0), Kick((0.1, 0, 0), 1.0)), settle_time=4.0)
    assert scenario.end_time(0.0) == 7.0
    assert scenario.end_time(5.0) == 9.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Kick((1.0, 2.0), 0.0),  # type: ignore[arg-type]
        lambda: Kick((math.nan, 0.0, 0.0), 0.0),
        lambda: Kick((101.0, 0.0, 0.0), 0.0),
        lambda: Kick((0.0, 0.0, 0.0), -1.0),
        lambda: Scenario("a", kicks=(1,)),  # type: ignore[arg-type]
        lambda: Scenario("a", kicks=3),  # type: ignore[arg-type]
        lambda: Scenario.from_json('{"id": "a", "kicks": 3}'),
        lambda: Scenario.from_json('{"id": "a", "kicks": [{"velocity": [0, 0, 0]}]}'),
    ],
)
def test_bad_kicks(make):
    with pytest.raises(PushRecoveryError):
        make()


def test_a_kick_has_a_row_without_a_force_after_the_pushes():
    pushes = assign_pushes(
        empty_pushes(1, 1), 0, Scenario("a", (Push((9.0, 0.0, 0.0), 0.1, 1.0),), kicks=(KICK,))
    )
    assert pushes.start[0].tolist() == [1.0, 2.5]
    assert pushes.force[0].tolist() == [[9.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert pushes.duration[0].tolist() == [0.1, MARK]
    assert pushes.step[0].tolist() == [-1, -1]  # neither waits for a gait event


@pytest.mark.parametrize(
    ("body", "other"),
    [
        ("left_foot", "right_foot"),
        ("link:Left_Elbow_Pitch", "link:Right_Elbow_Pitch"),
        ("link:L_ELBOW_P", "link:R_ELBOW_P"),
        ("link:l_sho_pitch", "link:r_sho_pitch"),
        ("link:arm_LEFT", "link:arm_RIGHT"),
        ("pelvis", "pelvis"),
        ("link:roll_l2", "link:roll_l2"),
    ],
)
def test_the_body_on_the_other_side_by_any_convention_of_names(body, other):
    assert mirrored_body(body) == other
    assert mirrored_body(other) == body
