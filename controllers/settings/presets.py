"""A preset as a JSON file: settings of the planner, of single arms and of a robot, and how they were found.

    {"format": "push-recovery preset", "format_version": 1, "base": "biped",
     "planner": {"touchdown_delay": 0.004},           fields of PlannerConfig, for every arm
     "arms": {"two-stage": {"beta_dcm": 900.0}},      the same for one arm
     "biped": {"gains": {"swing_kp": 350.0}},         limits, gait, gains, bounds of the MuJoCo biped
     "found": {...}}                                  for the reader

What a file leaves out is that of its base, one of the named presets.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ..errors import InvalidValueError, UnknownNameError
from ..files import write_atomically
from .named_presets import ARM_GAINS, PRESETS
from .planner_config import PlannerConfig

FORMAT = "push-recovery preset"
FORMAT_VERSION = 1
SECTIONS = ("base", "planner", "arms", "biped", "found")
Values = Mapping[str, Any]


@dataclass(frozen=True)
class PresetFile:
    """What a preset file says; checked where it concerns the planner."""

    base: str = "default"
    planner: Values = field(default_factory=dict)  # field of PlannerConfig -> value
    arms: Mapping[str, Values] = field(default_factory=dict)  # policy -> the same
    biped: Mapping[str, Values] = field(default_factory=dict)  # section -> field -> value
    found: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.base not in PRESETS:
            raise UnknownNameError("base of a preset file", self.base, PRESETS)
        sections = {"planner": self.planner, "arms": self.arms, "biped": self.biped, "found": self.found}
        groups = {**{f"arms.{name}": part for name, part in _items(self.arms)},
                  **{f"biped.{name}": part for name, part in _items(self.biped)}}  # fmt: skip
        for name, section in {**sections, **groups}.items():
            if not isinstance(section, Mapping):
                raise InvalidValueError(f"{name} of a preset file must be an object, got {section!r}")
        for arm in ("", *self.arms):
            self.config(arm)

    def config(self, arm: str = "") -> PlannerConfig:
        """The planner's settings of an arm; of those without settings of their own for the empty name.

        Raises:
            UnknownNameError: a field that PlannerConfig does not have.
            InvalidValueError: a value that it refuses.
        """
        own = ARM_GAINS.get(self.base, {}).get(arm, {})
        values = {**own, **self.planner, **self.arms.get(arm, {})}
        valid = [entry.name for entry in fields(PlannerConfig)]
        for name in values:
            if name not in valid:
                raise UnknownNameError("planner field of a preset file", name, valid)
        return replace(PRESETS[self.base], **values)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self)}

    def save(self, path: Path) -> None:
        """Write the file whole or not at all."""
        write_atomically(path, (json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n").encode())


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
        if preset not in PRESETS:
            raise UnknownNameError("preset", preset, [*PRESETS, "FILE.json"])
        return PresetFile(preset)
    try:
        content = json.loads(Path(preset).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InvalidValueError(f"cannot read preset file {preset!r}: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InvalidValueError(f"{preset!r} is no preset file: its 'format' is not {FORMAT!r}")
    if content.get("format_version") != FORMAT_VERSION:
        raise InvalidValueError(
            f"preset file {preset!r} has format_version {content.get('format_version')!r}; "
            f"this version reads {FORMAT_VERSION}"
        )
    for name in content:
        if name not in {"format", "format_version", *SECTIONS}:
            raise UnknownNameError(f"section of preset file {preset!r}", name, SECTIONS)
    return PresetFile(**{name: content[name] for name in SECTIONS if name in content})


def preset_config(name: str) -> PlannerConfig:
    """Look a preset up by name or preset file (see `preset_file.py`); of a file, what is common to all arms.

    Raises:
        UnknownNameError: listing the valid names.
        InvalidValueError: a file that cannot be read or has an impossible value.
    """
    if is_preset_file(name):
        return load_preset(name).config()
    if name not in PRESETS:
        raise UnknownNameError("preset", name, PRESETS)
    return PRESETS[name]


def _items(section: Any) -> list[tuple[str, Any]]:
    return list(section.items()) if isinstance(section, Mapping) else []
