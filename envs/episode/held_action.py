"""An action held for several planning periods by robots that share a core."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError, shown
from .episodes import GaitEpisodes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Held(NamedTuple):
    """What came of a held action for n robots, each up to the end of its episode."""

    reward: Array  # (n,) summed over the periods
    terms: Array  # (n, terms) of it, in the order of the episodes' reward_terms
    failed: Mask  # (n,)
    truncated: Mask  # (n,)


def check_hold(periods: object) -> int:
    """For how many planning periods an action is held.

    Raises:
        InvalidValueError: no whole number from 1.
    """
    if isinstance(periods, bool) or not isinstance(periods, int) or periods < 1:
        raise InvalidValueError(f"an action is held for a whole number of periods >= 1, got {shown(periods)}")
    return periods


def hold_action(
    episodes: GaitEpisodes,
    live: Mask,
    periods: int,
    act: Callable[[Mask], NDArray[np.float32]],
    at_end: Callable[[Mask, int, Held], None],
    watch: Callable[[], None] | None = None,
) -> Held:
    """Step the episodes with one action for some periods, or until all of them have ended.

    Args:
        episodes: of n robots.
        live: (n,) whose episodes count; the core moves the others, too.
        periods: for which the action is held.
        act: actions (n, action_size) of a period, given which robots (n,) are still in their episode.
        at_end: called with the robots (n,) whose episode ended in a period, how many periods were left of
            the action, and what has come of it so far: the core goes on with them.
        watch: called after every period.
    """
    n, terms, live = episodes.n, len(episodes.reward_terms), live.copy()
    held = Held(np.zeros(n), np.zeros((n, terms)), np.zeros(n, np.bool_), np.zeros(n, np.bool_))
    for left in reversed(range(periods)):
        period = episodes.step(act(live))
        if watch is not None:
            watch()
        held.reward[live] += period.reward.total[live]
        held.terms[live] += period.reward.terms[live]
        held.failed[live] = period.failed[live]
        held.truncated[live] = period.truncated[live]
        over = live & (held.failed | held.truncated)
        if over.any():
            at_end(over, left, held)
            live &= ~over
        if not live.any():
            break
    return held
