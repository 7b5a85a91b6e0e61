"""Scans on hand-written outcomes, thresholds on curves whose truth is known, and the draw of replicas."""

import math
from itertools import count, islice

import numpy as np
import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.output.statistics import wilson_interval
from push_recovery.eval.score import threshold as scans
from scipy.stats import norm


def test_the_largest_before_the_first_failure_and_at_all():
    found = scans.Scanned.of({30.0: False, 10.0: True, 20.0: True, 40.0: True, 50.0: False})
    assert found == scans.Scanned(survived=20.0, largest_survived=40.0, failed=(30.0, 50.0))
    assert scans.Scanned.of({10.0: False, 20.0: True}) == scans.Scanned(0.0, 20.0, (10.0,))
    assert scans.Scanned.of({10.0: True, 20.0: True}) == scans.Scanned(20.0, 20.0, ())
    assert scans.Scanned.of({}) == scans.Scanned(0.0, 0.0, ())


@pytest.mark.parametrize("at_once", [1, 2, 5, 50])
def test_a_scan_ends_so_far_past_the_first_failure_whatever_runs_at_once(at_once):
    asked = []

    def run(strengths):
        while chunk := list(islice(strengths, at_once)):
            asked.extend(chunk)
            yield from ((strength, strength not in {7.0, 9.0}) for strength in reversed(chunk))

    found = scans.scan_upwards(run, (float(k) for k in count(1)), 3.0, bool)
    assert found == {float(k): k not in {7, 9} for k in range(1, 11)}
    assert list(found) == sorted(found)
    assert len(asked) < 11 + at_once


def test_a_scan_without_failure_takes_every_strength():
    found = scans.scan_upwards(lambda strengths: ((s, True) for s in strengths), [1.0, 2.0], 0.5, bool)
    assert found == {1.0: True, 2.0: True}


def test_multiples_end_at_the_cap():
    assert list(scans.multiples(1500.0)) == [1500.0, 3000.0]
    assert list(scans.multiples(20.0))[-1] == scans.FORCE_CAP
    assert list(scans.multiples(scans.FORCE_CAP)) == [scans.FORCE_CAP]
    assert len(list(scans.multiples(0.1))) == 40000  # 4000 / 0.1 is 40000 but for rounding


