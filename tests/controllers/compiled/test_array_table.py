"""Compiled code finds every array in the address table where the table has it."""

from typing import Any, NamedTuple, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from push_recovery.controllers.compiled.array_table import (
    DIMENSIONS,
    first_rows,
    is_array_type,
    parts_table,
)
from push_recovery.envs.biped import period as biped_arena
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode import period_end as gait_period
from push_recovery.envs.scenario.scenario import Scenario
from typing_extensions import TypeAliasType

ARENA = {name: getattr(biped_arena, f"{name}_of") for name in biped_arena.Arena._fields}
JUDGED = {name: getattr(gait_period, f"{name}_of") for name in gait_period.Judged._fields}


@pytest.fixture(scope="module")
def episodes():
    """Three bipeds, and so the arrays of a core and of its judge."""
    episodes = BipedEpisodes(3)
    episodes.begin(0, Scenario("a"))
    return episodes


def place(array):
    """Address, dtype, shape and strides; strides mean nothing along an axis of at most one entry."""
    long = [stride for stride, count in zip(array.strides, array.shape, strict=True) if count > 1]
    return array.ctypes.data, array.dtype, array.shape, long


def same(found, held):
    assert type(found) is type(held)
    for name, own, other in zip(held._fields, found, held, strict=True):
        if isinstance(other, np.ndarray):
            assert place(own) == place(other), name
        else:
            assert own == other, name


@pytest.mark.parametrize("name", ARENA)
def test_the_arena_is_read_where_it_is(episodes, name):
    core = episodes.core
    arena, table = core._arenas[0], core._tables[0]
    constants = (core._constants,) if name == "bounds" else ()
    same(ARENA[name](table, *constants), getattr(arena, name))


@pytest.mark.parametrize("name", JUDGED)
def test_the_judge_reads_its_arrays_where_they_are(episodes, name):
    judged = gait_period.Judged(episodes.robots, episodes._episodes, episodes.monitor.state)
    same(JUDGED[name](episodes._table), getattr(judged, name))


class Settings(NamedTuple):
    gain: float


class One(NamedTuple):
    settings: Settings
    a: NDArray[np.float64]
    b: NDArray[np.int64]


class Two(NamedTuple):
    c: NDArray[np.float64]


class Parts(NamedTuple):
    one: One
    other: One
    two: Two


def test_a_part_begins_after_the_arrays_of_those_before_it():
    rows = first_rows(Parts)
    assert rows._asdict() == {"one": 0, "other": 2, "two": 4}
    one, two = One(Settings(1.0), np.zeros(3), np.zeros((2, 2), np.int64)), Two(np.zeros(5))
    table = parts_table(Parts(one, one, two))
    assert table.shape == (5, 1 + 2 * DIMENSIONS)
    assert table[rows.other, 0] == one.a.ctypes.data
    assert table[rows.two, :2].tolist() == [two.c.ctypes.data, 5]


Scalar = TypeVar("Scalar", bound=np.generic)
AliasedArray = TypeAliasType("AliasedArray", np.ndarray[Any, np.dtype[Scalar]], type_params=(Scalar,))


class Aliased(NamedTuple):
    """As NDArray is from numpy 2.5 on."""

    a: AliasedArray[np.float64]
    gain: float
    b: AliasedArray[np.int64]


class AliasedParts(NamedTuple):
    first: Aliased
    second: Two


def test_an_alias_of_an_array_is_counted_as_one():
    assert first_rows(AliasedParts)._asdict() == {"first": 0, "second": 2}
    first, second = Aliased(np.zeros(3), 1.0, np.zeros(2, np.int64)), Two(np.zeros(5))
    table = parts_table(AliasedParts(first, second))
    assert table[:, 0].tolist() == [first.a.ctypes.data, first.b.ctypes.data, second.c.ctypes.data]


@pytest.mark.parametrize(
    ("kind", "is_one"),
    [
        (np.ndarray, True),
        (NDArray[np.float64], True),
        (TypeAliasType("Floats", NDArray[np.float64]), True),
        (TypeAliasType("Number", float), False),
        (float, False),
        (tuple[float, float], False),
    ],
)
def test_which_annotations_mean_an_array(kind, is_one):
    assert is_array_type(kind) is is_one


@pytest.mark.parametrize(
    ("part", "name"),
    [(One(Settings(1.0), np.zeros(3), None), "b"), (One(np.zeros(1), np.zeros(3), np.zeros(2)), "settings")],
)
def test_a_part_whose_arrays_are_not_its_annotations_is_refused(part, name):
    """Its rows would be counted wrongly, and compiled code would read other memory."""
    with pytest.raises(TypeError, match=f"One: {name}$"):
        parts_table(Parts(part, part, Two(np.zeros(5))))
