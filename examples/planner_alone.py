"""The planner without an environment: an observation by name, and length, width and time of its step."""

import numpy as np
from push_recovery.controllers.model.observation import OBSERVATION_NAMES
from push_recovery.controllers.policies.two_stage import TwoStagePolicy

from push_recovery import RobotModel

robot = RobotModel(mass=60.0, com_height=0.8)
planner = TwoStagePolicy(robot)
# A step in place has begun; a push of 21 N s forward moves the DCM by 0.1 m (docs/planner.md)
seen = {"com_velocity_x": 0.1 * robot.omega, "dcm_x": 0.1, "dcm_y": 0.0186, "com_y": 0.0186, "swing_y": 0.2,
        "stance_contact": 1.0}  # fmt: skip
plan = planner.plan(np.array([seen.get(name, 0.0) for name in OBSERVATION_NAMES]))
print(f"undisturbed: {plan.nominal.length:.2f} m, {plan.nominal.width:.2f} m, {plan.nominal.duration:.2f} s")
print(f"pushed: {plan.step[0]:.2f} m, {plan.step[1]:.2f} m, {plan.duration:.2f} s")
