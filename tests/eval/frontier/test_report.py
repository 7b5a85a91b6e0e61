"""The frontier's table on rows written by hand."""

from pathlib import Path

from push_recovery.eval.score.frontier import (
    DirectionLimits,
    Frontier,
    FrontierSettings,
    frontier_cells,
    frontier_columns,
)


def row(psi, survived, largest):
    return {"policy": "p", "psi_deg": psi, "survived_N": survived, "largest_survived_N": largest, "falls": []}


FRONTIER = Frontier(
    FrontierSettings("env"),
    {"p": [row(0.0, 100.0, 100.0), row(180.0, 150.0, 240.0)]},
    {0.0: DirectionLimits(own=400.0, paper=200.0), 180.0: DirectionLimits(own=300.0, paper=0.0)},
    Path("out"),
)


def test_shares_are_of_the_own_box_then_of_the_papers():
    first, second = frontier_cells(FRONTIER)
    assert first == ("0", "400", "200", "100 (0.25, 0.50)", "-")
    assert second == ("180", "300", "0", "150 (0.50, -; 240)", "-")  # more survived beyond the first failure
    assert len(frontier_columns(FRONTIER)) == len(first)


def test_the_contracts_object_holds_both_limits():
    entry, _ = FRONTIER.to_dict("p")["directions"]
    assert entry == {
        "psi_deg": 0.0, "survived_N": 100.0, "largest_survived_N": 100.0, "limit_N": 200.0, "fraction": 0.5,
        "own_limit_N": 400.0, "own_fraction": 0.25,
    }  # fmt: skip
