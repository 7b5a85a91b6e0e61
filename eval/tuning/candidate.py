"""From a preset to the space of a search, and from a point's settings back to a preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
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
        "shared": asdict(preset.config()),
        **BipedSettings().changed(preset.robot()).to_dict(),
    }
    return make_space(select(dimensions, settings.only), start)


def preset_of(
    settings: TuningSettings,
    values: Mapping[str, Mapping[str, float]],
    found: Mapping[str, Any] | None = None,
) -> PresetFile:
    """The preset of a point: what the study starts from, with the point's values put in.

    The group `planner` becomes the arm's own, `shared` that of every arm; the planner holds its plan when
    the gait machine commits the swing foot.
    """
    start = load_preset(settings.preset)
    shared = {**start.planner, **values.get("shared", {})}
    if "commit" in values.get("gait", {}):
        shared["freeze"] = values["gait"]["commit"]
    arms = {name: dict(own) for name, own in start.arms.items()}
    if "planner" in values:
        arms[settings.policy] = {**arms.get(settings.policy, {}), **values["planner"]}
    biped = {name: dict(section) for name, section in start.biped.items()}
    for section in SECTIONS:
        if section in values:
            biped[section] = {**biped.get(section, {}), **values[section]}
    return PresetFile(start.base, shared, arms, biped, dict(found or {}))
