"""Show one episode in a window, or write it as a film or a contact sheet."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..controllers.errors import InvalidValueError, MissingExtraError
from ..controllers.policy_file import write_atomically
from ..envs.scenario import Scenario
from .commands import output_suffix
from .loading import load_policy, make_env
from .outcome import Outcome
from .rollout import planning_period, rollout

FORMATS = (".mp4", ".gif", ".png")
FILM_RATE = 25.0  # frames per simulated second
SHEET_FRAMES = 8


class _Camera(gym.Wrapper):
    """Keeps a rendered frame at FILM_RATE of simulated time."""

    def __init__(self, env: gym.Env):
        super().__init__(env)
        self.frames: list[NDArray[np.uint8]] = []
        self.every = max(1, round(1.0 / (FILM_RATE * planning_period(env))))
        self._count = 0

    def _shoot(self) -> None:
        if self._count % self.every == 0:
            self.frames.append(np.array(self.env.render(), dtype=np.uint8))
        self._count += 1

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        result = self.env.reset(**kwargs)
        self._shoot()
        return result

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        result = self.env.step(action)
        self._shoot()
        return result


def play(env_id: str, policy: str, scenario: Scenario, out: Path | None) -> tuple[Outcome, Path | None]:
    """Run a scenario with rendering; returns its outcome and the file written.

    Raises:
        MissingExtraError: a film is asked for and imageio is not installed.
        UnknownNameError: the suffix is no known format.
    """
    suffix = output_suffix(out, FORMATS) if out else None
    if suffix in {".mp4", ".gif"}:
        _imageio()
    env = make_env(env_id, render_mode="rgb_array" if out else "human")
    try:
        if out is None:
            return rollout(env, load_policy(policy, env), scenario, policy), None
        camera = _Camera(env)
        outcome = rollout(camera, load_policy(policy, env), scenario, policy)
    finally:
        env.close()
    write_atomically(
        out, _contact_sheet(camera.frames) if suffix == ".png" else _film(camera.frames, str(suffix))
    )
    return outcome, out


def _imageio() -> Any:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("imageio", "view") from error
    return imageio


def _film(frames: list[NDArray[np.uint8]], suffix: str) -> bytes:
    """Frames as mp4 or gif."""
    buffer = io.BytesIO()
    options: dict[str, Any] = {"macro_block_size": 1} if suffix == ".mp4" else {}
    with _imageio().get_writer(buffer, format=suffix[1:], mode="I", fps=FILM_RATE, **options) as writer:
        for frame in frames:
            writer.append_data(frame)
    return buffer.getvalue()


def _contact_sheet(frames: list[NDArray[np.uint8]]) -> bytes:
    """Evenly spaced frames side by side in two rows, as PNG."""
    if not frames:
        raise InvalidValueError("the episode has no frames")
    from matplotlib.image import imsave

    chosen = [frames[round(i)] for i in np.linspace(0, len(frames) - 1, SHEET_FRAMES)]
    half = SHEET_FRAMES // 2
    sheet = np.concatenate(
        [np.concatenate(chosen[:half], axis=1), np.concatenate(chosen[half:], axis=1)], axis=0
    )
    buffer = io.BytesIO()
    imsave(buffer, sheet, format="png")
    return buffer.getvalue()
