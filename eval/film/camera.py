"""Frames of an episode, and what its info told last."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rollout.one import GymRobot

Frame = NDArray[np.uint8]  # (height, width, 3)
FILM_RATE = 25.0  # frames per simulated second


class Camera:
    """Watches an episode, and keeps a frame of it at a rate of simulated time.

    Args:
        period: of planning [s].
        rate: frames per simulated second.
    """

    def __init__(self, period: float, rate: float = FILM_RATE):
        self.frames: list[Frame] = []
        self.times: list[float] = []  # of the frames, since reset [s]
        self.push_start = 0.0  # of the last push [s]
        self.info: dict[str, Any] = {}  # of the last step
        self._period = period
        self._every = max(1, round(1.0 / (rate * period)))
        self._count = 0

    def __call__(self, robot: GymRobot) -> None:
        """Look after reset or a step."""
        if self._count % self._every == 0 or robot.ended:
            self.frames.append(np.array(robot.env.render(), dtype=np.uint8))
            self.times.append(float(robot.info.get("time", self._count * self._period)))
        self._count += 1
        start = (robot.info.get("push") or {}).get("start")
        self.push_start = self.push_start if start is None else float(start)
        self.info = robot.info

    def frame_at(self, after: float) -> int:
        """Index of the frame nearest to a time after the push began [s]; the first or last one beyond."""
        return int(np.argmin(np.abs(np.array(self.times) - self.push_start - after)))


def middle(frame: Frame, proportions: tuple[int, int]) -> Frame:
    """The middle of a frame, at most as wide as width to height say."""
    rows, columns = frame.shape[:2]
    kept = min(columns, rows * proportions[0] // proportions[1])
    left = (columns - kept) // 2
    return frame[:, left : left + kept]
