"""A push and what became of it, in words for people."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...envs.scenario.push import Push
from ..rollout.outcome import Outcome, reason_words
from .record import EpisodeRecord

DIRECTIONS = (
    "forward", "forward and to the left", "to the left", "backward and to the left", "backward",
    "backward and to the right", "to the right", "forward and to the right",
)  # fmt: skip


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
    start = (push or {}).get("start")
    return f"{pushes_words([] if push is None else [push])}: {ending_words(info, start or 0.0)}"


class EpisodeWords:
    """Pushes and ending of an episode, from the `info` of its steps; times count from its first push."""

    def __init__(self) -> None:
        self.info: Mapping[str, Any] = {}  # of the last step
        self.pushes: list[Mapping[str, Any]] = []  # that have begun, in the form of `info["push"]`

    def look(self, info: Mapping[str, Any]) -> None:
        """Take in the `info` of reset or a step."""
        self.info, push = info, info.get("push")
        if push and push["start"] is not None and push["start"] not in {one["start"] for one in self.pushes}:
            self.pushes.append(push)

    def __str__(self) -> str:
        return f"{self.push}: {self.ending}"

    @property
    def push_start(self) -> float:
        """When the first push began, since reset [s]; 0 where none has."""
        return float(self.pushes[0]["start"]) if self.pushes else 0.0

    @property
    def push(self) -> str:
        """The pushes in words."""
        push = self.info.get("push")
        return pushes_words(self.pushes or ([push] if push else []))

    @property
    def ending(self) -> str:
        """How it ends, in words, with the time after the first push began."""
        return ending_words(self.info, self.push_start)


def last_info(record: EpisodeRecord) -> dict[str, Any]:
    """Entries of the last step's `info` that `describe` needs: push, time, failure reason, recovery."""
    outcome, push = record.outcome, None
    if record.scenario.forces:
        begun = [start for start in record.push_starts if start < outcome.end_time]
        index = record.push_starts.index(max(begun)) if begun else 0
        start = record.push_starts[index]
        push = {
            "impulse": record.scenario.forces[index].impulse,
            "start": start if math.isfinite(start) else None,
        }
    return {
        "push": push,
        "time": outcome.end_time,
        "failure_reason": outcome.failure_reason,
        "recovered_at": outcome.recovered_at,
    }


def pushes_words(pushes: Sequence[Mapping[str, Any]]) -> str:
    """Pushes in the form of `info["push"]`: "52.8 N s to the right", "4 x 60.0 N s backward"."""
    pushes = [push for push in pushes if any(push["impulse"])]
    if not pushes:
        return "no push"
    sizes = [f"{math.hypot(*push['impulse']):.1f}" for push in pushes]
    weakest, hardest = min(sizes, key=float), max(sizes, key=float)
    size = hardest if weakest == hardest else f"{weakest}-{hardest}"
    ways = {direction_words(*push["impulse"][:2]) for push in pushes}
    way = ways.pop() if len(ways) == 1 else "in several directions"
    return f"{f'{len(pushes)} x ' if len(pushes) > 1 else ''}{size} N s {way}"


def ending_words(info: Mapping[str, Any], start: float) -> str:
    """Ending of an episode in words by its last `info`, with the time since `start` [s]."""
    if info.get("failure_reason"):
        return f"fell after {info['time'] - start:.1f} s ({reason_words(info['failure_reason'])})"
    settled = info.get("recovered_at")
    if settled is None:
        return f"still up after {info['time'] - start:.1f} s, but does not walk as commanded"
    return f"recovered after {max(settled - start, 0.0):.1f} s"


def impulse_words(push: Push, mass: float) -> str:
    """Impulse, impulse by the robot's mass, and direction of a push."""
    size = push.impulse_magnitude
    return f"{size:.1f} N s ({size / mass:.2f} N s/kg) {direction_words(*push.force[:2])}"


def push_words(record: EpisodeRecord) -> str:
    """The pushes of an episode: the first one, and how many more."""
    if not record.scenario.forces:
        return "no push"
    first, *others = record.scenario.forces
    return impulse_words(first, record.mass) + (f" and {len(others)} more" if others else "")


def verdict(outcome: Outcome) -> str:
    """Ending of an episode in words: recovered, survived or fell, and when."""
    if outcome.recovered_at is not None and outcome.recovered:
        return f"recovered, from {outcome.recovered_at:.2f} s on"
    if outcome.survived:
        return f"survived {outcome.end_time:.2f} s, not settled"
    return f"fell after {outcome.end_time:.2f} s ({reason_words(outcome.failure_reason)})"
