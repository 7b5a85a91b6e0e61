import math

import pytest
from push_recovery.training.starts import DIRECTIONS, SuccessTable


def test_pushes_of_even_odds_are_all_taken_and_sure_ones_by_the_floor():
    table = SuccessTable(100.0, 0.1)
    for share, probability in ((0.0, 0.1), (0.5, 1.0), (1.0, 0.1), (0.25, 0.1 + 0.9 * 0.75)):
        table.shares[2, 3] = share
        assert table.probability((2, 3)) == pytest.approx(probability)
    assert SuccessTable(100.0, 1.0).probability((0, 0)) == 1.0


def test_bins_are_eighths_of_a_turn_and_twenty_newton_seconds():
    table = SuccessTable(90.0, 0.1)
    assert table.shares.shape == (DIRECTIONS, 5)
    assert table.bin_of(0.0, 0.0) == (0, 0)
    assert table.bin_of(math.radians(44.9), 19.9) == (0, 0)
    assert table.bin_of(math.radians(45.1), 20.0) == (1, 1)
    assert table.bin_of(-1e-9, 90.0) == (7, 4)
    assert table.bin_of(-math.pi / 2 - 0.1, 1e3) == (5, 4)


def test_bins_of_another_robot_have_their_own_width():
    table = SuccessTable(45.0, 0.1, 10.0)
    assert table.shares.shape == (DIRECTIONS, 5)
    assert table.bin_of(0.0, 19.9) == (0, 1)
    assert table.bin_of(0.0, 45.0) == (0, 4)


def test_a_share_follows_what_is_told_of_its_bin_alone():
    table = SuccessTable(40.0, 0.1)
    table.tell((1, 0), True)
    table.tell((4, 1), False)
    assert table.shares[1, 0] == pytest.approx(0.525)
    assert table.shares[4, 1] == pytest.approx(0.475)
    assert (table.shares == 0.5).sum() == table.shares.size - 2
    for _ in range(200):
        table.tell((1, 0), True)
    assert table.shares[1, 0] == pytest.approx(1.0, abs=1e-4)
