"""Names of policies and of what became of episodes, short enough for tables and figures, and in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Any

from ...envs.scenario.push import Push
from ...envs.scenario.scenario import Scenario
from ..record.words import direction_words
from ..score.effort import measures_of
from ..score.kinds import KINDS

Row = Mapping[str, Any]
REASONS = {  # why an episode does not count as recovered
    "not_settled": "stayed up, but was not back in its commanded walk at the end",
    "com_height": "the centre of mass sank too low above the standing foot",
    "pelvis_tilt": "the pelvis leaned over by more than 60 degrees",
    "not_finite": "the simulation ran out of numbers",
    "dcm_diverged": "its motion ran away farther than any step can catch",
}
LIMITS = {  # of controllers/whole_body/bounds_met.py, in words
    "step_length": "the planned step is as long as it may be",
    "step_width": "the planned step is as wide or as narrow as it may be",
    "step_time": "the foot cannot come down any sooner",
    "cop": "the planned centre of pressure is at the edge of where it may be",
    "trunk_torque": "the trunk is swung as hard as it may be",
    "trunk_angle": "the trunk leans as far as it may",
    "leg_reach": "the foothold is farther than the leg reaches",
    "joint_torque": "a motor gives all it can",
    "sole_edge": "the pressure under the sole is at its edge",
    "contact": "friction or load under the foot is at its bound",
    "touchdown_error": "the foot landed elsewhere or later than planned",
    "dcm_tracking": "the robot's motion is not what was planned",
}


def short_labels(names: Iterable[str]) -> dict[str, str]:
    """Policy -> label: of a file its folder and stem, where that tells it apart; any other name as it is."""
    names = list(names)
    short = {name: _short(name) for name in names}
    taken = list(short.values())
    return {name: label if taken.count(label) == 1 else name for name, label in short.items()}


def _short(name: str) -> str:
    path = PurePath(name)
    return "/".join([*path.parts[-2:-1], path.stem]) if path.suffix == ".safetensors" else name


def impulse_words(push: Push) -> str:
    """Body, impulse, direction in the robot's frame and duration of a push."""
    direction = direction_words(*push.force[:2])
    return f"{push.body}, {push.impulse_magnitude:.0f} N s {direction} within {push.duration:.2f} s"


def scenario_words(scenario: Scenario) -> str:
    """What happens in a scenario: its first push, how many there are, and on which walk."""
    if not scenario.pushes:
        return f"no push, walking {KINDS['command'](scenario)}"
    count, walk = KINDS["count"](scenario), KINDS["command"](scenario)
    return f"{impulse_words(scenario.pushes[0])}, {count}, {'' if walk == 'turning' else 'walking '}{walk}"


def effort_words(row: Row) -> str:
    """What an episode took, as far as its row tells; empty where it does not."""
    measures = measures_of(row)
    margin, lean, energy = (measures.get(name) for name in ("smallest_margin", "trunk_excursion", "energy"))
    if margin is None or lean is None or energy is None:
        return ""
    return f"margin {100.0 * margin:.0f} cm, lean {math.degrees(lean):.0f} deg, {energy / 1000.0:.1f} kJ"


def outcome_words(row: Row) -> str:
    """What became of an episode, and the first limit that a fall met."""
    if row["recovered"]:
        return "recovers"
    if row["survived"]:
        return "stays up, does not settle"
    first = row.get("first_limit")
    return f"falls at {row['end_time']:.1f} s ({row['failure_reason']}{f', first {first}' if first else ''})"
