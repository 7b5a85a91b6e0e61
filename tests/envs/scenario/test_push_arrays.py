"""Arrays of pushes of several robots: each has its own, whatever the others get."""

import numpy as np
from push_recovery.envs.scenario.arrays import assign_pushes, empty_pushes
from push_recovery.envs.scenario.push import PENDING, GaitEvent, Push
from push_recovery.envs.scenario.scenario import Scenario

ONE = Push((1.0, 2.0, 3.0), 0.1, 0.5)
TWO = Push((4.0, 5.0, 6.0), 0.2, GaitEvent(2, "right", 0.25), "trunk", (0.1, 0.2, 0.3), "heading")


def of(pushes, k):
    """What robot k has, field by field, as lists."""
    return [field[k].tolist() for field in pushes]


def test_arrays_that_grow_keep_what_the_others_have():
    pushes = empty_pushes(3, 1)
    for k in (0, 2):
        pushes = assign_pushes(pushes, k, Scenario("a", (ONE,)))
        pushes.delivered[k, 0] = 0.5 + k
    before = [of(pushes, k) for k in (0, 2)]
    grown = assign_pushes(pushes, 1, Scenario("b", (TWO, ONE)))
    assert grown.start.shape == (3, 2)
    for k, fields in zip((0, 2), before, strict=True):
        assert [field[:1] for field in of(grown, k)] == fields
        assert grown.start[k, 1] == PENDING
        assert grown.step[k, 1] == -1  # never comes
    assert grown.force[1].tolist() == [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]
    assert grown.start[1].tolist() == [PENDING, 0.5]
    assert grown.step[1].tolist() == [3, -1]  # from the left foot, step 3 is the first on the right one
    assert (grown.fraction[1, 0], grown.body[1].tolist(), grown.frame[1].tolist()) == (0.25, [1, 0], [1, 0])
    assert grown.offset[1, 0].tolist() == [0.1, 0.2, 0.3]


def test_fewer_pushes_leave_nothing_of_those_before():
    pushes = assign_pushes(empty_pushes(1, 1), 0, Scenario("a", (TWO, ONE)))
    pushes.delivered[:] = 7.0
    again = assign_pushes(pushes, 0, Scenario("b", (ONE,), stance_side="right"))
    assert again is pushes  # there was room
    assert again.start[0].tolist() == [0.5, PENDING]
    assert not again.delivered.any()
    assert not again.force[0, 1].any()
    np.testing.assert_array_equal(again.step[0], [-1, -1])
