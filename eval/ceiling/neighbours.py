"""Pushes beside a push: a little harder or softer, and turned a little."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Scenario

FORCES = (-0.02, -0.01, 0.0, 0.01, 0.02)  # change of the force, as a share of it
TURNS = (-2.0, -1.0, 0.0, 1.0, 2.0)  # of its direction about the vertical, counter-clockwise [deg]
NEIGHBOURS = len(FORCES) * len(TURNS) - 1


def neighbours(scenario: Scenario) -> list[Scenario]:
    """The scenario with all its pushes changed alike, for each change of force and direction but none."""
    changes = [change for change in product(FORCES, TURNS) if change != (0.0, 0.0)]
    return [
        replace(
            scenario,
            id=f"{scenario.id}/{force:+.0%}{turn:+.0f}deg",
            pushes=tuple(changed(push, 1.0 + force, math.radians(turn)) for push in scenario.pushes),
        )
        for force, turn in changes
    ]


def changed(push: Push, factor: float, turn: float) -> Push:
    """A push whose force is `factor` times as large and turned by `turn` [rad]."""
    (x, y, z), cos, sin = push.force, math.cos(turn), math.sin(turn)
    return replace(push, force=(factor * (cos * x - sin * y), factor * (sin * x + cos * y), factor * z))
