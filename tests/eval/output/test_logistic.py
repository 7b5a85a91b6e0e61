"""The fit against published values, and against statsmodels 0.15 (values written down here)."""

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.statistics import fit_logistic

# O-rings of 23 flights of the Space Shuttle by temperature [degrees F] (Dalal, Fowlkes and Hoadley 1989)
TEMPERATURE = [66, 70, 69, 68, 67, 72, 73, 70, 57, 63, 70, 78, 67, 53, 67, 75, 70, 81, 76, 79, 75, 76, 58]
DISTRESS = [0, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 1]
# Male budworms killed of 20 at each log2 dose (Collett 1991, Venables and Ripley 2002, section 7.2)
DOSE = np.repeat(range(6), 20)
KILLED = np.concatenate([[1] * n + [0] * (20 - n) for n in (1, 4, 9, 13, 18, 20)])


def test_the_published_fit_of_the_o_rings():
    fit = fit_logistic(TEMPERATURE, DISTRESS)
    assert fit is not None
    np.testing.assert_allclose([fit.intercept, fit.slope], [15.0429, -0.2322], atol=5e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), [7.3786, 0.1082], atol=5e-5)


def test_fit_and_band_are_those_of_statsmodels():
    fit = fit_logistic(DOSE, KILLED)
    assert fit is not None
    np.testing.assert_allclose([fit.intercept, fit.slope], [-2.81855497, 1.25894942], atol=1e-7)
    np.testing.assert_allclose(
        fit.covariance, [[0.30028956, -0.10267712], [-0.10267712, 0.04497177]], atol=1e-7
    )
    at = [0.0, 2.0, 5.0]
    np.testing.assert_allclose(fit.probability(at), [0.056330, 0.425397, 0.970003], atol=1e-6)
    low, high = fit.band(at)
    np.testing.assert_allclose(low, [0.019985, 0.306350, 0.903784], atol=1e-6)
    np.testing.assert_allclose(high, [0.148740, 0.553773, 0.991097], atol=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.95])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_interval_ends_where_the_band_crosses_the_share(share, sign):
    fit = fit_logistic(sign * DOSE, KILLED)
    assert fit is not None
    interval = fit.input_interval(share)
    assert interval is not None
    low, high = interval
    assert low < fit.input_at(share) < high
    assert fit.probability(fit.input_at(share)) == pytest.approx(share)
    ends = (high, low) if sign > 0 else (low, high)  # of the band's lower and upper side
    assert fit.band(ends[0])[0] == pytest.approx(share)
    assert fit.band(ends[1])[1] == pytest.approx(share)


def test_no_interval_where_the_slope_may_be_none():
    fit = fit_logistic([0, 1, 2, 3, 0, 1, 2, 3], [1, 0, 1, 0, 0, 1, 0, 1])
    assert fit is not None
    assert fit.input_interval(0.5) is None


@pytest.mark.parametrize(
    "yes", [[1, 1, 1, 1], [0, 0, 0, 0], [0, 0, 1, 1], [1, 1, 0, 0]], ids=["all", "none", "above", "below"]
)
def test_no_fit_without_an_overlap(yes):
    assert fit_logistic([1.0, 2.0, 3.0, 4.0], yes) is None


def test_units_of_the_input_do_not_matter():
    one, other = fit_logistic(DOSE, KILLED), fit_logistic(1000.0 * DOSE + 7.0, KILLED)
    assert one is not None
    assert other is not None
    assert other.input_at(0.5) == pytest.approx(1000.0 * one.input_at(0.5) + 7.0)
    assert other.input_interval(0.9) == pytest.approx(
        [1000.0 * end + 7.0 for end in one.input_interval(0.9) or ()]
    )


@pytest.mark.parametrize(("x", "yes"), [([1.0, 2.0], [1]), ([1.0, np.nan, 3.0], [1, 0, 1])])
def test_bad_inputs(x, yes):
    with pytest.raises(InvalidValueError, match="inputs"):
        fit_logistic(x, yes)
