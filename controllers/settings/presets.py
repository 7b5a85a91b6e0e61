"""Presets: settings of the planner, of single arms and of a robot, as JSON files.

    {"format": "push-recovery preset", "format_version": 1, "base": "biped",
     "planner": {"touchdown_delay": 0.004},           fields of PlannerConfig, for every arm
     "biped": {"gains": {"swing_kp": 350.0}},         limits, gait, gains, bounds of the MuJoCo biped
     "arms": {"two-stage": {"beta_dcm": 900.0,        both for one arm
                            "biped": {"gait": {"apex": 0.05}}}},
     "found": {...}}                                  for the reader

What a file leaves out is that of its base: a named preset, or "neutral", the defaults of `PlannerConfig`. The
named presets are files, too, in the folder `presets/` beside this module: all tuned numbers stand there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..errors import InvalidValueError, UnknownNameError
from ..files import read_file, write_atomically
from ..json_text import parse_json
from .arms import ARMS
from .planner_config import PlannerConfig

FORMAT = "push-recovery preset"
FORMAT_VERSION = 1
SECTIONS = ("base", "planner", "arms", "biped", "found")
NEUTRAL = "neutral"  # base of presets that stand on no other
FOLDER = files(__package__ or __name__) / "presets"
Values = Mapping[str, Any]


@dataclass(frozen=True)
class PresetFile:
    """What a preset file says; checked where it concerns the planner."""

    base: str = "default"
    planner: Values = field(default_factory=dict)  # field of PlannerConfig -> value
    arms: Mapping[str, Values] = field(default_factory=dict)  # policy -> the same, and its own `biped`
    biped: Mapping[str, Values] = field(default_factory=dict)  # section -> field -> value
    found: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        valid = (*preset_names(), NEUTRAL)
        if self.base not in valid:
            raise UnknownNameError("base of a preset file", self.base, valid)
        sections = {"planner": self.planner, "arms": self.arms, "biped": self.biped, "found": self.found}
        groups = {f"arms.{name}": part for name, part in _items(self.arms)}
        robots = {"biped": self.biped}
        for name, part in groups.items():
            robots[f"{name}.biped"] = dict(_items(part)).get("biped", {})
        for name, robot in robots.items():
            groups |= {name: robot, **{f"{name}.{section}": part for section, part in _items(robot)}}
        for name, section in {**sections, **groups}.items():
            if not isinstance(section, Mapping):
                raise InvalidValueError(f"{name} of a preset file must be an object, got {section!r}")
        for arm in self.arms:
            if arm not in ARMS:
                raise UnknownNameError("arm of a preset file", arm, ARMS)
        for arm in ("", *self.arms):
            self.config(arm)

    def config(self, arm: str = "") -> PlannerConfig:
        """The planner's settings of an arm; of those without settings of their own for the empty name.

        Raises:
            UnknownNameError: a field that PlannerConfig does not have.
            InvalidValueError: a value that it refuses.
        """
        own = {name: value for name, value in self.arms.get(arm, {}).items() if name != "biped"}
        values = {**self.planner, **own}
        valid = [entry.name for entry in fields(PlannerConfig)]
        for name in values:
            if name not in valid:
                raise UnknownNameError("planner field of a preset file", name, valid)
        base = PlannerConfig() if self.base == NEUTRAL else named_preset(self.base).config(arm)
        return base.replace(**values)

    def robot(self, arm: str = "") -> dict[str, dict[str, Any]]:
        """Section -> field -> value of the robot that an arm walks: the base's, with this file's put in.

        For the empty name, and for arms that have none of their own, it is the robot common to all.
        """
        sections = {} if self.base == NEUTRAL else named_preset(self.base).robot(arm)
        for part in (self.biped, self.arms.get(arm, {}).get("biped", {})):
            for name, values in part.items():
                sections[name] = {**sections.get(name, {}), **values}
        return sections

    @property
    def made_for(self) -> Values | None:
        """Field of `RobotModel` -> value of the robot that it is for, by it or its base; None: for any."""
        if "robot" in self.found or self.base == NEUTRAL:
            return self.found.get("robot")
        return named_preset(self.base).made_for

    def has_own_robot(self, arm: str) -> bool:
        """Whether an arm walks another robot, or another timing of its touchdown, than the common one."""
        delays = self.config(arm).touchdown_delay, self.config().touchdown_delay
        return self.robot(arm) != self.robot() or delays[0] != delays[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self)}

    def save(self, path: Path) -> None:
        """Write the file whole or not at all."""
        write_atomically(path, (json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n").encode())


@cache
def preset_names() -> tuple[str, ...]:
    """Names of the presets that come with the package."""
    return tuple(sorted(entry.name.removesuffix(".json") for entry in FOLDER.iterdir()))


@cache
def named_preset(name: str) -> PresetFile:
    """The file of a named preset.

    Raises:
        UnknownNameError: listing the valid names.
    """
    if name not in preset_names():
        raise UnknownNameError("preset", name, preset_names())
    return _parse((FOLDER / f"{name}.json").read_text(encoding="utf-8"), name)


def is_preset_file(preset: str) -> bool:
    """Whether a preset is given by a file rather than by its name."""
    return isinstance(preset, str) and preset.endswith(".json")


def load_preset(preset: str) -> PresetFile:
    """The preset of a file, or of a name as a file that changes nothing.

    Raises:
        UnknownNameError: no such name, section or field.
        InvalidValueError: a file that cannot be read, of another format, or with an impossible value.
    """
    if not is_preset_file(preset):
        if preset not in preset_names():
            raise UnknownNameError("preset", preset, [*preset_names(), "FILE.json"])
        return PresetFile(preset)
    try:
        text = read_file(preset)
    except (OSError, ValueError) as error:
        raise InvalidValueError(f"cannot read preset file {preset!r}: {error}") from error
    return _parse(text, preset)


def _parse(text: str | bytes, name: str) -> PresetFile:
    """The preset file with a content; `name` is for errors."""
    content = parse_json(f"preset file {name!r}", text)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidValueError(f"{name!r} is no preset file: its 'format' is not {FORMAT!r}")
    if content.get("format_version") != FORMAT_VERSION:
        raise InvalidValueError(
            f"preset file {name!r} has format_version {content.get('format_version')!r}; "
            f"this version reads {FORMAT_VERSION}"
        )
    for section in content:
        if section not in {"format", "format_version", *SECTIONS}:
            raise UnknownNameError(f"section of preset file {name!r}", section, SECTIONS)
    return PresetFile(**{section: content[section] for section in SECTIONS if section in content})


def preset_config(preset: str, arm: str = "") -> PlannerConfig:
    """The planner's settings of a preset, by name or file: of an arm, or what is common to all.

    Raises:
        UnknownNameError: listing the valid names.
        InvalidValueError: a file that cannot be read or has an impossible value.
    """
    return load_preset(preset).config(arm) if is_preset_file(preset) else named_preset(preset).config(arm)


def _items(section: Any) -> list[tuple[str, Any]]:
    return list(section.items()) if isinstance(section, Mapping) else []
