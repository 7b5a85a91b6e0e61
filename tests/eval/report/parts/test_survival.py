import numpy as np
import pytest
from push_recovery.eval.output.statistics import kaplan_meier
from push_recovery.eval.report.pushes import share_at, survival_part


def test_only_scenarios_with_several_pushes_count(evaluation):
    found = evaluation({"a": "rsf" * 8, "b": "r" * 24})
    several = [len(scenario.pushes) > 1 for scenario in found.suite.scenarios]
    falls = sum(letter == "f" and many for letter, many in zip("rsf" * 8, several, strict=True))
    assert 0 < falls < sum(several) < 24
    for row, many in zip(found.rows["a"], several, strict=True):
        row["end_time"] = 9.0 if row["survived"] else 4.0 if many else 1.0
    part = survival_part(found, {"a": "first", "b": "second"})
    assert part is not None
    assert part.episodes == sum(several)
    assert part.columns == ["policy", "falls", "standing at 3.0 s", "standing at 6.0 s", "standing at 9.0 s"]
    first, second = part.rows
    assert first[:3] == ("first", str(falls), "100.0 %")
    share = 100.0 * (1.0 - falls / sum(several))
    assert float(first[3].split()[0]) == float(first[4].split()[0]) == pytest.approx(share, abs=0.05)
    assert second[:2] == ("second", "0")
    assert "first" in part.figure


def test_nothing_is_shown_of_single_pushes(evaluation):
    found = evaluation({"a": "rsf" * 8})
    single = [i for i, scenario in enumerate(found.suite.scenarios) if len(scenario.pushes) == 1]
    suite = type(found.suite)("single", "1", tuple(found.suite.scenarios[i] for i in single))
    rows = {"a": [found.rows["a"][i] for i in single]}
    assert survival_part(type(found)(suite, found.env_id, rows, found.directory, 0.0), {"a": "a"}) is None


def test_a_share_is_told_with_its_interval():
    curve = kaplan_meier([1.0, 2.0, 3.0, 3.0], [True, False, True, False])
    assert share_at(curve, 0.5) == "100.0 %"
    assert share_at(curve, 1.0).startswith("75.0 % (")
    assert share_at(curve, 3.0).startswith("37.5 % (")  # 3/4 of those before, and of two at risk one falls
    low, high = (float(part) for part in share_at(curve, 3.0).split("(")[1].rstrip(")").split(" to "))
    assert np.isclose(low, 100.0 * curve.low[-1], atol=0.05)
    assert np.isclose(high, 100.0 * curve.high[-1], atol=0.05)
