import hashlib
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from push_recovery.controllers.array_table import COMMON, NO_STATE, SENSED, Floats1, Floats2, Ints1
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.envs.scenario.model_errors import PhysicsOptions
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario, StartOffset
from push_recovery.envs.snapshot import RobotSnapshot, arrays_of, digest_of, take_rows


class Walk(NamedTuple):
    time: Floats1
    place: Floats2
    gain: float
    steps: Ints1


class Floor(NamedTuple):
    height: Floats1
    size: Annotated[Floats1, COMMON]


class Parts(NamedTuple):
    walk: Annotated[Walk, SENSED]
    floor: Floor


def parts() -> Parts:
    walk = Walk(np.arange(3.0), np.arange(6.0).reshape(3, 2), 0.5, np.arange(3))
    return Parts(walk, Floor(np.ones(3), np.ones(7)))


def test_every_annotated_array_is_found_unless_its_annotation_or_its_part_s_is_left_out():
    assert list(arrays_of(parts(), ())) == [
        "walk.time", "walk.place", "walk.steps", "floor.height", "floor.size",
    ]  # fmt: skip
    assert list(arrays_of(parts(), {SENSED, COMMON})) == ["floor.height"]
    assert list(arrays_of(parts(), {NO_STATE}, only=COMMON)) == ["floor.size"]
    assert list(arrays_of(parts(), {COMMON}, only=SENSED)) == ["walk.time", "walk.place", "walk.steps"]


def test_rows_are_copies_that_cannot_be_written():
    whole = parts()
    rows = take_rows(arrays_of(whole, {COMMON}), 1, 3)
    whole.walk.place[1] = -1.0
    assert rows["walk.place"].tolist() == [2.0, 3.0]
    assert rows["walk.time"].shape == ()
    assert rows["walk.steps"].item() == 1
    with pytest.raises(ValueError, match="read-only"):
        rows["walk.place"][0] = 9.0


def test_an_array_of_another_length_is_refused_by_its_name():
    with pytest.raises(TypeError, match=r"a row for each of 3 robots: floor\.size"):
        take_rows(arrays_of(parts(), ()), 0, 3)


@pytest.mark.parametrize(
    ("start", "comes"),
    [
        (0.5, True), (0.499, False), (GaitEvent(3, "right", 0.5), True), (GaitEvent(3, "right", 0.49), False),
        (GaitEvent(2, "left", 1.0), False), (GaitEvent(4, "left", 0.0), True),
    ],
)  # fmt: skip
def test_a_push_may_begin_at_the_very_moment_of_the_snapshot(start, comes):
    """At 0.5 s, 0.3 s into step 3 of 0.6 s; its own push, which begins just then, has not begun."""
    own = Push((1.0, 0.0, 0.0), 0.1, 0.5)
    rows = {
        "pushes.start": np.array([0.5]), "schedule.next": np.array(0), "gait.steps": np.array(3),
        "gait.elapsed": np.array(0.3), "gait.plan": np.array([0.1, 0.2, 0.6, 0.0, 0.0, 0.0, 0.0]),
    }  # fmt: skip
    snapshot = RobotSnapshot(Scenario("a", (own,)), 0.5, {}, rows)
    asked = Scenario("b", (Push((2.0, 0.0, 0.0), 0.1, start),))
    assert snapshot.check_scenario(Scenario("b", (own,))) == [0]
    if comes:
        assert snapshot.check_scenario(asked) == []
    else:
        with pytest.raises(InvalidValueError, match="push 0 would begin before"):
            snapshot.check_scenario(asked)
    rows["pushes.start"][0] = 0.499
    with pytest.raises(InvalidValueError, match="push 0 of the snapshot began at"):
        snapshot.check_scenario(asked)


@pytest.mark.parametrize(
    "change",
    [
        {"stance_side": "right"},
        {"physics": PhysicsOptions(0.001)},
        {"start": StartOffset((0.01, 0.0))},
        {"stride": 0.1, "command": Command(stand=True)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_what_a_walk_began_with_must_stay(change):
    rows = {"pushes.start": np.empty(0), "schedule.next": np.array(0)}
    same = {"command": change["command"]} if "command" in change else {}
    snapshot = RobotSnapshot(Scenario("a", **same), 0.5, {}, rows)
    assert snapshot.check_scenario(Scenario("b", **same)) == []
    with pytest.raises(InvalidValueError, match=f"must have its {next(iter(change))}"):
        snapshot.check_scenario(Scenario("b", **change))


def test_a_digest_knows_where_one_part_ends():
    assert digest_of(b"a", b"bc") == hashlib.sha256(b"a\0bc").hexdigest()[:12] != digest_of(b"ab", b"c")
