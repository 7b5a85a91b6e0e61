"""The named presets of the planner, and the gains that single arms have of their own."""

from __future__ import annotations

from dataclasses import replace

from .planner_config import PlannerConfig

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
