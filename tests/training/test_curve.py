"""Points of the learning curve on outcomes written by hand."""

from types import SimpleNamespace

import pytest

pytest.importorskip("stable_baselines3")
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.training import run as curve


def outcome(recovered, survived, reward):
    return SimpleNamespace(recovered=recovered, survived=survived, total_reward=reward)


def test_shares_of_recovered_and_survived_and_the_mean_reward(monkeypatch, tmp_path):
    outcomes = [
        outcome(True, True, 4.0), outcome(False, True, 2.0), outcome(False, True, -1.0),
        outcome(False, False, -3.0),
    ]  # fmt: skip
    monkeypatch.setattr(curve, "rollout_all", lambda *arguments: outcomes)
    point = curve.score(None, None, [], 512, 1.23456)  # type: ignore[arg-type]
    assert point == curve.CurvePoint(512, 1.235, 4, 0.25, 0.75, 0.5)
    curve.write_curve(tmp_path / "curve.csv", [point])
    assert curve.read_curve(tmp_path / "curve.csv") == [point]


def test_a_file_that_is_no_curve_is_refused(tmp_path):
    (tmp_path / "curve.csv").write_text("timesteps,seconds\n1,soon\n")
    with pytest.raises(InvalidValueError, match="is no learning curve"):
        curve.read_curve(tmp_path / "curve.csv")
    assert curve.read_curve(tmp_path / "none.csv") == []
