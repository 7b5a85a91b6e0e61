"""From a preset to the space of a search, and from a point's settings back to a preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from ...controllers.settings.presets import PresetFile, load_preset
from ...envs.biped.settings import SECTIONS, BipedSettings
from .dimensions import ROBOT, planner_dimensions
from .settings import TuningSettings
from .space import Space, make_space, select


def space_of(settings: TuningSettings) -> Space:
    """The dimensions that a study searches, starting at its preset.

    Raises:
        UnknownNameError: a field that is not among them.
    """
    planner, robot = settings.space != "robot", settings.space != "planner"
    dimensions = (planner_dimensions(settings.policy) if planner else ()) + (ROBOT if robot else ())
    preset = load_preset(settings.preset)
    start: dict[str, Mapping[str, Any]] = {
        "planner": asdict(preset.config(settings.policy)),
        **BipedSettings().changed(preset.robot(settings.policy)).to_dict(),
    }
    return make_space(select(dimensions, settings.only), start)


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
    return replace(start, arms={**start.arms, settings.policy: own}, found=dict(found or {}))
