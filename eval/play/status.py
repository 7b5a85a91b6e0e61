"""What a robot is going through, in words."""

from __future__ import annotations

from ...envs.scenario.push import Push
from ..record.sampler import LIMIT
from ..record.words import fall_words, impulse_words
from .lane import Lane

RECENT = 30  # samples in which a limit counts as being met


def status_words(lane: Lane) -> str:
    """Walks, was pushed, has recovered or fallen: one sentence."""
    push = _last_push(lane)
    if lane.over:
        after = "" if push is None else f" {lane.time - float(_start(push)):.2f} s after the push"
        return f"fell{after} ({fall_words(lane.failure)})"
    if push is None:
        return f"walks, {lane.time:.1f} s"
    since = lane.time - _start(push)
    if lane.recovered_at is not None and lane.recovered_at >= _start(push):
        return f"recovered {lane.recovered_at - _start(push):.2f} s after {impulse_words(push, lane.mass)}"
    return f"pushed {since:.2f} s ago with {impulse_words(push, lane.mass)}"


def limits_words(lane: Lane) -> list[str]:
    """The limits being met: in one of the last RECENT planning periods."""
    rows = list(lane.rows)[-RECENT:]
    names = [name for name in (rows[-1] if rows else {}) if name.startswith(LIMIT)]
    met = [name for name in names if any(row[name] > 0.0 for row in rows)]
    return [name.removeprefix(LIMIT).replace("_", " ") for name in met]


def _last_push(lane: Lane) -> Push | None:
    pushes = lane.scenario.pushes
    return pushes[-1] if pushes else None


def _start(push: Push) -> float:
    """Of a push by hand, which is given at a time."""
    return push.start if isinstance(push.start, float) else 0.0
