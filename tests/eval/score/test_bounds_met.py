"""The bounds that bipeds meet, from rollouts to tables."""

import pytest
from push_recovery.controllers.whole_body.limits import BOUNDS
from push_recovery.envs.biped.env import BipedEpisodes
from push_recovery.envs.scenario.push import polar_push
from push_recovery.envs.scenario.scenario import Scenario
from push_recovery.eval.rollout.environments import make_env
from push_recovery.eval.rollout.episodes import rollout, rollout_batch
from push_recovery.eval.rollout.load_policy import load_policy
from push_recovery.eval.score.evaluate import COLUMNS, bound_cells, bound_summary, fall_cell, first_bounds


def row(survived, first, **shares):
    return {"survived": survived, "recovered": survived, "first_limit": first, "limit_shares": shares}


ROWS = [
    row(False, "cop", cop=0.5, contact=0.2),
    row(False, "contact", contact=0.4),
    row(False, "cop", cop=0.1),
    row(True, "cop", cop=0.2),
    row(True, None),
    {**row(True, "contact", contact=0.9), "recovered": False},  # stands unsettled: neither
]


def test_falls_and_recoveries_are_counted_apart():
    summary = bound_summary(ROWS)
    assert summary["falls"] == {
        "cop": {"first": 2, "met": pytest.approx(2 / 3), "time": pytest.approx(0.2)},
        "contact": {"first": 1, "met": pytest.approx(2 / 3), "time": pytest.approx(0.2)},
    }
    assert summary["recovered"] == {"cop": {"first": 1, "met": 0.5, "time": 0.1}}
    assert first_bounds(ROWS) == "cop 2, contact 1"
    assert first_bounds(ROWS[3:]) == "-"


def test_a_fall_is_told_by_the_bound_met_first_and_the_three_met_longest():
    shares = {"cop": 0.25, "contact": 0.5, "sole_edge": 0.125, "leg_reach": 0.5}
    falls = [{"first_limit": "sole_edge", "limit_shares": shares}, {"first_limit": "cop", "limit_shares": {}}]
    longest = sorted(("contact", "leg_reach"), key=BOUNDS.index)  # of equal ones in the order of the bounds
    assert fall_cell(falls) == f"sole_edge; {longest[0]} 0.50, {longest[1]} 0.50, cop 0.25"
    assert fall_cell([{"first_limit": None, "limit_shares": {}}]) == "-"


def test_cells_follow_the_order_of_the_limits():
    cells = bound_cells(ROWS)
    assert [cell[0] for cell in cells] == [name for name in BOUNDS if name in {"cop", "contact"}]
    assert cells[0] == ("cop", "2", "0.67", "0.20", "0.50", "0.10")
    assert {len(cell) for cell in cells} == {len(COLUMNS)}
    assert bound_cells(ROWS[4:5]) == []


def test_an_outcome_says_what_was_met_and_when_the_same_alone_and_in_a_batch():
    env = make_env("PushRecovery/Biped-v0")
    policy = load_policy("two-stage", env)
    pushes = {"weak": 1.0, "strong": 250.0, "far too strong": 900.0}
    scenarios = [Scenario(n, (polar_push(f, 1.0, 0.1, 0.5),), settle_time=0.6) for n, f in pushes.items()]
    batch = {out.scenario_id: out for out in rollout_batch(BipedEpisodes(3), policy, scenarios, "two-stage")}
    for scenario in scenarios:
        assert rollout(env, policy, scenario, "two-stage").to_dict() == batch[scenario.id].to_dict()
    weak, strong, lost = (batch[name] for name in pushes)
    assert (weak.first_limit, weak.limits_met, weak.limit_shares) == (None, {}, {})
    assert strong.limits_met[strong.first_limit] == min(strong.limits_met.values()) >= 0.5
    assert sum(lost.limit_shares.values()) > sum(strong.limit_shares.values())
    assert len(lost.limits_met) >= len(strong.limits_met)


def test_an_environment_without_a_record_meets_nothing():
    env = make_env("PushRecovery/Pendulum-v0")
    scenario = Scenario("hard", (polar_push(900.0, 1.0, 0.1, 0.5),), settle_time=0.5)
    out = rollout(env, load_policy("two-stage", env), scenario, "two-stage")
    assert (out.first_limit, out.limits_met, out.limit_shares) == (None, {}, {})
