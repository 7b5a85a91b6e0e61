import numpy as np
from push_recovery.eval.search import CrossEntropy, as_text


def method(seed: int = 0, population: int = 40, elites: int = 5, least: float = 0.05) -> CrossEntropy:
    return CrossEntropy(np.random.default_rng(seed), np.zeros(3), np.full(3, 0.8), population, elites, least)


def test_candidates_are_normal_and_clipped():
    drawn = method(population=20_000).ask()
    assert drawn.dtype == np.float32
    assert np.abs(drawn).max() == 1.0
    inside = np.abs(drawn) < 1.0
    assert abs(inside.mean() - 0.789) < 0.01  # P(|z| < 1 / 0.8)
    assert np.abs(np.median(drawn, axis=0)).max() < 0.03


def test_files_hold_candidates_exactly():
    drawn = method().ask()
    told = as_text(drawn)
    assert max(len(repr(number)) for row in told for number in row) <= len("-0.1234")
    np.testing.assert_array_equal(np.array(told, np.float32), drawn)


def test_the_next_generation_is_drawn_about_the_elites():
    search = method(population=4, elites=2)
    candidates = np.array([[0, 0, 0], [0.4, 0.2, 1], [9, 9, 9], [0.6, 0.2, 0]], np.float32)
    search.tell(candidates, np.array([1.0, 5.0, -3.0, 4.0]))
    np.testing.assert_allclose(search.mean, [0.5, 0.2, 0.5], atol=1e-7)
    np.testing.assert_allclose(search.spread, [0.1, 0.05, 0.5], atol=1e-7)


def test_of_equal_candidates_the_first_are_taken():
    search = method(population=3, elites=2, least=1e-9)
    search.tell(np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]], np.float32), np.zeros(3))
    np.testing.assert_allclose(search.mean, [0.0, 0.5, 0.5])


def test_it_finds_a_maximum_and_the_same_one_again():
    goal, found = np.array([0.6, -0.9, 0.1]), []
    for _ in range(2):
        search = method(seed=3)
        for _ in range(15):
            candidates = search.ask()
            search.tell(candidates, -np.abs(candidates - goal).max(axis=1))
        found.append(search.mean)
    assert np.abs(found[0] - goal).max() < 0.05
    assert found[0].tolist() == found[1].tolist()
