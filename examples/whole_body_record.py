"""What the biped does in an episode, physics step by physics step, for examples/explain_whole_body.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from push_recovery.controllers.policies.two_stage import make_policy
from push_recovery.controllers.settings import preset_config
from push_recovery.controllers.whole_body.inverse_dynamics import Task, whole_body_torque
from push_recovery.controllers.whole_body.kinematics import base_angular_velocity, sole_motion, sole_position
from push_recovery.controllers.whole_body.limits import LIMIT_NAMES, centre_of_pressure, make_bounds
from push_recovery.envs.biped.core import BIPED_BOUNDS, BIPED_GAINS, BIPED_GAIT, BipedSettings
from push_recovery.envs.scenario.push import GaitEvent, Push
from push_recovery.envs.scenario.scenario import Command, Scenario

START = GaitEvent(4, "left")  # of the pushes
KNEES = [5, 11]  # motors of the knees, in the order of the model
HIPS, ANKLES = [3, 9], [7, 13]  # joints of the legs' ends in xanchor
KEPT = [LIMIT_NAMES.index(name) for name in ("joint_torque", "sole_edge", "contact")]  # by whole-body control
Changes = Mapping[str, Mapping[str, float]]  # of BipedSettings: section -> field -> value


def episode(
    scenario: Scenario,
    changes: Changes | None = None,
    every_period: Callable[[Any, dict[str, Any]], None] = lambda core, info: None,
    every_step: Callable[[Any], None] | None = None,
) -> dict[str, Any]:
    """Play a scenario on a biped with some constants changed; its last info."""
    env = gym.make("push_recovery:PushRecovery/Biped-v0")
    biped, settings = env.unwrapped, BipedSettings().changed(changes or {})
    core = biped.core  # type: ignore[attr-defined]
    core.configure(settings, preset_config("biped"))
    policy = make_policy("two-stage", biped.robot, biped.limits, biped.preset)  # type: ignore[attr-defined]
    observation, info = env.reset(options={"scenario": scenario})
    if every_step is not None:
        every_step(core)
        core.after_physics_step = lambda: every_step(core)
    over = False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy.predict(observation)[0])
        every_period(core, info)
        over = terminated or truncated
    return info


class Recorder:
    """What one push does, sampled at every physics step."""

    def __init__(self, force: float, duration: float, shoot: Callable[[Any, dict[str, Any]], None]) -> None:
        """Push backward with `force` [N] for `duration` [s]; `shoot` looks at every planning period."""
        self.rows: list[dict[str, Any]] = []
        self._before: Any = None  # what the control of the coming physics step sees
        scenario = Scenario("backward", (Push((-force, 0.0, 0.0), duration, START),))
        info = episode(scenario, every_period=shoot, every_step=self._look)
        self.recovered_at = info["recovered_at"]
        self.series = {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}
        self.time = self.series["time"] - info["push"]["start"]

    def _look(self, core: Any) -> None:
        gait, phys, s = core.gait, core.physics, BIPED_GAIT
        soles = np.array([sole_position(phys, 0, i) for i in range(2)])
        before, now = self._before, (int(gait.stance[0]), phys.com[0, 0].copy(), soles, gait.swing[0].copy())
        speed, spans = phys.qvel[0, 6:].copy(), core.limits_record.span[0, KEPT].copy()
        self._before = (*now, speed, spans)
        if before is None:
            return
        stance, plan, wrench = now[0], gait.plan[0], gait.wrench[0]
        swing = before[3][6] if before[0] == stance else 0.0  # a new swing foot rests
        lever = before[1][0] - before[2][stance, 0] - s.cmp_gain * plan[5]
        lengths = np.linalg.norm(phys.xanchor[0, HIPS] - phys.xanchor[0, ANKLES], axis=1)
        self.rows.append({
            "time": gait.time[0], "elapsed": gait.elapsed[0], "length": plan[0], "duration": plan[2],
            "of_plan": s.omega**2 * (lever - plan[3]),
            "given": wrench[0] / s.mass, "cop": -wrench[4] / wrench[2], "planned_cop": plan[3],
            "waist": phys.ctrl[0, 0], "swing": abs(swing), "height_asked": gait.height[0, 0],
            "height": now[1][2] - soles[stance, 2], "stance_leg": lengths[stance],
            "swing_leg": lengths[1 - stance], "knee": np.abs(speed[KNEES]).max(),
            "knee_speed": before[4][KNEES], "knee_torque": phys.ctrl[0, KNEES].copy(),
            "at_bound": (spans > before[5]).any(),
        })  # fmt: skip


def leg_momentum(acceleration: float = 30.0) -> list[float]:
    """How far the CoP moves for an acceleration of the swing sole, forward and aside, by it [s^2].

    By exact inverse dynamics without bounds, the CoM's acceleration given, of the robot as an episode begins.
    """
    wide = {"cop_x_max": 1e6, "cop_y_max": 1e6, "yaw_friction": 1e6, "friction": 1e6, "force_min": -1e9}
    bounds, _memory = make_bounds(BIPED_BOUNDS._replace(**wide), np.full((2, 14), 1e9))
    env = gym.make("push_recovery:PushRecovery/Biped-v0")
    env.reset(options={"scenario": Scenario("in place")})
    core: Any = env.unwrapped.core  # type: ignore[attr-defined]
    stance = int(core.gait.stance[0])
    foot = sole_motion(core.physics, 0, 1 - stance, base_angular_velocity(core.physics, 0))
    height = core.physics.com[0, 0, 2] - sole_position(core.physics, 0, stance)[2]
    wrench, torque, cops = np.zeros(6), np.zeros(14), []
    for asked in ((0.0, 0.0), (acceleration, 0.0), (0.0, acceleration)):
        swing = np.array([*foot.position, *foot.velocity, *asked, 0.0])
        task = Task(stance, (0.0, 0.0), (height, 0.0, 0.0), (1.0, 0.0), swing, (0.0, 0.0))
        whole_body_torque(core.physics, 0, task, 0.0, BIPED_GAINS, bounds, wrench, torque)
        cops.append(centre_of_pressure(wrench, (1.0, 0.0)))
    return [(cops[1 + i][i] - cops[0][i]) / acceleration for i in range(2)]


class Walk:
    """A walk at 0.5 m/s: its mean speed from 4 s to 10 s, and how the feet land."""

    def __init__(self, landing_delay: float = BIPED_GAIT.landing_delay) -> None:
        self.places: list[tuple[float, float]] = []  # time [s], CoM forward [m]
        self.landed: list[float] = []  # time of every touchdown, from T on [s]
        self.depth: list[float] = []  # of the stance sole under the floor [m]
        self._before = 0, 0.0
        scenario = Scenario("walk", command=Command(0.5), duration=10.0)
        episode(scenario, {"gait": {"landing_delay": landing_delay}}, every_step=self._look)
        time, place = np.array([row for row in self.places if row[0] >= 4.0]).T
        self.speed = (place[-1] - place[0]) / (time[-1] - time[0])

    def _look(self, core: Any) -> None:
        gait, (steps, late) = core.gait, self._before
        if gait.steps[0] != steps:
            self.landed.append(late)
        elif gait.elapsed[0] > BIPED_GAIT.settled:
            self.depth.append(-sole_position(core.physics, 0, int(gait.stance[0]))[2])
        self._before = int(gait.steps[0]), float(gait.elapsed[0] - gait.plan[0, 2])
        self.places.append((float(gait.time[0]), float(core.physics.com[0, 0, 0])))
