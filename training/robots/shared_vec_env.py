"""Robots that share one environment, as Stable-Baselines3 asks for them: one by one."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import gymnasium as gym
from stable_baselines3.common.vec_env import VecEnv

from ...controllers.errors import InvalidValueError


class SharedVecEnv(VecEnv):
    """A `VecEnv` whose attributes and methods are those of one object that all robots share."""

    @property
    @abstractmethod
    def shared(self) -> Any:
        """The object."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of what is shared, once for each of the robots asked for."""
        return [getattr(self.shared, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of what all robots share.

        Raises:
            InvalidValueError: for some of the robots only.
        """
        self._require_all(indices)
        setattr(self.shared, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of what is shared, once; its result stands for every robot.

        Raises:
            InvalidValueError: for some of the robots only.
        """
        self._require_all(indices)
        return [getattr(self.shared, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """False: no robot has wrappers of its own."""
        return [False] * len(list(self._get_indices(indices)))

    def _require_all(self, indices: Any) -> None:
        asked = sorted(self._get_indices(indices))
        if asked != list(range(self.num_envs)):
            raise InvalidValueError(f"the {self.num_envs} robots share one environment, got indices {asked}")
