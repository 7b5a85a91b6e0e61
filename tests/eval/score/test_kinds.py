"""Counts by kind of push, on rows written by hand."""

from push_recovery.envs.scenario.push import Push
from push_recovery.envs.scenario.scenario import Command, Scenario
from push_recovery.eval.score.report import groups_of, kind_cells
from push_recovery.eval.score.suites import standard_suite

FORCE = (100.0, 0.0, 0.0)
PELVIS, TRUNK = Push(FORCE, 0.1, 1.0), Push(FORCE, 0.1, 1.0, "trunk")
SCENARIOS = (
    Scenario("a", (PELVIS,)),
    Scenario("b", (TRUNK,), Command(0.1)),
    Scenario("c", (TRUNK, TRUNK), Command(0.1)),
    Scenario("d", (PELVIS, TRUNK), Command(-0.1)),
)


def row(name, recovered, survived):
    return {"scenario_id": name, "recovered": recovered, "survived": survived}


def test_recovered_and_survived_are_counted_in_each_group():
    rows = [row("d", False, True), row("a", True, True), row("c", False, False), row("b", True, True)]
    assert kind_cells(SCENARIOS, rows) == {
        "pelvis": "1 / 1 of 1",
        "pelvis and trunk": "0 / 1 of 1",
        "trunk": "1 / 1 of 2",
        "double": "0 / 1 of 2",
        "single": "2 / 2 of 2",
        "backward": "0 / 1 of 1",
        "forward": "1 / 1 of 2",
        "in place": "1 / 1 of 1",
    }


def test_a_kind_of_one_group_only_tells_nothing():
    """All of `standard` are single pushes at the pelvis."""
    assert set(groups_of(standard_suite().scenarios)) == {"backward", "forward", "in place", "sideways"}
    assert groups_of(SCENARIOS[:1]) == {}
