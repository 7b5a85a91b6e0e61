"""Compiled code finds every array in the address table where the table has it."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from push_recovery.controllers.compiled.array_table import DIMENSIONS, first_rows, parts_table
from push_recovery.envs.biped import period as biped_arena
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.episode import period_end as gait_period
from push_recovery.envs.scenario.scenario import Scenario

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
