"""All weights and margins of the two-stage planner, and the named presets."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

from .errors import InvalidValueError, UnknownNameError, is_finite_number

CHOICES = {"form": ("zoh", "jerk"), "solver": ("daqp", "osqp"), "jerk_cost": ("literal", "repaired")}


@dataclass(frozen=True)
class PlannerConfig:
    """Weights and margins of both stages; immutable, see `PRESETS`."""

    # Stage 1, eq. 3
    alpha_step: float = 1.0  # alpha_1 [1/m^2]
    alpha_duration: float = 1.0  # alpha_2 [-], on tau = exp(omega T)
    alpha_offset: float = 1e6  # alpha_3 [1/m^2]
    adapt_step: bool = True  # False keeps the nominal place
    adapt_duration: bool = True  # False keeps the nominal time
    duration_margin: float = 0.0  # tau >= exp(omega (t + margin)) [s]
    swing_acceleration: float = 0.0  # T gives the foot time to swing with this peak; 0: any [m/s^2]
    freeze: float = 0.0  # the plan of both stages is held when less than this remains [s]
    touchdown_delay: float = 0.0  # the new foot carries load this long after T [s]
    double_support: float = 0.0  # d: both feet stand for this long from touchdown on, part of T [s]

    # Both stages
    push_carry: float = 0.0  # the push of the last period is expected to last this much longer [s]
    push_threshold: float = 0.0  # a smaller push estimate is taken for noise [m]
    trunk_debt: bool = False  # what stopping the trunk will cost belongs to the DCM

    # Stage 2, eq. 20
    use_cop: bool = True
    use_trunk: bool = True
    form: Literal["zoh", "jerk"] = "zoh"
    solver: Literal["daqp", "osqp"] = "daqp"
    sampling_time: float = 0.05  # horizon grid [s]
    tail_intervals: int = 6  # braking tail of the trunk after touchdown
    tail_sampling_time: float = 0.06  # [s]
    beta_cop: float = 1.0  # beta_1 [1/m^2]
    beta_dcm_acceleration: float = 1.0  # beta_2 [s^4/m^2], jerk form only
    beta_trunk: float = 1e-4  # beta_3: trunk acceleration (zoh) [s^4/rad^2] or jerk (jerk form) [s^6/rad^2]
    beta_trunk_rate: float = 1e-2  # beta_4 [s^2/rad^2]
    beta_dcm: float = 1e5  # beta_5 [1/m^2]
    beta_trunk_angle: float = 1.0  # [1/rad^2]
    cop_margin_x: float = 0.0  # kept from the edge of the sole [m]
    cop_margin_y: float = 0.0  # [m]
    trunk_gravity: float = (
        0.0  # gravity torque of the leaning trunk per sin(lean), taken from the torque bound [N m]
    )
    beta_trunk_limit: float = 1e4  # weight of the trunk angle beyond its limit [1/rad^2]
    first_interval_min: float = 0.01  # the control period: shortest first interval of the horizon [s]
    jerk_cost: Literal["literal", "repaired"] = (
        "repaired"  # jerk form: eq. 20 as written, or about the free motion
    )

    # Trunk law of the arms without momentum regulation
    upright_stiffness: float = 20.0  # [1/s^2]
    upright_damping: float = 9.0  # [1/s]

    def __post_init__(self) -> None:
        for name, valid in CHOICES.items():
            if getattr(self, name) not in valid:
                raise UnknownNameError(f"PlannerConfig.{name}", getattr(self, name), valid)
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, bool) and not isinstance(value, bool):
                raise InvalidValueError(f"PlannerConfig.{field.name} must be True or False, got {value!r}")
            if isinstance(field.default, float) and not (is_finite_number(value) and value >= 0):
                raise InvalidValueError(f"PlannerConfig.{field.name} must be finite and >= 0, got {value!r}")
        tail = self.tail_intervals
        if isinstance(tail, bool) or not isinstance(tail, int) or tail < 0:
            raise InvalidValueError(f"PlannerConfig.tail_intervals must be an integer >= 0, got {tail!r}")
        for name in ("sampling_time", "tail_sampling_time"):
            if not getattr(self, name) > 0:
                raise InvalidValueError(
                    f"PlannerConfig.{name} must be positive [s], got {getattr(self, name)}"
                )
        if self.double_support > 0 and self.touchdown_delay > 0:
            raise InvalidValueError(
                "PlannerConfig.double_support and touchdown_delay exclude each other, "
                f"got {self.double_support} s and {self.touchdown_delay} s: set one of them to 0"
            )


PAPER_WEIGHTS = {
    "alpha_step": 1.0,
    "alpha_duration": 1.0,
    "alpha_offset": 1000.0,
    "push_carry": 0.0,
    "trunk_debt": False,
    "form": "jerk",
    "beta_cop": 1.0,
    "beta_dcm_acceleration": 1.0,
    "beta_trunk": 1.0,
    "beta_trunk_rate": 1.0,
    "beta_dcm": 1e5,
}  # Table II to the letter

_BASE = PlannerConfig()

PRESETS: dict[str, PlannerConfig] = {
    "paper": replace(_BASE, **PAPER_WEIGHTS),
    "default": replace(
        _BASE,
        push_carry=0.1,
        push_threshold=0.2,
        trunk_debt=True,
        tail_intervals=8,
        beta_dcm=1e6,
        beta_trunk=1e-2,
        beta_trunk_rate=1.0,
    ),
    "biped": replace(
        _BASE,
        alpha_step=2.24,
        alpha_duration=1.46,
        alpha_offset=436.0,
        freeze=0.0316,  # the biped's gait machine commits the swing foot then
        touchdown_delay=0.0116,
        swing_acceleration=163.0,
        cop_margin_x=0.00873,
        cop_margin_y=0.00487,
        beta_dcm=77700.0,
        beta_trunk=0.00203,
        beta_trunk_rate=0.11,
        beta_trunk_angle=1.25,
        trunk_gravity=93.5,
        duration_margin=0.00665,
        push_carry=0.0183,
        push_threshold=0.112,
        sampling_time=0.0405,
        beta_trunk_limit=2460.0,
        tail_sampling_time=0.0777,
    ),
}
PRESETS["double-support"] = replace(
    PRESETS["default"],
    double_support=0.1,  # the paper's 0.55 s + 0.1 s
    beta_trunk_angle=10.0,  # with 1, 16 of 476 survivors of 500 pushes do not recover in time
)

ARM_GAINS: dict[str, dict[str, dict[str, float]]] = {
    "biped": {
        "stage-1": {
            "alpha_duration": 2.68,
            "alpha_offset": 3160.0,
            "duration_margin": 0.0147,
            "push_carry": 0.0229,
            "push_threshold": 0.03,
            "upright_stiffness": 10.9,
            "upright_damping": 6.99,
        },
        "stage-1+cop": {
            "alpha_duration": 0.0253,
            "alpha_offset": 3.39,
            "duration_margin": 0.0312,
            "push_carry": 0.0481,
            "push_threshold": 0.227,
            "beta_dcm": 287000.0,
            "sampling_time": 0.0718,
            "cop_margin_x": 0.01,
            "cop_margin_y": 0.0153,
            "upright_stiffness": 11.4,
            "upright_damping": 2.48,
        },
        "stage-1+momentum": {
            "alpha_duration": 0.512,
            "alpha_offset": 943.0,
            "duration_margin": 0.0167,
            "push_carry": 0.0268,
            "push_threshold": 0.0569,
            "beta_dcm": 25600.0,
            "sampling_time": 0.0523,
            "beta_trunk": 0.0466,
            "beta_trunk_rate": 3.4,
            "beta_trunk_angle": 3.28,
            "beta_trunk_limit": 380.0,
            "trunk_gravity": 98.5,
            "tail_sampling_time": 0.0713,
        },
    },
}  # by preset and policy: what an arm does not share with the others, see docs/tuning.md


def preset_config(name: str) -> PlannerConfig:
    """Look a preset up by name or preset file (see `preset_file.py`); of a file, what is common to all arms.

    Raises:
        UnknownNameError: listing the valid names.
        InvalidValueError: a file that cannot be read or has an impossible value.
    """
    from .preset_file import is_preset_file, load_preset

    if is_preset_file(name):
        return load_preset(name).config()
    if name not in PRESETS:
        raise UnknownNameError("preset", name, PRESETS)
    return PRESETS[name]
