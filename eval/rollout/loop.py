"""The episode loop: scenarios to outcomes, on one robot or on many side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...controllers.errors import InvalidValueError
from ...controllers.policies.interface import Policy
from ...envs.scenario.scenario import Scenario
from .outcome import Ending, Outcome

MAX_STEPS = 1_000_000  # of an episode; only an environment that never ends gets there
Ints = NDArray[np.int64]
Watch = Callable[[Any], None]  # of the robots, after the start of an episode and after every planning period


class Robots(Protocol):
    """What the loop runs scenarios on; each robot holds one episode at a time."""

    n: int

    def begin(self, k: int, scenario: Scenario) -> None:
        """Begin a scenario with robot k."""
        ...

    def rest(self, k: int) -> None:
        """Robot k is no longer needed."""
        ...

    def observe(self, rows: Ints) -> Any:
        """What the policy is to see of the robots `rows`; asked for once a step."""
        ...

    def step(self, rows: Ints, actions: Any) -> list[int]:
        """Act with the robots `rows`; returns those whose episode has ended, in rising order."""
        ...

    def ending(self, k: int) -> Ending:
        """How the episode of robot k has ended."""
        ...


def run_episodes(
    robots: Robots, policy: Policy, scenarios: Iterable[Scenario], policy_name: str
) -> Iterator[tuple[int, Outcome]]:
    """Run scenarios to their ends; yields (number of the scenario, outcome) as they finish.

    Args:
        robots: what they held before is lost.
        policy: acts for all robots in one call; its state starts anew with each episode.
        scenarios: taken one at a time, when a robot is free: what has been yielded may decide what comes.
        policy_name: for the outcomes.

    Raises:
        InvalidValueError: an episode that never ends.
    """
    # Over 40 lines, as the queue, the robots' states and the ends that are yielded belong to one loop.
    queue, running = enumerate(scenarios), {}
    steps, live = np.zeros(robots.n, np.int64), np.zeros(robots.n, np.bool_)

    def fill(k: int) -> None:
        steps[k], live[k] = 0, False
        if (numbered := next(queue, None)) is None:
            robots.rest(k)
            return
        robots.begin(k, numbered[1])
        running[k], live[k] = numbered, True

    for k in range(robots.n):
        fill(k)
    state: Any = None
    rows = np.flatnonzero(live)
    while len(rows):
        if steps[rows].max() >= MAX_STEPS:
            raise _endless(running[int(rows[steps[rows].argmax()])][1])
        action, state = policy.predict(
            robots.observe(rows), state=state, episode_start=steps[rows] == 0, deterministic=True
        )
        ended = robots.step(rows, action)
        steps[rows] += 1
        for k in ended:
            number, scenario = running.pop(k)
            yield number, Outcome.of(scenario, policy_name, robots.ending(k), int(steps[k]))
            fill(k)
        if ended:
            state = _of_those_left(state, live[rows])
            rows = np.flatnonzero(live)


def _of_those_left(state: Any, left: NDArray[np.bool_]) -> Any:
    """A policy's state without the rows of robots that rest; nothing of it where all do."""
    if state is None or not left.any():
        return None
    return state if left.all() else tuple(part[left] for part in state)


def _endless(scenario: Scenario) -> InvalidValueError:
    return InvalidValueError(f"scenario {scenario.id!r} did not end within {MAX_STEPS} steps")
