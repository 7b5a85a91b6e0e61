import json

import pytest
from push_recovery.controllers.errors import InvalidValueError, UnknownNameError
from push_recovery.eval.cli.main import main
from push_recovery.eval.score.suites import HARD_SEED, KINDS, get_suite, hard_suite, load_suite, new_suite


@pytest.mark.parametrize("like", KINDS)
def test_a_suite_follows_from_its_seed(like):
    first, again, other = (new_suite(like, seed, 20) for seed in (1, 1, 2))
    assert first == again
    assert (first.name, len(first.scenarios)) == (f"{like}-1", 20)
    assert not {(s.pushes, s.errors) for s in first.scenarios} & {
        (s.pushes, s.errors) for s in other.scenarios
    }


def test_the_draw_is_that_of_the_named_suite():
    drawn = new_suite("hard", HARD_SEED, 1024, "hard")
    assert drawn.sha256 == hard_suite().sha256
    assert new_suite("shift-floor", 20261207, name="shift-floor") == get_suite("shift-floor")


def test_other_ranges():
    ranges = {"impulse_min": 150.0, "impulse_max": 180.0, "push_duration": 0.2}
    pushes = [s.pushes[0] for s in new_suite("hard", 3, 256, pushes=ranges).scenarios]
    assert {push.duration for push in pushes} == {0.2}
    assert min(push.impulse_magnitude for push in pushes) == pytest.approx(150.0, abs=0.2)
    assert max(push.impulse_magnitude for push in pushes) == pytest.approx(180.0, abs=0.2)


@pytest.mark.parametrize(
    "pushes",
    [
        {"direction_min": 0.0}, {"errors": {}}, {"impuls": 1.0}, {"turn": 0.1}, {"bodies": ["trunk"]},
        {"push_duration_ratio": 2.0}, {"pushes_max": 2},
    ],
)  # fmt: skip
def test_ranges_that_would_do_nothing_are_refused(pushes):
    with pytest.raises((InvalidValueError, UnknownNameError)):
        new_suite("hard", 3, pushes=pushes)


def test_what_cannot_be_drawn():
    with pytest.raises(UnknownNameError, match="shift-body"):
        new_suite("shift-boddy")
    with pytest.raises(InvalidValueError, match="'varied'"):
        new_suite("varied", pushes={"impulse_min": 10.0})
    with pytest.raises(InvalidValueError, match="scenarios"):
        new_suite("varied", scenarios=0)
    with pytest.raises(InvalidValueError, match="impulse_max"):
        new_suite("hard", pushes={"impulse_min": 300.0})


def test_the_command_writes_what_evaluate_reads(tmp_path, capsys):
    path = tmp_path / "mine.json"
    argv = ["suite", "new", "--seed", "5", "--like", "shift-model", "--scenarios", "8", "--out", str(path)]
    assert main([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {**load_suite(path).summary(), "out": str(path)}
    assert get_suite(str(path)) == new_suite("shift-model", 5, 8)
    assert main(["suite", "new", "--seed", "5", "--pushes", "[1]", "--out", str(path)]) == 2
    assert "JSON object" in capsys.readouterr().err
