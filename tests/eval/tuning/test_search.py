import sys

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError, MissingExtraError
from push_recovery.eval.tuning.space import Dimension, Space
from push_recovery.eval.tuning.study import Search, Z, clearly_worse, estimate, race, rungs

BOX = Space(tuple(Dimension("g", f"x{i}", -4.0, 4.0, 1.0) for i in range(4)), (0.0,) * 4)
TARGET = np.array([2.0, -1.0, 0.5, 6.0])  # the last one outside the box


def run(seed: int, trials: int) -> list[np.ndarray]:
    search = Search(BOX, seed)
    points = []
    for _ in range(trials):
        points.append(search.ask())
        search.tell(points[-1], -float(np.sum((points[-1] - TARGET) ** 2)))
    return points


def test_search_finds_the_best_point_of_the_box():
    np.testing.assert_allclose(run(1, 600)[-1], [2.0, -1.0, 0.5, 4.0], atol=0.02)


def test_proposals_are_a_function_of_seed_and_scores():
    first = np.array(run(5, 40))
    assert np.array_equal(first, run(5, 40))
    assert not np.array_equal(first, run(6, 40))
    assert (np.abs(first) <= 4.0).all()


def test_search_needs_two_fields():
    with pytest.raises(InvalidValueError, match=r"^a search needs at least 2 fields, got 1$"):
        Search(Space(BOX.dimensions[:1], (0.0,)), 0)


def test_missing_package_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(MissingExtraError, match=r"^cmaes is not installed.*'push-recovery\[tune\]'$"):
        Search(BOX, 0)


def test_estimate_is_exact_for_a_constant_difference():
    best = np.linspace(0.0, 0.9, 64)
    assert estimate(best[:16] - 0.1, best) == pytest.approx(best.mean() - 0.1)
    assert estimate(best, ()) == pytest.approx(best.mean())


def test_clearly_worse_is_the_one_sided_bound_of_the_paired_difference():
    """k losses in n pairs: mean -k/n, sample variance (k/n)(1 - k/n) n/(n-1)."""
    n, best = 64, np.ones(128)
    for losses in range(8):
        values = np.ones(n)
        values[:losses] = 0.0
        p = losses / n
        bound = -p + Z * np.sqrt(p * (1 - p) / (n - 1))
        assert clearly_worse(values, best) == (bound < 0.0), losses
    assert not clearly_worse(np.zeros(128), best)  # nothing is left to save


def test_race_stops_at_the_rung_where_a_trial_is_clearly_worse():
    assert rungs(256) == [64, 128, 256]
    best = [1.0] * 256
    assert len(race(lambda a, b: [0.0] * (b - a), 256, best)) == 64
    assert len(race(lambda a, b: [1.0] * (b - a), 256, best)) == 256
    assert len(race(lambda a, b: [0.0] * (b - a), 256, [])) == 256  # no best yet
    asked = []
    race(lambda a, b: asked.append((a, b)) or best[a:b], 256, best)
    assert asked == [(0, 64), (64, 128), (128, 256)]
