"""Compiled code finds every array in the address table where the table has it."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, types
from numba.core.errors import TypingError
from push_recovery.controllers import array_table
from push_recovery.controllers.array_table import (
    DIMENSIONS,
    Floats1,
    Ints2,
    address_of,
    caller_of,
    first_rows,
    part_of,
    parts_table,
)
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.biped.period import Arena, controller_of
from push_recovery.envs.episode.period_end import PeriodArrays
from push_recovery.envs.scenario.scenario import Scenario


def reader(parts, name):
    """Compiled code that reads one part of a table."""
    return njit(lambda table: part_of(table, parts, name))


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


@pytest.mark.parametrize("name", Arena._fields)
def test_the_arena_is_read_where_it_is(episodes, name):
    core = episodes.core
    arena, tables = core._arenas[0][0], core._tables[0][0]
    if name in ("bounds", "both"):  # which have settings, too
        same(getattr(controller_of(tables, core.constants), name), getattr(arena, name))
    else:
        same(reader(Arena, name)(tables.arena), getattr(arena, name))


@pytest.mark.parametrize("name", PeriodArrays._fields)
def test_the_judge_reads_its_arrays_where_they_are(episodes, name):
    judged = PeriodArrays(episodes.robots, episodes._episodes, episodes.monitor.state)
    same(reader(PeriodArrays, name)(episodes._table), getattr(judged, name))


class Settings(NamedTuple):
    gain: float


class One(NamedTuple):
    settings: Settings
    a: Floats1
    b: Ints2


class Two(NamedTuple):
    c: Floats1


class Parts(NamedTuple):
    one: One
    other: One
    two: Two


ONE, TWO = One(Settings(1.0), np.zeros(3), np.zeros((2, 2), np.int64)), Two(np.zeros(5))


def test_a_part_begins_after_the_arrays_of_those_before_it():
    rows = first_rows(Parts)
    assert rows == {"one": 0, "other": 2, "two": 4}
    one, two = ONE, TWO
    table = parts_table(Parts(one, one, two))
    assert table.shape == (5, 1 + 2 * DIMENSIONS)
    assert table[rows["other"], 0] == one.a.ctypes.data
    assert table[rows["two"], :2].tolist() == [two.c.ctypes.data, 5]


def test_what_is_read_is_written_where_it_is_held():
    """Strides that are no array's own order, a part behind others, and settings beside the arrays."""
    floats, ints = np.arange(12.0)[::-3], np.arange(24).reshape(4, 6).T[1::2, ::3]
    one, two = One(Settings(1.0), floats, ints), Two(np.arange(3.0))
    table = parts_table(Parts(one, one, two))
    a, b = reader(Parts, "other")(table)  # not a One: its settings are not in the table
    assert a.tolist() == [11.0, 8.0, 5.0, 2.0]
    assert b.tolist() == [[1, 19], [3, 21], [5, 23]]
    found = reader(Parts, "two")(table)
    assert type(found) is Two
    found.c[1] = 7.0
    assert two.c.tolist() == [0.0, 7.0, 2.0]


def test_dense_parts_are_contiguous_in_compiled_code():
    two = Two(np.arange(3.0))
    found = njit(lambda table: array_table.dense_part_of(table, Parts, "two"))(
        parts_table(Parts(ONE, ONE, two))
    )
    assert found.c.flags.c_contiguous
    assert place(found.c) == place(two.c)


def test_a_part_is_named_when_the_code_is_compiled():
    with pytest.raises(TypingError):
        njit(lambda table, name: part_of(table, Parts, name))(parts_table(Parts(ONE, ONE, TWO)), "two")


@pytest.mark.parametrize(
    ("part", "name"),
    [
        (One(Settings(1.0), np.zeros(3), None), "b"),
        (One(np.zeros(1), np.zeros(3), np.zeros((2, 2), np.int64)), "settings"),
        (One(Settings(1.0), np.zeros((3, 1)), np.zeros((2, 2), np.int64)), "a"),
        (One(Settings(1.0), np.zeros(3), np.zeros((2, 2))), "b"),
        (One(Settings(1.0), np.zeros(3, np.float32), np.zeros((2, 2), np.int64)), "a"),
    ],
)
def test_a_part_whose_arrays_are_not_its_annotations_is_refused(part, name):
    """Its rows would be counted wrongly, and compiled code would read other memory."""
    with pytest.raises(TypeError, match=f"One: {name}$"):
        parts_table(Parts(part, part, Two(np.zeros(5))))


@njit
def half_of(a, k):
    if k < 0:
        raise ValueError("no entry")
    return 0.5 * a[k]


def test_a_kernel_is_called_by_its_address_and_its_errors_come_through():
    kind = types.float64(types.float64[::1], types.int64)
    call = caller_of(kind)
    by_address = njit(lambda address, a, k: call(address, a, k))
    address, a = address_of(half_of, kind), np.array([4.0, 6.0])
    assert by_address(address, a, 1) == 3.0
    with pytest.raises(ValueError, match="no entry"):
        by_address(address, a, -1)


def test_a_kernel_that_returns_another_type_has_no_address():
    with pytest.raises(TypeError, match="half_of returns float64, not int64"):
        address_of(half_of, types.int64(types.float64[::1], types.int64))
