"""`compare` on rows written by hand, where surviving and recovering differ."""

import json

import pytest
import toy_gait_env as toy
from push_recovery.eval.score.evaluate import compare, evaluate
from push_recovery.eval.score.suites import Suite, standard_suite

SUITE = Suite("ten", "1", standard_suite().scenarios[:10])
#        both  only a    only b  neither
OF_A = [1, 1, 1, 1, 1, 1, 0, 0, 0, 0]  # recovered
OF_B = [1, 1, 0, 0, 0, 0, 1, 0, 0, 0]
A_STOOD = [1, 1, 1, 1, 1, 1, 1, 1, 0, 0]  # survived
B_STOOD = [1, 1, 1, 1, 1, 1, 1, 1, 1, 0]


def test_pairs_are_counted_by_what_recovered(tmp_path):
    a, b = (
        toy.save_policy(tmp_path / f"{name}.safetensors", gain) for name, gain in (("a", 0.2), ("b", 8.0))
    )
    evaluate(SUITE, toy.ENV_ID, [a, b], 1, tmp_path / "out")
    path = tmp_path / "out" / "outcomes.jsonl"
    place = {scenario.id: i for i, scenario in enumerate(SUITE.scenarios)}
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    for row in rows:
        i, (recovered, survived) = (
            place[row["scenario_id"]],
            {a: (OF_A, A_STOOD), b: (OF_B, B_STOOD)}[row["policy"]],
        )
        row["recovered"], row["survived"] = bool(recovered[i]), bool(survived[i])
        row["failure_reason"] = None if survived[i] else "height"
    path.write_text("".join(json.dumps(row) + "\n" for row in reversed(rows)))
    found = compare(a, b, SUITE, toy.ENV_ID, directory=tmp_path / "out").to_dict()
    assert (found["a"], found["b"], found["suite"], found["pairs"]) == (a, b, "ten", 10)
    assert [found[key] for key in ("both", "only_a", "only_b", "neither")] == [2, 4, 1, 3]
    assert found["rate_difference"] == pytest.approx(0.3)
    assert found["mcnemar_p"] == pytest.approx(2 * (5 + 1) / 2**5)  # at least 4 of 5, both tails
    assert (found["survived_a"], found["survived_b"]) == (8, 9)
    low, high = found["ci95"]
    assert low < 0.3 < high
    turned = compare(b, a, SUITE, toy.ENV_ID, directory=tmp_path / "out").to_dict()
    assert (turned["only_a"], turned["only_b"], turned["rate_difference"]) == (1, 4, pytest.approx(-0.3))
    assert turned["ci95"] == pytest.approx([-high, -low], abs=0.11)  # of a grid of tenths
