"""What differs between two robots, in words."""

from push_recovery.controllers.validation import differences


def test_entries_that_differ_are_told_with_both_values():
    there = {"mass": 60.0, "trunk_pitch": True, "foot_length": 0.2, "name": "biped"}
    here = {"mass": 33.341142, "trunk_pitch": False, "foot_length": 0.2, "name": "g1"}
    told = "mass 60 there and 33.34 here, trunk_pitch True there and False here, name biped there and g1 here"
    assert differences(there, here) == told


def test_rounding_and_entries_of_one_side_are_no_difference():
    assert differences({"mass": 60.0, "old": 1}, {"mass": 60.0 + 1e-12, "new": 2}) == ""
    assert differences({"steps": 2}, {"steps": 3}) == "steps 2 there and 3 here"
    assert differences({"flag": True}, {"flag": 1.0}) == ""
