"""The biped's constants that a preset may set: gait box, gait machine, whole-body gains and bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from ...controllers.errors import InvalidValueError, UnknownNameError, is_finite_number
from ...controllers.model.gait_box import GaitLimits
from ...controllers.model.robot import RobotModel
from ...controllers.settings.presets import load_preset, named_preset
from ...controllers.whole_body.bounds import BoundSettings
from ...controllers.whole_body.gait_machine import GaitSettings
from ...controllers.whole_body.inverse_dynamics import Gains

BIPED = RobotModel()  # Table II
OF_ROBOT = ("omega", "com_height", "cmp_gain", "mass")  # fields of GaitSettings that no file may set
_TUNED = named_preset("biped").robot()
BIPED_LIMITS = replace(GaitLimits.of(BIPED), **_TUNED["limits"])
BIPED_GAINS, BIPED_BOUNDS = Gains(**_TUNED["gains"]), BoundSettings(**_TUNED["bounds"])
BIPED_GAIT = GaitSettings(
    BIPED.omega, BIPED.com_height, BIPED.cmp_per_trunk_acceleration, BIPED.mass, **_TUNED["gait"]
)
SECTIONS: dict[str, tuple[str, ...]] = {
    "limits": tuple(entry.name for entry in fields(GaitLimits) if isinstance(entry.default, float)),
    "gait": tuple(name for name in GaitSettings._fields if name not in OF_ROBOT),
    "gains": Gains._fields,
    "bounds": BoundSettings._fields,
}


@dataclass(frozen=True)
class BipedSettings:
    """The constants, frozen; the defaults are those of `PushRecovery/Biped-v0`."""

    limits: GaitLimits = BIPED_LIMITS
    gait: GaitSettings = BIPED_GAIT
    gains: Gains = BIPED_GAINS
    bounds: BoundSettings = BIPED_BOUNDS

    def changed(self, changes: Mapping[str, Mapping[str, Any]]) -> BipedSettings:
        """These settings with some fields changed: section -> field -> value.

        Raises:
            UnknownNameError: an unknown section or field; lists the valid ones.
            InvalidValueError: a value that is no finite number, a negative one outside the limits, or one
                that GaitLimits refuses.
        """
        for section, values in changes.items():
            if section not in SECTIONS:
                raise UnknownNameError("section of the biped's settings", section, SECTIONS)
            for name, value in values.items():
                if name not in SECTIONS[section]:
                    raise UnknownNameError(f"field of the biped's {section}", name, SECTIONS[section])
                if not (is_finite_number(value) and (section == "limits" or value >= 0)):
                    bound = "" if section == "limits" else " and >= 0"
                    raise InvalidValueError(
                        f"{name} of the biped's {section} must be finite{bound}, got {value!r}"
                    )
        return BipedSettings(
            replace(self.limits, **changes.get("limits", {})),
            self.gait._replace(**changes.get("gait", {})),
            self.gains._replace(**changes.get("gains", {})),
            self.bounds._replace(**changes.get("bounds", {})),
        )

    def of_robot(self, robot: RobotModel) -> BipedSettings:
        """These settings for a robot of another mass, CoM height, trunk or waist."""
        own = robot.omega, robot.com_height, robot.cmp_per_trunk_acceleration, robot.mass
        limits = replace(self.limits, trunk_pitch=robot.trunk_pitch, trunk_roll=robot.trunk_roll)
        return replace(self, limits=limits, gait=self.gait._replace(**dict(zip(OF_ROBOT, own, strict=True))))

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Section -> field -> value, all that `changed` takes."""
        sections = {"limits": asdict(self.limits), "gait": self.gait._asdict(), "gains": self.gains._asdict(),
                    "bounds": self.bounds._asdict()}  # fmt: skip
        return {name: {key: values[key] for key in SECTIONS[name]} for name, values in sections.items()}


def biped_settings(preset: str, arm: str = "") -> BipedSettings:
    """The settings of a preset, by name or file, for an arm; the rest is the biped's own preset's."""
    return BipedSettings().changed(load_preset(preset).robot(arm))
