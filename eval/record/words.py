"""A push and what became of it, in words for people."""

import math
from collections.abc import Mapping
from typing import Any

from ...envs.scenario.push import Push
from ..rollout.outcome import Outcome
from .record import EpisodeRecord

DIRECTIONS = (
    "forward", "forward and to the left", "to the left", "backward and to the left", "backward",
    "backward and to the right", "to the right", "forward and to the right",
)  # fmt: skip
FALLS = {  # why an episode ended, by the name that its info gives
    "com_height": "sank too low",
    "pelvis_tilt": "tipped over",
    "dcm_diverged": "ran away from any step",
    "not_finite": "ran out of numbers",
}


def sector_of(psi_deg: float) -> int:
    """Number of the nearest of eight directions, counter-clockwise from forward [deg]."""
    return round(psi_deg / 45.0) % len(DIRECTIONS)


def direction_words(x: float, y: float) -> str:
    """The nearest of eight directions to a vector, x forward and y to the left."""
    return DIRECTIONS[sector_of(math.degrees(math.atan2(y, x)))]


def describe(episode: EpisodeRecord | Mapping[str, Any]) -> str:
    """An episode in one line: "52.8 N s to the right: recovered after 1.4 s".

    Args:
        episode: a record, or the `info` of an episode's last step. Times are counted from the start of the
            latest push.
    """
    info = last_info(episode) if isinstance(episode, EpisodeRecord) else episode
    push = info.get("push")
    return f"{'no push' if push is None else info_push_words(push)}: {ending_words(info)}"


def last_info(record: EpisodeRecord) -> dict[str, Any]:
    """Entries of the last step's `info` that `describe` needs: push, time, failure reason, recovery."""
    outcome, push = record.outcome, None
    if record.scenario.pushes:
        begun = [start for start in record.push_starts if start < outcome.end_time]
        index = record.push_starts.index(max(begun)) if begun else 0
        start = record.push_starts[index]
        push = {
            "impulse": record.scenario.pushes[index].impulse,
            "start": start if math.isfinite(start) else None,
        }
    return {
        "push": push,
        "time": outcome.end_time,
        "failure_reason": outcome.failure_reason,
        "recovered_at": outcome.recovered_at,
    }


def info_push_words(push: Mapping[str, Any]) -> str:
    """Impulse and direction of a push in the form of `info["push"]`."""
    size = math.hypot(*push["impulse"])
    return f"{size:.1f} N s {direction_words(*push['impulse'][:2])}"


def ending_words(info: Mapping[str, Any]) -> str:
    """Ending of an episode in words by its last `info`, with the time after the push."""
    start = (info.get("push") or {}).get("start") or 0.0
    if info.get("failure_reason"):
        return f"fell after {info['time'] - start:.1f} s ({fall_words(info['failure_reason'])})"
    settled = info.get("recovered_at")
    if settled is None:
        return f"still up after {info['time'] - start:.1f} s, but does not walk as told"
    return f"recovered after {max(settled - start, 0.0):.1f} s"


def fall_words(reason: str | None) -> str:
    """Why a robot fell; a reason of an environment of others stays as it is."""
    return FALLS.get(reason or "", reason or "")


def impulse_words(push: Push, mass: float) -> str:
    """Impulse, impulse by the robot's mass, and direction of a push."""
    size = push.impulse_magnitude
    return f"{size:.1f} N s ({size / mass:.2f} N s/kg) {direction_words(*push.force[:2])}"


def push_words(record: EpisodeRecord) -> str:
    """The pushes of an episode: the first one, and how many more."""
    if not record.scenario.pushes:
        return "no push"
    first, *others = record.scenario.pushes
    return impulse_words(first, record.mass) + (f" and {len(others)} more" if others else "")


def verdict(outcome: Outcome) -> str:
    """Ending of an episode in words: recovered, survived or fell, and when."""
    if outcome.recovered_at is not None and outcome.recovered:
        return f"recovered, from {outcome.recovered_at:.2f} s on"
    if outcome.survived:
        return f"survived {outcome.end_time:.2f} s, not settled"
    return f"fell after {outcome.end_time:.2f} s ({fall_words(outcome.failure_reason)})"
