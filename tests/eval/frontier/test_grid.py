"""The scan of pushes on hand-written outcomes."""

from itertools import count, islice

import pytest
from push_recovery.eval.score.frontier import FORCE_CAP, Scanned, multiples, scan_upwards


def test_the_largest_before_the_first_failure_and_at_all():
    found = Scanned.of({30.0: False, 10.0: True, 20.0: True, 40.0: True, 50.0: False})
    assert found == Scanned(survived=20.0, largest_survived=40.0, failed=(30.0, 50.0))
    assert Scanned.of({10.0: False, 20.0: True}) == Scanned(0.0, 20.0, (10.0,))
    assert Scanned.of({10.0: True, 20.0: True}) == Scanned(20.0, 20.0, ())
    assert Scanned.of({}) == Scanned(0.0, 0.0, ())


@pytest.mark.parametrize("at_once", [1, 2, 5, 50])
def test_a_scan_ends_so_far_past_the_first_failure_whatever_runs_at_once(at_once):
    asked = []

    def run(strengths):
        while chunk := list(islice(strengths, at_once)):
            asked.extend(chunk)
            yield from ((strength, strength not in {7.0, 9.0}) for strength in reversed(chunk))

    found = scan_upwards(run, (float(k) for k in count(1)), 3.0, bool)
    assert found == {float(k): k not in {7, 9} for k in range(1, 11)}
    assert list(found) == sorted(found)
    assert len(asked) < 11 + at_once


def test_a_scan_without_failure_takes_every_strength():
    assert scan_upwards(lambda strengths: ((s, True) for s in strengths), [1.0, 2.0], 0.5, bool) == {
        1.0: True, 2.0: True,
    }  # fmt: skip


def test_multiples_end_at_the_cap():
    assert list(multiples(1500.0)) == [1500.0, 3000.0]
    assert list(multiples(20.0))[-1] == FORCE_CAP
    assert list(multiples(FORCE_CAP)) == [FORCE_CAP]
    assert len(list(multiples(0.1))) == 40000  # 4000 / 0.1 is 40000 but for rounding
