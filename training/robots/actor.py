"""What the networks of a training see of n robots, and what the outputs do to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...controllers.learned.inputs import NetworkInputs, input_size
from ...controllers.policies.residual_rule import Below, ResidualRule
from ...envs.episode.episodes import GaitEpisodes
from ...envs.joint.episodes import JointResidualEpisodes
from .critic import critic_rows, critic_size

Actions = NDArray[np.float32]
Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Actor:
    """A network that acts alone, or as a residual, on the robots of `episodes`.

    Args:
        episodes: of n robots.
        inputs: names of the blocks that the network sees.
        rule: how a residual is added; None: the outputs are the actions.
        critic: names of the blocks behind them, which only a value network sees.
    """

    def __init__(
        self,
        episodes: GaitEpisodes,
        inputs: Sequence[str],
        rule: ResidualRule | None = None,
        critic: Sequence[str] = (),
    ):
        self._episodes, self._rule, self._critic = episodes, rule, critic
        self._inputs = NetworkInputs(inputs, episodes.robot, episodes.limits)
        self.size = input_size(inputs, episodes.observation_size) + critic_size(critic)
        self._gate = episodes.gate if isinstance(episodes, JointResidualEpisodes) else None
        n = episodes.n
        self._below = Below(np.zeros((n, 7), np.float32), np.zeros((n, 1), np.float32))

    def look(self, rows: Ints) -> None:
        """See where the robots `rows` are now."""
        if self._rule is not None and len(rows):
            base, opening = self._rule.below(self._episodes.core.observation[rows])
            self._below.base[rows], self._below.opening[rows] = base, opening

    @property
    def quiet(self) -> Mask:
        """Robots (n,) that no output acts on, since a gate is shut; none where there is no gate."""
        if self._rule is not None:
            return self._below.opening[:, 0] <= 0.0
        if self._gate is not None:
            return self._gate(self._episodes.core.observation)[:, 0] <= 0.0
        return np.zeros(self._episodes.n, np.bool_)

    def inputs(self) -> NDArray[np.float32]:
        """What the networks see (n, size), as seen last."""
        below = None if self._rule is None else self._below
        rows = self._inputs.rows(self._episodes.seen, below)
        return np.hstack([rows, *critic_rows(self._episodes, self._critic)]).astype(np.float32)

    def actions(self, outputs: Actions) -> Actions:
        """Actions of the episodes that outputs (n, k) in [-1, 1] stand for."""
        return outputs if self._rule is None else self._rule.total(self._below, outputs).total
