"""Which trial counts as the best one."""

from push_recovery.eval.tuning.study import best_of


def trial(number, score, stopped=False):
    return {"trial": number, "score": score, "stopped": stopped}


def test_the_best_has_met_every_scenario_and_of_equal_ones_came_first():
    rows = [trial(0, 0.4), trial(1, 0.6), trial(2, 0.9, stopped=True), trial(3, 0.6), trial(4, 0.5)]
    assert best_of(rows)["trial"] == 1
    assert best_of(rows[2:])["trial"] == 3
