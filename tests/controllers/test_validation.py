import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError, is_finite_number, shown
from push_recovery.controllers.validation import (
    require_choice,
    require_integer,
    require_kind,
    require_number,
    require_vector,
)

BEYOND_FLOATS = 10**400
BEYOND_TEXT = 10**5000  # more digits than Python writes


@pytest.mark.parametrize("value", [BEYOND_FLOATS, -BEYOND_FLOATS, BEYOND_TEXT], ids=["+", "-", "text"])
def test_an_integer_that_no_float_holds_is_no_finite_number(value):
    assert not is_finite_number(value)
    with pytest.raises(InvalidValueError, match=r"^x \[m\] must be finite"):
        require_number("x [m]", value)


def test_a_refused_integer_of_thousands_of_digits_gets_its_message():
    with pytest.raises(InvalidValueError, match=r"n must be an integer in \[0, 5\], got a int of thousands"):
        require_integer("n", BEYOND_TEXT, high=5)
    with pytest.raises(UnknownNameError, match="unknown preset a int of thousands of digits"):
        require_choice("preset", BEYOND_TEXT, ("biped",))


def test_long_values_are_cut_in_messages():
    assert shown("a" * 1000) == "'" + "a" * 199 + "... (1002 characters)"
    assert shown([1, 2]) == "[1, 2]"


@pytest.mark.parametrize("value", [-1, 6, 2.0, True, "3", None])
def test_integers_lie_within_their_bounds(value):
    with pytest.raises(InvalidValueError, match=r"n must be an integer in \[0, 5\]"):
        require_integer("n", value, high=5)


@pytest.mark.parametrize("value", [0, 5, np.int64(3)])
def test_integers_within_their_bounds_pass(value):
    assert type(require_integer("n", value, high=5)) is int
    assert require_integer("n", value, high=5) == value


def test_bounds_of_a_vector_hold_for_every_entry_and_both_ways():
    assert require_vector("v", [2.0, -2.0, 0.0], 2.0) == (2.0, -2.0, 0.0)
    for i, value in ((0, 2.1), (1, -2.1), (2, math.inf)):
        entries = [0.0, 0.0, 0.0]
        entries[i] = value
        with pytest.raises(InvalidValueError, match=rf"v\[{i}\]"):
            require_vector("v", entries, 2.0)


def test_a_choice_may_be_anything_and_is_refused_by_name():
    with pytest.raises(UnknownNameError, match=r"unknown side \['left'\] \(valid: left, right\)"):
        require_choice("side", ["left"], ("left", "right"))


def test_kinds_are_named():
    assert require_kind("limits", 3, int) == 3
    with pytest.raises(InvalidValueError, match="limits must be a dict, got 3"):
        require_kind("limits", 3, dict)
