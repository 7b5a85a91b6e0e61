"""The meaning of an action, noted on the action space of its environment, so that a saved model knows it.

Gait actions, corrections of a planner and held actions have equal spaces. Learning libraries keep the spaces
of a model and save them with it, so the note travels with the model, into its file and into other processes.
Wrappers that make a space of their own leave no note there.
"""

from __future__ import annotations

import copy
from dataclasses import asdict
from typing import Any, TypeVar

import gymnasium as gym

from .episodes import GaitEpisodes

Meaning = dict[str, Any]  # plain values, which can be read without this project
S = TypeVar("S", bound=gym.Space[Any])
NOTE = "push_recovery_meaning"  # attribute of a space
# Of a meaning; all else in it says what the environment is below them
HOLD, RESIDUAL = "hold", "residual"


def noted(space: gym.Space[Any] | None) -> Meaning | None:
    """The meaning that was noted on a space; None where nothing was."""
    return getattr(space, NOTE, None)


def note(space: S, meaning: Meaning) -> S:
    """The space with a meaning noted on it; in all else it is as before."""
    setattr(space, NOTE, meaning)
    return space


def meaning_of(episodes: GaitEpisodes) -> Meaning:
    """Meaning of an action for one planning period to the robots of episodes."""
    return {
        "environment": episodes.name,
        "robot": asdict(episodes.robot),
        "limits": asdict(episodes.limits),
        "control_hz": float(episodes.control_hz),
        **episodes.action_settings(),
    }


def note_hold(space: S, periods: int) -> S:
    """A space like this one, whose actions are held for some planning periods; itself for one period."""
    if periods == 1:
        return space
    meaning = noted(space) or {}
    return note(copy.deepcopy(space), meaning | {HOLD: meaning.get(HOLD, 1) * periods})


def note_residual(space: S, below: gym.Space[Any] | None, residual: Meaning) -> S:
    """The space with the note that its actions are residuals on a policy.

    Args:
        space: of the residuals.
        below: of the actions that are corrected.
        residual: the policy below by name, its preset, scale and gate.
    """
    meaning = dict(noted(below) or {})
    inner = {key: meaning.pop(key) for key in (HOLD, RESIDUAL) if key in meaning}
    if inner:  # a hold or a residual below a residual
        meaning["below"] = inner
    return note(space, meaning | {RESIDUAL: residual})
