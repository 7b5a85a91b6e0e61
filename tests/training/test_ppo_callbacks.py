"""What is told between two updates."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from push_recovery.training.run import Progress

FELL = {"failure_reason": "low", "recovered_at": 1.0}  # it had recovered, and fell all the same
STOOD = {"failure_reason": None, "recovered_at": None}
RECOVERED = {"failure_reason": None, "recovered_at": 0.0}


class Logger:
    def __init__(self):
        self.values = {}

    def record(self, name, value):
        self.values[name] = value


def ended(progress: Progress, *infos) -> None:
    progress.locals = {"dones": np.ones(len(infos), np.bool_), "infos": list(infos)}
    assert progress.on_step()


def test_recovered_is_standing_and_settled(monkeypatch):
    told, logger = [], Logger()
    progress = Progress(lambda timesteps, share: told.append(share))
    monkeypatch.setattr(Progress, "logger", logger)
    progress._on_rollout_end()
    assert told == [None]  # no episode has ended yet
    progress.model = type("Model", (), {"num_timesteps": 0})()  # type: ignore[assignment]
    ended(progress, FELL, STOOD, RECOVERED, RECOVERED)
    progress._on_rollout_end()
    assert told == [None, 0.5]
    assert logger.values == {"rollout/recovered": 0.5}


def test_only_episodes_that_end_count(monkeypatch):
    progress = Progress(lambda timesteps, share: None)
    progress.model = type("Model", (), {"num_timesteps": 0})()  # type: ignore[assignment]
    progress.locals = {"dones": np.array([False, True, False]), "infos": [RECOVERED, FELL, RECOVERED]}
    progress.on_step()
    assert list(progress.recovered) == [False]
