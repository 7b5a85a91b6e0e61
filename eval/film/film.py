"""From shots to a film: which moments, how fast, and into which file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...controllers.files import write_atomically
from ...envs.scenario.scenario import Scenario
from ..rollout.one import planning_period, rollout
from ..rollout.policy_source import acting_in
from .camera import FILM_RATE, Camera, Frame
from .captions import COLOURS, Shot, compose
from .encode import gif_bytes, mp4_bytes

SLOW = 0.5  # speed of a film of two policies against time
RATE = 25.0  # pictures a second of an mp4
GIF_RATE = 12.5  # and of a GIF
BEFORE, LONGEST = 0.4, 3.2  # seen before the push began and at most after it [s]
LINGER = 0.6  # seen after all is decided [s]


def shoot(env_id: str, policy: str, scenario: Scenario, rate: float) -> Shot:
    """Run a scenario before a camera.

    Args:
        env_id: of the environment.
        policy: a name, a file, or MODULE:ATTRIBUTE.
        scenario: what happens.
        rate: frames per simulated second.

    Raises:
        PushRecoveryError: the policy can't act, or nothing can be drawn here.
    """
    with acting_in(env_id, policy, render_mode="rgb_array") as (env, acting, label):
        camera = Camera(planning_period(env), rate)
        rollout(env, acting, scenario, label, camera)
    return Shot(label, camera)


def side_by_side(shots: Sequence[Shot], speed: float, rate: float) -> list[Frame]:
    """The push and what follows, until it is decided for all and a little longer."""
    last = min(max(shot.decided for shot in shots) + LINGER, LONGEST)
    return [compose(shots, float(after), speed) for after in np.arange(-BEFORE, last, speed / rate)]


def whole_episode(shot: Shot) -> list[Frame]:
    """Every frame of one episode, at the speed of time."""
    return [compose([shot], time - shot.camera.push_start, 1.0) for time in shot.camera.times]


def write_pair(shots: Sequence[Shot], stem: Path) -> list[Path]:
    """STEM.gif and STEM.mp4 of the same push under several policies; returns their paths."""
    frames = side_by_side(shots, SLOW, RATE)
    every = round(RATE / GIF_RATE)
    found = []
    contents = {".gif": gif_bytes(frames[::every], GIF_RATE, COLOURS), ".mp4": mp4_bytes(frames, RATE)}
    for suffix, content in contents.items():
        path = stem.with_name(stem.name + suffix)
        write_atomically(path, content)
        found.append(path)
    return found


def episode_film(shot: Shot, suffix: str) -> bytes:
    """One episode as mp4 or GIF."""
    frames = whole_episode(shot)
    return (
        mp4_bytes(frames, FILM_RATE) if suffix == ".mp4" else gif_bytes(frames[::2], FILM_RATE / 2, COLOURS)
    )