@pytest.mark.parametrize("grid", [7.0, 10.0, 20.0, 100.0, 2500.0])
def test_coarse_forces_rise_on_the_grid_by_a_third_or_a_half_up_to_the_cap(grid):
    forces = np.array(list(scans.coarse_forces(grid)))
    assert np.allclose(forces / grid, np.round(forces / grid))
    assert forces[-1] == pytest.approx(scans.FORCE_CAP // grid * grid)
    assert forces[0] == pytest.approx(min(16 * grid, forces[-1]))
    assert np.isin(np.round(12 * forces[1:-1] / forces[:-2]), [16, 18]).all()
    assert len(forces) <= 12 or grid < 10.0


def test_replicas_are_a_latin_hypercube_and_a_function_of_number_and_seed():
    replicas = scans.draw_replicas(32, 5)
    assert replicas == scans.draw_replicas(32, 5)
    columns = np.array([(one.phase, *one.start.com, *one.start.lean) for one in replicas]).T
    degree = math.radians(1.0)
    spans = [(0.0, 1.0), *[(-1e-3, 1e-3)] * 2, *[(-degree, degree)] * 2]
    for column, (low, high) in zip(columns, spans, strict=True):
        cells = np.floor(32 * (column - low) / (high - low)).astype(int)
        assert sorted(cells) == list(range(32))
    assert (np.diff(columns[0]) > 0).all()
    assert np.abs(np.corrcoef(columns) - np.eye(5)).max() < 0.5
    assert len({one.noise_seed for one in replicas}) == 32
    other = scans.draw_replicas(32, 6)
    assert all(
        a.phase != b.phase and a.noise_seed != b.noise_seed for a, b in zip(replicas, other, strict=True)
    )


@pytest.mark.parametrize(
    ("count", "seed", "words"), [(0, 0, "replicas"), (5000, 0, "4096"), (8, -1, "replica_seed")]
)
def test_impossible_replicas_are_refused(count, seed, words):
    with pytest.raises(InvalidValueError, match=words):
        scans.draw_replicas(count, seed)


def test_a_threshold_does_not_lie_beyond_a_hole():
    """At 20 N a third of the replicas fail that recover again from 30 N."""
    found = tried("1" * 12, "1" * 12, "1" * 8 + "0" * 4, "1" * 12, "0" * 12)
    assert found.shares.tolist() == [1.0, 1.0, 8 / 12, 8 / 12, 0.0]
    (estimate,) = found.estimates((0.8,))
    assert estimate.force == pytest.approx(10.0 + 10.0 * 0.2 * 12 / 4)
    (half,) = found.estimates((0.5,))
    assert half.force == pytest.approx(30.0 + 10.0 * (8 / 12 - 0.5) / (8 / 12))


def test_a_share_is_reached_between_two_forces_by_their_straight_line():
    forces, shares = np.array([0.0, 100.0, 120.0, 200.0]), np.array([1.0, 0.9, 0.7, 0.0])
    for share, force in ((0.9, 100.0), (0.8, 110.0), (0.7, 120.0), (0.35, 160.0), (1.0, 0.0), (0.95, 50.0)):
        assert scans.force_at(forces, shares, share) == pytest.approx(force)
    assert scans.force_at(forces, shares - 0.5, 0.6) == 0.0  # not even unpushed
    assert scans.force_at(forces, shares + 1.0, 0.8) == 200.0  # at every force that was tried


def test_the_score_band_is_wilsons_interval():
    shares = np.array([0.0, 0.25, 0.8, 1.0])
    low, high = scans.score_band(shares, 20)
    expected = [wilson_interval(round(20 * share), 20) for share in shares]
    assert np.allclose(np.transpose([low, high]), expected)


def tried(*columns):
    """Outcomes at 0, 10, 20, ... N, as strings of replicas in the order of their phase."""
    return scans.Tried.of(
        {10.0 * k: scans.bools(bit == "1" for bit in text) for k, text in enumerate(columns)}
    )


def test_neighbours_in_phase_that_agree_count_as_more_replicas():
    half, mixed = tried("1" * 20, "1" * 10 + "0" * 10, "0" * 20), tried("1" * 20, "10" * 10, "0" * 20)
    assert half.effective_replicas(0.5) == pytest.approx(20 / ((1 + 1) / 2 / 19 / 0.25))
    assert mixed.effective_replicas(0.5) == 20
    assert tried("1" * 20, "0" * 20).effective_replicas(0.5) == 20  # nothing says that they hang together
    (narrow,), (wide,) = half.estimates((0.8,)), mixed.estimates((0.8,))
    assert narrow.force == wide.force == pytest.approx(4.0)
    assert wide.low <= narrow.low < 4.0 < narrow.high < wide.high


def test_first_failure_and_islands_are_those_of_single_replicas():
    """At 10 N the third fails, at 20 N the second, too; at 30 N the third recovers, at 40 N the second."""
    found = tried("1111", "1101", "1001", "1010", "0100")
    assert found.first_failure == 10.0
    assert found.islands == {30.0: 1, 40.0: 1}
    assert tried("11", "11", "10").islands == {}
    assert tried("11", "11").first_failure is None
    assert tried("10", "11", "00").first_failure == 0.0


def searched(limits, grid=20.0, shares=scans.SHARES):
    """Forces that a search tries, in order, on replicas that recover up to `limits`, and what comes of it."""
    asked = []

    def run(force):
        asked.append(force)
        return limits >= force

    return asked, scans.search(run, lambda yes: [(yes, shares)], grid)


def test_a_search_finds_each_share_to_a_cell_with_few_forces():
    limits = np.linspace(611.0, 1811.0, 25)
    asked, outcomes = searched(limits)
    assert len(asked) == len(set(asked)) == len(outcomes) <= 20
    assert list(outcomes) == sorted(outcomes)
    found = scans.Tried.of(outcomes)
    for share, estimate in zip(scans.SHARES, found.estimates(), strict=True):
        truth = np.sort(limits)[25 - math.ceil(share * 25)]  # the largest force from which that many recover
        assert truth - 20.0 <= estimate.force <= truth + 20.0
        cell = [force for force in found.forces if abs(force - estimate.force) <= 20.0]
        assert len(cell) >= 2
    weak, _ = searched(np.full(8, 10.0))  # below the first cell of the grid
    assert min(weak) == 20.0
    strong, outcomes = searched(np.full(8, math.inf))
    assert (strong[-1], len(strong)) == (scans.FORCE_CAP, 9)
    (estimate,) = scans.Tried.of(outcomes).estimates((0.8,))
    assert estimate.force == scans.FORCE_CAP


def test_a_second_series_is_searched_as_finely():
    """Half of the robots that stay up at 400 N have stepped from 150 N on."""
    limits, steps = np.full(10, 400.0), np.full(10, 155.0)
    outcomes = scans.search(
        lambda force: (limits >= force, steps >= force),
        lambda found: [(found[0], (0.8,)), (found[1], (0.8,))],
        20.0,
    )
    assert {140.0, 160.0, 400.0, 420.0} <= set(outcomes)


CURVES = {  # largest force [N] by phase, and the deviation of its noise
    "phase alone": (lambda phase: 600.0 * np.exp(1.2 * phase), 1.0),
    "noise alone": (lambda phase: 1500.0 + 0.0 * phase, 120.0),
    "weak in mid-step": (lambda phase: 900.0 + 500.0 * np.sin(2.0 * np.pi * phase), 60.0),
    "weak at first": (lambda phase: np.where(phase < 0.3, 500.0, 2000.0), 40.0),
}


@pytest.mark.parametrize("name", CURVES)
def test_intervals_hold_the_truth_as_often_as_they_say(name):
    """Robots whose largest forces are known by phase: truth from the distribution, not from replicas."""
    limit, noise = CURVES[name]
    forces, middles = np.arange(300.0, 3000.0, 2.0), (np.arange(2000) + 0.5) / 2000
    recovered = norm.sf((forces[:, None] - limit(middles)) / noise).mean(axis=1)
    truth = np.array([np.interp(-share, -recovered, forces) for share in scans.SHARES])
    runs, held, off = 60, np.zeros(3), np.zeros(3)
    for run in range(runs):
        rng = np.random.default_rng([run, 32])
        phases = (np.arange(32) + rng.random(32)) / 32
        _, outcomes = searched(limit(phases) + noise * rng.standard_normal(32))
        estimates = scans.Tried.of(outcomes).estimates()
        held += [one.low <= value <= one.high for one, value in zip(estimates, truth, strict=True)]
        off += [one.force - value for one, value in zip(estimates, truth, strict=True)]
    assert (held / runs >= 0.88).all(), held / runs
    assert abs(off[1]) / runs < 10.0  # the threshold itself is off by less than half a cell in the mean


def test_forces_count_by_how_near_their_share_up_to_there_is():
    """At 20 N 16 of 20 recover of which 10 do at 10 N: p is 0.5 at both, 1 and 8 changes, 2 x 19 = 38."""
    hole = tried("1" * 20, "1" * 10 + "0" * 10, "1110" * 4 + "1111", "0" * 20)
    assert hole.effective_replicas(0.5) == pytest.approx(20 / ((2 + 9) / 38 / (0.25 + 0.16)))
    falling, w = tried("1" * 20, "1" * 16 + "0" * 4, "10" * 10, "0" * 20), math.exp(-3.0)
    assert falling.effective_replicas(0.8) == pytest.approx(20 / ((2 + 20 * w) / 38 / (0.16 + 0.25 * w)))


def test_a_share_that_just_as_many_recover_from_is_reached():
    """Half of the robots recover up to 210 N, half up to 2010 N: J50 is the force of the stronger half."""
    _, outcomes = searched(np.array([210.0, 2010.0]))
    j95, _, j50 = scans.Tried.of(outcomes).estimates()
    assert 200.0 <= j95.force <= 220.0
    assert 2000.0 <= j50.force <= 2020.0


def test_noise_seeds_of_replicas_have_31_bits():
    assert 2**30 <= max(one.noise_seed for one in scans.draw_replicas(32, 5)) < 2**31
