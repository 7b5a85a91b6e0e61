"""Kaplan-Meier against a published table and against the plain share."""

import math

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.statistics import kaplan_meier

# Remission of 21 patients on 6-mercaptopurine [weeks], Freireich et al. (1963); the estimate as tabled in
# Kleinbaum and Klein, Survival Analysis.
RELAPSED = (6, 6, 6, 7, 10, 13, 16, 22, 23)
CENSORED = (6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35)
TABLE = {6: 0.8571, 7: 0.8067, 10: 0.7529, 13: 0.6902, 16: 0.6275, 22: 0.5378, 23: 0.4482}


def remission():
    return kaplan_meier((*RELAPSED, *CENSORED), [True] * len(RELAPSED) + [False] * len(CENSORED))


def test_it_is_the_published_table():
    curve = remission()
    for week, share in TABLE.items():
        assert curve.at(week) == pytest.approx(share, abs=5e-5)
    assert curve.at(5.99) == 1.0
    assert curve.at(9) == curve.at(7)  # a censored one changes nothing
    assert curve.at(100) == curve.at(23)


def test_the_interval_is_greenwoods_on_a_doubly_logarithmic_scale():
    curve = remission()
    at_risk = {6: 21, 7: 17, 10: 15, 13: 12, 16: 11, 22: 7, 23: 6}
    falls = {week: RELAPSED.count(week) for week in at_risk}
    for last in (6, 23):
        sums = sum(falls[w] / (at_risk[w] * (at_risk[w] - falls[w])) for w in at_risk if w <= last)
        share = math.prod(1 - falls[w] / at_risk[w] for w in at_risk if w <= last)
        reach = 1.959964 * math.sqrt(sums) / abs(math.log(share))
        index = int(np.flatnonzero(curve.times == last)[0])
        expected = share ** math.exp(reach), share ** math.exp(-reach)
        assert (curve.low[index], curve.high[index]) == pytest.approx(expected, rel=1e-6)


def test_without_censoring_it_is_the_share_that_stands():
    ends = [0.5, 2.0, 2.0, 3.5]
    curve = kaplan_meier(ends, [True] * 4)
    assert [curve.at(time) for time in (0.4, 0.5, 2.0, 3.5)] == pytest.approx([1.0, 0.75, 0.25, 0.0])


def test_where_nobody_or_everybody_falls_the_interval_is_whole():
    standing = kaplan_meier([4.0, 4.0, 4.0], [False] * 3)
    assert (standing.at(4.0), standing.low[0], standing.high[0]) == (1.0, 0.0, 1.0)
    fallen = kaplan_meier([1.0, 2.0], [True, True])
    assert (fallen.at(2.0), fallen.low[1], fallen.high[1]) == (0.0, 0.0, 1.0)
    assert 0.0 < fallen.low[0] < 0.5 < fallen.high[0] < 1.0


@pytest.mark.parametrize(
    ("ends", "fell"), [([], []), ([1.0], [True, False]), ([-1.0], [True]), ([float("nan")], [True])]
)
def test_bad_input_is_refused(ends, fell):
    with pytest.raises(InvalidValueError):
        kaplan_meier(ends, fell)
