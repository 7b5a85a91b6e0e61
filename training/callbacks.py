"""What happens between two updates of PPO: progress, checkpoints, the learning curve."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from .curve import CurvePoint


class Progress(BaseCallback):
    """Reports timesteps after each of them, and the share of training episodes that recovered to TensorBoard.

    Args:
        report: Called with the timesteps so far and the recovered share of the last 100 episodes (or None).
    """

    def __init__(self, report: Callable[[int, float | None], None]):
        super().__init__()
        self.report = report
        self.recovered: deque[bool] = deque(maxlen=100)

    def _on_step(self) -> bool:
        ended: Any = self.locals["dones"]
        for index in np.flatnonzero(ended):
            info = self.locals["infos"][index]
            self.recovered.append(info.get("failure_reason") is None and info.get("recovered_at") is not None)
        return True

    def _on_rollout_end(self) -> None:
        share = float(np.mean(self.recovered)) if self.recovered else None
        if share is not None:
            self.logger.record("rollout/recovered", share)
        self.report(self.num_timesteps, share)


class Every(BaseCallback):
    """Calls `action` before a rollout whenever `period` timesteps have passed since it last did.

    Args:
        period: In timesteps.
        action: Called without arguments; sees the networks as the last update left them.
        start: Timesteps at which the count begins.
    """

    def __init__(self, period: int, action: Callable[[], None], start: int):
        super().__init__()
        self.period = period
        self.action = action
        self.last = start

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last >= self.period:
            self.last = self.num_timesteps
            self.action()

    def _on_step(self) -> bool:
        return True


def record_point(logger: Any, point: CurvePoint) -> None:
    """Put a point of the learning curve into TensorBoard."""
    for name in ("recovered", "survived", "mean_reward"):
        logger.record(f"eval/{name}", getattr(point, name))
