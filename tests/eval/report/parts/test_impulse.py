"""Thresholds told only where pushes were given; groups of equally many pushes."""

import numpy as np
import pytest
from push_recovery.eval.output.statistics import LogisticFit, fit_logistic
from push_recovery.eval.report.pushes import Curve, binned, curve_cells, curve_figure, curves_of
from push_recovery.eval.score.suites import quick_suite

IMPULSE = np.linspace(50.0, 200.0, 40)
SURE = np.diag([1e-6, 1e-12])


def curve(intercept: float, slope: float, covariance=SURE, yes=None) -> Curve:
    recovered = np.arange(40) % 2 == 0 if yes is None else np.full(40, yes)
    return Curve("p", "pelvis", IMPULSE, recovered, LogisticFit(intercept, slope, np.asarray(covariance)))


def test_a_threshold_is_where_the_curve_meets_the_share():
    assert curve(12.0, -0.1).threshold(0.5) == "120"
    assert curve(12.0, -0.1).threshold(0.95) == "91"  # (12 - log 19) / 0.1 = 90.6


def test_nothing_is_told_beyond_the_pushes_given():
    assert curve(3.0, -0.1).threshold(0.5) == "under 50"
    assert curve(30.0, -0.1).threshold(0.5) == "over 200"
    wide = curve(19.0, -0.1, [[0.09, 0.0], [0.0, 1e-12]]).threshold(0.5)  # +-1.96 x 0.3 / 0.1
    assert wide == "190 (184 to 196)"
    assert curve(19.0, -0.1, [[4.0, 0.0], [0.0, 1e-12]]).threshold(0.5) == "190 (151 to over 200)"


def test_no_threshold_without_a_slope_downwards():
    assert curve(-12.0, 0.1).threshold(0.5) == "not told"
    assert curve(12.0, -0.1, np.diag([1e-6, 1.0])).threshold(0.5) == "not told"
    assert Curve("p", "pelvis", IMPULSE, IMPULSE < 100.0, None).threshold(0.5) == "not told"


def test_all_or_none_recovered():
    assert curve(0.0, -1.0, yes=True).threshold(0.95) == "over 200"
    assert curve(0.0, -1.0, yes=False).threshold(0.95) == "under 50"


def test_a_curve_for_each_body_over_its_single_pushes():
    scenarios = quick_suite().scenarios
    sizes = [s.pushes[0].impulse_magnitude for s in scenarios]
    rows = [{"impulse": size, "recovered": size < 100.0 + 50.0 * (i % 2)} for i, size in enumerate(sizes)]
    pelvis, trunk = curves_of(scenarios, rows, "p")
    single = [s.pushes[0] for s in scenarios if len(s.pushes) == 1]
    assert (pelvis.body, trunk.body) == ("pelvis", "trunk")
    assert pelvis.impulse.tolist() == [p.impulse_magnitude for p in single if p.body == "pelvis"]
    assert trunk.impulse.size == sum(p.body == "trunk" for p in single)
    expected = fit_logistic(pelvis.impulse, pelvis.recovered)
    assert expected is not None
    assert pelvis.fit is not None
    assert pelvis.fit.slope == expected.slope < 0.0
    cells = curve_cells([pelvis, trunk])
    assert cells[0][:3] == ("p", "pelvis", str(pelvis.impulse.size))
    assert curve_figure([pelvis, trunk], 200.0).startswith("<svg")


def test_groups_are_equally_large_and_reach_as_far_as_wilson():
    centres, share, below, above = binned(np.arange(12.0), np.arange(12) < 5)
    assert centres.tolist() == [0.5, 2.5, 4.5, 6.5, 8.5, 10.5]
    assert share.tolist() == [1.0, 1.0, 0.5, 0.0, 0.0, 0.0]
    assert above[0] == 0.0
    assert below[0] == pytest.approx(1.0 - 0.342, abs=5e-4)  # Wilson of 2 of 2 begins at 0.342
    assert (below[2], above[2]) == pytest.approx((0.4055, 0.4055), abs=5e-4)  # of 1 of 2: 0.0945 to 0.9055
