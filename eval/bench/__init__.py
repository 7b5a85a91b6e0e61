"""Timings on this machine; here the keys of `push-recovery bench --json`, and their meanings."""

KEYS = {
    "raw_physics_rtf": "bare mj_step of one robot along a walk; all rtf are simulated s per wall s",
    "single_env_rtf": "one robot through gym.make, two-stage in the loop",
    "vector_env_rtf": "vector_envs robots on `threads` threads, planner, whole-body control and physics",
    "biped_rtf": "64 robots on one thread, in turn with",
    "humanoid_rtf": "Gymnasium's Humanoid-v5, random actions, no controller, one core, resets not timed",
    "over_humanoid": "biped_rtf / humanoid_rtf",
    "memory_mib_per_robot": "resident memory of one robot among 256 [MiB]",
    "start_s": "from starting Python to an environment that has been reset, kernels on disk [s]",
    "plan_us": "two-stage, one observation a call",
    "stage_1_us": "from the observation to the step plan, one a call",
    "stage_2_us": "CoP and trunk acceleration, one a call",
    "whole_body_us": "gait machine, swing foot and torques in a physics step, one robot",
    "plan_batch_us": "two-stage in a call of 4096 observations, each",
    "stage_1_batch_us": "stage 1 in a call of 4096, each",
    "stage_2_batch_us": "stage 2 in a call of 4096, each",
    "stage_2_daqp_c_us": "what DAQP says that its C code took for the same stage 2 problems, dense",
    "stage_2_daqp_c_mean_us": "the same, mean",
}
GROUPS = {
    "period_us_N_robots_T_threads": "planning period of one robot of N: planner, control, physics; median",
    "rtf_N_robots_T_threads": "simulated s of all N robots per wall s",
    "cost_over_physics_N_robots_T_threads": "that period over bare mujoco.batch of the same states",
    "stage_1_SOLVER_us, stage_2_SOLVER_us": "the dense problem, from Python: daqp, osqp, quadprog, proxqp",
    "stage_2_SOLVER_error_m": "largest difference of its CoP from ours [m]",
    "solvers_missing": "solvers that are not installed",
}
EPILOG = "keys of --json (times in us; {median, p99} where one call was timed many times):\n" + "".join(
    f"  {key}\n      {text}\n" for key, text in (KEYS | GROUPS).items()
)
