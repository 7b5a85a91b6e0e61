"""The bounds that planner, gait machine and whole-body control may meet: their names and their bits."""

from __future__ import annotations

# In the order in which the bounds of one moment are told
BOUNDS = (
    "step_length",  # planned, at its bound
    "step_width",  # planned, at its bound
    "step_time",  # planned T at T_min, or the least that the swing foot needs
    "cop",  # planned, at the edge of where the planner may put it
    "trunk_torque",  # planned acceleration at its bound
    "trunk_angle",  # within 5 % of the largest
    "leg_reach",  # the foothold was moved within reach, or the CoM is asked to its lowest
    "joint_torque",  # a motor gives all it can
    "sole_edge",  # CoP that whole-body control asks for at its bound
    "contact",  # friction, yaw moment or least load at its bound
    "touchdown_error",  # the stance foot landed off its plan, or the swing foot is late
    "dcm_tracking",  # the DCM moved as under another CMP than the planned one
)
(
    STEP_LENGTH, STEP_WIDTH, STEP_TIME, COP_EDGE, TRUNK_TORQUE, TRUNK_LEAN, LEG_REACH, JOINT_TORQUE,
    SOLE_EDGE, CONTACT, TOUCHDOWN_ERROR, DCM_TRACKING,
) = (1 << i for i in range(len(BOUNDS)))  # fmt: skip
LANDED_OFF = 0.03  # a touchdown this far from the planned place counts as an error [m]
LANDED_LATE = 0.03  # or this far from the planned time [s]
