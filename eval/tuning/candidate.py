"""From a preset to the space of a search, and from a point's settings back to a preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from ...controllers.settings.presets import PresetFile, load_preset
from ...envs.biped.settings import SECTIONS, BipedSettings
from .dimensions import OF_TRUNK, ROBOT, planner_dimensions
from .scorer import BIPED, PENDULUM, own_episodes
from .settings import TuningSettings
from .space import Space, make_space, select

BIPED_PRESET = "biped"


def space_of(settings: TuningSettings) -> Space:
    """The dimensions that a study searches, starting at its preset.

    Those of another robot than the biped have its bounds and units times as much as their start is of the
    biped's own value. What turns a trunk is left out where there is no waist.

    Raises:
        UnknownNameError: a field that is not among them.
    """
    planner, robot = settings.space != "robot", settings.space != "planner"
    dimensions = (planner_dimensions(settings.policy) if planner else ()) + (ROBOT if robot else ())
    start = _values(settings.preset, settings.policy)
    if settings.env_id not in (BIPED, PENDULUM):
        own, model = _values(BIPED_PRESET, settings.policy), own_episodes(settings.env_id).robot
        if not (model.trunk_pitch or model.trunk_roll):
            dimensions = tuple(d for d in dimensions if d.name not in OF_TRUNK)
        dimensions = tuple(d.times(_ratio(start[d.group][d.name], own[d.group][d.name])) for d in dimensions)
    return make_space(select(dimensions, settings.only), start)


def _values(preset: str, policy: str) -> dict[str, Mapping[str, Any]]:
    """Group -> field -> value of an arm's own settings."""
    found = load_preset(preset)
    robot = BipedSettings().changed(found.robot(policy)).to_dict()
    return {"planner": asdict(found.config(policy)), **robot}


def _ratio(value: float, other: float) -> float:
    """How many times the other one a value is; 1 where there is no ratio."""
    return value / other if value * other > 0.0 else 1.0


def preset_of(
    settings: TuningSettings,
    values: Mapping[str, Mapping[str, float]],
    found: Mapping[str, Any] | None = None,
) -> PresetFile:
    """The preset of a point: what the study starts from, with the point's values put in as the arm's own.

    The planner holds its plan when the gait machine commits the swing foot.
    """
    start = load_preset(settings.preset)
    own = {**start.arms.get(settings.policy, {}), **values.get("planner", {})}
    if "commit" in values.get("gait", {}):
        own["freeze"] = values["gait"]["commit"]
    if sections := {name: values[name] for name in SECTIONS if name in values}:
        robot = own.get("biped", {})
        own["biped"] = {**robot, **{name: {**robot.get(name, {}), **part} for name, part in sections.items()}}
    return replace(start, arms={**start.arms, settings.policy: own}, found={**whose(start), **(found or {})})


def whose(preset: PresetFile) -> dict[str, Any]:
    """What `found` of a preset that comes of this one says of whose it is."""
    return {} if preset.made_for is None else {"robot": preset.made_for}
