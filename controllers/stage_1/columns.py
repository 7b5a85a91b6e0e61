"""Columns of the arrays of stage 1, by name; of a pair (x, y) the first one."""

from __future__ import annotations

# A packed problem, `StepProblem.pack`
GAIN = 0  # pair, a [m]
STEP_NOMINAL = 2  # pair [m]
TAU_NOMINAL = 4
OFFSET_NOMINAL = 5  # pair [m]
STEP_LOW = 7  # pair [m]
STEP_HIGH = 9  # pair [m]
TAU_LOW = 11
TAU_HIGH = 12
ALPHA_STEP = 13
ALPHA_DURATION = 14
ALPHA_OFFSET = 15
PROBLEM_SIZE = 16

# Its solution, `solve_step_kernel`
SOLVED_STEP = 0  # pair, u [m]
SOLVED_TAU = 2
SOLVED_OFFSET = 3  # pair, b [m]
SOLUTION_SIZE = 5

# A plan, `StepPlanner.plan`; the first seven are the gait variables, by the names of `model/gait_box.py`: of
# stage 1 the CoP is that of the undisturbed step, the trunk acceleration that of the upright law
OFFSET = 7  # pair, b of the plan [m]
NOMINAL = 9  # L, W, T, b_x, b_y of the nominal gait
NOMINAL_OFFSET = 12  # pair, its b [m]
TARGET = 14  # pair, xi_des = u_T + b_nom (eq. 7), with double support + c (u_nom - u_T) [m]
REMAINING = 16  # until the new foot carries load [s], >= 0
HELD = 17  # 1 where the plan is the previous one
DCM_AHEAD = 18  # pair, measured DCM with what the push will still add [m]
SHIFT = 20  # pair, p kappa(t): what the CoP's transfer in double support takes off the DCM [m]
RESULT = 22  # from here on what stage 2 gives, `stage_2/interface.py`: CoP and trunk acceleration, then
DCM_END = 26  # pair, DCM at touchdown; of stage 1 u_T + b [m]
STATUS = 28  # of stage 2's solver
ROW_SIZE = 29
