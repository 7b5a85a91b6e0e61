"""All weights and margins of the two-stage planner."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from ..errors import InvalidValueError, UnknownNameError, is_finite_number

CHOICES = {
    "foothold": ("optimal", "capture_point", "linear_mpc"),
    "form": ("zoh", "jerk"),
    "solver": ("daqp", "osqp"),
    "jerk_cost": ("literal", "repaired"),
}
SHORTEST_SAMPLING = 1e-3  # [s]; the horizon has a table for each number of intervals up to the longest step
MOST_INTERVALS = 100  # of the braking tail


@dataclass(frozen=True)
class PlannerConfig:
    """Weights and margins of both stages; immutable. Tuned values are in the presets, see `presets.py`."""

    # Stage 1, eq. 3
    alpha_step: float = 1.0  # alpha_1 [1/m^2]
    alpha_duration: float = 1.0  # alpha_2 [-], on tau = exp(omega T)
    alpha_offset: float = 1e6  # alpha_3 [1/m^2]
    adapt_step: bool = True  # False keeps the nominal place
    adapt_duration: bool = True  # False keeps the nominal time
    foothold: Literal["optimal", "capture_point", "linear_mpc"] = (
        "optimal"  # eq. 3, the rule of `stage_1/capture_step`, or `baselines/linear_mpc`
    )
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

    # Linear MPC, against |CoP - sole's centre|^2; all are deviations from the nominal gait
    mpc_velocity: float = 0.1  # of the CoM [s^2]
    mpc_jerk: float = 1e-8  # of the CoM [s^6]
    mpc_step: float = 1e-3  # of the footsteps, against the integral over the horizon [s]

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
        if isinstance(tail, bool) or not isinstance(tail, int) or not 0 <= tail <= MOST_INTERVALS:
            raise InvalidValueError(
                f"PlannerConfig.tail_intervals must be an integer from 0 to {MOST_INTERVALS}, got {tail!r}"
            )
        for name in ("sampling_time", "tail_sampling_time"):
            if not getattr(self, name) >= SHORTEST_SAMPLING:
                raise InvalidValueError(
                    f"PlannerConfig.{name} must be at least {SHORTEST_SAMPLING} s, got {getattr(self, name)}"
                )
        if self.double_support > 0 and self.touchdown_delay > 0:
            raise InvalidValueError(
                "PlannerConfig.double_support and touchdown_delay exclude each other, "
                f"got {self.double_support} s and {self.touchdown_delay} s: set one of them to 0"
            )

    def replace(self, **changes: Any) -> PlannerConfig:
        """These settings with some fields changed.

        Raises:
            UnknownNameError: a field that does not exist; names the nearest one.
            InvalidValueError: an impossible value.
        """
        valid = [field.name for field in fields(self)]
        for name in changes:
            if name not in valid:
                raise UnknownNameError("field of PlannerConfig", name, valid)
        return replace(self, **changes)
